"""The table of turbulence: what it adds to the equations, and that nothing changes without it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import load_vehicle

TABLE = """
[turbulence]
u = { intensity = 1.5, length = 200.0 }
v = { intensity = { value = 1.0, free = true, bounds = [0.1, 3.0] }, length = 100.0 }
w = { intensity = "=turbulence.v.intensity", length = "=turbulence.v.length" }
"""


def test_states_and_noise_are_added_at_the_end_and_an_intensity_can_be_tied(twin_boom: str) -> None:
    calm, gusty = parse_vehicle(twin_boom, "calm"), parse_vehicle(twin_boom + TABLE, "gusty")
    added = ("gust.u", "gust.v.fast", "gust.v.slow", "gust.w.fast", "gust.w.slow")
    assert gusty.states == (*calm.states, *added)
    assert gusty.inputs == (*calm.inputs, "gust.u.noise", "gust.v.noise", "gust.w.noise")
    assert gusty.recorded == calm.recorded == calm.inputs
    assert gusty.rows["turbulence.w.intensity"] == gusty.rows["turbulence.v.intensity"]
    assert gusty.parameters[gusty.rows["turbulence.v.intensity"]].unit == "m/s"
    alone = parse_vehicle(twin_boom + "[turbulence]\n" + TABLE.splitlines()[3], "alone")
    for vehicle, gusts, free in (
        (gusty.reduced("longitudinal"), ("u", "w"), True),  # w is tied to v
        (gusty.reduced("lateral"), ("v",), True),
        (alone.reduced("longitudinal"), (), False),
    ):
        told = [p.name for p in vehicle.parameters if p.free and p.name.startswith("turbulence")]
        assert (vehicle.gusts, told) == (gusts, ["turbulence.v.intensity"] * free)


def test_a_gust_is_felt_as_the_opposite_motion(twin_boom: str) -> None:
    """In still air the equations are those without gusts; air that moves down is a body that moves up."""
    calm, gusty = parse_vehicle(twin_boom, "calm"), parse_vehicle(twin_boom + TABLE, "gusty")
    start = {"V": 33.0, "alpha": 0.05, "beta": 0.02, "p": 0.1, "q": 0.2, "theta": 0.1, "h": 200.0}
    u = np.array([0.1, 0.02, 0.03, 0.0, 0.0, 0.0])
    rows, at = gusty.parameter_rows(), {name: i for i, name in enumerate(gusty.states)}
    x = np.repeat(gusty.initial_states(start, rows, u), 3, axis=1)
    x[at["w"], 0] -= 0.7
    x[at["gust.w.fast"], 1] = 0.7 / np.sqrt(3.0)
    rates, readings = gusty.kernel().evaluate(np.repeat(rows, 3, axis=1), x, np.tile(u[:, None], 3))
    assert np.allclose(readings[:, 0], readings[:, 1], rtol=1e-12, atol=1e-12)
    rows = calm.parameter_rows()
    still = calm.kernel().evaluate(rows, calm.initial_states(start, rows, u[:3]), u[:3, None])
    assert np.allclose(rates[: len(calm.states), 2:], still[0], rtol=1e-13, atol=1e-13)
    assert np.allclose(readings[:, 2:], still[1], rtol=1e-13, atol=1e-13)


def test_a_gust_does_not_turn_with_what_hovers() -> None:
    """At rest in air that moves by (1, -0.7, 0.4) m/s north, east, down is the opposite motion through calm air."""
    text = load_vehicle("quad-x").text + TABLE.replace("]", "]\nairspeed = 5.0", 1)
    gusty = parse_vehicle(text, "gusty")
    blown, turned = np.array([1.0, -0.7, 0.4]), {"phi": 0.3, "theta": -0.2, "psi": 1.9}
    through_air = Rotation.from_euler("ZYX", [1.9, -0.2, 0.3]).inv().apply(-blown)
    rows, u = gusty.parameter_rows(), np.array([0.6, 0.55, 0.6, 0.62, 0.0, 0.0, 0.0])
    still = gusty.initial_states({"h": 50.0, **turned}, rows, u)
    start = {"h": 50.0, **turned, **dict(zip("uvw", through_air, strict=True))}
    moving = gusty.initial_states(start, rows, u)
    at = {name: i for i, name in enumerate(gusty.states)}
    for axis, value in zip("uvw", blown, strict=True):
        still[[i for name, i in at.items() if name.startswith(f"gust.{axis}")]] = value
    both = np.concatenate([still, moving], axis=1)
    rates, readings = gusty.kernel().evaluate(np.repeat(rows, 2, axis=1), both, np.tile(u[:, None], 2))
    felt = [gusty.outputs.index(c) for c in ("ax", "ay", "az")]
    assert readings[felt, 0] == pytest.approx(readings[felt, 1], abs=1e-12)
    assert rates[[at[r] for r in "pqr"], 0] == pytest.approx(rates[[at[r] for r in "pqr"], 1], abs=1e-12)
