r"""Residuals that repeat themselves from reading to reading, made white by an autoregression of each channel.

Output error leaves gusts, and what the model lacks, in its residuals, most of it slow. Counted as independent, slow residuals
outweigh what the first moments of an input say; where a controller answers gusts, they then bias what is found of its
surfaces. A channel whose readings have the autocorrelation r weighs by the prediction errors of its autoregression instead
(generalized least squares, or prewhitening); the first readings after a gap by those of lower order, so that the likelihood is
that of the stationary process.

References
----------
G. C. Goodwin and R. L. Payne, *Dynamic System Identification*, Academic Press, 1977, sections 3.5 and 5.4.
L. Ljung, *System Identification*, 2nd ed., Prentice Hall, 1999, sections 7.4 and 13.4 (data of a closed loop).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from scipy.linalg import solve_toeplitz, solve_triangular, toeplitz

from stoop.base.arrays import BoolArray, FloatArray
from stoop.problem.weights import Weights


def yule_walker(autocovariance: FloatArray) -> tuple[FloatArray, float]:
    """Return coefficients (p,) and innovation variance of the autoregression with a positive definite autocovariance (p + 1,)."""
    r = autocovariance
    coefficients = solve_toeplitz(r[:-1], r[1:]) if len(r) > 1 and r[0] > 0.0 else np.zeros(len(r) - 1)
    return coefficients, float(r[0] - coefficients @ r[1:])


def least_squares_autoregression(segments: Sequence[FloatArray], order: int) -> tuple[FloatArray, int]:
    """Return coefficients (order,) of the autoregression of a series with NaN in segments (n_i,), and the number of its rows.

    Unlike :func:`yule_walker` it is not biased where the spectrum is steep.
    """
    window = np.lib.stride_tricks.sliding_window_view
    long = [window(s, order + 1)[:, ::-1] for s in segments if len(s) > order]
    rows = np.concatenate([np.empty((0, order + 1)), *long])
    rows = rows[np.isfinite(rows).all(axis=1)]
    return np.linalg.lstsq(rows[:, 1:], rows[:, 0], rcond=None)[0], len(rows)


@dataclass(frozen=True, eq=False)
class ChannelColor:
    """Autocorrelation (p + 1,) of a channel at multiples of the time between its readings; the first is 1.

    Readings are taken in blocks of p: the autoregression leads from one block to the next.
    """

    autocorrelation: FloatArray

    @property
    def order(self) -> int:
        """Number p of readings from which the next one is predicted."""
        return len(self.autocorrelation) - 1

    @cached_property
    def innovation(self) -> float:
        """Variance of the prediction error over that of the channel."""
        return float(self._predictor @ self.autocorrelation)

    @cached_property
    def _predictor(self) -> FloatArray:
        return np.append(1.0, -yule_walker(self.autocorrelation)[0])

    @cached_property
    def _blocks(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What whitens (p, p) the first block, each other block, and what it takes of the block before."""
        a = self._predictor / np.sqrt(self.innovation)
        first = np.linalg.inv(np.linalg.cholesky(toeplitz(self.autocorrelation[:-1])))
        return first, np.tril(toeplitz(a[:-1])), np.triu(toeplitz(a[:0:-1]))

    def whiten(self, y: FloatArray) -> FloatArray:
        """Return white readings (n, m) of unit variance for readings (n, m) of unit variance without a gap."""
        (first, own, before), blocks = self._blocks, self._divided(y)
        out = np.concatenate([first @ blocks[:1], own @ blocks[1:] + before @ blocks[:-1]])
        return out.reshape(-1, y.shape[1])[: len(y)]

    def whiten_back(self, left: FloatArray) -> FloatArray:
        """Return the transpose of :meth:`whiten` times `left` (n, m)."""
        (first, own, before), blocks = self._blocks, self._divided(left)
        out = np.concatenate([first.T @ blocks[:1], own.T @ blocks[1:]])
        out[:-1] += before.T @ blocks[1:]
        return out.reshape(-1, left.shape[1])[: len(left)]

    def colored(self, white: FloatArray) -> FloatArray:
        """Return the inverse of :meth:`whiten`, (n, m)."""
        (first, own, before), blocks = self._blocks, self._divided(white)
        blocks[0] = solve_triangular(first, blocks[0], lower=True)
        for earlier, block in pairwise(blocks):
            block[:] = solve_triangular(own, block - before @ earlier, lower=True)
        return blocks.reshape(-1, white.shape[1])[: len(white)]

    def _divided(self, y: FloatArray) -> FloatArray:
        """Return readings (n, m) in blocks (b, p, m), with zeros behind the last; a copy."""
        out = np.zeros((-(-len(y) // self.order), self.order, y.shape[1]))
        out.reshape(-1, y.shape[1])[: len(y)] = y
        return out


#: of a color: from readings (n, m) without a gap to as many
Method: TypeAlias = Callable[[ChannelColor, FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class Color:
    """The color of every channel, by its readings, which are so many samples apart."""

    channels: tuple[ChannelColor, ...]
    periods: tuple[int, ...]

    @property
    def logdet(self) -> float:
        """Logarithm of the variances of the innovations over those of the channels, the sum."""
        return float(np.sum(np.log([one.innovation for one in self.channels])))

    @property
    def arrays(self) -> dict[str, Any]:
        """Arrays from which :meth:`restored` builds the same."""
        own = {f"color.{i}": one.autocorrelation for i, one in enumerate(self.channels)}
        return {**own, "color.periods": np.array(self.periods)}

    @classmethod
    def restored(cls, arrays: Mapping[str, Any]) -> Color | None:
        """Return the color in arrays; None without any."""
        if "color.periods" not in arrays:
            return None
        periods = tuple(map(int, arrays["color.periods"]))
        return cls(tuple(ChannelColor(arrays[f"color.{i}"]) for i in range(len(periods))), periods)

    def apply(self, method: Method, values: FloatArray, present: BoolArray) -> FloatArray:
        """Return what `method` makes of values (..., n, n_y), zero where not `present` (n, n_y); overwrites them."""
        out = values.reshape(-1, *values.shape[-2:])
        for i, one in enumerate(self.channels):
            if one.order and out[..., i].any():
                for rows in _stretches(present[:, i].tobytes(), self.periods[i]):
                    out[:, rows, i] = method(one, out[:, rows, i].T).T
        return out.reshape(values.shape)

    def whitened(self, residuals: FloatArray) -> FloatArray:
        """Return residuals (n, n_y), NaN where there is none, white and with their variances."""
        present = np.isfinite(residuals)
        white = self.apply(ChannelColor.whiten, np.where(present, residuals, 0.0), present)
        return np.where(present, white, np.nan)


@lru_cache(maxsize=256)
def _stretches(present: bytes, period: int) -> tuple[slice, ...]:
    """Return the readings without a gap of a channel, of which the samples with one are given: the same in every evaluation."""
    rows = np.flatnonzero(np.frombuffer(present, dtype=np.bool_))
    own = np.split(rows, np.flatnonzero(np.diff(rows) != period) + 1)
    return tuple(slice(int(some[0]), int(some[-1]) + 1, period) for some in own if some.size)


@dataclass(frozen=True, eq=False)
class ColoredWeights(Weights):
    """Weights of residuals that have a color; their `root` is diagonal."""

    color: Color

    @property
    def separable(self) -> bool:
        """Readings are weighted by those before."""
        return False

    @property
    def logdet(self) -> float:
        """Logarithm of the determinant of the covariance of the innovations."""
        return super().logdet + self.color.logdet

    def scaled(self, factors: Sequence[float]) -> Weights:
        """Return the weights for a noise whose standard deviations are larger by factors (n_y,)."""
        larger = super().scaled(factors)
        return ColoredWeights(larger.covariance, larger.root, self.color)

    def whiten(self, residuals: FloatArray, present: BoolArray, out: FloatArray | None = None) -> FloatArray:
        """Return residuals (..., n, n_y), zero where nothing was measured, uncorrelated and of unit variance."""
        return self.color.apply(ChannelColor.whiten, super().whiten(residuals, present, out), present)

    def whiten_back(self, left: FloatArray, present: BoolArray) -> FloatArray:
        """Return the transpose of :meth:`whiten` times `left` (n, n_y)."""
        back = self.color.apply(ChannelColor.whiten_back, np.where(present, left, 0.0), present)
        return super().whiten_back(back, present)

    def colored(self, whitened: FloatArray, present: BoolArray) -> FloatArray:
        """Return residuals (n, n_y) in the channels' units from whitened ones: the inverse of :meth:`whiten`."""
        return super().colored(self.color.apply(ChannelColor.colored, whitened.copy(), present), present)

    def innovations(self, residuals: FloatArray) -> FloatArray:
        """Return by how much residuals (n, n_y), NaN where there is none, miss what those before foretell, in their units."""
        return self.color.whitened(residuals) * np.sqrt([one.innovation for one in self.color.channels])
