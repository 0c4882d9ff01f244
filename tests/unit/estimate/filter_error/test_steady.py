"""The steady covariance against SciPy's, and against the equation that it solves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are

from stoop.estimate.filter_gains import steady_covariance


def system(seed: int, n: int = 5, ny: int = 3, count: int = 4) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    F = np.eye(n) + 0.05 * rng.standard_normal((count, n, n))
    H = rng.standard_normal((count, ny, n))
    G = 0.1 * rng.standard_normal((count, n, n))
    return F, H, G @ np.swapaxes(G, 1, 2), 10.0 ** rng.uniform(-2.0, 2.0, (count, ny))


@given(seed=st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_equals_scipy(seed: int) -> None:
    F, H, Q, R = system(seed)
    found = steady_covariance(F, H, Q, 1.0 / R)
    for f, h, q, r, P in zip(F, H, Q, R, found, strict=True):
        assert np.allclose(P, solve_discrete_are(f.T, h.T, q, np.diag(r)), rtol=1e-6, atol=1e-9)


def test_an_unmeasured_channel_informs_of_nothing() -> None:
    F, H, Q, R = system(3)
    information = 1.0 / R
    information[:, 1] = 0.0
    assert np.allclose(
        steady_covariance(F, H, Q, information), steady_covariance(F, H[:, [0, 2]], Q, information[:, [0, 2]])
    )


def test_a_candidate_without_a_solution_leaves_the_others_alone() -> None:
    F, H, Q, R = system(4)
    alone = steady_covariance(F[1:], H[1:], Q[1:], 1.0 / R[1:])
    grown, rounded = (F.copy(), H.copy(), Q.copy()), (F.copy(), H.copy(), Q.copy())
    grown[0][0], grown[1][0] = 1.5 * np.eye(5), 0.0  # grows and is not seen
    rounded[1][0], rounded[2][0] = 1.0, 1e40  # beside which the identity is lost: a singular matrix
    for system_ in (grown, rounded):
        together = steady_covariance(*system_, 1.0 / R)
        assert not np.isfinite(together[0]).all()
        assert together[1:] == pytest.approx(alone)
