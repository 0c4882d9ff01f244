r"""Frequency responses of outputs to inputs that may move together, from windows of several lengths at once.

Every stretch without a gap is cut into overlapping windows, each less its mean, tapered by Hann's window and transformed at a few
frequencies in every octave: what the chirp z-transform computes octave by octave, here by one matrix product, which takes less
time. At each frequency the responses H of one output to all inputs minimize

.. math:: \sum_i \frac{W_i}{K_i} \sum_{k=1}^{K_i} |Y_{ik} - X_{ik} H|^2, \qquad W_i = (\epsilon_i/\epsilon_{min})^{-4},

over the :math:`K_i` windows of each length i, with the random error :math:`\epsilon_i` of that length: composite windows, and
conditioned responses where inputs move together. With one length this is the usual cross spectrum over the power spectrum.

Windows overlap, and those of different lengths share samples. The noise of their transforms therefore has a known correlation
R, the inner products of their tapers; with V the weights of the windows, :math:`C = (X^H V X)^{-1}` and M = V - V X C X^H V,

.. math:: \mathrm{cov}(H) = \sigma^2\, C X^H V R V X C, \qquad \sigma^2 = r^H V r / \mathrm{tr}(M R),

and :math:`\sigma^2` has :math:`2\,\mathrm{tr}(MR)^2 / \mathrm{tr}(MRMR)` degrees of freedom (Satterthwaite).

References
----------
M. B. Tischler and R. K. Remple, *Aircraft and Rotorcraft System Identification*, 2nd ed., AIAA, 2012, chapters 7, 9 and 10.
J. S. Bendat and A. G. Piersol, *Random Data*, 4th ed., Wiley, 2010, chapters 7 and 9.
F. E. Satterthwaite, "An approximate distribution of estimates of variance components", *Biometrics Bulletin* 2(6), 1946.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Final

import numpy as np
from scipy import sparse
from scipy.special import stdtrit

from stoop.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, run_slices

OVERLAP: Final = 0.5  #: of successive windows
MAX_LENGTH: Final = 20.0  #: s, of a window
#: of windows, down to a quarter of the longest: what is shorter has more leakage than noise
LENGTHS: Final = 5
SPARE_WINDOWS: Final = 2  #: without overlap, of the longest length, beyond the number of inputs
MIN_SAMPLES: Final = 16  #: of a window
POINTS_PER_OCTAVE: Final = 12
MAX_SHARE: Final = 0.4  #: of the sampling rate, that a frequency may be
WEIGHT_POWER: Final = -4.0  #: of the random error of a length (Tischler and Remple, section 10.3)
MAX_CONDITION: Final = 1e8  #: of the spectra of the inputs, beyond which they are one input


@dataclass(frozen=True, eq=False)
class Stretch:
    """Samples of inputs and outputs on one uniform grid, NaN where nothing was recorded."""

    rate: float  #: Hz
    inputs: FloatArray  #: (n, p)
    outputs: FloatArray  #: (n, q)


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Response of an output to one input, those to the other inputs taken off, with coherence and random error.

    Under feedback, which answers gusts and noise too, it lies between the response of the vehicle and the inverse of the
    feedback; a coherence near one says that the input dominates.
    """

    #: of a frequency that a window holds at least: half the width of the main lobe of Hann's window
    CYCLES: ClassVar = 2.0
    MAX_FREQUENCY: ClassVar = 10.0  #: Hz, by default

    input: str
    output: str
    frequency: FloatArray  #: (m,) rad/s, rising
    response: ComplexArray  #: (m,), unit of the output over that of the input
    coherence: FloatArray  #: (m,), 0 to 1; the partial coherence where there are several inputs
    error: FloatArray  #: (m,), standard error of real and of imaginary part over the magnitude
    bound: FloatArray  #: (m,), 95 % random error of the magnitude over the magnitude, and of the phase, rad
    window: FloatArray  #: (m,) s, mean length of the windows, by their weights

    @staticmethod
    def window_lengths(
        durations: Sequence[float], inputs: int, longest: float = MAX_LENGTH
    ) -> tuple[float, ...]:
        """Return the lengths of windows, s, for stretches of these durations, s; none where these are too short.

        Of the longest at least `SPARE_WINDOWS` more than there are inputs fit side by side.
        """
        wanted = inputs + SPARE_WINDOWS
        # a length at which one more window fits into some stretch is a duration over a whole number
        candidates = {d / k for d in durations for k in range(1, wanted + 1)}
        fitting = [x for x in candidates if sum(int(d / x * (1.0 + 1e-9)) for d in durations) >= wanted]
        if not fitting:
            return ()
        first = min(longest, max(fitting))
        return tuple(np.geomspace(first, 0.25 * first, LENGTHS).tolist())

    @staticmethod
    def estimate(
        stretches: Sequence[Stretch],
        inputs: Sequence[str],
        outputs: Sequence[str],
        band: tuple[float, float] | None = None,
        lengths: Sequence[float] | None = None,
    ) -> list[FrequencyResponse]:
        """Return the response of every output to every input; none of an output whose stretches are too short.

        Parameters
        ----------
        stretches : sequence of Stretch
            Nothing is estimated across their ends or across a gap.
        inputs, outputs : names of the p and q columns
        band : (low, high), rad/s, optional
            By default from `FrequencyResponse.CYCLES` per longest window to 10 Hz, or 0.4 times the slowest sampling rate.
        lengths : sequence of float, s, optional
            Of the windows; by default by :meth:`window_lengths`.
        """
        found: dict[int, list[FrequencyResponse]] = {}
        for own in _recorded_together(stretches, len(outputs)):
            pieces = []  # rate, and the inputs and these outputs (n, p + k) where there is no gap
            for one in stretches:
                values = np.column_stack([one.inputs, one.outputs[:, own]])
                present: BoolArray = np.asarray(np.isfinite(values).all(axis=1))
                pieces += [(one.rate, values[run]) for run in run_slices(present)]
            durations = [len(v) / rate for rate, v in pieces]
            chosen = lengths or FrequencyResponse.window_lengths(durations, len(inputs))
            chosen = [x for x in chosen if all(x * rate >= MIN_SAMPLES for rate, _ in pieces)]
            if not chosen or not pieces:
                continue
            lowest = FrequencyResponse.CYCLES / max(chosen)
            ceiling = MAX_SHARE * min(rate for rate, _ in pieces)
            most = FrequencyResponse.MAX_FREQUENCY
            low, high = (lowest, most) if band is None else (b / (2.0 * np.pi) for b in band)
            hertz = frequencies(max(low, lowest), min(high, ceiling))
            if hertz.size:
                windows = _windows(pieces, chosen, hertz)
                p = len(inputs)
                for k, column in enumerate(own, p):
                    alone = replace(windows, transforms=windows.transforms[..., [*range(p), k]])
                    found[column] = _responses(alone, hertz, inputs, outputs[column])
        return [one for column in sorted(found) for one in found[column]]


