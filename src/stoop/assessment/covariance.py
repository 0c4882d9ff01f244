r"""From information to covariance: for white residuals, for colored ones, and for windows that each begin anew.

With the information D, sensitivities S, the weight R^-1 and the autocovariance Rvv of the residuals, output error with the
weight of white noise has the covariance

    C = D^-1 [ sum_i sum_j S_i' R^-1 Rvv(i - j) R^-1 S_j ] D^-1

(Morelli and Klein); D^-1 alone is the Cramer-Rao bound of white noise. The double sum is a product of spectra. Two refinements
over the paper's sample autocovariance, without which nominal 95 % intervals cover 80 to 90 %: what the fit absorbed of the
noise is added back, and an autoregression continues the autocovariance where its long lags are noise themselves.

Windows that begin anew leave residuals that grow along each window: not stationary, but alike from window to window. Their
covariance is the mean over all windows, every window's residuals with every window's sensitivities,

    C = D^-1 [ P + sum_w S_w' V S_w ] D^-1,    V = mean over v of r_v r_v'

with P the information of the priors. Covariances of neighbors are added with weights that fall to zero (Newey and West), and
the gap from a window's end to the next one's beginning counts among its residuals. A window's residuals are taken as a fit to
all the others would have left them, r + S (D - S'S)^-1 S' r (Bell and McCaffrey).

References
----------
E. A. Morelli and V. Klein, "Accuracy of aerodynamic model parameters estimated from flight test data", *Journal of Guidance,
Control, and Dynamics* 20(1), 1997, pp. 74-80.
R. M. Bell and D. F. McCaffrey, "Bias reduction in standard errors for linear regression with multi-stage samples", *Survey
Methodology* 28(2), 2002, pp. 169-181.
W. K. Newey and K. D. West, "A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent covariance
matrix", *Econometrica* 55(3), 1987, pp. 703-708.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.fft import next_fast_len, rfft
from scipy.linalg import toeplitz

from stoop.base.arrays import BoolArray, ComplexArray, FloatArray
from stoop.estimate.noise import lagged_products
from stoop.problem.evidence import Inverse, PieceEvidence, invert

NORMAL_95: Final = 1.959963984540054  #: two-sided 95 % quantile of the normal distribution
MIN_POWER: Final = 1e-3  #: of the variance, at any frequency; bounds how slow the noise can be
#: of the autoregression: at 100 Hz, slow residuals under white noise still come out right
MAX_ORDER: Final = 20
SAMPLES_PER_LAG: Final = 50  #: short records get a lower order, or the autoregression fits its own noise
#: of what the fit absorbed, which depends on the noise model; afterwards it changes below 1 %
ROUNDS: Final = 3
NEIGHBORS: Final = 3  #: windows whose residuals may still be correlated
MIN_WINDOWS: Final = 12  #: below which a mean over windows says little
#: of the information about a direction, in one window; of more, others foresee nothing
MAX_SHARE: Final = 0.5


def data_information(pieces: Sequence[PieceEvidence]) -> FloatArray:
    """Return Fisher's information (k, k) of the measurements alone, for white noise."""
    count = pieces[0].jacobian.shape[2]
    total = np.zeros((count, count))
    for piece in pieces:
        rows = piece.filled()[1].reshape(-1, count)
        own = np.flatnonzero(rows.any(axis=0))  # not the initial states and biases of other maneuvers
        part = rows[:, own]
        total[np.ix_(own, own)] += part.T @ part
    return total


def marked(covariance: FloatArray, determined: BoolArray) -> FloatArray:
    """Return `covariance` (k, k) with infinite variance, and NaN covariances, for what is not determined."""
    result = np.array(covariance)
    result[~determined, :] = np.nan
    result[:, ~determined] = np.nan
    np.fill_diagonal(result, np.where(determined, np.diag(covariance), np.inf))
    return result


def standard_errors(covariance: FloatArray) -> FloatArray:
    """Return the square roots (k,) of the variances; infinite where nothing is known."""
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def correlation(covariance: FloatArray) -> FloatArray:
    """Return the correlation matrix (k, k); NaN for unknowns without a finite, positive variance."""
    sigma = standard_errors(covariance)
    sigma = np.where(np.isfinite(sigma) & (sigma > 0.0), sigma, np.nan)
    matrix = np.clip(covariance / np.outer(sigma, sigma), -1.0, 1.0)
    np.fill_diagonal(matrix, 1.0)
    return matrix


