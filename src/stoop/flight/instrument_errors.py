"""Instrument errors: what sensors do to a reading, with the priors that every reconstruction of a flight path shares.

A reading is scale times truth plus bias, late by a delay, at the place of the sensor.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from stoop.base.units import DEGREE
from stoop.base.variables import EULER, POSITION, RATES, SPECIFIC_FORCE, VELOCITY

GROUND: Final = frozenset({*VELOCITY, *POSITION})
AIR: Final = frozenset({"V", "airspeed_pitot", "alpha", "beta"})
DELAYED: Final[dict[str, tuple[str, ...]]] = {
    "V": ("V",),
    "airspeed_pitot": ("airspeed_pitot",),
    "alpha": ("alpha",),
    "beta": ("beta",),
    "attitude": EULER,
    "velocity": VELOCITY,
    "position": POSITION,
}  #: name of a delay -> the channels that are late together
RATES_DELAY: Final = "rates.delay"


@dataclass(frozen=True)
class InstrumentError:
    """One error of an instrument, or the steady wind."""

    name: str  #: a parameter of the kinematics, or ``CHANNELS.delay``
    mean: float  #: of the prior, SI
    std: float
    unit: str
    meaning: str
    needs: tuple[frozenset[str], ...]  #: of each set at least one channel must have been logged


def _table() -> Iterable[InstrumentError]:
    error = InstrumentError
    velocity, attitude, forces = (GROUND | AIR,), frozenset(EULER), frozenset(SPECIFIC_FORCE)
    turned = (attitude | GROUND | AIR,)
    for axis in "xyz":
        yield error(f"a{axis}.bias", 0.0, 0.3, "m/s2", f"accelerometer {axis} reads too much by", velocity)
    for axis in "xyz":
        yield error(f"a{axis}.scale", 1.0, 0.02, "1", f"accelerometer {axis}, scale", velocity)
    for name in RATES:
        yield error(f"{name}.bias", 0.0, 0.03, "rad/s", f"gyro {name} reads too much by", turned)
    for name in RATES:
        yield error(f"{name}.scale", 1.0, 0.05, "1", f"gyro {name}, scale", turned)
    for name in ("phi", "theta"):
        needs = (frozenset({name}), attitude, GROUND | AIR)
        yield error(f"{name}.bias", 0.0, 1.0 * DEGREE, "rad", f"{name} reads too much by", needs)
    yield error("psi.bias", 0.0, 5.0 * DEGREE, "rad", "psi reads too much by", (frozenset({"psi"}), GROUND))
    # A wind can be separated from biases only where the motion through the air and that over ground were logged.
    for axis, way in (("n", "north"), ("e", "east")):
        yield error(f"wind.{axis}", 0.0, 10.0, "m/s", f"steady wind, {way}", (GROUND, AIR))
    yield error("wind.d", 0.0, 0.3, "m/s", "steady wind, down", (GROUND, frozenset({"alpha"})))
    for name, scale, bias, unit, factor, sensor in (
        ("V", 0.1, 2.0, "m/s", "V, scale", "V"),
        ("airspeed_pitot", 0.15, 3.0, "m/s", "airspeed_pitot, scale", "airspeed_pitot"),
        ("alpha", 0.2, 3.0 * DEGREE, "rad", "alpha vane, upwash factor", "alpha vane"),
        ("beta", 0.2, 3.0 * DEGREE, "rad", "beta vane, sidewash factor", "beta vane"),
    ):
        yield error(f"{name}.scale", 1.0, scale, "1", factor, (frozenset({name}),))
        yield error(f"{name}.bias", 0.0, bias, unit, f"{sensor} reads too much by", (frozenset({name}),))
    vanes = (frozenset({"alpha", "beta"}),)
    for axis in "xyz":
        place = f"accelerometer's place, {axis}"
        yield error(f"accelerometer.{axis}", 0.0, 0.5, "m", place, (GROUND, forces))
    for axis in "xyz":
        yield error(f"vane.{axis}", 0.0, 1.0, "m", f"vanes' place, {axis}", vanes)
    # Delays are against the accelerometers, or against the gyros where only the attitude was logged.
    gyros = "gyros are late against the accelerometers by"
    yield error(RATES_DELAY, 0.0, 0.03, "s", gyros, (attitude, GROUND | AIR, forces))
    for name, channels in DELAYED.items():
        yield error(f"{name}.delay", 0.0, 0.1, "s", f"{name} is late by", (frozenset(channels),))


INSTRUMENT_ERRORS: Final = tuple(_table())


def instrument_errors(logged: Iterable[str]) -> tuple[InstrumentError, ...]:
    """Return the errors that can be estimated from these channels."""
    there = frozenset(logged)
    return tuple(one for one in INSTRUMENT_ERRORS if all(needed & there for needed in one.needs))


def prior_std(name: str) -> float:
    """Return the prior standard deviation of an instrument error, SI."""
    return next(one.std for one in INSTRUMENT_ERRORS if one.name == name)
