"""The compiled filter against a plain one, on a linear system whose transition is known."""

import numpy as np
import pytest
import sympy as sp
from naive.kalman import kalman

from stoop.kernels import Kernel, SymbolicModel, filtering, load_kernel

DT = 0.02
H = np.array([[1.0, 0.0, 0.0], [0.3, 1.0, -0.5]])
Q, R, P = np.diag([1e-4, 2e-4, 3e-4]), np.array([0.04, 0.09]), 0.1 * np.eye(3)


def swing() -> SymbolicModel:
    """A damped oscillator that filtered noise drives; the second reading is an angle."""
    x = sp.symbols("a b c", real=True)
    d = sp.symbols("da db dc", real=True)
    u, p = sp.Symbol("n", real=True), sp.Symbol("stiffness", real=True)
    rates = (x[1], -p * x[0] - 0.6 * x[1] + 2 * x[2], -1.5 * x[2] + u)
    outputs, moved = (x[0], 0.3 * x[0] + x[1] - 0.5 * x[2]), tuple(a + b for a, b in zip(x, d, strict=True))
    return SymbolicModel(x, (u,), (p,), rates, outputs, ("a", "angle"), (False, True), moves=d, moved=moved)


@pytest.fixture(scope="module")
def kernel(tmp_path_factory: pytest.TempPathFactory) -> Kernel:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STOOP_CACHE_DIR", str(tmp_path_factory.mktemp("kernels")))
        made = load_kernel("swing", swing)
        made.entry("filter", 1)
    return made


@pytest.fixture(scope="module")
def measured() -> np.ndarray:
    rng = np.random.default_rng(1)
    z = 0.3 * rng.standard_normal((300, 2))
    z[rng.random(z.shape) < 0.2] = np.nan
    return z


def transition(stiffness: float) -> np.ndarray:
    """Runge-Kutta of order four is the exponential up to the fourth power."""
    one = DT * np.array([[0.0, 1.0, 0.0], [-stiffness, -0.6, 2.0], [0.0, 0.0, -1.5]])
    return np.eye(3) + one + one @ one / 2 + one @ one @ one / 6 + one @ one @ one @ one / 24


def test_step_is_the_transition(kernel: Kernel) -> None:
    nothing = np.zeros((1, 3))
    after, readings = kernel.step(np.full((1, 3), 9.0), np.eye(3), nothing, nothing, DT)
    assert np.allclose(after, transition(9.0), rtol=0.0, atol=1e-14)
    assert np.allclose(readings, H, rtol=0.0, atol=1e-14)


def test_covariance_and_gains_along_a_record_with_holes(kernel: Kernel, measured: np.ndarray) -> None:
    F, seen = transition(9.0), np.isfinite(measured)
    which = np.zeros(300, dtype=np.int64)
    found = filtering.riccati(kernel, F[None], H[None], Q[None], R, seen.astype(float), which, P)
    _, covariances, gains, _ = kalman(F, H, Q, R, np.zeros(3), P, measured)
    for k, own in enumerate(seen):
        assert np.allclose(found[0][k].reshape(3, 2)[:, own], gains[k], rtol=1e-10, atol=1e-13)
        assert not found[0][k].reshape(3, 2)[:, ~own].any()
        assert np.allclose(found[1][k][np.ix_(own, own)], covariances[k], rtol=1e-10)


def test_every_candidate_flies_with_its_own_gains(kernel: Kernel, measured: np.ndarray) -> None:
    stiffness, start = np.array([4.0, 9.0, 16.0]), np.array([0.1, -0.2, 0.3])
    seen, which = np.isfinite(measured), np.zeros(300, dtype=np.int64)
    own = [transition(s)[None] for s in stiffness]
    found = [filtering.riccati(kernel, F, H[None], Q[None], R, seen.astype(float), which, P)[0] for F in own]
    gains, many = np.stack(found, axis=2), len(stiffness)
    begin, samples = np.repeat(start[:, None], many, 1), np.arange(300, dtype=np.int64)
    given = (stiffness[None, :], begin, gains, samples, np.zeros((300, 1)), measured, DT)
    found, states = filtering.innovations(kernel, *given, states=True)
    for b, s in enumerate(stiffness):
        plain, *_ = kalman(transition(s), H, Q, R, start, P, measured)
        for k, own in enumerate(seen):
            assert np.allclose(found[b, k, own], plain[k], rtol=1e-9, atol=1e-11)
            assert not found[b, k, ~own].any()
    assert np.array_equal(states[:, 0], np.repeat(start[None, :], many, 0))


def test_without_a_gain_it_is_the_simulation(kernel: Kernel) -> None:
    p, x = np.full((1, 5), 9.0), np.repeat([[0.3], [0.1], [0.2]], 5, 1)
    u = np.random.default_rng(2).normal(size=(200, 1))
    none, which = np.zeros((1, 6, 5)), np.zeros(200, dtype=np.int64)
    found, states = filtering.innovations(kernel, p, x, none, which, u, np.zeros((200, 2)), DT)
    assert np.allclose(found, -kernel.trajectories(p, x, u, DT), rtol=1e-12, atol=1e-13)
    assert states.size == 0


def test_an_innovation_of_an_angle_takes_the_short_way(kernel: Kernel) -> None:
    p, x, z = np.full((1, 1), 9.0), np.array([[0.0], [3.0], [0.0]]), np.array([[0.0, -3.0]])
    none, which = np.zeros((1, 6, 1)), np.zeros(1, dtype=np.int64)
    found, _ = filtering.innovations(kernel, p, x, none, which, np.zeros((1, 1)), z, DT)
    assert found[0, 0, 1] == pytest.approx(2.0 * np.pi - 6.0)


def test_arrays_that_do_not_fit_and_models_without_moves_are_refused(kernel, pendulum):
    p, x, u, z = np.full((1, 1), 9.0), np.zeros((3, 1)), np.zeros((5, 1)), np.zeros((5, 2))
    which = np.zeros(5, dtype=np.int64)
    with pytest.raises(ValueError, match="gains"):
        filtering.innovations(kernel, p, x, np.zeros((1, 5, 1)), which, u, z, DT)
    with pytest.raises(ValueError, match="which"):
        filtering.innovations(kernel, p, x, np.zeros((1, 6, 1)), which + 1, u, z, DT)
    with pytest.raises(ValueError, match="error state"):
        pendulum.entry("filter", 1)
