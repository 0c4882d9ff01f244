r"""The color of residuals, and the covariance of estimates under it.

With the information D, sensitivities S, the weight R^-1 and the autocovariance Rvv of the residuals, output error with the
weight of white noise has the covariance

    C = D^-1 [ sum_i sum_j S_i' R^-1 Rvv(i - j) R^-1 S_j ] D^-1

(Morelli and Klein). Residuals of a model that is not quite right are large where its readings are curved, too: the estimates then
move by H^-1 per score and not by D^-1, with the Hessian H of half the cost, S' R^-1 S less the residuals times the second
derivatives (White). Where the model is right the two agree. The double sum is a product of spectra.

Two refinements over the paper's sample autocovariance, without which nominal 95 % intervals cover 80 to 90 %: what the fit
absorbed of the noise is added back, and an autoregression continues the autocovariance where its long lags are noise themselves.
Gusts and errors of recorded inputs pass through the dynamics and disturb several channels at once, with phases between them: the
coherency of the innovations between channels is estimated by bands of frequency, averaged over all segments.

References
----------
E. A. Morelli and V. Klein, "Accuracy of aerodynamic model parameters estimated from flight test data", *Journal of Guidance,
Control, and Dynamics* 20(1), 1997, pp. 74-80.
H. White, "Maximum likelihood estimation of misspecified models", *Econometrica* 50(1), 1982, pp. 1-25, theorem 3.2.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.fft import next_fast_len, rfft
from scipy.linalg import toeplitz

from stoop.assessment.covariance import inverse_information
from stoop.base.arrays import ComplexArray, FloatArray, IntArray
from stoop.estimate.noise import lagged_products
from stoop.problem.color import yule_walker
from stoop.problem.evidence import Inverse, PieceEvidence

MIN_POWER: Final = 1e-3  #: of the variance, at any frequency; bounds how slow the noise can be
#: of the autoregression: slow residuals under white noise come out right at 100 Hz, a lightly damped mode in gusts at 50 Hz
MAX_ORDER: Final = 40
SAMPLES_PER_LAG: Final = 50  #: short records get a lower order, or the autoregression fits its own noise
#: of what the fit absorbed, which depends on the noise model; afterwards it changes below 1 %
ROUNDS: Final = 3
MEMORY: Final = 4.0  #: mean segments; noise that decays more slowly cannot be told from a constant
SPAN: Final = 16.0  #: memories, over which the variance of the slowest noise is summed
#: share of the readings at a lag, over that at the lag which has most, below which a slow channel has too few there
FEW_PAIRS: Final = 0.25
#: independent frequencies of the narrowest band, per channel; with fewer than 1 all channels cohere
BAND_DEGREES: Final = 2.5
BAND_GROWTH: Final = 1.5  #: width of a band over that of the one below
#: least eigenvalue of the Hessian over the information: a cost that bends less is no parabola over a standard error
MIN_CURVATURE: Final = 0.1
#: least eigenvalue; what the fit absorbed is an estimate and can leave a negative one
MIN_COHERENCY: Final = 1e-6


@dataclass(frozen=True, eq=False)
class ColoredNoise:
    """An autoregression per channel: v[n] = sum_i coefficients[:, i] v[n - 1 - i] + w[n], cov(w) = innovation.

    With a coherency the channels of w depend on each other by bands of frequency, each channel alone being white.
    """

    coefficients: FloatArray  #: (ny, order)
    innovation: FloatArray  #: (ny, ny)
    edges: FloatArray | None = None  #: (b + 1,) of the bands, cycles per sample, 0 to 0.5
    coherency: ComplexArray | None = None  #: (b, ny, ny), Hermitian with unit diagonals

    @classmethod
    def white(cls, channels: int) -> ColoredNoise:
        """Return noise of unit variance without memory."""
        return cls(np.zeros((channels, 0)), np.eye(channels))

    def gain(self, size: int) -> ComplexArray:
        """Return the frequency response (size // 2 + 1, ny) from innovation to noise, for an FFT of `size`.

        The power spectrum, transform of E[v(i + l) v(i)'], is G cov(w) G^H with G the diagonal matrix of the response.
        """
        ones = np.ones((len(self.coefficients), 1))
        return np.asarray(1.0 / rfft(np.concatenate([ones, -self.coefficients], axis=1), size, axis=1).T)

    def bands(self, size: int) -> list[slice]:
        """Return the frequencies of an FFT of `size` over which the innovations' covariance is one; b of them."""
        if self.edges is None:
            return [slice(0, size // 2 + 1)]
        first = np.searchsorted(band_numbers(self.edges, size), np.arange(len(self.edges)))
        return [slice(a, b) for a, b in itertools.pairwise(first.tolist())]

    @property
    def powers(self) -> ComplexArray:
        """Covariance (b, ny, ny) of the innovations in each band."""
        if self.edges is None or self.coherency is None:
            return self.innovation.astype(np.complex128)[None]
        std = np.sqrt(np.diag(self.innovation))
        return np.asarray(np.outer(std, std) * self.coherency)

    @property
    def roots(self) -> ComplexArray:
        """Matrices L (b, ny, ny) with L L^H the covariance of the innovations in each band."""
        values, vectors = np.linalg.eigh(self.powers)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])

    def variance(self, columns: FloatArray) -> FloatArray:
        """Return the variances (m,) of the sums of noise times columns (n, n_y, m)."""
        return np.asarray(sum(np.einsum("nm,nm->m", rows, rows) for rows in self._rows(columns)))

    def covariance(self, columns: FloatArray) -> FloatArray:
        """Return the covariance (m, m) of the sums of noise times columns (n, n_y, m)."""
        return np.asarray(sum(rows.T @ rows for rows in self._rows(columns)))

    def _rows(self, columns: FloatArray) -> Iterator[FloatArray]:
        """Yield rows (., m) whose products, added up, are those of the noise times columns (n, n_y, m)."""
        size = next_fast_len(2 * len(columns), real=True)
        weight = half_spectrum_scale(size)[:, None] * self.gain(size).conj()
        colored = rfft(columns, size, axis=0) * weight[:, :, None]
        for band, root in zip(self.bands(size), self.roots, strict=True):
            mixed = (root.conj().T @ colored[band]).reshape(-1, columns.shape[2])
            yield mixed.real
            yield mixed.imag


def band_edges(samples: int, channels: int) -> FloatArray:
    """Return edges (b + 1,) of bands, cycles per sample, in which so many samples determine a matrix of the channels."""
    width, edges = BAND_DEGREES * channels / samples, [0.0]
    while edges[-1] + (1.0 + BAND_GROWTH) * width < 0.5:  # else the last band takes what is left
        edges.append(edges[-1] + width)
        width *= BAND_GROWTH
    return np.array([*edges, 0.5])


def band_numbers(edges: FloatArray, size: int) -> IntArray:
    """Return the band (size // 2 + 1,) of each frequency of an FFT of `size`."""
    frequencies = np.arange(size // 2 + 1) / size
    return np.asarray(np.minimum(np.searchsorted(edges, frequencies, side="right") - 1, len(edges) - 2))


def normalized_coherency(powers: ComplexArray) -> ComplexArray:
    """Return the coherency (b, ny, ny) of cross-powers (b, ny, ny), positive definite; identity for an idle channel."""
    strength = np.sqrt(np.maximum(np.einsum("bii->bi", powers).real, 0.0))
    idle = strength <= 0.0
    strength = np.where(idle, 1.0, strength)
    scaled = powers / (strength[:, :, None] * strength[:, None, :])
    scaled = 0.5 * (scaled + scaled.conj().transpose(0, 2, 1)) + idle[:, :, None] * np.eye(powers.shape[-1])
    values, vectors = np.linalg.eigh(scaled)
    possible = (vectors * np.maximum(values, MIN_COHERENCY)[:, None, :]) @ vectors.conj().transpose(0, 2, 1)
    own = np.sqrt(np.einsum("bii->bi", possible).real)
    return np.asarray(possible / (own[:, :, None] * own[:, None, :]))


def autocorrelation(residuals: Sequence[FloatArray], lags: int) -> FloatArray:
    """Return the residual autocorrelation (ny, lags + 1) over segments (n_i, ny) with NaN where missing.

    Normalized by the variance over all samples; NaN for a channel without residuals.
    """
    present = [np.isfinite(residual) for residual in residuals]
    filled = [np.where(mask, residual, 0.0) for residual, mask in zip(residuals, present, strict=True)]
    sums, _ = lagged_products(filled, [mask.astype(np.float64) for mask in present], lags)
    return sums / np.where(sums[:, :1] > 0.0, sums[:, :1], np.nan)


def fit_noise(autocovariance: FloatArray, memory: float) -> ColoredNoise:
    """Return the autoregressions, independent of each other, with an autocovariance (ny, order + 1).

    White noise is added where the autocovariance is impossible. What a few lags show to decay more slowly than in a memory, in
    samples, decays as fast as that, with the same variance.
    """
    possible, order = autocovariance.copy(), autocovariance.shape[1] - 1
    least = np.linalg.eigvalsh(np.stack([toeplitz(channel) for channel in possible]))[:, 0]
    possible[:, 0] += np.maximum(0.0, MIN_POWER * np.abs(possible[:, 0]) - least)
    fits = [yule_walker(channel) for channel in possible]
    coefficients, power = np.array([a for a, _ in fits]), np.array([variance for _, variance in fits])
    companion = np.zeros((len(possible), order, order))
    companion[:, 0], companion[:, 1:, :-1] = coefficients, np.eye(order - 1)
    slowest, decay = np.abs(np.linalg.eigvals(companion)).max(axis=1), 1.0 - 1.0 / memory
    slow = slowest > decay
    if slow.any():
        coefficients[slow] *= (decay / slowest[slow, None]) ** np.arange(1, order + 1)
        size = next_fast_len(round(SPAN * memory), real=True)
        gain = ColoredNoise(coefficients[slow], np.eye(int(slow.sum()))).gain(size)
        power[slow] = possible[slow, 0] / (half_spectrum_scale(size) ** 2 @ np.abs(gain) ** 2)
    return ColoredNoise(coefficients, np.diag(power))


def between_lags(autocovariance: FloatArray, counts: FloatArray) -> FloatArray:
    """Return autocovariances (ny, lags) with straight lines where few readings are so far apart, to zero after the last.

    Such lines are the autocovariance of a possible noise, and zeros, or what a few pairs say, are not: an autoregression of
    these rings, or never decays.
    """
    out, lags = autocovariance.copy(), np.arange(autocovariance.shape[1])
    seen = counts / np.maximum(counts.max(axis=0), 1.0)
    for channel, there in zip(out, seen > FEW_PAIRS * seen[:, 1:].max(axis=1, keepdims=True), strict=True):
        known = lags[there]
        if 0 < known.size < lags.size:
            step = known[-1] - known[-2] if known.size > 1 else 1
            channel[:] = np.interp(lags, [*known, known[-1] + step], [*channel[there], 0.0])
    return out


@dataclass(frozen=True, eq=False)
class Coloring:
    """The sensitivities and residuals of a fit in the frequency domain, in coordinates of unit information."""

    segments: tuple[PieceEvidence, ...]
    inverse: Inverse  #: of the information that the fit used, priors included
    prior: FloatArray  #: (k, k); information of the priors
    white: bool = False  #: whether residuals are uncorrelated by construction: no color is looked for
    observed: FloatArray | None = None  #: (r, r); Hessian of half the cost, where it is known

    @classmethod
    def of(cls, pieces: Sequence[PieceEvidence], prior: FloatArray, white: bool = False) -> Coloring:
        """Return the coloring of a fit with the information (k, k) of priors and gaps."""
        return cls(tuple(pieces), inverse_information(pieces, prior), prior, white)

    @cached_property
    def noise(self) -> ColoredNoise:
        """The noise behind the residuals of the fit."""
        return self.noise_behind([segment.filled()[0] for segment in self.segments])

    def noise_behind(self, residuals: Sequence[FloatArray]) -> ColoredNoise:
        """Return the noise behind residuals (n, n_y), zero where nothing was measured, of each segment.

        It is their color, with what the fit absorbed added back: with residuals v - S d and d = D^-1 S' v, the lagged
        products of v exceed those of the residuals by the mean of S d v' + v d' S' - S d d' S'; channels are taken one by one.
        """
        if self.white:
            return ColoredNoise.white(residuals[0].shape[1])
        lengths = [len(segment.residual) for segment in self.segments]
        memory = MEMORY * float(np.mean(lengths))
        order = max(1, min(MAX_ORDER, sum(lengths) // SAMPLES_PER_LAG, min(lengths) - 1))
        present = [segment.present.astype(np.float64) for segment in self.segments]
        sums, counts = lagged_products(residuals, present, order)
        share, pairs = counts / np.maximum(counts[:, :1], 1.0), np.maximum(counts, 1.0)
        autocovariance, blocks = between_lags(sums / pairs, counts), self.single_blocks
        for _ in range(ROUNDS):
            noise = fit_noise(autocovariance, memory)
            innovation = np.diag(noise.innovation)[:, None]
            own = [(block, np.abs(noise.gain(block.size).T) ** 2 * innovation) for block in blocks]
            spread = self.spread([block.separate_middle(power) for block, power in own])
            absorbed = np.zeros_like(share)
            for block, power in own:
                crossed, squared = block.lagged(power, spread, order)
                absorbed += crossed * share - squared
            corrected = sums + absorbed
            # A fit leaves at least one of n numbers: more cannot have been absorbed.
            power, most = np.abs(corrected[:, :1]), pairs[:, :1] * np.abs(sums[:, :1])
            limit = np.divide(most, power, out=np.ones_like(power), where=power > most)
            autocovariance = between_lags(limit * corrected / pairs, counts)
        return self._coherent(fit_noise(autocovariance, memory), residuals)

    def _coherent(self, noise: ColoredNoise, residuals: Sequence[FloatArray]) -> ColoredNoise:
        """Return the noise with the coherency of its innovations between channels, what the fit absorbed added back."""
        edges = band_edges(sum(len(s.residual) for s in self.segments), len(noise.coefficients))
        pairs = zip(self.single_blocks, residuals, strict=True)
        powers = sum(block.cross_powers(noise, residual, edges) for block, residual in pairs)
        found = replace(noise, edges=edges, coherency=normalized_coherency(np.asarray(powers)))
        white = [block.whitened(found) for block in self.single_blocks]
        for _ in range(ROUNDS):
            spread, innovations = self.spread([one.middle(found.roots) for one in white]), found.powers
            absorbed = sum(one.absorbed(innovations, spread) for one in white)
            found = replace(found, coherency=normalized_coherency(np.asarray(powers + absorbed)))
        return found

    def middles(self, noise: ColoredNoise) -> list[FloatArray]:
        """Return the covariance (a, a) of the scores of each segment under `noise`, in the a directions that it sees."""
        roots = noise.roots
        return [block.whitened(noise).middle(roots) for block in self.blocks]

    def covariance(self, noise: ColoredNoise) -> FloatArray:
        """Return the covariance (k, k) of the estimates under `noise`."""
        return np.asarray(self.moves @ self.spread(self.middles(noise)) @ self.moves.T)

    @cached_property
    def moves(self) -> FloatArray:
        """What scores in coordinates of unit information move the estimates by, (k, r)."""
        factor = self.inverse.factor
        if self.observed is None or not np.isfinite(self.observed).all():
            return factor
        values, vectors = np.linalg.eigh(self.observed)
        return np.asarray(factor @ (vectors / np.maximum(values, MIN_CURVATURE)) @ vectors.T)

    def spread(self, middles: Sequence[FloatArray]) -> FloatArray:
        """Return the covariance (r, r) of the scores, from that of each segment in its own directions."""
        turned = (b.basis.T @ middle @ b.basis for b, middle in zip(self.blocks, middles, strict=True))
        return np.asarray(sum(turned) + self.inverse.factor.T @ self.prior @ self.inverse.factor)

    @cached_property
    def blocks(self) -> tuple[_Block, ...]:
        """Spectra of the sensitivities, segment by segment."""
        return tuple(_Block.of(segment, self.inverse.factor) for segment in self.segments)

    @cached_property
    def single_blocks(self) -> tuple[_Block, ...]:
        """The same in single precision, at twice the speed: enough (1e-7) for what the fit absorbed, a correction."""
        return tuple(replace(block, parts=block.parts.astype(np.float32)) for block in self.blocks)


@dataclass(frozen=True, eq=False)
class _Block:
    """Spectrum of the sensitivities of one segment, in a of the r unit-information coordinates."""

    size: int  #: of the FFT
    basis: FloatArray  #: orthonormal rows (a, r): the directions that this segment sees
    parts: FloatArray  #: real and imaginary part (2, ny, size // 2 + 1, a), scaled to sums over time

    @classmethod
    def of(cls, segment: PieceEvidence, factor: FloatArray) -> _Block:
        """Return the spectrum of a segment."""
        jacobian = segment.filled()[1]
        active = jacobian.any(axis=(0, 1))
        left, stretch, basis = np.linalg.svd(factor[active], full_matrices=False)
        size = next_fast_len(2 * len(jacobian), real=True)  # the autocovariance does not wrap around
        spectrum = np.asarray(rfft(jacobian[:, :, active] @ (left * stretch), size, axis=0))
        spectrum = (spectrum * half_spectrum_scale(size)[:, None, None]).transpose(1, 0, 2)
        parts = np.empty((2, *spectrum.shape))
        parts[0], parts[1] = spectrum.real, spectrum.imag
        return cls(size, basis, parts)

    def separate_middle(self, power: FloatArray) -> FloatArray:
        """Return S' V S (a, a) over this segment for noise with spectra (ny, f) that is independent between channels."""
        root = np.sqrt(power).astype(self.parts.dtype)
        rows = (self.parts * root[:, :, None]).reshape(math.prod(self.parts.shape[:-1]), self.parts.shape[-1])
        return np.asarray(rows.T @ rows)

    @cached_property
    def strength(self) -> FloatArray:
        """Sums of squares (ny, f) over the directions."""
        return np.asarray(np.einsum("cyfa,cyfa->yf", self.parts, self.parts))

    def lagged(self, power: FloatArray, spread: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
        """Return the lagged products (ny, order + 1) of S d with v, both ways, and of S d with itself."""
        # one large product, not one per frequency
        rows = self.parts.reshape(math.prod(self.parts.shape[:-1]), self.parts.shape[-1])
        inner = (self.basis @ spread @ self.basis.T).astype(rows.dtype)
        squares = np.einsum("na,na->n", rows @ inner, rows)
        squared = squares.reshape(self.parts.shape[:3]).sum(axis=0, dtype=np.float64)
        wave = np.cos(2.0 * np.pi / self.size * np.outer(np.arange(power.shape[1]), np.arange(order + 1)))
        return 2.0 * (self.strength * power) @ wave, squared @ wave

    def cross_powers(self, noise: ColoredNoise, residual: FloatArray, edges: FloatArray) -> ComplexArray:
        """Return the sums (b, ny, ny) over each band of the whitened periodograms of a residual (n, ny)."""
        spectrum = rfft(residual, self.size, axis=0) * half_spectrum_scale(self.size)[:, None]
        white = spectrum / noise.gain(self.size)
        powers = white[:, :, None] * white.conj()[:, None, :]
        first = np.searchsorted(band_numbers(edges, self.size), np.arange(len(edges)))
        return np.stack([powers[a:b].sum(axis=0) for a, b in itertools.pairwise(first)])

    def whitened(self, noise: ColoredNoise) -> _Whitened:
        """Return the sensitivities over the frequency response of a noise, and times its conjugate, by its bands."""
        gain, white, colored = noise.gain(self.size).T, [], []
        inverse, power = (1.0 / gain)[:, :, None], (np.abs(gain) ** 2)[:, :, None].astype(self.parts.dtype)
        a, b = inverse.real.astype(self.parts.dtype), inverse.imag.astype(self.parts.dtype)
        for band in noise.bands(self.size):
            real, imaginary = self.parts[:, :, band]
            own = np.empty((2, *real.shape), self.parts.dtype)
            np.multiply(real, a[:, band], out=own[0])
            np.multiply(real, b[:, band], out=own[1])
            own[0] -= imaginary * b[:, band]
            own[1] += imaginary * a[:, band]
            white.append(own.reshape(2 * len(gain), -1))
            colored.append((own * power[:, band]).reshape(2 * len(gain), -1))
        return _Whitened(self.basis, tuple(white), tuple(colored))


@dataclass(frozen=True, eq=False)
class _Whitened:
    """Spectrum of the sensitivities of one segment beside a noise with the frequency response G, in b bands."""

    basis: FloatArray  #: (a, r), of the segment
    white: tuple[FloatArray, ...]  #: G^-1 S, (2 ny, f a): real parts of all channels, then imaginary parts
    colored: tuple[FloatArray, ...]  #: G^H S

    def middle(self, roots: ComplexArray) -> FloatArray:
        """Return the double sum (a, a) over this segment, S' V S, for innovations of covariance L L^H (b, ny, ny)."""
        total = np.zeros((len(self.basis), len(self.basis)))
        for colored, root in zip(self.colored, roots, strict=True):
            a, b = root.real.T, -root.imag.T
            mixing = np.block([[a, -b], [b, a]]).astype(colored.dtype)
            rows = (mixing @ colored).reshape(colored.size // max(len(total), 1), len(total))
            total += rows.T @ rows
        return total

    @cached_property
    def crossed(self) -> ComplexArray:
        """Products (b, ny, ny) of the sensitivities over the response and times its conjugate."""
        return np.stack([_hermitian(a @ b.T) for a, b in zip(self.white, self.colored, strict=True)])

    def absorbed(self, powers: ComplexArray, spread: FloatArray) -> ComplexArray:
        """Return by how much the whitened periodograms (b, ny, ny) of v exceed those of the residuals v - S d.

        `powers` (b, ny, ny) is the covariance of the innovations, `spread` (r, r) that of the scores.
        """
        inner = (self.basis @ spread @ self.basis.T).astype(self.white[0].dtype)
        turned = (
            (white.reshape(white.size // max(len(inner), 1), len(inner)) @ inner).reshape(white.shape)
            for white in self.white
        )
        squared = np.stack([_hermitian(a @ b.T) for a, b in zip(turned, self.white, strict=True)])
        crossed = self.crossed @ powers
        return np.asarray(crossed + crossed.conj().transpose(0, 2, 1) - squared)


def _hermitian(products: FloatArray) -> ComplexArray:
    """Return X Y^H (ny, ny) from the products (2 ny, 2 ny) of real and imaginary parts."""
    n = len(products) // 2
    same, cross = products[:n, :n] + products[n:, n:], products[n:, :n] - products[:n, n:]
    return np.asarray(same + 1j * cross)


def half_spectrum_scale(size: int) -> FloatArray:
    """Return factors (size // 2 + 1,) with which squares of a real transform add up to those of the series."""
    twice = np.full(size // 2 + 1, 2.0)
    twice[[0, -1] if size % 2 == 0 else 0] = 1.0
    return np.sqrt(twice / size)
