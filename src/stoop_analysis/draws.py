"""Draws of the estimated parameters: of a converged posterior, or of the corrected covariance within bounds and priors.

A normal distribution is cut off at the bounds. Parameters whose bounds lie within some standard errors are drawn first, by
rejection from their joint marginal distribution, or by Gibbs sampling where nearly all draws would be rejected; the others
follow from them by the conditional normal distribution. Of a parameter that the data do not determine the prior is drawn,
or, without one, the range between its bounds.

References
----------
C. P. Robert, "Simulation of truncated normal variables", *Statistics and Computing* 5, 1995, pp. 121-125 (Gibbs sampling
of the multivariate case).
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy.special import log_ndtr, ndtri_exp

from stoop import Notice, Vehicle
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import StoopError
from stoop.extend.fits import ParameterEstimate, Result
from stoop.extend.notices import notice

Source = Literal["posterior", "covariance"]
POSTERIOR_FILE: Final = "posterior.nc"
NEAR: Final = 6.0  #: standard errors; a bound farther away is not met
REJECTION_ROUNDS: Final = 40  #: of as many draws as are wanted; then Gibbs sampling
SWEEPS: Final = 200  #: of Gibbs sampling, all draws side by side
COUNTS: Final = (100, 1_000_000)  #: of draws
PRIOR_SHARE: Final = 0.8  #: of the prior's standard deviation; a standard error above it is the prior's


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws of the free parameters."""

    names: tuple[str, ...]
    values: FloatArray  #: (D, k), SI
    source: Source
    #: parameters that the data leave to the prior or to the bounds
    undetermined: tuple[str, ...] = ()
    notices: tuple[Notice, ...] = ()

    def numbers_of(self, vehicle: Vehicle) -> dict[str, FloatArray]:
        """Return the draws (D,) of the numbers of a vehicle and of delays, by name; nuisances are left out."""
        columns = zip(self.names, self.values.T, strict=True)
        return {n: x.copy() for n, x in columns if n in vehicle.rows or n.endswith(".delay")}


def draws_of(
    result: Result,
    posterior: bytes | None,
    count: int,
    seed: int = 0,
    source: Source | None = None,
    where: str = "the result",
) -> Draws:
    """Return draws of a result.

    Parameters
    ----------
    result : Result
    posterior : bytes, optional
        The file ``posterior.nc``, where the posterior was sampled.
    count : int
        Number of draws D; of a posterior no more than it holds.
    seed : int
        Of the draws from the covariance.
    source : {"posterior", "covariance"}, optional
        The posterior where it was sampled when absent.
    where : str
        Name of the result, for messages.

    Raises
    ------
    StoopError
        The posterior has not converged or is not there, the result has no covariance, or the count is out of range.
    """
    if not COUNTS[0] <= count <= COUNTS[1]:
        raise StoopError(f"draws: {count:.4g}; give a number from {COUNTS[0]} to {COUNTS[1]}")
    sampled = result.uncertainty.get("posterior")
    if source == "covariance" or (source is None and sampled is None):
        return from_covariance(result, count, seed)
    if sampled is None:
        raise StoopError(
            f"{where}: its posterior was not sampled; run stoop identify with --posterior, or take --source covariance"
        )
    if any(one.code == "posterior-not-converged" for one in sampled.notes):
        rhat = sampled.figures.get("rhat", float("nan"))
        raise StoopError(
            f"{where}: the posterior has not converged (R-hat {rhat:.3f}); take --source covariance, or fix what the report "
            "calls not identifiable and sample again"
        )
    if posterior is None:
        raise StoopError(f"{where}: holds no {POSTERIOR_FILE}; sample again, or take --source covariance")
    return from_posterior(result, posterior, count, where)


def from_posterior(result: Result, posterior: bytes, count: int, where: str = "the result") -> Draws:
    """Return evenly spaced draws of a posterior file.

    Raises
    ------
    StoopError
        It cannot be read, or holds other parameters than the result.
    """
    import xarray as xr

    names = tuple(result.parameters)
    try:
        with xr.open_dataset(io.BytesIO(posterior), group="posterior", engine="h5netcdf") as data:
            values = np.column_stack([np.ravel(np.asarray(data[n], dtype=np.float64)) for n in names])
    except (OSError, KeyError, ValueError, ImportError) as error:
        raise StoopError(
            f"{where}: {POSTERIOR_FILE}: no draws can be read ({type(error).__name__}: {error}); take --source covariance"
        ) from None
    if not (len(values) and np.isfinite(values).all()):
        raise StoopError(
            f"{where}: {POSTERIOR_FILE}: holds no finite draws; sample again, or take --source covariance"
        )
    chosen = np.linspace(0, len(values) - 1, min(count, len(values))).astype(int)
    rests = tuple(n for n, p in result.parameters.items() if _rests_on_prior(p, p.std_error))
    return Draws(names, values[chosen], "posterior", rests)


