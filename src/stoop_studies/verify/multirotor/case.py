"""The F450, flown once: what stoop is told, what the instruments read, what is true; and one noisy fit."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.flight import Flight, from_columns
from stoop.vehicle import Vehicle
from stoop.workflow import identify
from stoop_studies.verify.multirotor.bench import motor_curve, truth
from stoop_studies.verify.multirotor.craft import Craft
from stoop_studies.verify.multirotor.flight import DURATION, MOTORS, TURNS, Recording, fly
from stoop_studies.verify.multirotor.vehicle import KNOWN, NOISE, vehicle_of

WORK: Final = "stoop_studies.verify.multirotor.case:work"
WINDOW: Final = f"0:{DURATION:g}"
SPEEDS: Final = "speeds"  #: recorded are the speeds of the rotors
COMMANDS: Final = "commands"  #: recorded are the commands alone


@dataclass(frozen=True, eq=False)
class Case:
    """The vehicle of JSBSim, flown.

    Attributes
    ----------
    recorded : str
        `SPEEDS` or `COMMANDS`.
    vehicle : Vehicle
        Known mass and geometry; all else guessed.
    flown : Recording
        Without noise.
    truth : mapping
        Parameter -> value that JSBSim's own vehicle has.
    """

    recorded: str
    vehicle: Vehicle
    flown: Recording
    truth: Mapping[str, float]

    def flight(self, seed: int, noise: float = 1.0) -> Flight:
        """Return the flight as noisy instruments record it; ``noise`` scales `NOISE`."""
        generator = np.random.default_rng([int(self.recorded == SPEEDS), seed])
        wanted = (*NOISE, "altitude", *(TURNS if self.recorded == SPEEDS else MOTORS))
        columns = {
            channel: values + noise * NOISE.get(channel, 0.0) * generator.standard_normal(len(values))
            for channel, values in ((c, self.flown.columns[c]) for c in wanted)
        }
        return from_columns("f450", self.flown.time, columns, source="JSBSim")


@functools.cache
def case(recorded: str) -> Case:
    """Fly the vehicle, and measure it on the stand.

    Raises
    ------
    StoopError
        JSBSim is not installed, or its data have changed.
    """
    craft, measured = Craft(), Craft()
    flown = fly(craft)
    middle = float(np.mean([flown.columns[c].mean() for c in MOTORS]))
    motor = None if recorded == SPEEDS else motor_curve(measured, middle)
    found = truth(measured, flown, motor)
    return Case(
        recorded,
        vehicle_of(measured, flown, found, motor),
        flown,
        {n: v for n, v in found.items() if n not in KNOWN},
    )


def work(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[Any]:
    """Identify the vehicle from one noisy flight, as a user would.

    Parameters
    ----------
    arguments : mapping
        ``recorded``: `SPEEDS` or `COMMANDS`; ``seed``: of the noise.
    stops : sequence
        One None per result.
    """
    known, seed = case(str(arguments["recorded"])), int(arguments["seed"])
    told = estimates(known, known.flight(seed))
    return [told for _ in stops]


def estimates(known: Case, flight: Flight) -> dict[str, dict[str, float]]:
    """Return truth, estimate and standard error of every parameter."""
    found = identify(known.vehicle, flight, [WINDOW]).identification.result.parameters
    return {
        "truth": dict(known.truth),
        "estimate": {name: found[name].estimate for name in known.truth},
        "sigma": {name: found[name].std_error for name in known.truth},
    }
