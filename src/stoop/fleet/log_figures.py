"""Figures of one flight from its log, each with its standard error: a registry of groups, with what each needs.

What a flight cannot tell is absent, with the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.errors import FlightError, StoopError
from stoop.estimate.regression.least_squares import TimeDomain
from stoop.flight import Flight
from stoop.performance.effectiveness import LIMITS, Balance, block_means, hover_commands
from stoop.reconstruction.compatibility import check
from stoop.vehicle import Vehicle

INSTRUMENTS: Final = {
    **dict.fromkeys(("ax", "ay", "az", "p", "q", "r", "accelerometer", "rates"), "imu"),
    **dict.fromkeys(("V", "airspeed_pitot"), "pitot"), **dict.fromkeys(("alpha", "beta", "vane"), "vanes"),
    **dict.fromkeys(("velocity", "position"), "gps"),
}  # fmt: skip
"""First part of the name of an instrument error -> place of the instrument."""
FEWEST: Final = 30  #: blocks of a second for the resistance of a battery
MOVED: Final = 0.02  #: A, rms of its changes that tells it


@dataclass(frozen=True)
class FlightFigure:
    """A figure of a flight; `part` is the place of the part on which it depends, or empty."""

    name: str
    value: float
    std_error: float
    unit: str
    part: str = ""


@dataclass(frozen=True)
class Group:
    """Figures that come from one evaluation; it raises `StoopError` where the flight cannot tell them."""

    needs: str
    evaluate: Callable[[Flight, Vehicle | None], Iterator[FlightFigure]]


def instruments(flight: Flight, vehicle: Vehicle | None) -> Iterator[FlightFigure]:
    """Yield biases, scales, delays and places of the sensors against each other that the flight determines.

    Their priors are taken off, which would draw every flight towards the same value, and changes towards zero.
    """
    found, _ = check(flight)
    for name, one in found.findings.items():
        which = name.partition(".")[0]
        own, prior = one.std_error**-2.0, one.prior_std**-2.0
        if one.identifiable and which != "wind" and own > prior:
            value = (own * one.estimate - prior * one.prior_mean) / (own - prior)
            yield FlightFigure(name, value, (own - prior) ** -0.5, one.unit, INSTRUMENTS.get(which, ""))


def rotors(flight: Flight, vehicle: Vehicle | None) -> Iterator[FlightFigure]:
    """Yield the commanded lift near hover, and the thrust of each rotor over the mean of all."""
    if vehicle is None or not vehicle.rotors:
        raise FlightError("no vehicle with rotors was given")
    balance = Balance(vehicle)
    thrust, torque, _ = hover_commands(flight, balance)
    lift = (balance.of_thrust @ thrust + balance.of_torque @ torque)[:1]
    blocks = block_means(np.vstack([lift, thrust / thrust.mean(axis=0)]), flight.rate)
    errors = blocks.std(axis=1, ddof=1) / np.sqrt(blocks.shape[1])
    yield FlightFigure("hover.lift", float(lift.mean()), float(errors[0]), "N")
    for name, share, error in zip(vehicle.rotors, blocks[1:].mean(axis=1), errors[1:], strict=True):
        yield FlightFigure(f"share.{name}", float(share), float(error), "1", name)


def battery(flight: Flight, vehicle: Vehicle | None) -> Iterator[FlightFigure]:
    """Yield the resistance of the battery: changes of the voltage over changes of the current from second to second.

    What the charge does to the voltage is slow, and hardly counts so.
    """
    if lost := [name for name in ("voltage", "current") if name not in flight]:
        raise FlightError(f"{' and '.join(lost)} not recorded")
    read = np.array([flight.column("voltage"), flight.column("current")])
    steps = np.diff(block_means(read[:, np.isfinite(read).all(axis=0)], flight.rate))
    if steps.shape[1] < FEWEST:
        raise FlightError(f"voltage and current of more than {FEWEST} s are needed")
    voltage, current = steps - steps.mean(axis=1, keepdims=True)
    if np.sqrt(np.mean(current**2)) < MOVED:
        raise FlightError("the current hardly changed")
    slope = float(current @ voltage / (current @ current))
    scatter = TimeDomain().scatter(current[:, None], voltage - slope * current, LIMITS.block)[0, 0]
    yield FlightFigure(
        "battery.resistance", -slope, float(np.sqrt(scatter)) / float(current @ current), "ohm", "battery"
    )


GROUPS: Final[Mapping[str, Group]] = {
    "instruments": Group("attitude, rates and a velocity", instruments),
    "rotors": Group("commands of all motors, and a vehicle with rotors", rotors),
    "battery": Group("voltage and current", battery),
}  # fmt: skip


def figures_of(flight: Flight, vehicle: Vehicle | None = None) -> tuple[list[FlightFigure], dict[str, str]]:
    """Return the figures of a flight, and for each group that it cannot tell the reason."""
    found: list[FlightFigure] = []
    absent: dict[str, str] = {}
    for name, group in GROUPS.items():
        try:
            own = list(group.evaluate(flight, vehicle))
        except StoopError as error:
            absent[name] = str(error).splitlines()[0]
            continue
        known = [one for one in own if np.isfinite(one.value) and one.std_error > 0.0]
        found += known
        if not known:
            absent[name] = f"needs {group.needs}"
    return found, absent
