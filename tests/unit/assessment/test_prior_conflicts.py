"""Tests of priors against fits without them, and against their distribution where priors and model are right."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest

from stoop.assessment.prior_conflicts import LEVEL, PriorTests, prior_tests
from stoop.vehicle.vehicle import Parameter

COUNT, FLIGHTS = 6, 1500
RNG = np.random.default_rng(7)
ROOT = RNG.standard_normal((COUNT, COUNT)) + 2.0 * np.eye(COUNT)
DATA = 5.0 * ROOT @ ROOT.T  # information of the data, as they are weighted
STD = np.array([0.3, 0.5, 0.2, 1.0, 0.4, 0.6])
#: the scores' covariance over the information: residuals are more correlated than the weights say
COLORED = 2.5


def fitted(truth: np.ndarray, scores: np.ndarray, wide: int = -1) -> tuple[np.ndarray, np.ndarray]:
    """Return estimates and information of a linear fit with priors about zero, one of them left out."""
    prior = np.diag(np.where(np.arange(COUNT) == wide, 0.0, STD**-2.0))
    information = DATA + prior
    return np.linalg.solve(information, DATA @ truth + scores), information


def judged(truth: np.ndarray, scores: np.ndarray) -> PriorTests:
    """Return the tests of the linear fit."""
    estimates, information = fitted(truth, scores)
    inverse = np.linalg.inv(information)
    names = [f"C{i}" for i in range(COUNT)]
    stated = zip(names, STD.tolist(), strict=True)
    layout = SimpleNamespace(parameters=[Parameter(n, 0.0, -9.0, 9.0, True, s, "1") for n, s in stated])
    known = dict(zip(names, estimates.tolist(), strict=True))
    fit: Any = SimpleNamespace(problem=SimpleNamespace(layout=layout), estimates=known)
    covariance = inverse @ (np.diag(STD**-2.0) + COLORED * DATA) @ inverse
    found = SimpleNamespace(information=information, corrected=covariance, cramer_rao=inverse)
    bars: Any = SimpleNamespace(free=np.arange(COUNT), uncertainty=found, scatter=None)
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
