"""Information and its inverse: what the data do not tell is called so, and priors are tested against the data."""

from types import SimpleNamespace
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.linalg import block_diag
from scipy.stats import kstest

from stoop.assessment import covariance as by
from stoop.assessment import error_bars as bars
from stoop.assessment.covariance import correlation, standard_errors
from stoop.assessment.error_bars import near_null_directions
from stoop.assessment.prior_conflicts import LEVEL, PriorTests, prior_tests
from stoop.problem.evidence import PieceEvidence, Unknown, invert, invert_rows
from stoop.vehicle.vehicle import Parameter

NAMES, ROWS = ("a", "b", "c", "d"), np.random.default_rng(0).normal(size=(400, 2))
LENGTH = 40


@given(st.integers(0, 99), st.integers(1, 8))
@settings(max_examples=30)
def test_inverse_whatever_the_units(seed: int, size: int) -> None:
    rows = np.random.default_rng(seed).normal(size=(3 * size, size))
    units = np.outer(*2 * [10.0 ** np.random.default_rng(seed).uniform(-8, 8, size)])
    found = invert(rows.T @ rows * units)
    assert_allclose(found.matrix * units, np.linalg.inv(rows.T @ rows), rtol=1e-6, atol=1e-8)
    assert found.determined.all()


def test_two_that_only_show_as_a_sum_are_both_unknown() -> None:
    rows = np.random.default_rng(0).normal(size=(50, 2))
    rows = np.column_stack([rows[:, 0], rows[:, 1], 1e3 * rows[:, 1]])
    assert invert(rows.T @ rows).determined.tolist() == [True, False, False]
    held = invert(rows.T @ rows + np.diag([0.0, 0.0, 100.0]))
    assert held.determined.all()
    assert standard_errors(held.matrix)[2] == pytest.approx(0.1, rel=1e-3)


