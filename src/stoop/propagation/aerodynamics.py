"""Aerodynamic coefficients of many vehicles at once, from the terms of their file, and what follows from their slopes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.vehicle import Vehicle, terms

STEP: Final = 1e-4  #: rad, of central differences
LIFT_GRID: Final = 121  #: angles of attack at which a maximum of the lift is looked for


def coefficients(
    vehicle: Vehicle,
    rows: FloatArray,
    flow: Mapping[str, FloatArray],
    deflections: Mapping[str, FloatArray],
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
    vehicle: Vehicle,
    rows: FloatArray,
    flow: Mapping[str, FloatArray],
    deflections: Mapping[str, FloatArray],
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
