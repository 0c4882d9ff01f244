"""The scatter of maneuvers: its expectation done by simulation, its limits, and coverage under a wrong model."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stoop.assessment.clusters import Influence, cluster_influence, cluster_scatter, moderated_scatter
from stoop.assessment.coloring import ColoredNoise, Coloring
from stoop.assessment.covariance import NORMAL_95, data_information
from stoop.problem.evidence import PieceEvidence, invert

SAMPLES, PARAMETERS, OWN = 60, 12, 2
WHITE = ColoredNoise.white(1)


def sensitivities(clusters: int, seed: int) -> list[np.ndarray]:
    """Return (n, 1, k) of each maneuver: parameters that all share, then unknowns that it alone sees."""
    random, out = np.random.default_rng(seed), []
    for g in range(clusters):
        jacobian = np.zeros((SAMPLES, 1, PARAMETERS + clusters * OWN))
        jacobian[:, 0, :PARAMETERS] = random.normal(size=(SAMPLES, PARAMETERS))
        own = PARAMETERS + g * OWN
        jacobian[:, 0, own : own + OWN] = random.normal(size=(SAMPLES, OWN))
        out.append(jacobian)
    return out


def coloring(
    jacobians: list[np.ndarray], noise: list[np.ndarray], prior: np.ndarray
) -> tuple[Coloring, np.ndarray]:
    """Return a linear fit to noise (n,) of each maneuver, with a prior of mean zero, and its estimates."""
    pieces = [PieceEvidence(v[:, None], J) for v, J in zip(noise, jacobians, strict=True)]
    information = data_information(pieces) + prior
    score = sum(J[:, 0].T @ v for v, J in zip(noise, jacobians, strict=True))
    estimates = np.linalg.solve(information, score)
    fitted = tuple(PieceEvidence(p.residual - p.jacobian @ estimates, p.jacobian) for p in pieces)
    return Coloring(fitted, invert(information), prior), estimates


def test_expectation_and_degrees_of_freedom_by_simulation() -> None:
    """Under the noise that is assumed the ratios average 1, and scatter as chi-squares with their degrees of freedom."""
    jacobians, random = sensitivities(3, seed=1), np.random.default_rng(2)
    prior = np.diag([4.0] * 3 + [0.0] * (PARAMETERS - 3) + [25.0] * (3 * OWN))
    ratios = []
    for _ in range(1500):
        drawn = [random.normal(size=SAMPLES) for _ in jacobians]
        fit, _ = coloring(jacobians, drawn, prior)
        mean = random.normal(size=len(prior)) * np.sqrt(np.diag(prior))  # of the priors, as noise of theirs
        moved = -fit.inverse.matrix @ mean
        shifted = tuple(PieceEvidence(s.residual + s.jacobian @ moved, s.jacobian) for s in fit.segments)
        moves = cluster_influence(Coloring(shifted, fit.inverse, prior), WHITE, [0, 1, 2], PARAMETERS)
        ratios.append(moves.ratio)
    found = np.array(ratios)
    assert_allclose(found.mean(axis=0), 1.0, atol=0.12)
    assert_allclose(found.var(axis=0), 2.0 / moves.degrees, rtol=0.3)


def test_nothing_to_compare() -> None:
    fit, _ = coloring(sensitivities(1, 0), [np.ones(SAMPLES)], np.zeros((PARAMETERS + OWN,) * 2))
    assert cluster_scatter(fit, WHITE, ["one"], PARAMETERS) is None
    apart = sensitivities(2, 0)
    apart[0][:, :, : PARAMETERS // 2] = 0.0  # no parameter in common
    apart[1][:, :, PARAMETERS // 2 : PARAMETERS] = 0.0
    drawn = [np.random.default_rng(i).normal(size=SAMPLES) for i in range(2)]
    fit, _ = coloring(apart, drawn, np.zeros((PARAMETERS + 2 * OWN,) * 2))
    assert cluster_scatter(fit, WHITE, [0, 1], PARAMETERS) is None


def test_common_excess_and_chance() -> None:
    ones, chance = np.ones(40), np.random.default_rng(0).chisquare(3, 40) / 3
    calm, excess, known = (
        moderated_scatter(Influence(ratio, 3.0 * ones, prior * ones), 4)
        for ratio, prior in ((0.9 * ones, 0.0), (9.0 * chance, 0.0), (9.0 * ones, 1.0))
    )
    assert np.all((calm.stretch >= 1.0) & (calm.stretch < 1.15))
    assert excess.excess == pytest.approx(3.0, rel=0.15)
    assert np.median(excess.stretch) == pytest.approx(3.0, rel=0.25)
    assert_allclose(known.stretch, 1.0)  # what the prior says, maneuvers do not change


@pytest.mark.parametrize(("excess", "low", "high"), [(0.0, 0.93, 0.995), (0.4, 0.90, 0.98)])
@pytest.mark.parametrize("clusters", [2, 5])
def test_intervals_of_effects_that_differ_between_maneuvers(
    clusters: int, excess: float, low: float, high: float
) -> None:
    """Parameters that are a little different in each maneuver: intervals hold their mean, and plain ones do not."""
    random, holds, plain = np.random.default_rng(3), [], []
    prior = np.diag([0.0] * PARAMETERS + [25.0] * (clusters * OWN))
    for seed in range(150):
        jacobians = sensitivities(clusters, seed)
        noise = [
            random.normal(size=SAMPLES) + J[:, 0, :PARAMETERS] @ (excess * random.normal(size=PARAMETERS))
            for J in jacobians
        ]
        fit, estimates = coloring(jacobians, noise, prior)
        off = np.abs(estimates / np.sqrt(np.diag(fit.inverse.matrix)))[:PARAMETERS]
        scatter = cluster_scatter(fit, WHITE, list(range(clusters)), PARAMETERS)
        assert scatter is not None
        holds.append(off <= NORMAL_95 * scatter.stretch)
        plain.append(off <= NORMAL_95)
    assert low <= np.mean(holds) <= high
    assert np.mean(plain) < 0.8 or excess == 0.0