@pytest.mark.parametrize("prior", [np.zeros((3, 3)), np.diag([1e-9, 0.0, 0.0])])
def test_standard_errors_have_the_digits_of_the_sensitivities(prior: np.ndarray) -> None:
    """At a condition number of 2.5e5 the product of the rows leaves 5 digits, their QR and singular values 11.

    Rows are the sensitivities of y = b1 (b2 + x)^(-1 / b3), the model of NIST's Bennett5, near its values.
    """
    x, (b1, b2, b3) = np.linspace(10.0, 12.0, 154), (-2523.5, 46.74, 0.93218)
    power = (b2 + x) ** (-1.0 / b3)
    rows = np.column_stack([power, -b1 / b3 * power / (b2 + x), b1 * np.log(b2 + x) / b3**2 * power])
    with mpmath.workdps(60):
        exact = mpmath.matrix(rows.tolist())
        inverse = (exact.T * exact + mpmath.matrix(prior.tolist())) ** -1
        wanted = [float(mpmath.sqrt(inverse[i, i])) for i in range(3)]
    assert np.max(np.abs(standard_errors(invert(rows.T @ rows + prior).matrix) / wanted - 1.0)) > 1e-9
    cut = [PieceEvidence(np.zeros((77, 1)), part[:, None, :]) for part in (rows[:77], rows[77:])]
    assert_allclose(standard_errors(bars.estimate_uncertainty(cut, prior).cramer_rao), wanted, rtol=1e-10)
    assert_allclose(standard_errors(by.inverse_information(cut, prior).matrix), wanted, rtol=1e-10)
    if not prior.any():
        assert_allclose(standard_errors(invert_rows(rows).matrix), wanted, rtol=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_rows_and_their_product_have_the_same_inverse(seed: int) -> None:
    """Pieces with unknowns of their own, priors that are correlated, an inflation, directions without information."""
    random = np.random.default_rng(seed)
    jacobians = [random.normal(size=(9000, 2, 6)), random.normal(size=(3, 2, 6))]
    jacobians[0][:, :, 4:], jacobians[1][:, :, 3] = 0.0, 0.0
    for jacobian in jacobians:
        jacobian[:, :, 1] = 2.0 * jacobian[:, :, 0]  # they only show as a sum
    pieces = [PieceEvidence(np.zeros(jacobian.shape[:2]), jacobian) for jacobian in jacobians]
    root = random.normal(size=(2, 2))
    for prior in (np.zeros((6, 6)), np.pad(1e4 * root.T @ root, (0, 4))):
        by_product = invert(4.0 * by.data_information(pieces) + prior)
        found = by.inverse_information(pieces, prior, 4.0)
        assert found.determined.tolist() == by_product.determined.tolist()
        assert found.determined[:2].all() == prior.any()
        assert_allclose(found.matrix, by_product.matrix, rtol=1e-8, atol=1e-12)
        assert_allclose(found.eigenvalues, by_product.eigenvalues, rtol=1e-8, atol=1e-12)


def test_missing_measurements_carry_no_information() -> None:
    random = np.random.default_rng(2)
    residual, jacobian = random.normal(size=(20, 2)), random.normal(size=(20, 2, 3))
    residual[4, 1] = np.nan
    jacobian[4, 1] = np.nan
    whole = by.data_information([PieceEvidence(residual, jacobian)])
    rows = np.delete(jacobian.reshape(-1, 3), 9, axis=0)
    assert_allclose(whole, rows.T @ rows)


def test_correlation_of_what_is_known() -> None:
    matrix = correlation(np.array([[4.0, 1.0, np.nan], [1.0, 1.0, np.nan], [np.nan, np.nan, np.inf]]))
    assert matrix[0, 1] == pytest.approx(0.5)
    assert np.isnan(matrix[0, 2])
    assert_allclose(np.diag(matrix), 1.0)


def test_the_sum_of_two_is_seen_and_their_difference_is_not() -> None:
    """A step along the difference is as long as the cost rises by 1, or more than doubles neither of the two."""
    random = np.random.default_rng(0)
    common = random.normal(size=500)
    J = np.column_stack([common, common + 1e-4 * random.normal(size=500), 5.0 * random.normal(size=500)])
    (dark,) = near_null_directions(NAMES[:3], J.T @ J, np.full(3, 1e6))
    assert (set(dark.changes), dark.changes["a"]) == ({"a", "b"}, pytest.approx(-dark.changes["b"], rel=1e-3))
    assert dark.singular_value < 1e-3
    step = np.array([dark.changes["a"], dark.changes["b"], 0.0])
    assert float(np.sum((J @ step) ** 2)) == pytest.approx(1.0, rel=0.05)
    assert dark.words is not None
    assert dark.words.code == "direction-together"
    (cut,) = near_null_directions(NAMES[:3], J.T @ J, np.array([5e-3, 2e-2, 1.0]))
    assert [cut.changes[n] for n in "ab"] == pytest.approx([5e-3, -5e-3], rel=1e-3)
    assert near_null_directions(("a", "b"), np.array([[1.0, 0.3], [0.3, 4.0]]), np.ones(2)) == ()


def test_marginal_information_is_the_inverse_of_the_block_of_the_covariance() -> None:
    A = np.random.default_rng(2).normal(size=(20, 4))
    whole = A.T @ A
    wanted = np.linalg.inv(np.linalg.inv(whole)[:2, :2])
    assert_allclose(bars.marginal_information(whole, 2), wanted, rtol=1e-9)
    assert_allclose(bars.marginal_information(whole, 4), whole)


def test_pairs_and_partners() -> None:
    related = correlation(block_diag([[1.0, 0.95], [0.95, 1.0]], [[4.0, -1.6], [-1.6, 1.0]]))
    (pair,) = bars.worst_pairs(NAMES, related)
    assert (pair.first, pair.second, pair.correlation) == ("a", "b", pytest.approx(0.95))
    assert (bars.partners(NAMES, related, 0), bars.partners(NAMES, related, 2)) == (("b",), ("d",))


def judge(rows: np.ndarray, prior: list[float], *scales: list[float]) -> tuple[bars.Identifiability, ...]:
    information = rows.T @ rows + np.diag(np.array(prior) ** -2.0)
    inverse, (box, size) = invert(information), scales
    each = enumerate(zip(size, box, prior, strict=True))
    unknowns = [Unknown(f"C{i}", "parameter", 0.0, *own) for i, own in each]
    return bars.identifiability(unknowns, information, by.marked(inverse.matrix, inverse.determined))


def test_a_number_that_is_not_the_data_s_is_called_so() -> None:
    """Rows of the sensitivities, priors, boxes, sizes; whether the second number is identifiable, and the reason."""
    collinear = np.column_stack([ROWS[:, 0], ROWS[:, 0] + 0.01 * ROWS[:, 1]])
    one, none = [1.0, 1.0], [np.inf, np.inf]
    for case, rows, prior, box, size, known, reason in (
        ("known", ROWS, none, none, one, True, ""),
        ("the prior alone", ROWS * [1.0, 1e-4], one, none, one, False, "prior-only"),
        ("the box alone", ROWS * [1.0, 0.1], none, one, [10.0, 10.0], False, "error-as-box"),
        ("small, its error far smaller than its box", ROWS, none, [2.0, 2.0], [1.0, 1e-3], True, ""),
        ("a huge relative error", ROWS * 1e-3, none, none, [100.0, 1.0], False, "error-beyond-size"),
        ("unseen", ROWS * [1.0, 0.0], none, one, one, False, "not-seen"),
        ("collinear", collinear, none, none, [100.0, 100.0], True, "known-in-combination"),
    ):
        first, second = judge(rows, prior, box, size)
        assert (second.identifiable, getattr(second.reason, "code", "")) == (known, reason), case
        assert (first.name, second.name, first.identifiable) == ("C0", "C1", True), case
        assert second.conditional_std <= second.marginal_std, case
        assert (second.multiple_correlation > 0.999) == (case == "collinear"), case
    known = judge(ROWS, none, none, one)[0]
    assert known.marginal_std == pytest.approx(0.05, rel=0.1)
    assert judge(ROWS * [1.0, 0.0], none, one, one)[1].marginal_std == np.inf
    values, units = bars.scaled_singular_values, np.outer(*2 * [[1e6, 1e-3]])
    assert_allclose(values(ROWS.T @ ROWS * units), values(ROWS.T @ ROWS))
    assert values(np.diag([4.0, 9.0])).tolist() == [1.0, 1.0]


def repeated(slopes: np.ndarray, windows: int, times: int) -> np.ndarray:
    """Return the mean variance that is told over the variance (k,) of estimates, for slopes (n, k).

    The noise is white beside a walk that begins anew with each window.
    """
    rng, (n, k) = np.random.default_rng(0), slopes.shape
    pull = np.linalg.inv(slopes.T @ slopes) @ slopes.T
    none = (np.empty((windows - 1, 0)), np.empty((windows - 1, 0, k)))
    edges, found, told = tuple(range(0, n + 1, LENGTH)), [], []
    for _ in range(times):
        walk = 0.3 * np.cumsum(rng.standard_normal((windows, LENGTH)), axis=1)
        noise = (walk + rng.standard_normal((windows, LENGTH))).reshape(-1, 1)
        estimate = pull @ noise[:, 0]
        segment = PieceEvidence(noise - (slopes @ estimate)[:, None], slopes[:, None, :])
        covariance = by.windowed_covariance([segment], [edges], [none], np.zeros((k, k)))
        found.append(estimate)
        told.append(np.diag(covariance))
    return np.mean(told, axis=0) / np.mean(np.square(found), axis=0)


def test_standard_errors_are_those_of_repetitions():
    rng, n = np.random.default_rng(1), 60 * LENGTH
    slopes = np.stack([np.tile(np.linspace(-1, 1, LENGTH), 60), rng.standard_normal(n)], axis=1)
    assert repeated(slopes, 60, 200) == pytest.approx(1.0, rel=0.25)


def test_what_a_fit_takes_up_of_the_noise_of_few_windows_is_given_back():
    """Six slow unknowns take up a sixth of the noise of thirteen windows, or else variances are a quarter too small."""
    rng, windows = np.random.default_rng(2), by.MIN_WINDOWS + 1
    level = np.repeat(rng.standard_normal((windows, 3)), LENGTH, axis=0)
    slopes = np.concatenate([level, level * np.tile(np.linspace(-1, 1, LENGTH), windows)[:, None]], axis=1)
    assert np.mean(repeated(slopes, windows, 400)) == pytest.approx(1.0, rel=0.12)


def test_no_variance_is_negative_however_short_pieces_are():
    rng = np.random.default_rng(4)
    for _ in range(50):
        drawn = [rng.standard_normal((120, 1, 7)) for _ in range(4)]
        pieces = [PieceEvidence(x[..., 0], x[..., 1:]) for x in drawn]
        none = (np.empty((2, 0)), np.empty((2, 0, 6)))
        covariance = by.windowed_covariance(pieces, [(0, 40, 80, 120)] * 4, [none] * 4, np.zeros((6, 6)))
        assert covariance is not None
        assert_allclose(covariance, covariance.T, rtol=1e-9, atol=1e-12)
        assert np.linalg.eigvalsh(covariance).min() >= 0.0


def test_the_wider_of_two_stands():
    one, other = np.array([[1.0, 0.5], [0.5, 4.0]]), np.diag([9.0, 1.0])
    assert np.allclose(by.widened(one, other), [[9.0, 1.5], [1.5, 4.0]])
    assert np.array_equal(by.widened(one, np.diag([np.inf, np.nan])), one)


COUNT, FLIGHTS, RNG = 6, 1500, np.random.default_rng(7)
ROOT = RNG.standard_normal((COUNT, COUNT)) + 2.0 * np.eye(COUNT)
DATA = 5.0 * ROOT @ ROOT.T  # information of the data, as they are weighted
STD = np.array([0.3, 0.5, 0.2, 1.0, 0.4, 0.6])
#: the scores' covariance over the information: residuals are more correlated than the weights say
COLORED = 2.5


def fitted(truth: np.ndarray, scores: np.ndarray, wide: int = -1) -> tuple[np.ndarray, np.ndarray]:
    """Return estimates and information of a linear fit with priors about zero, one of them left out."""
    information = DATA + np.diag(np.where(np.arange(COUNT) == wide, 0.0, STD**-2.0))
    return np.linalg.solve(information, DATA @ truth + scores), information


def judged(truth: np.ndarray, scores: np.ndarray) -> PriorTests:
    estimates, information = fitted(truth, scores)
    inverse, names = np.linalg.inv(information), [f"C{i}" for i in range(COUNT)]
    stated = zip(names, STD.tolist(), strict=True)
    layout = SimpleNamespace(parameters=[Parameter(n, 0.0, -9.0, 9.0, True, s, "1") for n, s in stated])
    known = dict(zip(names, estimates.tolist(), strict=True))
    fit: Any = SimpleNamespace(problem=SimpleNamespace(layout=layout), estimates=known)
    covariance = inverse @ (np.diag(STD**-2.0) + COLORED * DATA) @ inverse
    found = SimpleNamespace(information=information, corrected=covariance, cramer_rao=inverse)
    bars: Any = SimpleNamespace(free=np.arange(COUNT), uncertainty=found, of_free=lambda *names: covariance)
    return prior_tests(fit, bars)


def scores_of(rng: np.random.Generator) -> np.ndarray:
    return np.sqrt(COLORED) * np.linalg.cholesky(DATA) @ rng.standard_normal(COUNT)


def test_right_priors_contradict_as_seldom_as_the_level_says() -> None:
    rng = np.random.default_rng(1)
    found = [judged(STD * rng.standard_normal(COUNT), scores_of(rng)) for _ in range(FLIGHTS)]
    share = np.mean([bool(one.conflicts) for one in found])
    assert share == pytest.approx(LEVEL, abs=3.0 * np.sqrt(LEVEL * (1.0 - LEVEL) / FLIGHTS) + 0.005)
    alone = [one.p_value for one in found if not one.conflicts]
    assert kstest(alone, "uniform").statistic < LEVEL + 0.035  # those with a conflict are left out


def test_the_estimate_without_a_prior_is_that_of_a_fit_without_it() -> None:
    rng = np.random.default_rng(2)
    truth, scores = STD * rng.standard_normal(COUNT), scores_of(rng)
    truth[3] = 12.0 * STD[3]
    (one, *others) = judged(truth, scores).conflicts
    assert (one.name, others) == ("C3", [])
    estimates, information = fitted(truth, scores, wide=3)
    assert one.estimate == pytest.approx(estimates[3])
    inverse = np.linalg.inv(information)
    own = inverse @ (information - DATA + COLORED * DATA) @ inverse
    assert one.std == pytest.approx(np.sqrt(own[3, 3]))
    assert one.ratio == pytest.approx(estimates[3] / np.hypot(STD[3], one.std))
    # the wider prior explains the difference: it is one standard deviation of both
    assert np.hypot(one.consistent, one.std) == pytest.approx(abs(one.estimate))


def test_a_conflict_is_counted_once() -> None:
    """A wrong prior moves all other estimates; once it is widened they are where their own priors have them."""
    truth = np.zeros(COUNT)
    truth[3] = 40.0 * STD[3]
    assert [one.name for one in judged(truth, np.zeros(COUNT)).conflicts] == ["C3"]
