"""How far one clock is behind another: correlation of what both streams measured.

References
----------
R. A. Fisher, On the "probable error" of a coefficient of correlation, Metron 1 (1921): atanh(r) is nearly normal
with variance 1 / n.
D. Padfield, Masked object registration in the Fourier domain, IEEE Trans. Image Processing 21 (2012), eq. 13:
correlation of records with holes and ends, normalized at every shift by the samples that overlap.
J. S. Bendat and A. G. Piersol, *Random Data*, 4th ed., section 8.5: error of a delay estimated from the peak.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.flight.channels import finite, stretches

Signal: TypeAlias = tuple[FloatArray, FloatArray]  #: time (n,) s and values (n,)

RATE: Final = (
    100.0  #: Hz of the grid on which signals are compared; the peak is interpolated between its points
)
BANDWIDTH: Final = 5.0  #: Hz; what is faster is noise of differentiation more often than motion
MAX_POINTS: Final = 2**20  #: of one signal; longer records are compared on a coarser grid
MIN_OVERLAP: Final = 5.0  #: s that must overlap at least
MIN_OVERLAP_SHARE: Final = 0.3  #: of the shorter record, that must overlap
MIN_SAMPLES: Final = 10  #: of a signal
MIN_CORRELATION: Final = 0.7  #: from which a shift is believed
MIN_SEPARATION: Final = 4.0  #: standard deviations by which the best correlation must lie above any other
MAX_CORRELATION: Final = 0.995  #: correlations above are alike: what is left of them is how samples fell
PIECE: Final = 15.0  #: s, over which the shift of a drifting clock is estimated
MAX_PIECE_SHIFT: Final = 0.5  #: s of a piece against the whole


@dataclass(frozen=True)
class Lag:
    """What must be added to one clock to read another.

    Attributes
    ----------
    shift : s, to be added at `origin`
    sigma : s, standard error of the shift
    correlation : of both records when shifted, 0 to 1
    rival : the highest correlation at any quite different shift
    overlap : s in which both records were compared
    samples : independent ones among them
    using : quantities that were compared
    drift : s per s, to be added beyond `origin`
    drift_sigma : its standard error
    origin : s on the moved clock
    """

    shift: float
    sigma: float
    correlation: float
    rival: float
    overlap: float
    samples: float
    using: tuple[str, ...]
    drift: float = 0.0
    drift_sigma: float = 0.0
    origin: float = 0.0

    @property
    def trusted(self) -> bool:
        """Whether records are alike when shifted so, and nowhere else (Fisher's z of both correlations)."""
        z, other = (np.arctanh(min(x, MAX_CORRELATION)) for x in (self.correlation, self.rival))
        return bool(
            self.correlation >= MIN_CORRELATION and (z - other) * np.sqrt(0.5 * self.samples) > MIN_SEPARATION
        )

    def moved(self, time: FloatArray) -> FloatArray:
        """Return times [s] of the moved clock as the other one shows them."""
        return np.asarray(time + self.shift + self.drift * (time - self.origin))


@dataclass(frozen=True)
class _Curve:
    """Correlation over shifts: shift (m,) s, value and overlap (m,) [1, s], rms rate of change of the signal [1/s], Hz."""

    shift: FloatArray
    value: FloatArray
    overlap: FloatArray
    speed: float
    bandwidth: float


def find_lag(
    moving: Mapping[str, Signal], fixed: Mapping[str, Signal], longest: float = np.inf, around: float = np.nan
) -> Lag | None:
    """Find the shift of one clock at which both records are most alike.

    Parameters
    ----------
    moving, fixed : quantity -> its samples, on the clock to be moved and on the one that counts
    longest : s, the largest shift that is looked for
    around : s, the middle of what is looked for; NaN: zero where a `longest` is given, else any shift

    Returns
    -------
    Lag, without drift; None when nothing can be compared
    """
    middle = 0.0 if np.isnan(around) else around
    curves = {}
    for name in moving:
        curve = _correlation(moving[name], fixed[name], middle, longest) if name in fixed else None
        if curve is not None and np.nanmax(curve.value) > 0.0:
            curves[name] = curve
    return _peak(curves) if curves else None


def with_drift(lag: Lag, moving: Mapping[str, Signal], fixed: Mapping[str, Signal]) -> Lag:
    """Add how fast one clock runs away from the other, from the shifts of pieces of the record.

    Where fewer than three pieces can be compared, the lag is returned as it is.
    """
    used = {name: moving[name] for name in lag.using}
    for _ in range(2):
        start, stop = (edge([x[0][i] for x in used.values()]) for edge, i in ((min, 0), (max, -1)))
        pieces = [
            (0.5 * (a + a + PIECE), piece)
            for a in np.arange(start, stop - 0.5 * PIECE, PIECE)
            if (piece := _piece(lag, used, fixed, float(a))) is not None and piece.trusted
        ]
        if len(pieces) < 3:
            return lag
        lag = _line(lag, pieces)
    return lag


def _piece(lag: Lag, moving: Mapping[str, Signal], fixed: Mapping[str, Signal], start: float) -> Lag | None:
    inside = {}
    for name, (t, x) in moving.items():
        at = (t >= start) & (t < start + PIECE)
        if np.count_nonzero(at) > MIN_SAMPLES:
            inside[name] = lag.moved(t[at]), x[at]
    return find_lag(inside, fixed, MAX_PIECE_SHIFT, 0.0) if inside else None


def _line(lag: Lag, pieces: list[tuple[float, Lag]]) -> Lag:
    """Fit shift and drift to the shifts that the pieces still need."""
    t = np.array([middle for middle, _ in pieces])
    weight = 1.0 / np.array([max(piece.sigma, 1e-4) for _, piece in pieces])
    origin = float(np.average(t, weights=weight**2))
    design = np.column_stack([np.ones(t.size), t - origin]) * weight[:, None]
    target = np.array([piece.shift for _, piece in pieces]) * weight
    (shift, slope), *_ = np.linalg.lstsq(design, target, rcond=None)
    rest = target - design @ np.array([shift, slope])
    scatter = max(float(rest @ rest) / max(t.size - 2, 1), 1.0)
    errors = np.sqrt(scatter * np.diag(np.linalg.inv(design.T @ design)))
    at = float(lag.moved(np.array([origin]))[0]) - origin  # what the lag so far adds there
    return replace(
        lag,
        shift=at + float(shift),
        drift=lag.drift + float(slope) * (1.0 + lag.drift),
        origin=origin,
        sigma=float(errors[0]),
        drift_sigma=float(errors[1]),
    )


def _peak(curves: Mapping[str, _Curve]) -> Lag | None:
    """Average the curves, each by its information, and find the highest point between its samples."""
    best = {name: float(np.nanmax(curve.value)) for name, curve in curves.items()}
    used = {name: c for name, c in curves.items() if best[name] > 0.5 * max(best.values())}
    grid = next(iter(used.values())).shift
    weights = {name: best[name] ** 2 / (1.0001 - best[name] ** 2) for name in used}
    layers = [weights[name] * np.interp(grid, c.shift, c.value) for name, c in used.items()]
    total = np.sum(layers, axis=0) / sum(weights.values())
    if not np.isfinite(total).any():
        return None
    top = int(np.nanargmax(total))
    shift, value = _parabola_peak(grid, total, top)
    overlap = max(float(c.overlap[min(top, c.overlap.size - 1)]) for c in used.values())
    information = sum(
        2.0 * c.bandwidth * overlap * c.speed**2 * best[name] ** 2 / (1.0001 - best[name] ** 2)
        for name, c in used.items()
    )
    sigma = float(1.0 / np.sqrt(max(information, 1e-12)))
    samples = 2.0 * max(c.bandwidth for c in used.values()) * overlap
    return Lag(shift, sigma, min(value, 1.0), _rival(total, top), overlap, samples, tuple(used))


def _parabola_peak(x: FloatArray, y: FloatArray, top: int) -> tuple[float, float]:
    """Return place and height of a parabola through the highest sample and its neighbors."""
    if not 0 < top < y.size - 1 or not np.isfinite(y[top - 1 : top + 2]).all():
        return float(x[top]), float(y[top])
    before, at, after = y[top - 1 : top + 2]
    bend = before - 2.0 * at + after
    if bend >= 0.0:
        return float(x[top]), float(at)
    part = 0.5 * (before - after) / bend
    return float(x[top] + part * (x[1] - x[0])), float(at - 0.25 * (before - after) * part)


def _rival(total: FloatArray, top: int) -> float:
    """Return the highest value outside of the hill on which the best one stands."""
    low = np.flatnonzero(~(total > 0.5 * total[top]))
    left, right = low[low < top], low[low > top]
    outside = total.copy()
    outside[(left[-1] if left.size else 0) : (right[0] + 1 if right.size else total.size)] = np.nan
    return max(float(np.nanmax(outside)), 0.0) if np.isfinite(outside).any() else 0.0


def _correlation(moving: Signal, fixed: Signal, middle: float, longest: float) -> _Curve | None:
    """Correlate two signals at all shifts of a grid; NaN where they overlap too little."""
    signals = [finite(*signal) for signal in (moving, fixed)]
    if any(t.size < MIN_SAMPLES for t, _ in signals):
        return None
    spans = [float(t[-1] - t[0]) for t, _ in signals]
    slowest = min(1.0 / float(np.median(np.diff(t))) for t, _ in signals)
    bandwidth = min(BANDWIDTH, 0.2 * slowest)
    rate = min(RATE, MAX_POINTS / max(*spans, 1e-3))
    if bandwidth > 0.2 * rate or min(spans) < MIN_OVERLAP:
        return None
    (a, holds_a), (b, holds_b) = (_gridded(t, x, rate, bandwidth) for t, x in signals)
    values, counts = _masked(a, holds_a, b, holds_b)
    shift = (np.arange(values.size) - (a.size - 1)) / rate + float(signals[1][0][0] - signals[0][0][0])
    least = max(MIN_OVERLAP, MIN_OVERLAP_SHARE * min(spans)) * rate
    inside = (counts >= least) & (np.abs(shift - middle) <= longest)
    if np.count_nonzero(inside) < 3:
        return None
    still = float(np.std(a[holds_a > 0.5]))
    speed = float(np.std(np.gradient(a)[holds_a > 0.5])) * rate / still if still > 0.0 else 0.0
    kept = slice(*(np.flatnonzero(inside)[[0, -1]] + [0, 1]).tolist())
    return _Curve(shift[kept], np.where(inside, values, np.nan)[kept], counts[kept] / rate, speed, bandwidth)


def _gridded(t: FloatArray, x: FloatArray, rate: float, bandwidth: float) -> tuple[FloatArray, FloatArray]:
    """Return a signal on a uniform grid, low-passed with zero phase, and where it holds samples (1 or 0)."""
    from scipy.signal import butter, sosfiltfilt

    size = int((t[-1] - t[0]) * rate) + 1
    points = t[0] + np.arange(size) / rate
    holds = np.zeros(size)
    for part in stretches(t):
        low, high = np.searchsorted(points, [t[part][0], t[part][-1]])
        holds[low : high + 1] = 1.0
    values = np.interp(points, t, x)
    middle = float(np.mean(values[holds > 0.5])) if holds.any() else 0.0
    sos = butter(2, bandwidth, fs=rate, output="sos")
    smooth = sosfiltfilt(sos, values - middle, padlen=min(size - 1, int(3.0 * rate / bandwidth)))
    return np.asarray(smooth) * holds, holds


def _masked(
    a: FloatArray, holds_a: FloatArray, b: FloatArray, holds_b: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the correlation (m,) at every shift of b against a, and how many samples overlap there."""
    from scipy.signal import correlate

    def correlated(y: FloatArray, x: FloatArray) -> FloatArray:
        return np.asarray(correlate(y, x, mode="full", method="fft"))

    n = np.maximum(np.round(correlated(holds_b, holds_a)), 0.0)
    safe = np.maximum(n, 1.0)
    sum_a, sum_b = correlated(holds_b, a), correlated(b, holds_a)
    power_a = np.maximum(correlated(holds_b, a**2) - sum_a**2 / safe, 0.0)
    power_b = np.maximum(correlated(b**2, holds_a) - sum_b**2 / safe, 0.0)
    power = np.sqrt(power_a * power_b)
    floor = 1e-6 * float(np.sqrt((a @ a) * (b @ b))) + 1e-300
    return np.where(
        power > floor, (correlated(b, a) - sum_a * sum_b / safe) / np.maximum(power, floor), 0.0
    ), n