def frequencies(low: float, high: float) -> FloatArray:
    """Return frequencies from `low` to `high`, evenly spaced within each octave; none where `high` is not above."""
    octaves = max(math.ceil(math.log2(high / low)), 0)
    within = 1.0 + np.arange(POINTS_PER_OCTAVE) / POINTS_PER_OCTAVE
    points = low * np.outer(2.0 ** np.arange(octaves), within).ravel()
    return np.asarray(points[points <= high * (1.0 + 1e-9)])


def decibels(response: ComplexArray) -> FloatArray:
    """Return magnitudes in dB."""
    with np.errstate(divide="ignore"):
        return np.asarray(20.0 * np.log10(np.abs(response)))


def _recorded_together(stretches: Sequence[Stretch], count: int) -> list[list[int]]:
    """Return groups of output columns with the same gaps: their windows are the same."""
    groups: dict[bytes, list[int]] = {}
    for column in range(count):
        gaps = b"".join(np.isfinite(one.outputs[:, column]).tobytes() for one in stretches)
        groups.setdefault(gaps, []).append(column)
    return list(groups.values())


@dataclass(frozen=True, eq=False)
class _Windows:
    """Windows of all lengths."""

    transforms: ComplexArray  #: (w, m, c); their squared magnitudes are one-sided densities
    length: FloatArray  #: (w,) s
    correlation: sparse.csr_array  #: (w, w), of the transforms of white noise


def _windows(
    pieces: Sequence[tuple[float, FloatArray]], lengths: Sequence[float], hertz: FloatArray
) -> _Windows:
    transforms, length, blocks = [], [], []
    for rate, values in pieces:
        sizes, starts = [], []
        for seconds in lengths:
            size = round(seconds * rate)
            room = len(values) - size
            if room < 0:
                continue
            count = 1 + int(np.ceil(room / max(1, round((1.0 - OVERLAP) * size))))
            own = np.unique(np.round(np.linspace(0, room, count)).astype(int))
            transforms.append(_transformed(values, own, size, rate, hertz))
            length.append(np.full(len(own), seconds))
            sizes.append(size)
            starts.append(own)
        if sizes:
            blocks.append(_taper_correlation(sizes, starts))
    if not blocks:
        return _Windows(np.zeros((0, 0, 0), dtype=complex), np.zeros(0), sparse.csr_array((0, 0)))
    correlation = sparse.block_diag(blocks, format="csr")
    return _Windows(np.concatenate(transforms), np.concatenate(length), correlation)


