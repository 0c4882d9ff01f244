"""The compiled Runge-Kutta steps against DOP853 at a relative tolerance of 1e-13 (Hairer, Norsett, Wanner); a paper's trim.

Inputs are linear between samples; DOP853 starts anew at their corners, where a method of high order would lose it. The PS-GDE
paper's (14): V0 = 35 m/s, alpha0 = 5.88 deg, elevator -1.7 deg, h0 = 200 m, T0 = 220.87 N. Mass and wing area are not printed;
they follow from (14), whose angles are rounded: 0.005 deg of alpha is 0.08 N of thrust.
"""

import math

import numpy as np
import pytest
from helpers.flown import maneuver
from scipy.integrate import DOP853

from stoop.kernels import Kernel
from stoop.simulation import trim
from stoop.simulation.fly import fly
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle.builtin import builtin_vehicle

PAPER = maneuver(20.0, ("elevator", "3-2-1-1", 1.0, 0.3, 0.2), ("elevator", "doublet", 4.0, 1.5, 0.05),
                 ("aileron", "doublet", 9.0, 0.5, 0.1), ("rudder", "doublet", 12.0, 1.0, 0.1), rate=100.0)  # fmt: skip


def exact(kernel: Kernel, rows: np.ndarray, x: np.ndarray, u: np.ndarray, corner: float) -> np.ndarray:
    def rates(s: float, state: np.ndarray, k: int) -> np.ndarray:
        here = u[k] + (u[min(k + 1, len(u) - 1)] - u[k]) * (s / corner)
        return kernel.evaluate(rows, state[:, None], here[:, None].copy())[0][:, 0]

    out, tight = [], {"rtol": 1e-13, "atol": 1e-13, "first_step": corner}
    for k in range(len(u)):
        out.append(kernel.evaluate(rows, x[:, None], u[k][:, None].copy())[1][:, 0])
        solver = DOP853(lambda s, state, k=k: rates(s, state, k), 0.0, x, corner, **tight)
        while solver.status == "running":
            solver.step()
        x = solver.y
    return np.array(out)


def test_outputs_at_100_hz() -> None:
    twin_boom = builtin_vehicle("twin-boom")
    flown, point = fly(twin_boom, PAPER), trim(twin_boom)
    rows = twin_boom.parameter_rows(point.changes)
    start = twin_boom.initial_states(point.start, rows, flown.inputs[0])
    expected = exact(twin_boom.kernel(), rows, start[:, 0], flown.inputs, 0.01)
    error = np.abs(flown.outputs - expected).max(axis=0) / np.abs(expected).max(axis=0)
    assert error.max() < 1e-6, dict(zip(twin_boom.outputs, error, strict=True))


def test_order_four() -> None:
    """A multisine sampled every 80 ms, and steps that divide those: the corners never fall inside a step."""
    twin_boom, coarse, corners = builtin_vehicle("twin-boom"), 0.08, 51
    t, point = coarse * np.arange(corners), trim(twin_boom)
    u = np.repeat(point.inputs[None, :], corners, axis=0)
    for i, (name, size) in enumerate((("elevator", 0.03), ("aileron", 0.03), ("rudder", 0.05))):
        u[:, twin_boom.inputs.index(name)] += size * (np.sin(2.5 * t + i) + np.sin(4.1 * t))
    rows = twin_boom.parameter_rows(point.changes)
    start = twin_boom.initial_states(point.start, rows, u[0])
    kernel, errors = twin_boom.kernel(), []
    expected = exact(kernel, rows, start[:, 0], u, coarse)
    for parts in (1, 2, 4, 8):
        fine = np.arange((corners - 1) * parts + 1) / parts
        v = np.array([np.interp(fine, np.arange(corners), column) for column in u.T]).T
        y = kernel.trajectories(rows, start, v, coarse / parts)[0, ::parts]
        errors.append(np.abs(y - expected).max(axis=0))
    order = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert order[1:].min() > 3.7
    assert order[1:].max() < 4.4
    assert order[-1] == pytest.approx(np.full(order.shape[1], 4.0), abs=0.2)


@pytest.mark.parametrize("reduce", ["full", "longitudinal"])
def test_trim(reduce: str) -> None:
    point = trim(builtin_vehicle("twin-boom").reduced(reduce), 35.0, 200.0)
    assert math.degrees(point.start["alpha"]) == pytest.approx(5.88, abs=0.005)
    assert math.degrees(point.deflections["elevator"]) == pytest.approx(-1.7, abs=0.05)
    assert point.thrust["propulsion.thrust"] == pytest.approx(220.87, abs=0.08)
    assert point.residual < 1e-12


def test_start_of_a_maneuver_stays_where_it_is() -> None:
    flown = fly(builtin_vehicle("twin-boom"), Maneuver(duration=20.0))
    assert abs(flown.outputs - flown.outputs[0]).max() < 1e-9
