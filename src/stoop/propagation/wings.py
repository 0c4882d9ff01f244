"""Steady flight on wings of many vehicles at once that differ in their numbers, with the linear models about it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.simulation.initial import commanded
from stoop.simulation.linearize import linear_models
from stoop.simulation.newton import solve
from stoop.simulation.steady_flight import TOLERANCE, WING_ANGLES, Conditions, OnWings
from stoop.simulation.trim import neutral_inputs
from stoop.vehicle import Vehicle
from stoop.vehicle.defaults import full_command


@dataclass(frozen=True, eq=False)
class Steady:
    """Steady flights, one a lane; NaN where there is none."""

    start: Mapping[str, FloatArray]  #: V, alpha, ... (B,), m/s, rad, m
    deflections: Mapping[str, FloatArray]  #: of the controls, rad
    thrust: Mapping[str, FloatArray]  #: number or channel that holds the speed, N or its unit
    climb: FloatArray  #: flight-path angle (B,), rad
    solution: FloatArray  #: scaled unknowns (m, B)
    given: Mapping[str, FloatArray]  #: the airspeed, or the angle of attack
    flies: BoolArray  #: (B,)
    overpowered: BoolArray  #: (B,), the throttle would have to be above full


def level_flight(vehicle: Vehicle, rows: FloatArray, altitude: float, density: float) -> OnWings:
    """Return the equations of level flight in still air, free of sideslip, for kernel parameters (n_p, B)."""
    vehicle = vehicle.reduced("full") if vehicle.reduce == "lateral" else vehicle.coupled_to(())
    quiet, still = neutral_inputs(vehicle, density, altitude), np.zeros(3)
    at = Conditions(vehicle, math.nan, altitude, 0.0, still, still, 0.0, quiet)
    return OnWings(at, {}, rows, WING_ANGLES[vehicle.reduce][0], powered=vehicle.file.propulsion is not None)


def steady_flights(
    flight: OnWings, given: Mapping[str, FloatArray], guess: FloatArray | None = None
) -> Steady:
    """Return the steady flights at airspeeds V, m/s, or angles of attack alpha, rad, (B,), from scaled unknowns (m, B)."""
    flight = replace(flight, given=given)
    vehicle, count = flight.at.vehicle, flight.rows.shape[1]
    starts = [np.repeat(x[:, None], count, axis=1) for x in flight.starts()] if guess is None else [guess]
    x, error = solve(flight.residuals, starts[0], TOLERANCE)
    for other in starts[1:]:
        failed = np.flatnonzero(error >= TOLERANCE)
        if failed.size:
            again = lambda y, lanes, failed=failed: flight.residuals(y, failed[lanes])  # noqa: E731
            x[:, failed], error[failed] = solve(again, other[:, failed], TOLERANCE)
    found = flight.trims(x)
    start = {n: np.broadcast_to(np.asarray(v), count) for n, v in found.start.items()}
    deflections = {c: commanded(vehicle, c, found.rows, found.inputs) for c in vehicle.controls}
    thrust = {n: np.asarray(v) for n, v in found.thrust.items()}
    with np.errstate(all="ignore"):
        largest = np.max(np.abs([*(start[a] for a in flight.angles), *deflections.values()]), axis=0)
        climb = np.arcsin(np.clip(flight.balance(found)[1], -1.0, 1.0))
        flies = (error < TOLERANCE) & (largest < math.pi / 2.0) & (start["V"] > 0.0)
    lost = np.where(flies, 0.0, np.nan)
    start, deflections, thrust = (
        {n: v + lost for n, v in some.items()} for some in (start, deflections, thrust)
    )
    overpowered = _beyond_power(vehicle, thrust, count) & flies
    return Steady(start, deflections, thrust, climb + lost, x, given, flies, overpowered)


def _beyond_power(vehicle: Vehicle, thrust: Mapping[str, FloatArray], count: int) -> BoolArray:
    """Tell whether a throttle would have to be above full (B,); a thrust has no limit in the model."""
    out = np.zeros(count, dtype=bool)
    for name, value in thrust.items():
        full = full_command(name) if "propulsion.speed_gain" in vehicle.rows else None
        if full is not None:
            out |= value > full
    return out


@dataclass(frozen=True, eq=False)
class Linear:
    """Linear models, one a lane."""

    names: tuple[str, ...]  #: of the n states, as of :func:`stoop.linearize`
    A: FloatArray  #: (B, n, n)
    effects: Mapping[str, FloatArray]  #: (B, n), rates of the states per radian of each control

    def steady_rate(self, state: str, control: str) -> FloatArray:
        """Return the rate of one axis (B,) per radian that a control holds when its own damping alone balances it."""
        i = self.names.index(state)
        return np.asarray(-self.effects[control][:, i] / self.A[:, i, i])


def linear_flights(flight: OnWings, at: Steady) -> Linear:
    """Return A and the accelerations by deflections about steady flights; NaN where there is none."""
    vehicle, lanes = flight.at.vehicle, np.flatnonzero(at.flies)
    found = replace(flight, given=at.given).trims(at.solution[:, lanes], lanes)
    names, A, B, *_ = linear_models(vehicle, found)

    def spread(values: FloatArray) -> FloatArray:
        out = np.full((len(at.flies), *values.shape[1:]), np.nan)
        out[lanes] = values
        return out

    effects = {}
    for i, control in enumerate(vehicle.controls):  # deflections act through their lags, where they have some
        lagged = f"{control}.lag" in names
        effects[control] = A[:, :, names.index(f"{control}.lag")] if lagged else B[:, :, i]
    return Linear(names, spread(A), {c: spread(e) for c, e in effects.items()})
