"""Forecast of a maneuver on rotors: flown by the autopilot, and read in short windows, as it will be fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stoop.errors import SimulationError
from stoop.input_design.information import Forecast, Setup
from stoop.input_design.sensitivity import PIECES, CandidateProblem, VehicleInformation
from stoop.problem import Weights
from stoop.problem.prepare import prepare
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver


def forecast_on_rotors(setup: Setup, maneuver: Maneuver, only_inside: bool) -> Forecast:
    """Return readings and information of a maneuver under the autopilot; as of :meth:`Setup.forecast`."""
    vehicle, count = setup.vehicle, len(maneuver.time)
    nothing = np.zeros_like(setup.known)
    try:
        flight = simulate_flight(vehicle, maneuver, noise=False, name="design")
    except SimulationError:  # it diverges
        return Forecast(np.full((count, len(vehicle.outputs)), np.nan), np.inf, nothing)
    readings = np.column_stack([flight.column(c) for c in vehicle.outputs])
    excess = setup.limits.excess(readings, vehicle.outputs)
    if only_inside and excess > 0.0:
        return Forecast(readings, excess, nothing)
    # without noise a reading that does not change is not stuck
    prepared = prepare(vehicle, {flight.name: flight}, [Window(flight.name, 0.0, maneuver.duration)])
    pieces = tuple(part for piece in prepared.pieces for part in PIECES[vehicle.frame](vehicle, piece))
    problem = CandidateProblem(replace(prepared, pieces=pieces), (len(pieces),))
    unit = setup.layout.unit(setup.values)
    at = VehicleInformation(vehicle, unit, Weights.of(setup.noise), np.inf)
    information = at.information(problem)
    return Forecast(readings, excess, nothing if information is None else information)
