"""The demonstration: the longitudinal problem of the PS-GDE paper, simulated and identified from wrong values."""

from __future__ import annotations

import json
from typing import Any, Final

import numpy as np

from stoop.estimate.fit import Options
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.identification import finish, search

NAME: Final = "demo"  #: of the flight
TABLE_1: Final = (
    "CD0", "CDalpha", "CL0", "CLalpha", "CLq", "CLelevator", "Cm0", "Cmalpha", "Cmq", "Cmelevator",
)  # fmt: skip
"""The coefficients that the paper identifies, in its order; their truths stand in the vehicle file."""

MANEUVER: Final = """
duration = 30.0
rate = 50.0
[[input]]
control = "elevator"
shape = "3-2-1-1"
start = 1.0
step = 0.3
amplitude = 0.2
[[input]]
control = "elevator"
shape = "pulse"
start = 7.0
duration = 3.0
amplitude = -0.1
"""
"""The paper's Fig. 3: 3-2-1-1 of 0.3 s and 11.46 deg, a pulse of 3 s, then about half a phugoid."""


def identify_demo(seed: int) -> tuple[FittedModel, dict[str, float]]:
    """Return the fitted model and the truth."""
    vehicle = load_vehicle("twin-boom").reduced("longitudinal")
    flight = simulate_flight(vehicle, parse_maneuver(MANEUVER, NAME), seed, name=NAME)
    truth = {k: v for k, v in json.loads(flight.attributes["truth"]).items() if k in TABLE_1}
    options = Options(seed=seed)
    model = finish(search(misled(vehicle, seed), flight, ["0:30"], options=options, command="stoop demo"))
    return model, truth


def misled(vehicle: Vehicle, seed: int) -> Vehicle:
    """Return the vehicle with wrong starting values and only Table 1's ten coefficients free."""
    factors = zip(TABLE_1, np.random.default_rng(seed).uniform(0.4, 1.6, len(TABLE_1)), strict=True)
    changes: dict[str, dict[str, Any]] = {n: {"value": vehicle.value(n) * f} for n, f in factors}
    others = [p.name for p in vehicle.parameters if p.free and not p.name.startswith("sensors.")]
    changes |= {name: {"free": False} for name in others if name not in TABLE_1}
    return vehicle.with_numbers(changes)
