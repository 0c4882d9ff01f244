"""Scenes in Dryden turbulence, as MIL-F-8785C has it at low altitude, with white noise of the sensors."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any, Final

import numpy as np

from stoop.base.units import FOOT, KNOT
from stoop.flight import Flight
from stoop.simulate import Maneuver, simulate_flight
from stoop.vehicle import Vehicle
from stoop.vehicle.schema import Turbulence
from stoop_studies.verify.coverage.scene import (
    Scene,
    aircraft,
    biased,
    coefficients,
    maneuvers,
    misled,
    windows,
)

ALTITUDE: Final = 200.0  #: m
WIND: Final = 30.0 * KNOT  #: m/s at 20 ft: moderate turbulence
BOUNDS: Final = (0.05, 10.0)  #: m/s, of the intensities


@functools.cache
def gusty() -> Vehicle:
    """Return the aircraft in moderate turbulence, the intensities among what is to be found.

    MIL-F-8785C, section 3.7.3.2 (below 1000 ft): L_w = h, L_u = L_v = h / (0.177 + 0.000823 h)^1.2, h and L in ft;
    sigma_w = 0.1 W_20, sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4.
    """
    h = ALTITUDE / FOOT
    share = 0.177 + 0.000823 * h
    level, upward = 0.1 * WIND / share**0.4, 0.1 * WIND
    along = _gust(level, FOOT * h / share**1.2)
    table = Turbulence.model_validate({"u": along, "v": along, "w": _gust(upward, ALTITUDE)})
    calm = aircraft()
    return replace(calm, file=calm.file.model_copy(update={"turbulence": table}))


def _gust(intensity: float, length: float) -> dict[str, Any]:
    return {"intensity": {"value": intensity, "free": True, "bounds": BOUNDS}, "length": length}


def in_dryden_turbulence(seed: int) -> Scene:
    """Return maneuvers through gusts that the seed draws."""
    rng = np.random.default_rng(seed)
    truth = gusty()
    flights = {name: _flown(biased(truth, rng), m, rng, name) for name, m in maneuvers().items()}
    start = misled(truth, rng)
    bounds = {p.name: {"bounds": BOUNDS} for p in start.parameters if p.name.endswith(".intensity")}
    return Scene(start.with_numbers(bounds), flights, windows(), coefficients(truth))


def _flown(vehicle: Vehicle, maneuver: Maneuver, rng: np.random.Generator, name: str) -> Flight:
    return simulate_flight(vehicle, maneuver, seed=int(rng.integers(2**31)), name=name)
