"""Margins of the gains that flew: of every axis, at airspeeds, at the estimates and over draws of the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.control_laws.rate_law import AXES
from stoop.errors import StoopError
from stoop.simulation.delays import input_delays
from stoop.simulation.linearize import linear_models
from stoop.simulation.steady_flight import neighbors
from stoop.simulation.trim import Trim
from stoop.tuning.loops import (
    AxisLoop,
    Plants,
    frequencies,
    motion,
    opened,
    return_difference,
    stable,
)
from stoop.tuning.margins import Margins, margins
from stoop.vehicle import Vehicle

COMMANDS: Final = tuple(f"control_{axis}" for axis in AXES)


@dataclass(frozen=True, eq=False)
class AxisMargins:
    """Margins about one axis at one airspeed: first at the estimates, then of draws of the model (1 + d,)."""

    axis: str
    airspeed: float  #: m/s; zero in a hover
    margins: Margins
    stable: float  #: share of the draws whose loops are stable together


def plants_of(vehicle: Vehicle, point: Trim, names: Sequence[str], values: FloatArray) -> Plants:
    """Return the linear models about a trim at the estimates, then at draws (d, k) of the numbers in `names`.

    Commands are the normalized ones of the autopilot, through the gains of the surfaces that they move.

    Raises
    ------
    StoopError
        The surfaces do not move by commands about the axes.
    """
    kept = [i for i, n in enumerate(names) if n in vehicle.rows or n.endswith(".delay")]
    numbers = {names[i]: np.concatenate([[vehicle.value(names[i])], values[:, i]]) for i in kept}
    points = neighbors(point)(numbers)
    states, A, B, *_ = linear_models(vehicle, points)
    used = [c for c in COMMANDS if c in vehicle.inputs]
    if not used:
        raise StoopError(
            f"tune: no surface of {vehicle.name} moves by {', '.join(COMMANDS)}: identify the model with the autopilot's "
            "commands about the axes as inputs of its surfaces"
        )
    gains = np.array([
        [vehicle.value(f"controls.{control}.mix.{c}", 0.0) for c in used] for control in vehicle.controls
    ])  # fmt: skip
    late = {vehicle.inputs[column]: points.rows[row] for column, row in input_delays(vehicle)}
    still = np.zeros(points.rows.shape[1])
    turning = [i for i, name in enumerate(states) if name not in ("psi", "h")]
    return Plants(
        tuple(states[i] for i in turning),
        A[:, turning][:, :, turning],
        B[:, turning, : len(gains)] @ gains,
        np.column_stack([late.get(c, still) for c in used]),
    )


def judge(plants: Plants, loops: Mapping[str, AxisLoop], airspeed: float) -> list[AxisMargins]:
    """Return the margins of loops by axis around models; the commands of `plants` are those about the axes of `loops`."""
    own = list(loops.values())
    frequency = frequencies(own)
    difference = return_difference(motion(plants, frequency), own, frequency)
    holds = stable(plants, own)
    if not holds[0]:
        raise StoopError(
            f"tune: at {airspeed:.4g} m/s the loops of {', '.join(loops)} are unstable with these gains around this model, which "
            "flew: model, gains or delays are not those of the flight"
        )
    return [
        AxisMargins(
            axis, airspeed, margins(frequency, loop), float(np.mean(holds[1:])) if len(holds) > 1 else 1.0
        )
        for axis, loop in zip(loops, opened(difference), strict=True)
    ]
