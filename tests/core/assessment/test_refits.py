"""Bootstrap, profile likelihood and posterior against closed forms, brute force, quadrature and densities that are known."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from helpers.flown import maneuver, with_few_free
from naive.fitted import Fitted, line
from numpy.testing import assert_allclose
from scipy.optimize import brentq, least_squares
from scipy.signal import lfilter

from stoop import Bootstrap, FittedModel, Options, Profile, load_vehicle, simulate_flight
from stoop.assessment.assessment import Optimum, check_method, linearize, refit
from stoop.assessment.bootstrap import ColoredBlocks, block_length, percentiles, shifts
from stoop.assessment.coloring import ColoredNoise
from stoop.assessment.covariance import NORMAL_95
from stoop.assessment.error_bars import estimate_uncertainty
from stoop.assessment.profile import ProfileLikelihood
from stoop.errors import IdentificationError
from stoop.optimize.normal_equations import dense
from stoop.parallel import Given
from stoop.problem.evidence import PieceEvidence
from stoop.vehicle import parse_vehicle
from stoop.workflow import fit

SAMPLES = 800
TRUTH = np.array([0.5, 0.4, 0.3])
T = np.linspace(0.0, 1.0, 25)
DELAY, FREE = "sensors.alpha.delay", ("CLalpha", "Cmalpha", "Cmq", "Cmelevator")
MANEUVER = maneuver(10.0, ("elevator", "3-2-1-1", 0.5, 0.4, 0.05), ("elevator", "doublet", 5.0, 0.6, 0.04))


def design(size: int = SAMPLES) -> np.ndarray:
    t = np.linspace(0.0, 8.0, size)
    return np.column_stack([np.ones(size), np.sin(1.3 * t), np.where(t > 4.0, 1.0, -0.5)])


def ar1(size: int, rho: float, random: np.random.Generator) -> np.ndarray:
    return np.asarray(lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], random.normal(size=size + 500))[500:])


def drawn(X: np.ndarray, y: np.ndarray, sigma: float) -> tuple[Optimum, ColoredBlocks]:
    z = np.linalg.lstsq(X, y, rcond=None)[0]
    v = ((y - X @ z) / sigma)[:, None]
    found = estimate_uncertainty([PieceEvidence(v, X[:, None, :] / sigma)], np.zeros((3, 3)))
    return linearize(line(X, y, sigma), z, np.arange(3)), ColoredBlocks.of(found.noise, [v])


@pytest.mark.parametrize("rho", [0.0, 0.95], ids=["white", "AR(1) 0.95"])
def test_standard_errors_are_those_of_the_noise_that_made_the_data(rho: float) -> None:
    """The truth is the sandwich with the autocovariance that generated the noise; plain Cramer-Rao fails at 0.95."""
    X, sigma, lags = design(), 0.02, np.abs(np.subtract.outer(np.arange(SAMPLES), np.arange(SAMPLES)))
    inverse = np.linalg.inv(X.T @ X)
    truth = np.sqrt(np.diag(inverse @ X.T @ (sigma**2 * rho**lags) @ X @ inverse))
    plain, found = sigma * np.sqrt(np.diag(inverse)), []
    for seed in range(6):
        optimum, noise = drawn(X, X @ TRUTH + sigma * ar1(SAMPLES, rho, np.random.default_rng(seed)), sigma)
        found.append(refit(optimum, shifts(optimum, noise, range(150), 1)).z.std(axis=0, ddof=1))
    assert_allclose(np.mean(found, axis=0) / truth, 1.0, atol=0.2)
    assert (rho == 0.0) == bool(np.all(truth / plain < 1.05))
    assert rho == 0.0 or np.all(truth / plain > 3.0)


def test_refits_of_a_curved_problem_are_those_of_scipy() -> None:
    t = np.linspace(0.0, 1.0, 60)

    def curve(z: np.ndarray) -> np.ndarray:
        return np.asarray(z[..., :1] * np.exp(-8.0 * z[..., 1:2] * t))

    def solution(data: np.ndarray, start: np.ndarray) -> np.ndarray:
        limits, fine = ([0, 0], [1, 1]), dict.fromkeys(("xtol", "ftol", "gtol"), 1e-14)
        return np.asarray(least_squares(lambda z: (curve(z) - data) / 0.05, start, bounds=limits, **fine).x)

    truth, random = np.array([0.5, 0.4]), np.random.default_rng(2)
    y = curve(truth) + 0.05 * random.normal(size=60)
    best = solution(y, truth)
    optimum = linearize(Fitted(lambda Z: (curve(Z) - y) / 0.05, 2), best, np.arange(2))
    noise = random.normal(size=(20, 60))
    wanted = [solution(curve(best) + 0.05 * e, best) for e in noise]
    assert_allclose(refit(optimum, -optimum.residual - noise).z, wanted, atol=3e-4)  # 1e-3 of an error


def test_a_refit_stays_in_its_box() -> None:
    X, best = design(), np.array([0.001, 0.5, 0.5])
    optimum = linearize(line(X, X @ best, 0.05), best, np.arange(3))
    found = refit(optimum, -optimum.residual - np.repeat([[3.0], [-3.0]], SAMPLES, axis=1))
    assert (found.z[0, 0], found.z[1, 0]) == (pytest.approx(0.151, abs=1e-6), pytest.approx(0.0, abs=1e-9))
    assert_allclose(found.z[1, 1:], np.linalg.lstsq(X[:, 1:], X @ best - 0.15, rcond=None)[0], atol=1e-6)


def test_a_diverging_replicate_is_lost_and_no_other() -> None:
    t = np.linspace(0.0, 1.0, 40)
    problem = Fitted(lambda Z: np.where(Z[:, :1] > 0.999, np.nan, Z[:, :1] * np.ones_like(t)), 1)
    optimum = linearize(problem, np.array([0.5]), np.arange(1))
    found = refit(optimum, np.array([[-0.6], [np.nan]]) * np.ones((2, 40)))
    assert found.endings == ("converged", "failed")
    assert found.z[0, 0] == pytest.approx(0.6)
    assert np.isnan(found.z[1, 0])


def test_noise_of_one_replicate_depends_on_its_number_and_the_seed_alone() -> None:
    X = design(200)
    optimum, noise = drawn(X, X @ TRUTH + 0.1 * ar1(200, 0.8, np.random.default_rng(1)), 0.1)
    whole = shifts(optimum, noise, range(6), 7)
    assert np.array_equal(whole[4:], shifts(optimum, noise, [4, 5], 7))
    assert not np.array_equal(whole, shifts(optimum, noise, range(6), 8))


def test_missing_readings_get_no_noise_and_cost_no_other() -> None:
    X, v = design(400), ar1(400, 0.9, np.random.default_rng(3))[:, None]
    v[100:140] = np.nan
    v[::7] = np.nan
    noise = ColoredBlocks.of(ColoredNoise(np.array([[0.9]]), np.array([[0.19]])), [v])
    optimum = linearize(line(X, X @ TRUTH, 1.0), TRUTH, np.arange(3))
    out = shifts(optimum, noise, range(40), 0) + optimum.residual
    assert np.all(out[:, ~np.isfinite(v[:, 0])] == 0.0)
    assert np.std(out[:, np.isfinite(v[:, 0])]) == pytest.approx(1.0, abs=0.15)


def test_drawn_noise_has_color_and_strength_of_the_model_and_shares_its_disturbances() -> None:
    random = np.random.default_rng(5)
    shared = ar1(3000, 0.9, random)
    v = np.column_stack([shared, 0.8 * shared + 0.6 * ar1(3000, 0.9, random)])
    color = ColoredNoise(np.array([[0.9], [0.9]]), 4.0 * 0.19 * np.array([[1.0, 0.8], [0.8, 1.0]]))
    blocks = ColoredBlocks.of(color, [v])
    made = np.concatenate([blocks.segment(0, np.random.default_rng(i)) for i in range(20)])
    assert made.std(axis=0) == pytest.approx([2.0, 2.0], rel=0.05)
    assert np.corrcoef(made.T)[0, 1] == pytest.approx(0.8, abs=0.03)
    assert np.corrcoef(made[1:, 0], made[:-1, 0])[0, 1] == pytest.approx(0.9, abs=0.02)


def test_block_length_grows_with_the_memory_of_the_series() -> None:
    """Politis and White (2004), section 3.2: for AR(1) the ideal length is (6 rho^2 / (1 - rho^2)^2 n)^(1/3)."""
    assert block_length(np.random.default_rng(0).normal(size=4000)) < 4.0
    for rho in (0.5, 0.8):
        ideal = (6.0 * (rho / (1.0 - rho**2)) ** 2 * 8000) ** (1.0 / 3.0)
        found = [block_length(ar1(8000, rho, np.random.default_rng(i))) for i in range(8)]
        assert np.median(found) == pytest.approx(ideal, rel=0.3)
    assert block_length(np.zeros(50)) == 1.0


def test_percentiles_are_corrected_for_bias() -> None:
    """A lognormal: bias-corrected percentiles do not mind that the estimate is the median, Efron and Tibshirani 14.3."""
    values = np.exp(np.random.default_rng(1).normal(size=(200_000, 1)))
    _, lower, upper = percentiles(np.array([1.0]), values)
    assert lower[0] == pytest.approx(np.exp(-1.96), rel=0.02)
    assert upper[0] == pytest.approx(np.exp(1.96), rel=0.02)
    _, _, upper = percentiles(np.array([np.exp(0.5)]), values)
    assert upper[0] == pytest.approx(np.exp(2.0 * 0.5 + 1.96), rel=0.05)
    assert np.isnan(percentiles(np.array([1.0]), values[:39])[0][0])


def test_a_linear_model_has_the_interval_of_the_normal_distribution() -> None:
    random = np.random.default_rng(0)
    X = np.column_stack([np.ones(60), np.linspace(-1.0, 1.0, 60), random.normal(size=60)])
    y = X @ np.array([0.5, 0.4, 0.6]) + 0.05 * random.normal(size=60)
    best, sigma = np.linalg.lstsq(X, y, rcond=None)[0], 0.05 * np.sqrt(np.diag(np.linalg.inv(X.T @ X)))
    optimum = linearize(line(X, y, 0.05), best, np.arange(3))
    for entry, factor in ((0, 1.0), (1, 2.5), (2, 0.7)):
        found, half = ProfileLikelihood(optimum, entry, factor), NORMAL_95 * factor * sigma[entry]
        assert found.lower == pytest.approx(best[entry] - half, abs=0.011 * half)
        assert found.upper == pytest.approx(best[entry] + half, abs=0.011 * half)
        assert found.better < 1e-6


def michaelis(z: np.ndarray) -> np.ndarray:
    """Return a curve whose two parameters are strongly bent together: 2 a t / (b + t)."""
    return np.asarray(2.0 * z[..., :1] * T / (z[..., 1:2] + T))


def brute(y: np.ndarray, best: float, value: float) -> float:
    """Return the likelihood-ratio statistic of b = value: a is linear, so its best is known exactly."""
    basis = 2.0 * T / (value + T)
    a = np.clip(float(basis @ y / (basis @ basis)), 0.0, 1.0)
    return float(np.sum((a * basis - y) ** 2)) / 0.06**2 - best


def test_a_curved_problem_has_the_interval_found_by_brute_force() -> None:
    y = michaelis(np.array([0.4, 0.3])) + 0.06 * np.random.default_rng(3).normal(size=len(T))
    problem = Fitted(lambda Z: (michaelis(Z) - y) / 0.06, 2)
    z = least_squares(lambda z: michaelis(z) - y, [0.4, 0.3], xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    best = float(np.sum(problem.residuals(z[None], 0) ** 2))
    lower = brentq(lambda b: brute(y, best, b) - NORMAL_95**2, 0.01, z[1])
    upper = brentq(lambda b: brute(y, best, b) - NORMAL_95**2, z[1], 1.0)
    found = ProfileLikelihood(linearize(problem, z, np.arange(2)), 1)
    assert found.lower == pytest.approx(lower, abs=0.02 * (z[1] - lower))
    assert found.upper == pytest.approx(upper, abs=0.02 * (upper - z[1]))
    assert (found.upper - z[1]) / (z[1] - found.lower) > 1.3  # the normal interval would be symmetric
    for value, root in found.points:
        assert root**2 == pytest.approx(max(brute(y, best, value), 0.0), abs=1e-3 + 1e-3 * root**2)


def test_an_end_that_the_data_leave_open_is_none() -> None:
    """Few readings and much noise: no b up to the bound can be refused, a least one can."""
    sparse = np.array([0.3, 0.6, 1.0])
    y = 2.0 * 0.3 * sparse / (0.6 + sparse)
    problem = Fitted(lambda Z: (2.0 * Z[:, :1] * sparse / (Z[:, 1:2] + sparse) - y) / 0.05, 2)
    found = ProfileLikelihood(linearize(problem, np.array([0.3, 0.6]), np.arange(2)), 1)
    assert np.isnan(found.upper)
    at_bound = np.column_stack([np.linspace(0.0, 1.0, 1001), np.ones(1001)])
    assert np.min(np.sum(problem.residuals(at_bound, 0) ** 2, axis=1)) < NORMAL_95**2
    assert 0.0 < found.lower < 0.6


def test_a_better_optimum_is_reported() -> None:
    problem = Fitted(lambda Z: np.column_stack([10.0 * (Z[:, 0] - 0.6), 10.0 * (Z[:, 1] - 0.5)]), 2)
    assert ProfileLikelihood(linearize(problem, np.array([0.6, 0.45]), np.arange(2)), 0).better > 0.1


@pytest.fixture(scope="module", params=["filter-error", "multiple-shooting"])
def job(request: pytest.FixtureRequest) -> FittedModel:
    text = load_vehicle("twin-boom").text + "[sensors.alpha]\ndelay = 0.033\n"
    late = {DELAY: {"free": request.param == "multiple-shooting", "bounds": (0.0, 0.1)}}
    vehicle = with_few_free(parse_vehicle(text, "late").reduced("longitudinal"), FREE).with_numbers(late)
    flight = simulate_flight(vehicle, MANEUVER, seed=3, name="sim")
    return fit(vehicle, flight, ["0:10"], options=Options(method=request.param))


def test_residuals_and_derivatives_are_those_of_the_evidence(job: FittedModel) -> None:
    problem, evidence = job.estimate.refit_problem, job.estimate.evidence
    r = problem.residuals(job.estimate.z[None], 0)[0]
    (piece,) = evidence.pieces
    assert -r[: piece.residual.size] == pytest.approx(piece.filled()[0].ravel(), abs=1e-6)
    J = dense(problem.jacobian(job.estimate.z, 0, r)[0])
    expected = piece.filled()[1].reshape(piece.residual.size, -1)[:, : len(job.estimate.z)]
    found = J[: piece.residual.size] / job.estimate.problem.layout.scales
    size = np.linalg.norm(expected, axis=0)
    assert np.linalg.norm(found - expected, axis=0)[size > 0.0] == pytest.approx(0.0, abs=0.05 * size.max())
    own = size[: len(FREE)]
    assert np.linalg.norm((found - expected)[:, : len(FREE)], axis=0) / own == pytest.approx(0.0, abs=0.05)


def test_bootstrap_and_profile_agree_with_the_corrected_errors(job: FittedModel) -> None:
    own = ("Cmq", DELAY) if DELAY in [p.name for p in job.estimate.problem.layout.parameters] else ("Cmq",)
    pool = Given(ThreadPoolExecutor(1))
    result = job.assess(Bootstrap(100, pool), Profile(own, pool)).result
    corrected, found = (result.uncertainty[m].parameters for m in ("corrected", "bootstrap"))
    ratios = [found[n].std_error / corrected[n].std_error for n in FREE]
    assert float(np.median(ratios)) == pytest.approx(1.0, abs=0.25)
    assert result.uncertainty["bootstrap"].figures["failed"] == 0.0
    for name in own:
        profile = result.uncertainty["profile"].parameters[name]
        assert profile.std_error == pytest.approx(corrected[name].std_error, rel=0.2)
        assert profile.ci95_lower < result.parameters[name].estimate < profile.ci95_upper
        assert found[name].std_error == pytest.approx(corrected[name].std_error, rel=0.35)


@pytest.mark.parametrize("method", ["equation-error", "frequency-domain"])
def test_the_likelihood_of_a_regression_has_no_shape_of_its_own(method: str) -> None:
    check_method(method, ["bootstrap"])
    for name in ("posterior", "profile"):
        with pytest.raises(IdentificationError, match=f"{name}: --method {method} is a linear regression"):
            check_method(method, ["bootstrap", name])