def _taper(size: int) -> FloatArray:
    return np.asarray(np.hanning(size + 1)[:-1])


def _transformed(
    values: FloatArray, starts: np.ndarray, size: int, rate: float, hertz: FloatArray
) -> ComplexArray:
    """Return the transforms (w, m, c) of windows of columns (n, c), their phases counted from the first sample."""
    windows = values[starts[:, None] + np.arange(size)]
    windows = (windows - windows.mean(axis=1, keepdims=True)) * _taper(size)[:, None]
    turns = 2.0 * np.pi / rate * np.outer(np.arange(size), hertz)
    rows = windows.transpose(0, 2, 1).reshape(-1, size)
    found = (rows @ np.cos(turns) - 1j * (rows @ np.sin(turns))).reshape(len(windows), -1, len(hertz))
    phase = np.exp(-2j * np.pi * np.outer(starts, hertz) / rate)
    scale = np.sqrt(2.0 / (rate * np.sum(_taper(size) ** 2)))
    return np.asarray(found.transpose(0, 2, 1) * phase[:, :, None] * scale)


def _taper_correlation(sizes: Sequence[int], starts: Sequence[np.ndarray]) -> sparse.coo_array:
    """Return the inner products (w, w) of the tapers of windows of one piece, each of norm one; zero where none overlap."""
    first = np.concatenate([[0], np.cumsum([len(s) for s in starts])])
    rows, columns, products = [], [], []
    for i, (size, own) in enumerate(zip(sizes, starts, strict=True)):
        for j, (other, theirs) in enumerate(zip(sizes, starts, strict=True)):
            a, b = _taper(size), _taper(other)
            product = np.correlate(a, b, "full") / np.sqrt(np.sum(a**2) * np.sum(b**2))
            low = np.searchsorted(theirs, own - other, "right")
            count = np.searchsorted(theirs, own + size) - low
            row = np.repeat(np.arange(len(own)), count)
            column = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + low[row]
            products.append(product[theirs[column] - own[row] + other - 1])
            rows.append(first[i] + row)
            columns.append(first[j] + column)
    whole = int(first[-1])
    places = (np.concatenate(rows), np.concatenate(columns))
    return sparse.coo_array((np.concatenate(products), places), shape=(whole, whole))


def _responses(
    windows: _Windows, hertz: FloatArray, inputs: Sequence[str], output: str
) -> list[FrequencyResponse]:
    """Solve the weighted least squares of all frequencies, all inputs at once."""
    size = np.sqrt(np.mean(np.abs(windows.transforms) ** 2, axis=(0, 1)))
    size[size == 0.0] = 1.0
    scaled = (windows.transforms / size).transpose(1, 0, 2)
    p, m = len(inputs), len(hertz)
    response, error, bound = np.zeros((p, m), dtype=complex), np.full((p, m), np.inf), np.full((p, m), np.inf)
    coherence, mean_length = np.zeros((p, m)), np.full(m, np.nan)
    own, found = _solved(scaled[..., :p], scaled[..., p], windows, hertz)
    response[:, own], coherence[:, own], mean_length[own] = found.response, found.coherence, found.length
    with np.errstate(divide="ignore", invalid="ignore"):
        error[:, own] = np.sqrt(0.5 * found.variance) / np.abs(found.response)
    bound[:, own] = stdtrit(found.freedom, 0.975) * error[:, own]
    return [
        FrequencyResponse(
            name, output, 2.0 * np.pi * hertz, response[k] * size[p] / size[k], coherence[k], error[k], bound[k],
            mean_length,
        )
        for k, name in enumerate(inputs)
    ]  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Solution:
    """Least squares of the frequencies that determine one."""

    response: ComplexArray  #: (p, k), of scaled transforms
    variance: FloatArray  #: (p, k)
    freedom: FloatArray  #: (k,), degrees of freedom of the variance
    coherence: FloatArray  #: (p, k), partial
    length: FloatArray  #: (k,) s, mean of the windows


