"""The measurement noise covariance, given in a file or by maximum likelihood from residuals, and weights by its color.

For a given trajectory the likelihood is greatest at R = mean of the residuals' outer products; R then
changes the weights (Klein and Morelli, *Aircraft System Identification*, 2nd ed., section 6.2). Residuals that repeat themselves
from reading to reading weigh by an autoregression of each channel.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from stoop.base.arrays import FloatArray
from stoop.base.files import read_bounded, utf8_text
from stoop.errors import IdentificationError
from stoop.problem import Misfit, Weights, on_circle
from stoop.problem.color import ChannelColor, Color, ColoredWeights
from stoop.results.decisions import DecisionRecord

#: of a channel's median spread within its pieces: no channel is trusted further than that
FLOOR: Final = 1e-5
SENSOR_FLOOR: Final = 1e-3  #: of the noise that the vehicle file gives a sensor, likewise
#: of a channel's spread: noise before anything is known, so that no channel dominates
FIRST_GUESS: Final = 0.5
MAX_LAG: Final = 2.0  #: s; residuals further apart are taken as independent
MAX_BYTES: Final = 100_000  #: of a covariance file
#: s; of 17 flights of JSBSim's aircraft, 0.1 s left errors of estimates a tenth larger in the median
MEMORY: Final = 0.3
MAX_ORDER: Final = 40
READINGS_PER_LAG: Final = 50  #: short records get a lower order, or the autoregression fits its own noise
#: of the variance, that is white at least; from 0.001 to 0.1 estimates are the same to a tenth of their error
WHITE_SHARE: Final = 0.01


def channel_residuals(problem: Misfit, z: FloatArray) -> list[FloatArray]:
    """Return measured minus simulated (n, n_y) of every piece, NaN where nothing was measured."""
    outputs = problem.layout.vehicle.outputs
    return [on_circle(p.measured - problem.outputs(z, i), outputs) for i, p in enumerate(problem.pieces)]


def noise_variance(problem: Misfit, residuals: Sequence[FloatArray]) -> FloatArray:
    """Return the maximum-likelihood variance (n_y,) of residuals (n, n_y) of each piece, kept above a floor.

    Residuals count over the relative noise of their piece.
    """
    pieces = zip(residuals, problem.pieces, strict=True)
    errors = np.concatenate([r / p.relative_noise if p.relative_noise else r for r, p in pieces])
    sensors, outputs = problem.layout.vehicle.file.sensors, problem.layout.vehicle.outputs
    spreads = FLOOR**2 * spread_within(problem)
    out = np.ones(errors.shape[1])
    for i, channel in enumerate(outputs):
        present = np.isfinite(errors[:, i])
        if present.any():
            floor = spreads[i] + (SENSOR_FLOOR * getattr(sensors, channel).sigma) ** 2
            out[i] = max(float(np.mean(errors[present, i] ** 2)), floor)
    return out


def noise_covariance(problem: Misfit, residuals: Sequence[FloatArray]) -> FloatArray:
    """Return the diagonal covariance (n_y, n_y) of :func:`noise_variance`; NaN for a channel that was never measured."""
    measured = np.any([np.isfinite(r).any(axis=0) for r in residuals], axis=0)
    return np.diag(np.where(measured, noise_variance(problem, residuals), np.nan))


def effective_variance(problem: Misfit, residuals: Sequence[FloatArray]) -> FloatArray:
    """Return the variance (n_y,) with which a channel weighs: its noise times the common correlation time.

    Correlated residuals repeat themselves: counted as independent they would drown the priors. One number,
    the median over the channels, is used for all: the channels' weights among each other stay those of
    maximum likelihood, and a channel that fits badly is not given up for it. For white residuals it is 1.
    """
    return noise_variance(problem, residuals) * common_time(residuals, problem.pieces[0].dt)


def first_variance(problem: Misfit) -> FloatArray:
    """Return a variance (n_y,) to begin with: a share of each channel's spread.

    One for a channel that was not measured or does not move.
    """
    spread = spread_within(problem)
    return FIRST_GUESS**2 * np.where(spread > 0.0, spread, 1.0)


def spread_within(problem: Misfit) -> FloatArray:
    """Return the median variance (n_y,) of a channel within its pieces; zero where nothing was measured.

    Over all pieces it would be, of a position, how far the vehicle went between them.
    """
    out = []
    for columns in zip(*(p.measured.T for p in problem.pieces), strict=True):
        own = [float(np.var(y[np.isfinite(y)])) for y in columns if np.isfinite(y).any()]
        out.append(float(np.median(own)) if own else 0.0)
    return np.array(out)


def correlation_times(residuals: Sequence[FloatArray], dt: float) -> FloatArray:
    """Return how many residuals of each channel say as much as one independent residual (n_y,), at least 1.

    The integrated autocorrelation 1 + 2 sum r_k up to its first zero crossing, k counting readings. A channel whose
    neighbors are uncorrelated within chance counts as white.
    """
    present = [np.isfinite(r).astype(float) for r in residuals]
    sums, counts = lagged_products([np.nan_to_num(r) for r in residuals], present, round(MAX_LAG / dt))
    out = np.ones(len(sums))
    for i in range(len(sums)):
        if counts[i, 0] < 10 or sums[i, 0] <= 0.0:
            continue
        apart = np.concatenate([np.diff(np.flatnonzero(column[:, i])) for column in present])
        if not apart.size:  # one reading in each piece
            continue
        total, pairs = by_readings(np.array([sums[i], counts[i]]), round(float(np.median(apart))))
        r = (total / np.maximum(pairs, 1.0)) / (total[0] / pairs[0])
        if len(r) > 1 and r[1] >= 2.0 / np.sqrt(pairs[0]):
            negative = np.flatnonzero(r <= 0.0)
            end = int(negative[0]) if negative.size else len(r)
            out[i] = max(1.0, 1.0 + 2.0 * float(np.sum(r[1:end])))
    return out


def common_time(residuals: Sequence[FloatArray], dt: float) -> float:
    """Return the median of :func:`correlation_times` over the channels that were measured."""
    present = np.any([np.isfinite(r).any(axis=0) for r in residuals], axis=0)
    return float(np.median(correlation_times(residuals, dt)[present]))


def by_readings(sums: FloatArray, period: int) -> FloatArray:
    """Return sums (..., l) over pairs l samples apart as sums over pairs k readings apart, `period` samples each."""
    nearest = (np.arange(sums.shape[-1]) + period // 2) // period
    return np.asarray(np.add.reduceat(sums, np.flatnonzero(np.diff(nearest, prepend=-1)), axis=-1))


def lagged_products(
    residuals: Sequence[FloatArray], present: Sequence[FloatArray], lags: int
) -> tuple[FloatArray, FloatArray]:
    """Return the sums (ny, lags + 1) over all segments of v(i) v(i + l), l from 0 to `lags`, by Fourier transforms.

    Likewise how many products they hold. Segments (n_i, ny) have zeros where a residual is missing, `present` ones where not.
    """

    def correlate(values: FloatArray) -> FloatArray:
        size = next_fast_len(len(values) + lags, real=True)
        transformed = rfft(values, size, axis=0)
        return np.asarray(irfft(np.abs(transformed) ** 2, size, axis=0)[: lags + 1].T)

    sums, counts = sum(map(correlate, residuals)), sum(map(correlate, present))
    return np.asarray(sums), np.maximum(np.rint(np.asarray(counts)), 0.0)


def colored_weights(problem: Misfit, residuals: Sequence[FloatArray]) -> ColoredWeights | None:
    """Return the weights by noise and color of residuals (n, n_y) of each piece; None where all channels are white.

    What the autoregressions leave of the color counts as in :func:`effective_variance`.
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


