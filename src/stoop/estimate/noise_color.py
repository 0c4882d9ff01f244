"""Weights of residuals that repeat themselves from reading to reading: an autoregression of each channel, from its residuals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.noise import common_time, correlation_times, lagged_products, noise_variance
from stoop.problem import Misfit, Weights
from stoop.problem.color import ChannelColor, Color, ColoredWeights
from stoop.results.decisions import DecisionRecord

#: s; of 17 flights of JSBSim's aircraft, 0.1 s left errors of estimates a tenth larger in the median
MEMORY: Final = 0.3
MAX_ORDER: Final = 40
READINGS_PER_LAG: Final = 50  #: short records get a lower order, or the autoregression fits its own noise
#: of the variance, that is white at least; from 0.001 to 0.1 estimates are the same to a tenth of their error
WHITE_SHARE: Final = 0.01


def colored_weights(problem: Misfit, residuals: Sequence[FloatArray]) -> ColoredWeights | None:
    """Return the weights by noise and color of residuals (n, n_y) of each piece; None where all channels are white.

    What the autoregressions leave of the color counts as in :func:`~stoop.estimate.noise.effective_variance`.
    """
    pairs, dt = zip(residuals, problem.pieces, strict=True), problem.pieces[0].dt
    own = [r / piece.relative_noise if piece.relative_noise else r for r, piece in pairs]
    times = correlation_times(own, dt)
    if not np.any(times > 1.0):
        return None
    channels = [_channel([r[:, [i]] for r in own], dt, time > 1.0) for i, time in enumerate(times)]
    color = Color(tuple(one for one, _ in channels), tuple(period for _, period in channels))
    left = common_time([color.whitened(r) for r in own], dt)
    plain = Weights.of(noise_variance(problem, residuals) * left)
    return ColoredWeights(plain.covariance, plain.root, color)


def color_record(problem: Misfit, residuals: Sequence[FloatArray]) -> DecisionRecord:
    """Return the record of weights by color, of residuals (n, n_y) of each piece."""
    found = f"residuals are correlated over {common_time(residuals, problem.pieces[0].dt):.0f} samples"
    return DecisionRecord("noise-color", "applied", found, "weighted by what readings before do not foretell")


def _channel(columns: Sequence[FloatArray], dt: float, colored: bool) -> tuple[ChannelColor, int]:
    """Return the color of a channel from its residuals (n, 1) in each piece, and the samples between its readings."""
    there = [np.isfinite(column) for column in columns]
    apart = np.concatenate([np.diff(np.flatnonzero(one)) for one in there])
    period, count = int(np.median(apart)) if apart.size else 1, sum(map(np.sum, there))
    order = min(MAX_ORDER, round(MEMORY / (period * dt)), int(count) // READINGS_PER_LAG)
    if not (colored and order):
        return ChannelColor(np.ones(1)), period
    own = [column[one][:, None] for column, one in zip(columns, there, strict=True) if one.any()]
    sums, _ = lagged_products(own, [np.ones_like(column) for column in own], order)
    return ChannelColor(np.append(1.0, sums[0, 1:] / sums[0, 0] / (1.0 + WHITE_SHARE))), period
