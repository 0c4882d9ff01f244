"""Two groups of lanes where equations are one long chain, one where they keep the processor busy."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.kernels.balance import groups
from stoop.kernels.emit import emit
from stoop.kernels.lanes import header
from stoop.simulation import initial_states, parameter_rows
from stoop.vehicle.builtin import resolve_vehicle
from stoop.vehicle.symbolic import build_model

STEPS = 24


def function(*lines: str) -> str:
    return "\n    ".join(["def derive(x, u, c):", *lines]) + "\n"


def chain(step: str) -> str:
    lines = ["t0 = x[0]", *(f"t{i + 1} = {step.format(t=f't{i}')}" for i in range(STEPS))]
    return function(*lines, f"return (t{STEPS}, )")


def beside(step: str) -> str:
    return function("t = x[0]", f"return ({''.join(step.format(t='t') + ', ' for _ in range(STEPS))})")


@pytest.mark.parametrize("step", ["{t} * 2.0", "1.0 / {t}", "sqrt({t} + 1.0)", "atan2({t}, 1.0)"])
def test_a_chain_takes_two(step: str) -> None:
    assert groups(chain(step), "derive") == 2


@pytest.mark.parametrize("step", ["{t} * 2.0", "1.0 / {t}", "sqrt({t} + 1.0)", "atan2({t}, 1.0)"])
def test_the_same_side_by_side_takes_one(step: str) -> None:
    assert groups(beside(step), "derive") == 1


def test_four_chains_fill_half_of_a_core() -> None:
    sums = [" + ".join(["x[0]"] * STEPS)] * 5
    assert groups(function(f"return ({sums[0]}, )"), "derive") == 2
    assert groups(function(f"return ({', '.join(sums[:3])}, )"), "derive") == 2
    assert groups(function(f"return ({', '.join(sums)}, )"), "derive") == 1


@pytest.mark.parametrize(("reduced", "expected"), [("longitudinal", 2), ("full", 1)])
def test_the_built_in_aircraft(reduced: str, expected: int) -> None:
    """What was measured for these two is in the module."""
    aircraft = resolve_vehicle("twin-boom")
    model = build_model(aircraft if reduced == "full" else aircraft.reduced(reduced))
    assert emit(model).groups == expected
    assert ("reassoc" in header(emit(model))) == (expected == 1), "the sums of two groups keep their order"


@pytest.mark.parametrize("reduced", ["longitudinal", "lateral", "full"])
def test_a_candidate_costs_the_same_in_every_lane(reduced: str) -> None:
    """On real equations: with reordered sums the two groups of the longitudinal model differ in the last place."""
    aircraft = resolve_vehicle("twin-boom")
    vehicle = aircraft if reduced == "full" else aircraft.reduced(reduced)
    kernel, rng, count = vehicle.kernel(), np.random.default_rng(3), 37
    rows = parameter_rows(vehicle, None, count) * rng.uniform(0.9, 1.1, (len(vehicle.values), count))
    u = 0.02 * rng.standard_normal((300, len(vehicle.inputs)))
    x = initial_states(vehicle, {"V": rng.uniform(28.0, 40.0, count), "alpha": 0.05, "h": 100.0}, rows, u[0])
    z, w = np.ones((2, 300, len(vehicle.outputs)))
    J, y = kernel.cost(rows, x, u, z, w, 0.02), kernel.trajectories(rows, x, u, 0.02)
    assert np.isfinite(J).all()
    for shift in (1, 8, 13):
        order = np.roll(np.arange(count), shift)
        assert np.array_equal(kernel.cost(rows[:, order], x[:, order], u, z, w, 0.02), J[order])
        assert np.array_equal(kernel.trajectories(rows[:, order], x[:, order], u, 0.02), y[order])
