"""Clocks of streams that disagree, brought together by motion that both streams measured.

A mapping says which stream is moved, and by which other one:

.. code-block:: toml

    [align."mocap.csv"]                  # the stream whose clock is moved
    with = "autopilot.csv"               # the stream whose clock counts
    using = ["r", "turning"]             # quantities that are compared; left out: all that both streams hold
    longest = 30.0                       # s, the largest shift looked for; left out: any
    drift = true                         # also how fast one clock runs away from the other; left out: false

References
----------
R. A. Fisher, On the "probable error" of a coefficient of correlation, Metron 1 (1921): atanh(r) is nearly normal
with variance 1 / n.
D. Padfield, Masked object registration in the Fourier domain, IEEE Trans. Image Processing 21 (2012), eq. 13:
correlation of records with holes and ends, normalized at every shift by the samples that overlap.
J. S. Bendat and A. G. Piersol, *Random Data*, 4th ed., section 8.5: error of a delay estimated from the peak.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Annotated, Final, Literal, NamedTuple, TypeAlias, TypeGuard

import numpy as np
from pydantic import Field

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.rotations import conjugate, continuous, euler_angles, normalized, product, quaternions_of
from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import EULER, POSITION, QUATERNION, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.errors import FlightError
from stoop.flight.conversion import Number, Table
from stoop.flight.gridding import MAX_VALUE, Channels, finite, stretches
from stoop.logs import Recording

QUANTITIES: Final = {
    "p": "roll rate, measured or from the attitude",
    "q": "pitch rate, measured or from the attitude",
    "r": "yaw rate, measured or from the attitude",
    "psi_dot": "how fast the heading changes; the yaw rate where there is no heading",
    "turning": "size of the rate of turn, whatever the axes",
    "vn": "velocity north, measured or from the position",
    "ve": "velocity east, measured or from the position",
    "vd": "velocity down, measured, or from position or altitude",
    "load": "size of the specific force, measured or from the velocity",
}  #: by which two streams can be compared

Signal: TypeAlias = tuple[FloatArray, FloatArray]  #: time (n,) s and values (n,)
Supply: TypeAlias = Callable[[Recording, str], Sequence[Channels]]  #: all channels that a stream can supply


class Limits:
    """When two records are compared, and when a shift is believed."""

    rate: Final = 100.0  #: Hz of the grid of comparison; the peak is interpolated between its points
    bandwidth: Final = 5.0  #: Hz; what is faster is noise of differentiation more often than motion
    points: Final = 2**20  #: of one signal; longer records are compared on a coarser grid
    overlap: Final = 5.0  #: s that must overlap
    overlap_share: Final = 0.3  #: of the shorter record, that must overlap
    samples: Final = 10  #: of a signal
    stated_correlation: Final = 0.5  #: below which a shift that the mapping asks for means nothing
    correlation: Final = 0.7  #: from which a shift is believed
    separation: Final = 4.0  #: standard deviations by which the best correlation must lie above any other
    alike: Final = 0.995  #: correlations above are alike: what is left of them is how samples fell
    piece: Final = 15.0  #: s, over which the shift of a drifting clock is estimated
    piece_shift: Final = 0.5  #: s of a piece against the whole
    attitude_delay: Final = 1.0  #: s; an attitude that comes later was not estimated from these rates
    shift: Final = 0.02  #: s; smaller disagreements are not worth a suggestion


class Alignment(Table):
    """[align.STREAM]: the clock of a stream is moved to that of another one."""

    reference: Annotated[str, Field(alias="with", min_length=1)]
    using: list[Literal["p", "q", "r", "psi_dot", "turning", "vn", "ve", "vd", "load"]] = Field(
        default_factory=list
    )
    longest: Annotated[Number, Field(gt=0.0)] | None = None
    drift: bool = False


@dataclass(frozen=True)
class Lag:
    """What must be added to one clock to read another."""

    shift: float  #: s, to be added at `origin`
    sigma: float  #: s, standard error of the shift
    correlation: float  #: of both records when shifted, 0 to 1
    rival: float  #: the highest correlation at any quite different shift
    overlap: float  #: s in which both records were compared
    samples: float  #: independent ones among them
    using: tuple[str, ...]  #: quantities that were compared
    drift: float = 0.0  #: s per s, to be added beyond `origin`
    drift_sigma: float = 0.0  #: its standard error
    origin: float = 0.0  #: s on the moved clock

    @property
    def trusted(self) -> bool:
        """Whether records are alike when shifted so, and nowhere else (Fisher's z of both correlations)."""
        z, other = (np.arctanh(min(x, Limits.alike)) for x in (self.correlation, self.rival))
        apart = (z - other) * np.sqrt(0.5 * self.samples) > Limits.separation
        return bool(self.correlation >= Limits.correlation and apart)

    def moved(self, time: FloatArray) -> FloatArray:
        """Return times [s] of the moved clock as the other one shows them."""
        return np.asarray(time + self.shift + self.drift * (time - self.origin))


def align(
    place: str, alignments: Mapping[str, Alignment], recording: Recording, supply: Supply
) -> tuple[Recording, list[Notice]]:
    """Move the clocks of streams; notices say by how much, and with which certainty.

    Parameters
    ----------
    place : of the mapping, for messages
    alignments : stream to be moved -> how
    recording : as it was read
    supply : gives all channels that a stream of the recording can supply

    Raises
    ------
    FlightError
        When a stream is missing, or both have nothing in common that shows the shift.
    """
    notices = []
    for name, one in alignments.items():
        at = f"{place}: align.{name}"
        both = []
        for stream in (name, one.reference):
            if stream not in recording.streams:
                raise FlightError(
                    f"{at}: '{stream}' is not in the log; it holds {', '.join(recording.streams)}"
                )
            known = quantities(supply(recording, stream))
            both.append({q: x for q, x in known.items() if not one.using or q in one.using})
        moving, fixed = both
        if not moving.keys() & fixed.keys():
            raise FlightError(
                f"{at}: nothing in common to compare: {name} holds {', '.join(moving) or 'nothing'}, "
                f"{one.reference} holds {', '.join(fixed) or 'nothing'}; map more of their columns"
            )
        lag = find_lag(moving, fixed, one.longest or np.inf)
        if lag is None or lag.correlation < Limits.stated_correlation:
            why = "they overlap too little"
            why = why if lag is None else f"the best correlation is {lag.correlation:.2f}"
            raise FlightError(
                f"{at}: {name} and {one.reference} do not show the same motion ({why}); "
                f"check signs and axes, or give the offset under [clock.{name}]"
            )
        lag = with_drift(lag, moving, fixed) if one.drift else lag
        std = lag.sigma
        values = {"shift": lag.shift, "std": std, "correlation": lag.correlation, "overlap": lag.overlap}
        notices.append(notice("clock-aligned", name, reference=one.reference, using=lag.using, **values))
        if lag.drift:
            notices.append(notice("clock-drift", name, ppm=1e6 * lag.drift, std=1e6 * lag.drift_sigma))
        if not lag.trusted:
            notices.append(notice("clock-doubtful", name, rival=lag.rival))
        moved = replace(recording.streams[name], time=lag.moved(recording.streams[name].time))
        recording = replace(recording, streams={**recording.streams, name: moved})
    return recording, notices


def suggest_alignments(recording: Recording, supply: Supply, place: str) -> list[Notice]:
    """Name the streams of a log of several files, each with a clock of its own, whose clocks seem to disagree.

    `place` is that of the mapping, for the advice.
    """
    if len(recording.streams) < 2:
        return []
    every = {name: quantities(supply(recording, name)) for name in recording.streams}
    known = {name: signals for name, signals in every.items() if signals}
    notices = []
    for one, other in combinations(sorted(known, key=lambda name: -len(known[name])), 2):
        lag = find_lag(known[other], known[one])
        if _is_evident(lag):
            values = {"shift": -lag.shift, "correlation": lag.correlation}
            notices.append(notice("clocks-disagree", other, reference=one, mapping=place, **values))
    return notices


def attitude_delay(channels: Sequence[Channels]) -> list[Notice]:
    """Return by how much the attitude of these channels comes late against the body rates, where that is plain."""
    forms = (set(QUATERNION), set(EULER))
    rates = next((group for group in channels if set(RATES) <= group.values.keys()), None)
    attitude = next((g for g in channels if any(form <= g.values.keys() for form in forms)), None)
    if rates is None or attitude is None or rates.source == attitude.source:
        return []
    both = (quantities([group]) for group in (attitude, rates))
    turning, measured = ({name: x for name, x in own.items() if name in RATES} for own in both)
    lag = find_lag(turning, measured, Limits.attitude_delay)
    if not _is_evident(lag):
        return []
    code = "attitude-late" if lag.shift < 0.0 else "attitude-early"
    values = {"delay": abs(lag.shift), "correlation": lag.correlation}
    return [notice(code, attitude.source, reference=rates.source, **values)]


def _is_evident(lag: Lag | None) -> TypeGuard[Lag]:
    return lag is not None and lag.trusted and abs(lag.shift) >= max(Limits.shift, 3.0 * lag.sigma)


def quantities(channels: Sequence[Channels]) -> dict[str, Signal]:
    """Return the motion that channels of one stream show, by the names of `QUANTITIES`."""
    each = ((group.time, *column) for group in channels for column in group.values.items())
    signals = {name: (time, np.where(np.abs(x) < MAX_VALUE, x, np.nan)) for time, name, x in each}
    found = _attitude_rates(signals)
    if "psi" in signals and "psi_dot" not in found:
        t, x = finite(*signals["psi"])
        found["psi_dot"] = _slope(t, np.unwrap(x))
    found |= {name: signals[name] for name in RATES if name in signals}
    if "r" in found and "psi_dot" not in found:
        found["psi_dot"] = found["r"]
    if set(RATES) <= found.keys() and found["p"][0].size == found["r"][0].size == found["q"][0].size:
        size = np.sqrt(found["p"][1] ** 2 + found["q"][1] ** 2 + found["r"][1] ** 2)
        found["turning"] = found["p"][0], size
    for speed, place in zip(VELOCITY, POSITION, strict=True):
        if speed in signals:
            found[speed] = signals[speed]
        elif place in signals:
            found[speed] = _slope(*finite(*signals[place]))
    if "altitude" in signals and "vd" not in found:
        t, x = finite(*signals["altitude"])
        found["vd"] = _slope(t, -x)
    for names in (SPECIFIC_FORCE, VELOCITY):  # the specific force: change of velocity less gravity
        if not set(names) <= signals.keys():
            continue
        t, parts = signals[names[0]][0], [signals[name][1] for name in names]
        if any(part.size != t.size for part in parts) or t.size < 3:
            continue
        if names == VELOCITY:
            x, y, z = (np.gradient(part, t) for part in parts)
            parts = [x, y, z - STANDARD_GRAVITY]
        found["load"] = t, np.sqrt(parts[0] ** 2 + parts[1] ** 2 + parts[2] ** 2)
        break
    return found


def _attitude_rates(signals: Mapping[str, Signal]) -> dict[str, Signal]:
    """Return body rates and rate of heading that an attitude implies: 2 conj(q) dq/dt."""
    names = next((part for part in (QUATERNION, EULER) if set(part) <= signals.keys()), None)
    if names is None:
        return {}
    columns = np.column_stack([signals[name][1] for name in names])
    good = np.isfinite(columns).all(axis=1)
    t, columns = signals[names[0]][0][good], columns[good]
    if t.size < 3:
        return {}
    q = continuous(normalized(columns if names == QUATERNION else quaternions_of(columns)))
    rates = 2.0 * product(conjugate(q), np.gradient(q, t, axis=0)).T[1:]
    found = {name: (t, x) for name, x in zip(RATES, rates, strict=True)}
    return {**found, "psi_dot": _slope(t, np.unwrap(euler_angles(q)[:, 2]))}


def _slope(t: FloatArray, x: FloatArray) -> Signal:
    return (t, np.gradient(x, t)) if t.size > 2 else (t[:0], x[:0])


class _Curve(NamedTuple):
    shift: FloatArray  #: (m,) s
    value: FloatArray  #: (m,) correlation
    overlap: FloatArray  #: (m,) s
    speed: float  #: 1/s, rms rate of change of the signal
    bandwidth: float  #: Hz


def find_lag(
    moving: Mapping[str, Signal], fixed: Mapping[str, Signal], longest: float = np.inf
) -> Lag | None:
    """Find the shift of one clock at which both records are most alike.

    The correlation curves of all quantities are averaged, each by its information.

    Parameters
    ----------
    moving, fixed : quantity -> its samples, on the clock to be moved and on the one that counts
    longest : s, the largest shift that is looked for

    Returns
    -------
    Lag, without drift; None when nothing can be compared
    """
    curves = {}
    for name in moving:
        curve = _correlation(moving[name], fixed[name], longest) if name in fixed else None
        if curve is not None and np.nanmax(curve.value) > 0.0:
            curves[name] = curve
    if not curves:
        return None
    best = {name: float(np.nanmax(curve.value)) for name, curve in curves.items()}
    used = {name: c for name, c in curves.items() if best[name] > 0.5 * max(best.values())}
    grid = next(iter(used.values())).shift
    weights = {name: best[name] ** 2 / (1.0001 - best[name] ** 2) for name in used}
    layers = [weights[name] * np.interp(grid, c.shift, c.value) for name, c in used.items()]
    total = np.sum(layers, axis=0) / sum(weights.values())
    if not np.isfinite(total).any():
        return None
    top = int(np.nanargmax(total))
    shift, value = float(grid[top]), float(total[top])
    if 0 < top < total.size - 1 and np.isfinite(total[top - 1 : top + 2]).all():
        before, at, after = total[top - 1 : top + 2]
        bend = before - 2.0 * at + after
        if bend < 0.0:  # the peak of a parabola through the highest point and its neighbors
            part = 0.5 * (before - after) / bend
            shift = float(grid[top] + part * (grid[1] - grid[0]))
            value = float(at - 0.25 * (before - after) * part)
    low = np.flatnonzero(~(total > 0.5 * total[top]))  # outside of the hill on which the peak stands
    left, right = low[low < top], low[low > top]
    outside = total.copy()
    outside[(left[-1] if left.size else 0) : (right[0] + 1 if right.size else total.size)] = np.nan
    rival = max(float(np.nanmax(outside)), 0.0) if np.isfinite(outside).any() else 0.0
    overlap = max(float(c.overlap[min(top, c.overlap.size - 1)]) for c in used.values())
    information = sum(
        2.0 * c.bandwidth * overlap * c.speed**2 * best[name] ** 2 / (1.0001 - best[name] ** 2)
        for name, c in used.items()
    )
    sigma = float(1.0 / np.sqrt(max(information, 1e-12)))
    samples = 2.0 * max(c.bandwidth for c in used.values()) * overlap
    return Lag(shift, sigma, min(value, 1.0), rival, overlap, samples, tuple(used))


def with_drift(lag: Lag, moving: Mapping[str, Signal], fixed: Mapping[str, Signal]) -> Lag:
    """Add how fast one clock runs away from the other, by a line through the shifts of pieces of the record.

    Where fewer than three pieces can be compared, the lag is returned as it is.
    """
    used = {name: moving[name] for name in lag.using}
    for _ in range(2):
        first, last = min(t[0] for t, _ in used.values()), max(t[-1] for t, _ in used.values())
        middles, pieces = [], []
        for start in np.arange(first, last - 0.5 * Limits.piece, Limits.piece):
            inside = {}
            for name, (time, x) in used.items():
                at = (time >= start) & (time < start + Limits.piece)
                if np.count_nonzero(at) > Limits.samples:
                    inside[name] = lag.moved(time[at]), x[at]
            piece = find_lag(inside, fixed, Limits.piece_shift) if inside else None
            if piece is not None and piece.trusted:
                middles.append(0.5 * (start + start + Limits.piece))
                pieces.append(piece)
        if len(pieces) < 3:
            return lag
        t = np.array(middles)
        weight = 1.0 / np.array([max(piece.sigma, 1e-4) for piece in pieces])
        origin = float(np.average(t, weights=weight**2))
        design = np.column_stack([np.ones(t.size), t - origin]) * weight[:, None]
        target = np.array([piece.shift for piece in pieces]) * weight
        (shift, slope), *_ = np.linalg.lstsq(design, target, rcond=None)
        rest = target - design @ np.array([shift, slope])
        scatter = max(float(rest @ rest) / max(t.size - 2, 1), 1.0)
        errors = np.sqrt(scatter * np.diag(np.linalg.inv(design.T @ design)))
        so_far = float(lag.moved(np.array([origin]))[0]) - origin
        drift, (sigma, drift_sigma) = lag.drift + float(slope) * (1.0 + lag.drift), errors.tolist()
        moved = {"shift": so_far + float(shift), "sigma": sigma, "origin": origin}
        lag = replace(lag, **moved, drift=drift, drift_sigma=drift_sigma)
    return lag


def _correlation(moving: Signal, fixed: Signal, longest: float) -> _Curve | None:
    """Correlate two signals at all shifts of a grid (Padfield, eq. 13); NaN where they overlap too little."""
    from scipy.signal import butter, correlate, sosfiltfilt

    signals = [finite(*signal) for signal in (moving, fixed)]
    if any(t.size < Limits.samples for t, _ in signals):
        return None
    spans = [float(t[-1] - t[0]) for t, _ in signals]
    slowest = min(1.0 / float(np.median(np.diff(t))) for t, _ in signals)
    bandwidth = min(Limits.bandwidth, 0.2 * slowest)
    rate = min(Limits.rate, Limits.points / max(*spans, 1e-3))
    if bandwidth > 0.2 * rate or min(spans) < Limits.overlap:
        return None
    gridded = []
    for t, x in signals:  # on a uniform grid, low-passed with zero phase; 1 where it holds samples, else 0
        size = int((t[-1] - t[0]) * rate) + 1
        points, held = t[0] + np.arange(size) / rate, np.zeros(size)
        for part in stretches(t):
            low, high = np.searchsorted(points, [t[part][0], t[part][-1]])
            held[low : high + 1] = 1.0
        values = np.interp(points, t, x)
        level = float(np.mean(values[held > 0.5])) if held.any() else 0.0
        sos = butter(2, bandwidth, fs=rate, output="sos")
        smooth = sosfiltfilt(sos, values - level, padlen=min(size - 1, int(3.0 * rate / bandwidth)))
        gridded.append((np.asarray(smooth) * held, held))
    (a, holds_a), (b, holds_b) = gridded

    def correlated(y: FloatArray, x: FloatArray) -> FloatArray:
        return np.asarray(correlate(y, x, mode="full", method="fft"))

    counts = np.maximum(np.round(correlated(holds_b, holds_a)), 0.0)
    safe = np.maximum(counts, 1.0)
    sum_a, sum_b = correlated(holds_b, a), correlated(b, holds_a)
    power_a = np.maximum(correlated(holds_b, a**2) - sum_a**2 / safe, 0.0)
    power_b = np.maximum(correlated(b**2, holds_a) - sum_b**2 / safe, 0.0)
    power = np.sqrt(power_a * power_b)
    floor = 1e-6 * float(np.sqrt((a @ a) * (b @ b))) + 1e-300
    curve = np.where(power > floor, (correlated(b, a) - sum_a * sum_b / safe) / np.maximum(power, floor), 0.0)
    shift = (np.arange(curve.size) - (a.size - 1)) / rate + float(signals[1][0][0] - signals[0][0][0])
    least = max(Limits.overlap, Limits.overlap_share * min(spans)) * rate
    inside = (counts >= least) & (np.abs(shift) <= longest)
    if np.count_nonzero(inside) < 3:
        return None
    still = float(np.std(a[holds_a > 0.5]))
    speed = float(np.std(np.gradient(a)[holds_a > 0.5])) * rate / still if still > 0.0 else 0.0
    kept = slice(*(np.flatnonzero(inside)[[0, -1]] + [0, 1]).tolist())
    return _Curve(shift[kept], np.where(inside, curve, np.nan)[kept], counts[kept] / rate, speed, bandwidth)
