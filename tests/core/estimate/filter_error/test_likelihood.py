"""The likelihood of innovations, its steady covariance and the end of Fisher's scoring, against independent twins."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.fits import posed
from hypothesis import given, settings
from hypothesis import strategies as st
from naive.kalman import kalman
from scipy.linalg import solve_discrete_are

from stoop.estimate.filter_gains import Noise, Steady, Varying, first_guess, steady_covariance
from stoop.estimate.filter_likelihood import Likelihood
from stoop.estimate.fitted_filter import with_gusts
from stoop.estimate.linearization import linearized
from stoop.estimate.scoring import UNREACHED, ScoringModel


def likely(vehicle, flight, gain):
    """The likelihood of four seconds, and unknowns near the values of the file."""
    problem = with_gusts(posed(vehicle, flight, 4.0))
    noise = Noise(vehicle, first_guess(vehicle, problem.pieces))
    x = problem.layout.unit(np.array([p.value for p in problem.layout.parameters]))
    z = np.concatenate([x, 0.1 * np.random.default_rng(0).standard_normal(problem.extra), noise.start])
    return Likelihood.of(problem, noise, gain, z.copy()), z


def test_a_step_to_nowhere_is_a_value(gusty, gusty_flight):
    likelihood, z = likely(gusty, gusty_flight, Steady())
    assert likelihood.cost(np.where(np.arange(len(z)) == 1, np.nan, z)) == np.inf


@pytest.mark.parametrize("gain", [Steady(), Varying(0.5)], ids=["steady", "varying"])
def test_gradient_is_the_slope_of_the_cost(gusty, gusty_flight, gain):
    holes = replace(gusty_flight, data=gusty_flight.data.copy(deep=True))
    holes.data["alpha"].values[50:60] = np.nan
    likelihood, z = likely(gusty, holes, gain)
    at = likelihood.score(z)
    for j in range(likelihood.size):
        h = np.zeros_like(z)
        h[j] = 1e-4
        slanted = (likelihood.cost(z + h) - likelihood.cost(z - h)) / 4e-4
        assert at.gradient[j] == pytest.approx(slanted, rel=2e-3, abs=2e-3 * np.sqrt(at.information[j, j]))


def test_a_straight_flight_has_the_likelihood_of_its_linear_model(gusty, gusty_flight):
    """Small moves about a steady flight: the filter of the equations is the plain filter of their linear model."""
    likelihood, z = likely(gusty, gusty_flight, Varying(1e9))
    piece, problem = likelihood.problem.pieces[0], likelihood.problem
    quiet = np.repeat(piece.inputs[:1], len(piece.time), axis=0)
    z[problem.dimension : -likelihood.noise.size] = 0.0
    still = replace(problem, pieces=(replace(piece, inputs=quiet),))
    flown = still.outputs(z[: -likelihood.noise.size], 0)
    small = 1e-3 * likelihood.noise.first * np.random.default_rng(1).standard_normal(flown.shape)
    still = replace(still, pieces=(replace(still.pieces[0], measured=flown + small),))
    likelihood = Likelihood.of(still, likelihood.noise, Varying(1e9), z)
    rows, _ = still.candidates(z[None, : -likelihood.noise.size], 0)
    point = likelihood.along(z).points[0]
    model = linearized(gusty, rows, point.states[:, :, None], point.inputs, piece.dt)
    tail = z[None, -likelihood.noise.size :]
    Q = likelihood.noise.process(tail, model.drive, piece.dt)[0, 0]
    F, H, R = model.transition[0, 0], model.readings[0, 0], likelihood.noise.variances(tail)[0]
    zero = np.zeros(len(F))
    *_, expected = kalman(F, H, Q, R, zero, np.outer(zero, zero), small)
    prior = float(np.sum(still.layout.prior_residuals(z[None, : -likelihood.noise.size]) ** 2))
    assert likelihood.cost(z) - prior == pytest.approx(expected, abs=0.02)


def test_second_differences_show_the_noise(gusty, gusty_flight):
    true = np.array([getattr(gusty.file.sensors, c).sigma for c in gusty.outputs])
    ratio = first_guess(gusty, posed(gusty, gusty_flight).pieces) / true
    assert np.all((ratio > 0.7) & (ratio < 2.5))  # gusts shake az within a sample


class Kinked(SimpleNamespace):
    """Twice a negative logarithm with its least at zero, whose gradient there promises a gain that no step finds."""

    size, known, bounds = 1, 1, (np.array([-1.0]), np.array([1.0]))

    def cost(self, z: np.ndarray) -> float:
        return float(np.abs(z[0]))

    def score(self, z: np.ndarray) -> Any:
        return SimpleNamespace(gradient=np.array([np.sqrt(2.0 * self.left)]), information=np.eye(1))


@pytest.mark.parametrize(("share", "ending"), [(0.5, "converged"), (2.0, "stalled")])
def test_a_search_that_no_step_improves_has_converged_where_little_seems_left(share, ending):
    model = ScoringModel(Kinked(left=share * UNREACHED * 1e-4), np.zeros(1), 1e-4)
    assert (model.optimal, model.settled()) == (False, ending)


def system(seed: int, n: int = 5, ny: int = 3, count: int = 4) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    F = np.eye(n) + 0.05 * rng.standard_normal((count, n, n))
    H, G = rng.standard_normal((count, ny, n)), 0.1 * rng.standard_normal((count, n, n))
    return F, H, G @ np.swapaxes(G, 1, 2), 10.0 ** rng.uniform(-2.0, 2.0, (count, ny))


@given(seed=st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_equals_scipy(seed: int) -> None:
    F, H, Q, R = system(seed)
    for f, h, q, r, P in zip(F, H, Q, R, steady_covariance(F, H, Q, 1.0 / R), strict=True):
        assert np.allclose(P, solve_discrete_are(f.T, h.T, q, np.diag(r)), rtol=1e-6, atol=1e-9)


def test_an_unmeasured_channel_informs_of_nothing() -> None:
    (F, H, Q, R), seen = system(3), [0, 2]
    found = steady_covariance(F, H, Q, [1.0, 0.0, 1.0] / R)
    assert np.allclose(found, steady_covariance(F, H[:, seen], Q, 1.0 / R[:, seen]))


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
