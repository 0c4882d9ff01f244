"""What a compatibility check estimates: each unknown with its prior and the channels that it takes part in."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from stoop.base.units import DEGREE

GROUND: Final = frozenset({"vn", "ve", "vd", "pn", "pe", "pd"})
AIR: Final = frozenset({"V", "airspeed_pitot", "alpha", "beta"})
ATTITUDE: Final = frozenset({"phi", "theta", "psi"})
FORCES: Final = frozenset({"ax", "ay", "az"})


@dataclass(frozen=True)
class Unknown:
    """One number that is not known beforehand.

    Attributes
    ----------
    name : str
        A kernel parameter, or ``CHANNELS.delay``.
    mean, std : float, SI
        The prior.
    unit : str
    meaning : str
        Plain words.
    needs : tuple of frozenset of str
        From each set at least one channel must have been logged, or the unknown is not there.
    """

    name: str
    mean: float
    std: float
    unit: str
    meaning: str
    needs: tuple[frozenset[str], ...]


def _inertial() -> list[Unknown]:
    moved = (GROUND | AIR,)
    rows = [
        Unknown(f"a{axis}.bias", 0.0, 0.3, "m/s2", f"accelerometer {axis} reads too much by", moved)
        for axis in "xyz"
    ]
    rows += [
        Unknown(f"a{axis}.scale", 1.0, 0.02, "1", f"accelerometer {axis}, scale", moved) for axis in "xyz"
    ]
    turned = (ATTITUDE | GROUND | AIR,)
    rows += [Unknown(f"{n}.bias", 0.0, 0.03, "rad/s", f"gyro {n} reads too much by", turned) for n in "pqr"]
    rows += [Unknown(f"{n}.scale", 1.0, 0.05, "1", f"gyro {n}, scale", turned) for n in "pqr"]
    return rows


def _air() -> list[Unknown]:
    rows = []
    for name, scale, bias in (("V", 0.1, 2.0), ("airspeed_pitot", 0.15, 3.0)):
        logged = (frozenset({name}),)
        rows += [
            Unknown(f"{name}.scale", 1.0, scale, "1", f"{name}, scale", logged),
            Unknown(f"{name}.bias", 0.0, bias, "m/s", f"{name} reads too much by", logged),
        ]
    for name, wash in (("alpha", "upwash"), ("beta", "sidewash")):
        logged = (frozenset({name}),)
        rows += [
            Unknown(f"{name}.scale", 1.0, 0.2, "1", f"{name} vane, {wash} factor", logged),
            Unknown(f"{name}.bias", 0.0, 3.0 * DEGREE, "rad", f"{name} vane reads too much by", logged),
        ]
    return rows


def _wind() -> list[Unknown]:
    """Steady wind; it is told apart from biases only where both motions were logged."""
    both = (GROUND, AIR)
    level = [
        Unknown(f"wind.{a}", 0.0, 10.0, "m/s", f"steady wind, {w}", both)
        for a, w in (("n", "north"), ("e", "east"))
    ]
    return [*level, Unknown("wind.d", 0.0, 0.3, "m/s", "steady wind, down", (GROUND, frozenset({"alpha"})))]


def _positions() -> list[Unknown]:
    vanes = (frozenset({"alpha", "beta"}),)
    return [
        *(
            Unknown(f"accelerometer.{a}", 0.0, 0.5, "m", f"accelerometer's place, {a}", (GROUND, FORCES))
            for a in "xyz"
        ),
        *(Unknown(f"vane.{a}", 0.0, 1.0, "m", f"vanes' place, {a}", vanes) for a in "xyz"),
    ]


def _attitude() -> list[Unknown]:
    also = (ATTITUDE, GROUND | AIR)
    return [
        *(
            Unknown(f"{a}.bias", 0.0, 1.0 * DEGREE, "rad", f"{a} reads too much by", (frozenset({a}), *also))
            for a in ("phi", "theta")
        ),
        Unknown("psi.bias", 0.0, 5.0 * DEGREE, "rad", "psi reads too much by", (frozenset({"psi"}), GROUND)),
    ]


DELAYED: Final[dict[str, tuple[str, ...]]] = {
    "V": ("V",),
    "airspeed_pitot": ("airspeed_pitot",),
    "alpha": ("alpha",),
    "beta": ("beta",),
    "attitude": ("phi", "theta", "psi"),
    "velocity": ("vn", "ve", "vd"),
    "position": ("pn", "pe", "pd"),
}  #: name of a delay -> the channels that are late together
RATES_DELAY: Final = "rates.delay"


def _delays() -> list[Unknown]:
    """Delays against the accelerometers, or against the gyros where nothing moves but the attitude."""
    late = [
        Unknown(f"{name}.delay", 0.0, 0.1, "s", f"{name} is late by", (frozenset(channels),))
        for name, channels in DELAYED.items()
    ]
    gyros = Unknown(
        RATES_DELAY,
        0.0,
        0.03,
        "s",
        "gyros are late against the accelerometers by",
        (ATTITUDE, GROUND | AIR, FORCES),
    )
    return [gyros, *late]


UNKNOWNS: Final = (*_inertial(), *_attitude(), *_wind(), *_air(), *_positions(), *_delays())


def unknowns(logged: Iterable[str]) -> tuple[Unknown, ...]:
    """Return the unknowns that a flight with these channels has."""
    there = frozenset(logged)
    return tuple(unknown for unknown in UNKNOWNS if all(needed & there for needed in unknown.needs))
