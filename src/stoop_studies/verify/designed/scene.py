"""What is designed, flown and identified: one aircraft, two inputs of the same duration and amplitude."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.design import Knowledge, Limits, Setup, design
from stoop.design.search import Plan, one_after_another
from stoop.design.setup import sensor_noise
from stoop.estimate.fit import Options, fit
from stoop.problem.windows import Window
from stoop.simulate import Maneuver, simulate_flight, trim
from stoop.vehicle import Vehicle
from stoop_studies.verify.coverage.scene import aircraft

PLAN: Final = Plan(duration=20.0, rate=50.0, evaluations=2000, seed=0)
FAMILY: Final = "square"
WIDE: Final = 8.0  #: predicted standard errors of the textbook's flight: no estimate may meet a bound
INPUTS: Final = ("textbook", "designed")


@functools.cache
def setup() -> Setup:
    """Return the aircraft in steady flight; nothing is known of its coefficients."""
    vehicle = aircraft()
    point = trim(vehicle)
    return Setup(vehicle, point, Limits.about(vehicle, point), Knowledge.none(), sensor_noise(vehicle))


@functools.cache
def maneuvers() -> Mapping[str, Maneuver]:
    """Return both inputs; the designed one is searched once in each process."""
    return dict(
        zip(INPUTS, (one_after_another(setup(), PLAN), design(setup(), PLAN, FAMILY).maneuver), strict=True)
    )


def predicted(name: str) -> FloatArray:
    """Return the standard errors (D,) that are predicted for an input, SI."""
    return setup().std(setup().forecast(maneuvers()[name]))


@functools.cache
def searched() -> Vehicle:
    """Return the vehicle to identify: boxes so wide that no estimate meets a bound."""
    room = WIDE * predicted("textbook")
    boxes = {
        name: {"bounds": (float(value - r), float(value + r))}
        for name, value, r in zip(setup().names, setup().values, room, strict=True)
    }
    return setup().vehicle.with_numbers(boxes)


def identify(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[dict[str, Any]]:
    """Return the errors of one flight's estimates; see `stoop.parallel.Run`.

    Parameters
    ----------
    arguments : mapping
        ``input``, one of :data:`INPUTS`, and ``seed``, of the noise.
    stops : sequence
        One: nothing is shared.
    """
    seed = int(arguments["seed"])
    flight = simulate_flight(searched(), maneuvers()[arguments["input"]], seed, name="flown")
    window = Window("flown", 0.0, PLAN.duration)
    done = fit(searched(), {"flown": flight}, [window], replace(Options(), seed=seed))
    errors = np.array([done.estimates[name] for name in setup().names]) - setup().values
    return [{"errors": errors.tolist(), "status": done.outcome.status} for _ in stops]