def _solved(
    X: ComplexArray, y: ComplexArray, windows: _Windows, hertz: FloatArray
) -> tuple[IntArray, _Solution]:
    """Solve for transforms of inputs (m, w, p) and of an output (m, w); return the k frequencies that determine a solution."""
    squared = windows.correlation.multiply(windows.correlation).tocsr()
    weights = _weights(X, y, windows, squared, hertz)
    VX = weights[..., None] * X
    gram, total = _adjoint(X) @ VX, weights.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        own = np.flatnonzero((total > 0.0) & (np.linalg.cond(gram) < MAX_CONDITION))
    X, y, VX, C = X[own], y[own], VX[own], np.linalg.inv(gram[own])
    weights, total = weights[own], total[own]
    H = C @ (_adjoint(VX) @ y[..., None])
    left = np.sum(weights * np.abs(y - (X @ H)[..., 0]) ** 2, axis=1)
    RVX = _across(windows.correlation, VX)
    B = _adjoint(VX) @ RVX
    first = total - _trace(C @ B)  # tr(MR)
    second = np.sum(weights * (squared @ weights.T).T, axis=1) + _trace(C @ B @ C @ B)  # tr(MRMR)
    second -= 2.0 * _trace(C @ (_adjoint(RVX) @ (weights[..., None] * RVX)))
    good = (first > 1e-6 * total) & (second > 0.0)
    C, H, B, weights = C[good], H[good, :, 0], B[good], weights[good]
    left, first, second, total = left[good], first[good], second[good], total[good]
    explained = np.abs(H) ** 2 / _diagonal(C)
    coherence = explained / np.maximum(explained + left[:, None], np.finfo(float).tiny)
    variance = (left / first)[:, None] * _diagonal(C @ B @ C)
    mean_length = weights @ windows.length / total
    return own[good], _Solution(H.T, variance.T, 2.0 * first**2 / second, coherence.T, mean_length)


def _weights(
    X: ComplexArray, y: ComplexArray, windows: _Windows, squared: sparse.csr_array, hertz: FloatArray
) -> FloatArray:
    """Return the weights (m, w) of windows at each frequency, Hz: by the random error of those of each length."""
    lengths = np.unique(windows.length)
    members = [np.asarray(windows.length == length) for length in lengths]
    counts = [int(own.sum()) for own in members]
    errors = np.full((len(lengths), len(hertz)), np.inf)
    for error, length, own, count in zip(errors, lengths, members, counts, strict=True):
        here = length * hertz >= FrequencyResponse.CYCLES * (1.0 - 1e-9)
        if count <= X.shape[2] + 1 or not here.any():
            continue
        inputs, outputs = X[np.ix_(here, own)], y[np.ix_(here, own)]
        basis, values, _ = np.linalg.svd(inputs, full_matrices=False)
        basis = basis * (values > count * np.finfo(float).eps * values[:, :1])[:, None, :]
        rest = outputs - (basis @ (_adjoint(basis) @ outputs[..., None]))[..., 0]
        left, all_of = (np.sum(np.abs(values) ** 2, axis=1) for values in (rest, outputs))
        averages = count**2 / float(own @ (squared @ own.astype(float)))
        error[here] = np.sqrt(left / np.maximum(all_of - left, np.finfo(float).tiny * 1e6) / averages)
    least, weights = errors.min(axis=0, initial=np.inf), np.zeros(y.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(least > 0.0, errors / least, np.where(errors == least, 1.0, np.inf))
    for ratio, error, own, count in zip(ratios, errors, members, counts, strict=True):
        known = np.where(np.isfinite(error), np.minimum(ratio, 1e6) ** WEIGHT_POWER / count, 0.0)
        weights[:, own] = known[:, None]
    return weights


def _adjoint(matrices: ComplexArray) -> ComplexArray:
    return np.asarray(np.swapaxes(matrices.conj(), -1, -2))


def _trace(matrices: ComplexArray) -> FloatArray:
    return np.asarray(np.trace(matrices, axis1=-2, axis2=-1).real)


def _diagonal(matrices: ComplexArray) -> FloatArray:
    return np.asarray(np.diagonal(matrices, axis1=-2, axis2=-1).real)


def _across(correlation: sparse.csr_array, columns: ComplexArray) -> ComplexArray:
    """Return the product (m, w, p) of a matrix (w, w) with the columns of each frequency."""
    m, w, p = columns.shape
    product = correlation @ columns.transpose(1, 0, 2).reshape(w, m * p)
    return np.asarray(product).reshape(w, m, p).transpose(1, 0, 2)
