"""Draws: the covariance comes back, bounds cut it off as SciPy does, and what cannot be drawn is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import kstest, truncnorm

from stoop.assessment.draws import draws_of, from_covariance, truncated_normal
from stoop.base.notices import notice
from stoop.errors import StoopError
from stoop.results.result import Covariance, NoiseCovariance, ParameterEstimate, Result
from stoop.results.uncertainty import MethodIntervals

COUNT = 4000
KNOWN = {"a": ParameterEstimate(1.0, 0.1)}


def result(parameters: dict[str, ParameterEstimate], matrix: np.ndarray) -> Result:
    nothing = NoiseCovariance((), np.empty((0, 0)))
    return Result(
        parameters, Covariance(tuple(parameters), matrix), nothing, (), (), (), (), 0.0, 0.0, 0.0, 0, "lm", "converged",
    )  # fmt: skip


def test_far_from_bounds_the_covariance_comes_back() -> None:
    far, rng, mean = np.full(3, 1e3), np.random.default_rng(0), np.array([1.0, 2.0, 3.0])
    covariance = np.array([[4.0, 1.2, 0.0], [1.2, 1.0, 0.3], [0.0, 0.3, 0.5]])
    drawn = truncated_normal(mean, covariance, -far, far, 20_000, rng)
    assert np.allclose(np.cov(drawn.T), covariance, atol=0.1)
    assert np.allclose(drawn.mean(axis=0), mean, atol=0.05)


@pytest.mark.parametrize("low", [-1.0, 0.5, 5.0])
def test_a_bound_cuts_off_as_scipy_does(low: float) -> None:
    """At 5 standard errors nearly all draws are rejected, and Gibbs sampling takes over."""
    rng = np.random.default_rng(1)
    drawn = truncated_normal(np.zeros(1), np.eye(1), np.array([low]), np.array([np.inf]), COUNT, rng)
    assert drawn.min() >= low
    assert kstest(drawn[:, 0], truncnorm(low, np.inf).cdf).pvalue > 0.01


def test_gibbs_sampling_of_two_corners_agrees_with_rejection() -> None:
    rng = np.random.default_rng(4)
    covariance = np.array([[1.0, 0.8], [0.8, 1.0]])
    low, high = np.array([2.8, -np.inf]), np.array([np.inf, 1.0])
    drawn = truncated_normal(np.zeros(2), covariance, low, high, COUNT, rng)
    plain = np.random.default_rng(5).multivariate_normal(np.zeros(2), covariance, 400_000)
    plain = plain[((plain >= low) & (plain <= high)).all(axis=1)]
    assert np.allclose(drawn.mean(axis=0), plain.mean(axis=0), atol=0.05)


def test_what_the_data_do_not_determine_is_drawn_from_prior_or_box_or_held() -> None:
    parameters = {
        "known": ParameterEstimate(1.0, 0.1),
        "prior": ParameterEstimate(2.0, prior_mean=3.0, prior_std=0.5, identifiable=False),
        "box": ParameterEstimate(0.2, bound_lower=0.0, bound_upper=1.0, identifiable=False),
        "held": ParameterEstimate(7.0, identifiable=False),
    }
    found = from_covariance(result(parameters, np.diag([0.01, np.inf, np.inf, np.inf])), COUNT, 0)
    drawn = dict(zip(found.names, found.values.T, strict=True))
    assert drawn["prior"].mean() == pytest.approx(3.0, abs=0.05)
    assert drawn["prior"].std() == pytest.approx(0.5, abs=0.03)
    assert kstest(drawn["box"], "uniform").pvalue > 0.01
    assert np.all(drawn["held"] == 7.0)
    assert found.undetermined == ("prior", "box", "held")
    assert [one.code for one in found.notices] == ["parameters-held"]


def test_what_cannot_be_drawn_from_is_refused_with_the_way_out() -> None:
    figures = {"rhat": 1.3, "sample_size": 20.0, "std_error": 0.2}
    failed = notice("posterior-not-converged", **figures, max_rhat=1.01, needed=400.0, max_std_error=0.03)
    plain = result(KNOWN, np.array([[0.01]]))
    stuck = replace(plain, uncertainty={"posterior": MethodIntervals({}, {"rhat": 1.3}, (failed,))})
    unknown = result({"a": ParameterEstimate(1.0)}, np.array([[np.inf]]))
    for fit, source, advice in (
        (stuck, None, r"not converged \(R-hat 1.300\); take --source covariance"),
        (plain, "posterior", "was not sampled; run stoop identify with --posterior"),
        (result({}, np.empty((0, 0))), "covariance", "holds no covariance"),
        (unknown, "covariance", "determines no parameter"),
    ):
        with pytest.raises(StoopError, match=advice):
            draws_of(fit, None, 100, source=source)
    one, other = (draws_of(stuck, None, 100, source="covariance") for _ in range(2))
    assert (one.source, other.source) == ("covariance", "covariance")
    assert np.array_equal(one.values, other.values)
    assert not np.array_equal(one.values, from_covariance(stuck, 100, 4).values)


def test_draws_of_a_posterior_file(tmp_path: Path) -> None:
    xr = pytest.importorskip("xarray")
    values = np.random.default_rng(0).normal(size=(4, 500))
    data = xr.Dataset({"a": (("chain", "draw"), values)})
    data.to_netcdf(tmp_path / "posterior.nc", group="posterior", engine="h5netcdf")
    fit = replace(result(KNOWN, np.array([[0.01]])), uncertainty={"posterior": MethodIntervals({}, {})})
    found = draws_of(fit, (tmp_path / "posterior.nc").read_bytes(), 1000)
    assert (found.source, found.values.shape) == ("posterior", (1000, 1))
    assert found.values[:, 0].std() == pytest.approx(values.std(), rel=0.05)