def is_covariance(matrix: FloatArray) -> bool:
    """Tell whether a square matrix is symmetric and positive definite, of one channel at least."""
    sound = matrix.size > 0 and np.isfinite(matrix).all() and np.allclose(matrix, matrix.T)
    return bool(sound and np.linalg.eigvalsh(matrix)[0] > 0.0)


def read_covariance(path: Path, channels: Sequence[str]) -> FloatArray:
    """Read variances (n_y,) or a covariance (n_y, n_y), the inverse of eq. (3)'s Q, from a small CSV.

    Raises
    ------
    IdentificationError
        Missing, not readable, wrong shape, or not symmetric positive definite.
    """
    wanted = f"one row of {len(channels)} variances, or a {len(channels)} by {len(channels)} matrix, for {', '.join(channels)}"
    try:
        text = utf8_text(read_bounded(path, MAX_BYTES))
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # that it is empty
            matrix = np.loadtxt(io.StringIO(text), delimiter=",", ndmin=2, dtype=np.float64)
    except FileNotFoundError:
        raise IdentificationError(f"{path}: no such file; check the name") from None
    except UnicodeError as error:
        raise IdentificationError(f"{path}: {error}") from None
    except (OSError, ValueError, UserWarning):
        raise IdentificationError(f"{path}: cannot be read as numbers; write {wanted}") from None
    if matrix.shape == (1, len(channels)):
        matrix = np.diag(matrix[0])
    if matrix.shape != (len(channels), len(channels)):
        raise IdentificationError(f"{path}: has shape {matrix.shape}; write {wanted}")
    if not is_covariance(matrix):
        raise IdentificationError(f"{path}: is not symmetric positive definite; a covariance must be")
    return matrix