def from_covariance(result: Result, count: int, seed: int = 0) -> Draws:
    """Return draws from the corrected covariance of a result; the same seed gives the same draws.

    Raises
    ------
    StoopError
        The result has no covariance, or it determines no parameter.
    """
    names, matrix = result.covariance.names, result.covariance.matrix
    if not names:
        raise StoopError(
            "the result holds no covariance of its parameters; write it again with stoop identify"
        )
    own = [result.parameters[name] for name in names]
    estimates = np.array([p.estimate for p in own])
    low, high = (np.array([getattr(p, end) for p in own]) for end in ("bound_lower", "bound_upper"))
    known = np.isfinite(np.diag(matrix)) & np.isfinite(estimates)
    if not known.any():
        raise StoopError(
            "the covariance of the result determines no parameter; fit maneuvers that move the controls, or fix parameters"
        )
    generator = np.random.default_rng(seed)
    values = np.repeat(estimates[None, :], count, axis=0)
    where = np.ix_(known, known)
    values[:, known] = truncated_normal(
        estimates[known], matrix[where], low[known], high[known], count, generator
    )
    held = []
    for i in np.flatnonzero(~known):
        p = own[i]
        if np.isfinite(p.prior_std) and p.prior_std > 0.0:
            ends = np.array([p.bound_lower]), np.array([p.bound_upper])
            variance = np.array([[p.prior_std**2]])
            drawn = truncated_normal(np.array([p.prior_mean]), variance, *ends, count, generator)
            values[:, i] = drawn[:, 0]
        elif np.isfinite([p.bound_lower, p.bound_upper]).all():
            values[:, i] = generator.uniform(p.bound_lower, p.bound_upper, count)
        else:
            held.append(names[i])
    std = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    rests = tuple(n for n, p, s in zip(names, own, std, strict=True) if _rests_on_prior(p, s))
    notices = (notice("parameters-held", parameters=tuple(held)),) if held else ()
    return Draws(names, values, "covariance", rests, notices)


def _rests_on_prior(p: ParameterEstimate, std: float) -> bool:
    """Whether the data add next to nothing to what was known before: no interval, the box's edge, or the prior's width."""
    known = np.isfinite(std) and not std >= PRIOR_SHARE * p.prior_std
    return not p.identifiable or p.at_bound or not known


def truncated_normal(
    mean: FloatArray,
    covariance: FloatArray,
    low: FloatArray,
    high: FloatArray,
    count: int,
    generator: np.random.Generator,
) -> FloatArray:
    """Return draws (count, k) of a normal distribution with `mean` (k,) and `covariance` (k, k) between bounds (k,)."""
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    with np.errstate(invalid="ignore"):
        near = (sigma > 0.0) & ((mean - low < NEAR * sigma) | (high - mean < NEAR * sigma))
    far, out = ~near, np.empty((count, len(mean)))
    first = np.empty((count, 0))
    if near.any():
        cut = (mean[near], covariance[np.ix_(near, near)], low[near], high[near])
        first = _cut_off(*cut, count, generator)
        out[:, near] = first
    inverse = np.linalg.pinv(covariance[np.ix_(near, near)], hermitian=True)
    gain = covariance[np.ix_(far, near)] @ inverse
    rest = covariance[np.ix_(far, far)] - gain @ covariance[np.ix_(near, far)]
    noise = generator.standard_normal((count, int(far.sum()))) @ _root(rest).T
    out[:, far] = mean[far] + (first - mean[near]) @ gain.T + noise
    # a bound NEAR standard errors away, or an estimate beyond its bound by rounding
    return np.clip(out, low, high)


def _root(matrix: FloatArray) -> FloatArray:
    """Return a matrix whose product with its own transpose is a covariance; scaled, because units differ by decades."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    safe = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(matrix / np.outer(safe, safe))
    return np.asarray(safe[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def _cut_off(
    mean: FloatArray,
    covariance: FloatArray,
    low: FloatArray,
    high: FloatArray,
    count: int,
    generator: np.random.Generator,
) -> FloatArray:
    """Return draws (count, k) of a few parameters near their bounds."""
    root, kept = _root(covariance), np.empty((0, len(mean)))
    for _ in range(REJECTION_ROUNDS):
        drawn = mean + generator.standard_normal((count, len(mean))) @ root.T
        kept = np.concatenate([kept, drawn[((drawn >= low) & (drawn <= high)).all(axis=1)]])
        if len(kept) >= count:
            return kept[:count]
    sigma = np.sqrt(np.diag(covariance))
    precision = np.linalg.pinv(covariance / np.outer(sigma, sigma), hermitian=True)
    z = np.clip(np.zeros((count, len(mean))), (low - mean) / sigma, (high - mean) / sigma)
    ends = (low - mean) / sigma, (high - mean) / sigma
    for _ in range(SWEEPS):
        for i in range(len(mean)):
            spread = 1.0 / np.sqrt(precision[i, i])
            center = z[:, i] - spread**2 * (z @ precision[i])
            a, b = ((end[i] - center) / spread for end in ends)
            z[:, i] = center + spread * _between(a, b, generator.uniform(size=count))
            z[:, i] = np.clip(z[:, i], ends[0][i], ends[1][i])
    return np.asarray(mean + sigma * z)


def _between(a: FloatArray, b: FloatArray, share: FloatArray) -> FloatArray:
    """Return the quantile of a standard normal distribution cut off at a and b, by logarithms: far tails stay exact."""
    flip = a > 0.0  # the lower tail is the accurate one
    low, high = np.where(flip, -b, a), np.where(flip, -a, b)
    share = np.where(flip, 1.0 - share, share)
    bottom, top = log_ndtr(low), log_ndtr(high)
    with np.errstate(divide="ignore"):
        inside = np.logaddexp(np.log1p(-share) + bottom, np.log(share) + top)
    x = ndtri_exp(inside)
    return np.asarray(np.where(flip, -x, x))
