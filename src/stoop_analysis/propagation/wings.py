"""Steady flight on wings of many vehicles at once that differ in their numbers, with the linear models about it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop import Vehicle
from stoop.extend import motion
from stoop.extend.arrays import BoolArray, FloatArray
from stoop.extend.vehicles import full_command, terms

STEP: Final = 1e-4  #: rad, of central differences
LIFT_GRID: Final = 121  #: angles of attack at which a maximum of the lift is looked for


def coefficients(
    vehicle: Vehicle, rows: FloatArray, flow: Mapping[str, FloatArray], deflections: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Return CL, CD and the others (B,) without rotation.

    Parameters
    ----------
    rows : (n_p, B) array
        Kernel parameters.
    flow : mapping
        V, m/s, alpha and, where there is one, beta, rad.
    deflections : mapping
        Of the controls, rad.
    """

    def number(name: str) -> FloatArray:
        return np.asarray(rows[vehicle.rows[name]])

    zero = np.zeros(rows.shape[1])
    still, beta = (zero,) * 3, flow.get("beta", zero)
    known = terms.values(number, vehicle.actual_rates, flow["V"], flow["alpha"], beta, still)
    known |= deflections
    out = {}
    for coefficient, group in vehicle.terms.items():
        total = zero.copy()
        for name, text in group.items():
            tree = terms.parse(text, known, name)
            total = total + number(name) * terms.convert(tree, known)
        out[coefficient] = total
    return out


def pitching_moment(
    vehicle: Vehicle, rows: FloatArray, alpha: FloatArray, c: Mapping[str, FloatArray]
) -> FloatArray:
    """Return the pitching-moment coefficient about the center of gravity (B,)."""
    if "reference.moment_point.x" not in vehicle.rows:
        return c["Cm"]

    def number(name: str) -> FloatArray | float:
        return rows[vehicle.rows[name]] if name in vehicle.rows else 0.0

    arm = {a: number(f"reference.moment_point.{a}") - number(f"mass.center_of_gravity.{a}") for a in "xz"}
    drag = c.get("CD", 0.0)
    forward = c["CL"] * np.sin(alpha) - drag * np.cos(alpha)
    down = -c["CL"] * np.cos(alpha) - drag * np.sin(alpha)
    return np.asarray(c["Cm"] + (arm["z"] * forward - arm["x"] * down) / number("reference.chord"))


def static_margin(
    vehicle: Vehicle, rows: FloatArray, flow: Mapping[str, FloatArray], deflections: Mapping[str, FloatArray]
) -> FloatArray:
    """Return the static margin with fixed controls (B,), in chords: minus the slope of Cm over that of CL."""
    ends = []
    for sign in (1.0, -1.0):
        alpha = flow["alpha"] + sign * STEP
        c = coefficients(vehicle, rows, {**flow, "alpha": alpha}, deflections)
        ends.append((c["CL"], pitching_moment(vehicle, rows, alpha, c)))
    lift, moment = (ends[0][i] - ends[1][i] for i in (0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(-moment / lift)


def lift_maximum(
    vehicle: Vehicle,
    rows: FloatArray,
    flow: Mapping[str, FloatArray],
    deflections: Mapping[str, FloatArray],
    low: float,
    high: float,
) -> FloatArray:
    """Return the angle of attack (B,), rad, of the first maximum of the lift between two; NaN where it rises to the end."""
    grid = np.linspace(low, high, LIFT_GRID)
    lift = np.array(
        [
            coefficients(vehicle, rows, {**flow, "alpha": np.full(rows.shape[1], a)}, deflections)["CL"]
            for a in grid
        ]
    )
    out = np.full(rows.shape[1], np.nan)
    inner = (lift[1:-1] > lift[:-2]) & (lift[1:-1] >= lift[2:])
    lanes = np.flatnonzero(inner.any(axis=0))
    at = inner[:, lanes].argmax(axis=0) + 1
    before, here, after = (lift[at + k, lanes] for k in (-1, 0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):  # vertex of the parabola through three points
        shift = np.nan_to_num(0.5 * (before - after) / (before - 2.0 * here + after))
    out[lanes] = grid[at] + shift * (grid[1] - grid[0])
    return out


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


def level_flight(vehicle: Vehicle, rows: FloatArray, altitude: float, density: float) -> motion.OnWings:
    """Return the equations of level flight in still air, free of sideslip, for kernel parameters (n_p, B)."""
    vehicle = vehicle.reduced("full") if vehicle.reduce == "lateral" else vehicle.coupled_to(())
    return motion.OnWings.still(vehicle, rows, altitude, density)


def steady_flights(
    flight: motion.OnWings, given: Mapping[str, FloatArray], guess: FloatArray | None = None
) -> Steady:
    """Return the steady flights at airspeeds V, m/s, or angles of attack alpha, rad, (B,), from scaled unknowns (m, B)."""
    flight = replace(flight, given=given)
    vehicle, count = flight.at.vehicle, flight.rows.shape[1]
    starts = [np.repeat(x[:, None], count, axis=1) for x in flight.starts()] if guess is None else [guess]
    x, solved = flight.solve(starts[0])
    for other in starts[1:]:
        failed = np.flatnonzero(~solved)
        if failed.size:
            x[:, failed], solved[failed] = flight.solve(other[:, failed], failed)
    found = flight.trims(x)
    start = {n: np.broadcast_to(np.asarray(v), count) for n, v in found.start.items()}
    deflections = {c: vehicle.commanded(c, found.rows, found.inputs) for c in vehicle.controls}
    thrust = {n: np.asarray(v) for n, v in found.thrust.items()}
    with np.errstate(all="ignore"):
        largest = np.max(np.abs([*(start[a] for a in flight.angles), *deflections.values()]), axis=0)
        climb = np.arcsin(np.clip(flight.balance(found)[1], -1.0, 1.0))
        flies = solved & (largest < math.pi / 2.0) & (start["V"] > 0.0)
    lost = np.where(flies, 0.0, np.nan)
    start, deflections, thrust = (
        {n: v + lost for n, v in some.items()} for some in (start, deflections, thrust)
    )
    overpowered = np.zeros(count, dtype=bool)
    for name, value in thrust.items():  # a thrust has no limit in the model
        full = full_command(name) if "propulsion.speed_gain" in vehicle.rows else None
        overpowered |= (value > full) & flies if full is not None else False
    return Steady(start, deflections, thrust, climb + lost, x, given, flies, overpowered)


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


def linear_flights(flight: motion.OnWings, at: Steady) -> Linear:
    """Return A and the accelerations by deflections about steady flights; NaN where there is none."""
    vehicle, lanes = flight.at.vehicle, np.flatnonzero(at.flies)
    found = replace(flight, given=at.given).trims(at.solution[:, lanes], lanes)
    names, A, B, *_ = motion.linear_models(vehicle, found)

    def spread(values: FloatArray) -> FloatArray:
        out = np.full((len(at.flies), *values.shape[1:]), np.nan)
        out[lanes] = values
        return out

    effects = {}
    for i, control in enumerate(vehicle.controls):  # deflections act through their lags, where they have some
        lagged = f"{control}.lag" in names
        effects[control] = A[:, :, names.index(f"{control}.lag")] if lagged else B[:, :, i]
    return Linear(names, spread(A), {c: spread(e) for c, e in effects.items()})
