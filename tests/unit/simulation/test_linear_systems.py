"""Linear models as objects of python-control and SciPy: the same responses, delays included."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lsim

from stoop.errors import SimulationError
from stoop.simulation import LinearModel, linearize, trim
from stoop.simulation.linear_systems import pade
from stoop.vehicle.builtin import builtin_vehicle

FREQUENCIES = np.array([0.3, 1.0, 3.0, 8.0])


@pytest.fixture(scope="module")
def model() -> LinearModel:
    vehicle = builtin_vehicle("twin-boom")
    return linearize(vehicle, trim(vehicle))


@pytest.fixture(scope="module")
def late(model: LinearModel) -> LinearModel:
    return replace(
        model, input_delays=np.array([0.1, 0.0, 0.05]), output_delays=np.full(len(model.outputs), 0.02)
    )


def transfer(of: Any) -> np.ndarray:
    """Return the outputs (n_w, n_y, n_u) of matrices for unit inputs."""
    one = np.eye(len(of.A))
    return np.array([of.C @ np.linalg.solve(1j * w * one - of.A, of.B) + of.D for w in FREQUENCIES])


def response(model: LinearModel) -> np.ndarray:
    """Return the same with exact delays."""
    s = 1j * FREQUENCIES
    ahead, after = np.exp(-s[:, None] * model.input_delays), np.exp(-s[:, None] * model.output_delays)
    return np.asarray(after[:, :, None] * transfer(model) * ahead[:, None, :])


def test_scipy_simulates_the_matrices(model: LinearModel) -> None:
    """A step of the elevator, by the matrix exponential."""
    system, time = model.to_scipy(), np.linspace(0.0, 1.0, 11)
    inputs = np.zeros((11, 3))
    inputs[:, model.inputs.index("elevator")] = 0.01
    _, out, _ = lsim(system, inputs, time)
    n = len(model.A)
    whole = np.zeros((n + 3, n + 3))
    whole[:n, :n], whole[:n, n:] = model.A, model.B
    state = expm(whole)[:n, n:] @ inputs[0]  # after one second
    assert out[-1] == pytest.approx(model.C @ state + model.D @ inputs[0], rel=1e-8, abs=1e-10)


def test_delays_are_in_series(late: LinearModel) -> None:
    ours = response(late)
    assert transfer(late.to_scipy(4)) == pytest.approx(ours, rel=1e-5, abs=1e-7 * np.abs(ours).max())
    with pytest.raises(SimulationError, match=r"delays of up to 0.1 s: give pade=N"):
        late.to_scipy()
    assert late.to_scipy(pade=0).A.shape == late.A.shape


def test_control_has_the_names_and_the_responses(late: LinearModel) -> None:
    system = late.to_control(pade=4)
    assert system.input_labels == list(late.inputs)
    assert system.output_labels == list(late.outputs)
    assert [n for n in system.state_labels if "delay" not in n] == list(late.states)
    ours = response(late)
    theirs = np.array([system(1j * w) for w in FREQUENCIES])
    assert theirs == pytest.approx(ours, rel=1e-5, abs=1e-7 * np.abs(ours).max())


def test_the_approximation_is_that_of_python_control() -> None:
    A, B, C, D = pade(0.2, 3)
    ours = control.StateSpace(A, B, C, D)
    theirs = control.TransferFunction(*control.pade(0.2, 3))
    for w in FREQUENCIES:
        assert ours(1j * w) == pytest.approx(theirs(1j * w), rel=1e-9)
        assert abs(ours(1j * w)) == pytest.approx(1.0, rel=1e-9)