@dataclass(frozen=True, eq=False)
class ColoredNoise:
    """An autoregression per channel: v[n] = sum_i coefficients[:, i] v[n - 1 - i] + w[n], cov(w) = innovation."""

    coefficients: FloatArray  #: (ny, order)
    innovation: FloatArray  #: (ny, ny)

    def gain(self, size: int) -> ComplexArray:
        """Return the frequency response (size // 2 + 1, ny) from innovation to noise, for an FFT of `size`.

        The power spectrum, transform of E[v(i + l) v(i)'], is G cov(w) G^H with G the diagonal matrix of the response.
        """
        ones = np.ones((len(self.coefficients), 1))
        return np.asarray(1.0 / rfft(np.concatenate([ones, -self.coefficients], axis=1), size, axis=1).T)

    def variance(self, columns: FloatArray) -> FloatArray:
        """Return the variances (m,) of the sums of noise times columns (n, n_y, m)."""
        size = next_fast_len(2 * len(columns), real=True)
        twice = np.full(size // 2 + 1, 2.0)
        twice[[0, -1] if size % 2 == 0 else 0] = 1.0
        spectrum = rfft(columns, size, axis=0) * self.gain(size).conj()[:, :, None]
        mixed = self.innovation @ spectrum
        return np.asarray(np.einsum("f,fim,fim->m", twice / size, spectrum.conj(), mixed).real)


def autocorrelation(residuals: Sequence[FloatArray], lags: int) -> FloatArray:
    """Return the residual autocorrelation (ny, lags + 1) over segments (n_i, ny) with NaN where missing.

    Normalized by the variance over all samples; NaN for a channel without residuals.
    """
    present = [np.isfinite(residual) for residual in residuals]
    filled = [np.where(mask, residual, 0.0) for residual, mask in zip(residuals, present, strict=True)]
    sums, _ = lagged_products(filled, [mask.astype(np.float64) for mask in present], lags)
    return sums / np.where(sums[:, :1] > 0.0, sums[:, :1], np.nan)


def fit_noise(autocovariance: FloatArray, residuals: Sequence[FloatArray]) -> ColoredNoise:
    """Return the autoregressions with the given autocovariance (ny, order + 1).

    White noise is added first where holes in the data or their correction made an autocovariance impossible; residuals, a
    sequence of (n_i, ny), give the correlation of the innovations between channels.
    """
    channels, order = len(autocovariance), autocovariance.shape[1] - 1
    coefficients, power = np.zeros((channels, order)), np.zeros(channels)
    for i, channel in enumerate(autocovariance):
        possible = channel.copy()
        least = float(np.linalg.eigvalsh(toeplitz(possible))[0])
        possible[0] += max(0.0, MIN_POWER * abs(float(possible[0])) - least)
        coefficients[i], power[i] = _levinson(possible)
    total = np.zeros((channels, channels))
    for residual in residuals:
        innovations = residual[order:].copy()
        for lag in range(order):
            innovations -= coefficients[:, lag] * residual[order - 1 - lag : len(residual) - 1 - lag]
        total += innovations.T @ innovations
    own = np.sqrt(np.diag(total))
    own = np.where(own > 0.0, own, 1.0)
    related = total / np.outer(own, own)
    np.fill_diagonal(related, 1.0)
    std = np.sqrt(power)
    return ColoredNoise(coefficients, np.outer(std, std) * related)


def _levinson(autocovariance: FloatArray) -> tuple[FloatArray, float]:
    """Return the coefficients and the innovation's variance by the Levinson-Durbin recursion."""
    coefficients = np.zeros(0)
    power = float(autocovariance[0])
    for order in range(1, len(autocovariance)):
        rest = float(autocovariance[order] - coefficients @ autocovariance[order - 1 : 0 : -1])
        reflection = rest / power if power > 0.0 else 0.0
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        power *= 1.0 - reflection**2
    return coefficients, power


@dataclass(frozen=True, eq=False)
class Coloring:
    """The sensitivities and residuals of a fit in the frequency domain, in coordinates of unit information."""

    segments: tuple[PieceEvidence, ...]
    inverse: Inverse  #: of the information that the fit used, priors included
    prior: FloatArray  #: (k, k); information of the priors

    def noise(self) -> ColoredNoise:
        """Return the noise behind the residuals: their color, with what the fit absorbed added back.

        With residuals v - S d and d = D^-1 S' v, the lagged products of v exceed those of the residuals by the mean of
        S d v' + v d' S' - S d d' S'; channels are taken one by one.
        """
        lengths = [len(segment.residual) for segment in self.segments]
        order = max(1, min(MAX_ORDER, sum(lengths) // SAMPLES_PER_LAG, min(lengths) - 1))
        residuals = [segment.filled()[0] for segment in self.segments]
        present = [segment.present.astype(np.float64) for segment in self.segments]
        sums, counts = lagged_products(residuals, present, order)
        share, pairs = counts / np.maximum(counts[:, :1], 1.0), np.maximum(counts, 1.0)
        noise = fit_noise(sums / pairs, residuals)
        for _ in range(ROUNDS):
            spread = self._spread([block.middle(noise, joint=False) for block in self._blocks])
            absorbed = np.zeros_like(share)
            for block in self._blocks:
                crossed, squared = block.lagged(noise, spread, order)
                absorbed += crossed * share - squared
            noise = fit_noise((sums + absorbed) / pairs, residuals)
        return noise

    def covariance(self, noise: ColoredNoise) -> FloatArray:
        """Return the covariance (k, k) of the estimates under `noise`."""
        factor = self.inverse.factor
        return np.asarray(factor @ self._spread([block.middle(noise) for block in self._blocks]) @ factor.T)

    def _spread(self, middles: Sequence[FloatArray]) -> FloatArray:
        """Return the covariance (r, r) of the scores, from that of each segment in its own directions."""
        turned = (b.basis.T @ middle @ b.basis for b, middle in zip(self._blocks, middles, strict=True))
        return np.asarray(sum(turned) + self.inverse.factor.T @ self.prior @ self.inverse.factor)

    @cached_property
    def _blocks(self) -> tuple[_Block, ...]:
        return tuple(_Block.of(segment, self.inverse.factor) for segment in self.segments)


@dataclass(frozen=True, eq=False)
class _Block:
    """Spectrum of the sensitivities of one segment, in a of the r unit-information coordinates."""

    size: int  #: of the FFT
    basis: FloatArray  #: orthonormal rows (a, r): the directions that this segment sees
    parts: FloatArray  #: real and imaginary part (2, size // 2 + 1, ny, a), scaled to sums over time

    @classmethod
    def of(cls, segment: PieceEvidence, factor: FloatArray) -> _Block:
        """Return the spectrum of a segment."""
        jacobian = segment.filled()[1]
        active = jacobian.any(axis=(0, 1))
        left, stretch, basis = np.linalg.svd(factor[active], full_matrices=False)
        size = next_fast_len(2 * len(jacobian), real=True)  # the autocovariance does not wrap around
        spectrum = np.asarray(rfft(jacobian[:, :, active] @ (left * stretch), size, axis=0))
        twice = np.full(len(spectrum), 2.0)
        twice[[0, -1] if size % 2 == 0 else 0] = 1.0
        return cls(
            size, basis, np.stack([spectrum.real, spectrum.imag]) * np.sqrt(twice / size)[:, None, None]
        )

    def middle(self, noise: ColoredNoise, joint: bool = True) -> FloatArray:
        """Return the double sum (a, a) over this segment: S' V S; on demand without correlation between channels."""
        gain, innovation = noise.gain(self.size), noise.innovation
        if joint:
            spectrum = gain[:, :, None] * innovation * gain.conj()[:, None, :]
            colored = spectrum @ (self.parts[0] + 1j * self.parts[1])
            left, right = self.parts, np.stack([colored.real, colored.imag])
        else:
            left = right = self.parts * np.sqrt(np.abs(gain) ** 2 * np.diag(innovation))[:, :, None]
        product: FloatArray = left.reshape(-1, left.shape[-1]).T @ right.reshape(-1, right.shape[-1])
        return 0.5 * (product + product.T)

    def lagged(self, noise: ColoredNoise, spread: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
        """Return the lagged products (ny, order + 1) of S d with v, both ways, and of S d with itself."""
        noise_power = np.abs(noise.gain(self.size)) ** 2 * np.diag(noise.innovation)
        crossed = np.einsum("cfya,cfya->fy", self.parts, self.parts) * noise_power
        rows = self.parts.reshape(-1, self.parts.shape[-1])  # one large product, not one per frequency
        power = np.einsum("na,na->n", rows @ (self.basis @ spread @ self.basis.T), rows)
        squared = power.reshape(self.parts.shape[:3]).sum(axis=0)
        wave = np.cos(2.0 * np.pi / self.size * np.outer(np.arange(len(crossed)), np.arange(order + 1)))
        return 2.0 * crossed.T @ wave, squared.T @ wave


def windowed_covariance(
    segments: Sequence[PieceEvidence],
    edges: Sequence[Sequence[int]],
    gaps: Sequence[tuple[FloatArray, FloatArray]],
    prior: FloatArray,
) -> FloatArray | None:
    """Return the covariance (k, k) of the estimates from the windows of each piece; None where they are too few.

    `edges` are the first sample of each window of a piece, then the number of its samples; `gaps` ((w - 1, e), (w - 1, e, k))
    from each window to the next, whitened, and their derivatives; `prior` (k, k) is the information of priors and gaps.
    """
    if sum(len(e) - 1 for e in edges) < MIN_WINDOWS:
        return None
    filled = [segment.filled() for segment in segments]
    rows = [j.reshape(-1, j.shape[2]) for _, j in filled]
    inverse = invert(prior + sum(j.T @ j for j in rows))
    middle = prior.copy()
    for (residual, jacobian), own, (gap, gap_jacobian) in zip(filled, edges, gaps, strict=True):
        # each window's residuals (w, m) with the gap behind it, and their derivatives (w, m, k)
        length, starts = int(np.min(np.diff(own))), own[:-1]
        r = np.stack([residual[a : a + length].ravel() for a in starts])
        S = np.stack([jacobian[a : a + length].reshape(r.shape[1], -1) for a in starts])
        r = np.concatenate([r, np.pad(gap, [(0, 1), (0, 0)])], axis=1)
        S = np.concatenate([S, np.pad(gap_jacobian, [(0, 1), (0, 0), (0, 0)])], axis=1)
        alone = np.stack([leave_window_out(*one, inverse.factor) for one in zip(r, S, strict=True)])
        met = gap_jacobian.reshape(-1, gap_jacobian.shape[2])
        total, recent = np.zeros_like(prior), deque[FloatArray](maxlen=1 + max(0, min(NEIGHBORS, len(r) - 2)))
        for S_w in S:  # the covariance of the scores' sum, and of neighbors
            recent.appendleft(alone @ S_w)  # window of the residual, unknown
            for lag, before in enumerate(recent):
                pair = before[: len(r) - lag].T @ recent[0][lag:]
                total += pair if lag == 0 else (1.0 - lag / (NEIGHBORS + 1.0)) * (pair + pair.T)
        middle += total / len(r) - met.T @ met  # of all lags alike: no variance is negative then
    return marked(inverse.matrix @ middle @ inverse.matrix, inverse.determined)


def leave_window_out(r: FloatArray, S: FloatArray, factor: FloatArray) -> FloatArray:
    """Return the residuals (m,) of a window as a fit to all others leaves them; `factor` (k, d) is the inverse's."""
    own = S @ factor
    share, along = np.linalg.eigh(own.T @ own)
    others = np.where(share < MAX_SHARE, 1.0 / (1.0 - np.minimum(share, MAX_SHARE)), 0.0)
    return np.asarray(r + own @ (along @ (others * (along.T @ (own.T @ r)))))


def widened(covariance: FloatArray, other: FloatArray) -> FloatArray:
    """Return a covariance (k, k) with each standard error at least that of another; correlations stay."""
    own, least = (np.sqrt(np.diag(c)) for c in (covariance, other))
    with np.errstate(invalid="ignore", divide="ignore"):
        stretch = np.where(least > own, least / own, 1.0)
    stretch = np.where(np.isfinite(stretch) & (own > 0.0), stretch, 1.0)
    return np.asarray(covariance * np.outer(stretch, stretch))
