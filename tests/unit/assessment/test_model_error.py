"""Error bars hold what the model lacks, and are as they were where it lacks nothing; what a bound holds makes others lean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from unit.assessment.test_extensions import fitted

from stoop.assessment.error_bars import error_bars
from stoop.assessment.extensions import scored
from stoop.assessment.model_error import LEVEL, lacks_nothing, model_error, variances
from stoop.estimate.fit import OutputErrorEstimate
from stoop.flight import Flight
from stoop.strategy import decision
from stoop.vehicle import Vehicle
from stoop.workflow import identify


def test_variances_of_extensions_that_share_nothing() -> None:
    """Each is what its score exceeds its noise by, or zero: the maximum of the evidence of one number."""
    z, G, S = np.array([5.0, -0.5, 20.0]), np.diag([2.0, 1.0, 4.0]), np.diag([4.0, 1.0, 9.0])
    expected = np.maximum(z**2 - np.diag(S), 0.0) / np.diag(G) ** 2
    assert variances(z, G, S) == pytest.approx(expected, rel=1e-2, abs=1e-6)


def test_variances_of_greatest_evidence() -> None:
    """No other variances explain scores of extensions that resemble each other better."""
    rng = np.random.default_rng(4)
    V = rng.standard_normal((60, 5)) + 1.5 * rng.standard_normal((60, 1))
    G = V.T @ V
    S, z = G.copy(), G @ np.array([0.0, 0.6, 0.0, -0.8, 0.0]) + np.linalg.cholesky(G) @ rng.standard_normal(5)

    def deviance(tau: np.ndarray) -> float:
        C = S + G @ np.diag(tau) @ G
        return float(np.linalg.slogdet(C)[1] + z @ np.linalg.solve(C, z))

    found = variances(z, G, S)
    others = [minimize(deviance, z, bounds=[(0.0, None)] * 5).fun for z in (np.full(5, 0.1), np.eye(5)[1])]
    assert deviance(found) < min(others) + 0.05


def test_scores_of_noise_are_significant_as_often_as_stated() -> None:
    rng = np.random.default_rng(1)
    root = rng.standard_normal((40, 12)) @ rng.standard_normal((12, 40)) + 3.0 * rng.standard_normal((40, 40))
    S = root @ root.T
    std = np.sqrt(np.diag(S))
    draws = (rng.standard_normal((2000, 40)) @ root.T) / std
    share = np.mean([not lacks_nothing(one, S / np.outer(std, std)) for one in draws])
    assert 0.6 * LEVEL < share < 2.0 * LEVEL


def test_a_right_model_keeps_its_error_bars() -> None:
    done = fitted(0.0)
    bars, (found, _) = error_bars(done), decision.test(done)
    known = scored(done, bars)
    assert known is not None
    assert not model_error(known).any()
    assert np.array_equal(found.bars.std, bars.std)
    assert not found.notices


def test_a_lag_that_is_lacking_widens_what_it_moves() -> None:
    """Roll damping and aileron are off by more than their error bars, and not by those that hold what is lacking."""
    done, right = fitted(0.04), fitted(0.0)
    bars, (found, _) = error_bars(done), decision.test(done)
    names = [p.name for p in done.problem.layout.parameters]
    (said,) = (one for one in found.notices if one.code == "bars-widened")
    for name in ("Clp", "Claileron"):
        i = names.index(name)
        off = abs(done.estimates[name] - right.estimates[name])
        assert 3.0 * bars.std[i] < off < 3.0 * found.bars.std[i]
        assert any(text.startswith(name) for text in said.values["most"])
    assert np.all(found.bars.std >= bars.std)
    assert np.array_equal(found.bars.covariance, bars.covariance)


def test_no_number_becomes_less_known_than_its_prior_says(pitch: OutputErrorEstimate) -> None:
    bars = error_bars(pitch)
    own = bars.free < len(bars.std)
    std = np.append(bars.std[bars.free[own]], np.ones(np.count_nonzero(~own)))
    bound = np.array([0.5, 1.2, np.inf])[np.arange(len(std)) % 3]
    wide = replace(bars, priors=bound * std).with_model_error(2.0 * std**2)
    expected = np.clip(bound, 1.0, np.sqrt(3.0))[own]
    assert wide.std[bars.free[own]] / std[own] == pytest.approx(expected)


def test_another_weighting_makes_no_number_less_known_than_its_prior_says(pitch: OutputErrorEstimate) -> None:
    """The prior alone says by how much an estimate is off: its variance and the square of the distance from its mean."""
    apart = np.random.default_rng(3).normal(0.0, 2.0, len(pitch.z))
    alone, both = (error_bars(replace(pitch, by_white=pitch.z + move)) for move in (0.0 * apart, apart))
    layout, free = pitch.problem.layout, both.free[both.free < len(both.std)]
    added, own = (layout.scales * apart)[free], np.ix_(free, free)
    assert both.covariance[own] == pytest.approx(alone.covariance[own] + np.outer(added, added))
    means = [0.0] * layout.dimension + [n.center for n in layout.nuisances]
    limits = [np.hypot(u.prior, u.estimate - m) for u, m in zip(pitch.unknowns, means, strict=True)]
    limits, whole = np.array(limits)[free], np.hypot(alone.std[free], added)
    assert np.isfinite(limits).any()
    assert np.any(whole > limits)
    assert both.std[free] == pytest.approx(np.maximum(alone.std[free], np.minimum(whole, limits)))


def test_a_parameter_at_its_bound_makes_others_lean(wrong: Vehicle, flight: Flight) -> None:
    """CL0 held far from the truth: CLalpha takes its place, with an error bar that is only conditional."""
    boxed = wrong.with_numbers({"CL0": {"value": 0.3, "bounds": (0.2, 0.35)}})
    job = identify(boxed, flight, ["0:12"])
    bars = error_bars(job.estimate)
    assert bars.at_bound[[p.name for p in job.estimate.problem.layout.parameters].index("CL0")]
    assert "CLalpha" in bars.conditional
    held = job.result.parameters["CL0"]
    assert (held.at_bound, np.isnan(held.std_error)) == (True, True)
    assert any("CLalpha" in w and "Known only if CL0" in w for w in job.result.warnings)
