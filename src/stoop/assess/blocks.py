"""Residuals made anew: blocks of innovations, colored again.

The residuals of a fit are colored, often over hundreds of samples. Blocks cut from them directly would break
that color at every joint, and the fit has absorbed part of it. So their color is taken off first, by the
autoregression that also corrects the covariance (what the fit absorbed added back); blocks of what is left
are drawn, all channels together, and colored again. Blocks keep what the autoregression does not explain: the
remaining correlation, heavy tails, and channels that are disturbed at the same time.

References
----------
H. R. Kuensch, "The jackknife and the bootstrap for general stationary observations", *Annals of Statistics*
17(3), 1989, pp. 1217-1241 (moving blocks).
A. C. Davison and D. V. Hinkley, *Bootstrap Methods and their Application*, Cambridge, 1997, section 8.2
(post-blackening).
D. N. Politis and H. White, "Automatic block-length selection for the dependent bootstrap", *Econometric
Reviews* 23(1), 2004, pp. 53-70, and the correction with A. Patton, 28(4), 2009, pp. 372-375.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.signal import lfilter

from stoop.assess.noise import ColoredNoise
from stoop.base.arrays import FloatArray
from stoop.estimate.noise import lagged_products

LONGEST: Final = 0.25  #: of a segment that one block may take: fewer than four would repeat the record
FEWEST: Final = 20  #: innovations of its own that a segment must have; else it takes those of all


def block_length(series: FloatArray) -> float:
    """Return the length of moving blocks that suits a series (n,) best, samples; at least 1.

    Politis and White (2004) with the correction of 2009: the length that minimizes the mean square error of the
    variance of a mean, from the autocovariance up to where it dies away.
    """
    n = len(series)
    centered = series - series.mean()
    most = min(n - 1, int(np.ceil(np.sqrt(n))) + max(5, int(np.log10(max(n, 10)) ** 1.5)))
    sums, _ = lagged_products([centered[:, None]], [np.ones((n, 1))], most)
    covariance = sums[0] / n
    if not covariance[0] > 0.0:
        return 1.0
    last = _dies_at(covariance / covariance[0], n)
    lags = np.arange(-min(2 * last, most), min(2 * last, most) + 1)
    taper = np.clip(2.0 * (1.0 - np.abs(lags) / (2.0 * last)), 0.0, 1.0)
    smoothed = taper * covariance[np.abs(lags)]
    level, slope = float(smoothed.sum()), float(np.sum(np.abs(lags) * smoothed))
    if level <= 0.0:
        return 1.0
    return max(1.0, float(np.cbrt(2.0 * slope**2 / (4.0 / 3.0 * level**2) * n)))


def _dies_at(correlation: FloatArray, n: int) -> int:
    """Return the lag from which a run of autocorrelations is within chance."""
    run = max(5, int(np.sqrt(np.log10(max(n, 10)))))
    small = np.abs(correlation[1:]) < 2.0 * np.sqrt(np.log10(max(n, 10)) / n)
    for lag in range(len(small)):
        if small[lag : lag + run].all():
            return max(1, lag)
    return max(1, len(small))


@dataclass(frozen=True, eq=False)
class Blocks:
    """Draws records of noise like that behind the residuals of a fit.

    Attributes
    ----------
    noise : ColoredNoise
        Color and strength of the weighted noise.
    pools : tuple of (m_i, ny)
        Innovations of each segment, scaled to the strength of the noise; NaN where a reading they need is missing.
    lengths : tuple of int
        Samples of each segment.
    block : int
        Samples of one block.
    """

    noise: ColoredNoise
    pools: tuple[FloatArray, ...]
    lengths: tuple[int, ...]
    block: int

    def draw(self, random: np.random.Generator) -> list[FloatArray]:
        """Return one record (n_i, ny) for each segment."""
        return [self._segment(i, random) for i in range(len(self.lengths))]

    def _segment(self, index: int, random: np.random.Generator) -> FloatArray:
        """Return a record that has run as long before it begins, so that it begins like any other stretch."""
        pool, length = self.pools[index], self.lengths[index]
        block, total = max(1, min(self.block, int(LONGEST * len(pool)))), 2 * length
        starts = random.integers(0, len(pool) - block + 1, -(-total // block))
        rows = (starts[:, None] + np.arange(block)).ravel()[:total]
        innovations = pool[rows]
        gaps = ~np.isfinite(innovations)
        if gaps.any():
            innovations[gaps] = (random.standard_normal(innovations.shape) * self._strength)[gaps]
        columns = zip(self.noise.coefficients, innovations.T, strict=True)
        colored = [lfilter([1.0], np.concatenate([[1.0], -a]), e) for a, e in columns]
        return np.ascontiguousarray(np.array(colored).T[length:])

    @property
    def _strength(self) -> FloatArray:
        return np.asarray(np.sqrt(np.diag(self.noise.innovation)))


def blocks(noise: ColoredNoise, residuals: Sequence[FloatArray]) -> Blocks:
    """Return what draws noise like that of `residuals`, a sequence of weighted (n_i, ny), NaN where missing."""
    order = noise.coefficients.shape[1]
    channels = [whitened([r[:, i] for r in residuals], order) for i in range(len(noise.coefficients))]
    scaled = [_scaled(c, float(np.sqrt(noise.innovation[i, i]))) for i, c in enumerate(channels)]
    own = [np.column_stack(segment) for segment in zip(*scaled, strict=True)]
    whole = np.concatenate(own)
    whole = whole if len(whole) else np.full((1, len(noise.coefficients)), np.nan)
    pools = tuple(pool if len(pool) >= FEWEST else whole for pool in own)
    seen = [column[np.isfinite(column)] for column in whole.T]
    longest = max((block_length(column) for column in seen if len(column) >= FEWEST), default=1.0)
    return Blocks(noise, pools, tuple(len(r) for r in residuals), int(np.ceil(longest)))


def whitened(segments: Sequence[FloatArray], order: int) -> list[FloatArray]:
    """Return what a series cannot foresee of itself, (n_i - order,) for segments (n_i,); NaN where unknown.

    The autoregression is fitted by least squares: one from the autocovariance, as it is used to color, is biased where
    the spectrum is steep, and what little color it leaves would be amplified when the noise is colored again.
    """
    rows = [_lagged(segment, order) for segment in segments]
    table = np.concatenate(rows)
    whole = table[np.isfinite(table).all(axis=1)]
    if len(whole) < FEWEST + 2 * order:
        return [np.full(len(part), np.nan) for part in rows]
    coefficients = np.linalg.lstsq(whole[:, 1:], whole[:, 0], rcond=None)[0]
    return [part[:, 0] - part[:, 1:] @ coefficients for part in rows]


def _lagged(series: FloatArray, order: int) -> FloatArray:
    """Return the series (n - order, order + 1) beside its own past, the latest first."""
    return np.lib.stride_tricks.sliding_window_view(series, order + 1)[:, ::-1]


def _scaled(segments: Sequence[FloatArray], strength: float) -> list[FloatArray]:
    """Return segments with mean zero and a given standard deviation over all of them."""
    seen = np.concatenate(segments)
    seen = seen[np.isfinite(seen)]
    spread = float(np.std(seen)) if seen.size else 0.0
    factor = strength / spread if spread > 0.0 else 0.0
    return [(segment - (seen.mean() if seen.size else 0.0)) * factor for segment in segments]
