"""The page on multirotors: its figures are those of the built-in vehicles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from naive.interpreted import Evaluate, interpreted

from docs.pages import DOCS, table
from stoop.simulation import initial_states, parameter_rows
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import BUILT_IN, builtin_vehicle
from stoop.vehicle.defaults import hover_command, share_of_weight
from stoop.vehicle.vehicle import leaves

PAGE = DOCS / "multirotor.md"


def hover(vehicle: Vehicle) -> float:
    numbers = dict(leaves(vehicle.file))
    return hover_command(numbers, share_of_weight(numbers)) or math.nan


def motion(vehicle: Vehicle, evaluate: Evaluate, inputs: np.ndarray, **start: float) -> dict[str, float]:
    """Return rates of the states (``r'``) and readings (``az``) by name."""
    rows = parameter_rows(vehicle)
    d, y = evaluate(rows, initial_states(vehicle, {"u": 0.0, **start}, rows, inputs), inputs[:, None])
    rates = {f"{s}'": float(v) for s, v in zip(vehicle.states, d[:, 0], strict=True)}
    return rates | dict(zip(vehicle.outputs, y[:, 0].tolist(), strict=True))


def test_effect_of_the_parameters() -> None:
    said = dict(
        zip(table(PAGE, "Effect of the parameters", "parameter").column("parameter"), _last(), strict=True)
    )
    quad = builtin_vehicle("quad-x")
    evaluate, x = interpreted(quad), hover(quad)
    u = np.full(4, x)
    still = motion(quad, evaluate, u)["az"]
    assert still == pytest.approx(-9.80665, rel=1e-6)
    calm = quad.with_numbers({f"body_drag.quadratic.{a}": {"value": 0.0} for a in "xyz"})
    climbing = motion(calm, evaluate, u, w=-3.0)["az"]
    by_rotors, by_both = (
        math.degrees(math.asin(-motion(v, evaluate, u, u=10.0)["ax"] / 9.80665)) for v in (calm, quad)
    )
    yaw = motion(quad, evaluate, u + 0.1 * np.array([1, 1, -1, -1]))["r'"]
    assert said == {
        "`T1`, `T2`": f"{x:.3f}",
        "inflow": f"{100.0 * (1.0 - climbing / still):.1f} %",
        "drag": f"{by_rotors:.1f} deg",
        "quadratic": f"{by_both - by_rotors:.1f} deg",
        "torque_ratio": f"{yaw:.2f} rad/s2",
        "lag": f"{1.0 / (2.0 * math.pi * quad.value('rotors.lag')):.1f} Hz",
    }


def _last() -> list[str]:
    return [row[-1] for row in table(PAGE, "Effect of the parameters", "parameter").rows]


def test_templates() -> None:
    rows = table(PAGE, "Templates", "name").rows
    assert [row[0] for row in rows] == [name for name in BUILT_IN if builtin_vehicle(name).rotors]
    for name, rotors, mass, x, _ in rows:
        vehicle = builtin_vehicle(name)
        assert (len(vehicle.rotors), vehicle.value("mass.mass")) == (int(rotors), float(mass))
        assert f"{hover(vehicle):.2f}" == x
