"""Recorded channels, each group on its own clock -> one uniform grid.

Fast channels pass an anti-alias low-pass per contiguous stretch; nothing is interpolated across a gap. Attitudes are
interpolated as quaternions, headings and bank angles without their jumps by a turn. An attitude that was logged slowly
follows the body rates between its samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, run_slices, within_range
from stoop.base.notices import Notice, notice
from stoop.base.rotations import (
    conjugate,
    continuous,
    euler_angles,
    normalized,
    product,
    quaternions_about,
    quaternions_of,
    wrap,
)
from stoop.base.variables import EULER, QUATERNION, RATES, SPECIFIC_FORCE, VARIABLES, WRAPPED
from stoop.errors import FlightError

MAX_GAP: Final = 0.05  #: s; a longer hole in an input ends a segment
MAX_VALUE: Final = 1e9  #: SI; no quantity of the registry is that large
TIME_TOLERANCE: Final = 1e-6  #: s; a grid point this close to the end of a stretch still belongs to it
TIME_RESOLUTION: Final = 0.1  #: of the step of a grid; a coarser clock makes two samples of one
GRID_RATES: Final = (50.0, 60.0, 70.0, 80.0, 90.0, 100.0)
"""Hz. A sample is a step of the integration: of 20 ms at most, with which the shortest lags are stable
(`stoop.vehicle.defaults.SHORTEST_LAG`), of 10 ms at least, which resolves the motion of a rigid aircraft."""
SAME_RATE: Final = 1.02  #: ratio of rates that count as one: clocks are no better
INERTIAL: Final = frozenset({*RATES, *SPECIFIC_FORCE})
GIVEN: Final = ("simulation", "dataset", "JSBSim")  #: sources of columns that come from no log
#: of the grid rate: 30 Hz at 100 Hz; -35 dB at 50 Hz, -76 dB at 90 Hz, 0.02 % lost at 10 Hz
CUTOFF: Final = 0.3
ORDER: Final = 4  #: of the Butterworth filter, which runs forward and backward


class Limits:
    """What a record must keep to, so that damaged clocks neither distort a grid nor fill the memory."""

    gap_periods: Final = 2.5  #: median periods; the longest gap of channels logged too slowly for `MAX_GAP`
    stray_distance: Final = 60.0  #: s from the rest of the record, at which a few samples are strays
    stray_periods: Final = 100.0  #: median periods; the same for channels logged slowly
    strays: Final = 3  #: samples, at most
    sample_rate: Final = 1e5  #: Hz; a clock that seems to run faster is not one of a sensor
    #: uniform samples for each recorded one, above which the median period is not the clock's
    clumping: Final = 20.0
    cells: Final = 100_000_000  #: numbers in a gridded flight (0.8 GB)
    emptiness: Final = 1000.0  #: points of the grid for each recorded sample
    counted: Final = 200  #: samples; a grid of `counted * emptiness` points is not refused for its emptiness
    attitude_rate: Final = 20.0  #: Hz; an attitude that was logged faster does not follow the rates
    rate_ratio: Final = 5.0  #: of the rate of the gyros over that of the attitude, at least


@dataclass(frozen=True)
class Channels:
    """Variables that share one clock."""

    source: str  #: topic or file they come from
    time: FloatArray  #: (n,) s, strictly increasing
    values: Mapping[str, FloatArray]  #: variable -> (n,) SI, NaN where there is none

    @property
    def rate(self) -> float:
        """Nominal rate [Hz] from the median period; zero with fewer than two samples."""
        return 1.0 / float(np.median(np.diff(self.time))) if self.time.size > 1 else 0.0


@dataclass(frozen=True)
class SourceRate:
    """How a variable was recorded."""

    source: str  #: topic or file
    rate: float  #: Hz, from the median period
    longest_gap: float  #: s, the longest hole between two samples
    gaps: int  #: how many holes end a contiguous stretch
    start: float  #: s, first and last sample on the log's own clock
    stop: float
    #: samples of the grid that are the nearest to a reading, where the grid is faster; the others were interpolated. Empty
    #: where every sample counts
    readings: tuple[int, ...] = ()
    derived: bool = False  #: from other channels, which a fit compares instead

    def on(self, grid: Grid, time: FloatArray) -> SourceRate:
        """Return the source with its readings, taken at times (n,) s, on a grid."""
        if not 0.0 < SAME_RATE * self.rate < grid.rate:
            return self
        nearest = np.unique(np.rint(grid.position(time)).astype(np.int64))
        inside = nearest[(nearest >= 0) & (nearest < grid.size)]
        return replace(self, readings=tuple(inside.tolist()))

    def counted(self, size: int) -> BoolArray:
        """Return which of the samples (size,) of the grid count."""
        if not self.readings:
            return np.ones(size, dtype=np.bool_)
        return np.isin(np.arange(size), self.readings)


def source_rate(source: str, time: FloatArray) -> SourceRate:
    """Describe the clock of one variable, from the samples that hold a value."""
    if time.size < 2:
        start = float(time[0]) if time.size else float("nan")
        return SourceRate(source, 0.0, 0.0, 0, start, start)
    steps = np.diff(time)
    period = float(np.median(steps))
    gaps = int(np.sum(steps > _longest_step(period)))
    return SourceRate(source, 1.0 / period, float(steps.max()), gaps, float(time[0]), float(time[-1]))


def drop_outliers(group: Channels) -> tuple[Channels, list[Notice]]:
    """Drop stray samples at both ends of the record and take impossibly large values as missing.

    One damaged time stamp would make a flight of hours, nearly all of it a gap.
    """
    time, values, notices = group.time, dict(group.values), list[Notice]()
    if time.size > Limits.strays:
        steps = np.diff(time)
        far = max(Limits.stray_distance, Limits.stray_periods * float(np.median(steps)))
        cuts = np.flatnonzero(steps > far) + 1
        pieces = [(a, b) for a, b in pairwise([0, *cuts.tolist(), time.size]) if b - a > Limits.strays]
        kept = slice(pieces[0][0], pieces[-1][1]) if cuts.size and pieces else slice(0, time.size)
        lost = int(time.size - (kept.stop - kept.start))
        if lost:
            notices.append(notice("stray-samples", group.source, count=lost, distance=Limits.stray_distance))
            time, values = time[kept], {name: x[kept] for name, x in values.items()}
    values, found = drop_impossible(group.source, values)
    notices += found
    return (Channels(group.source, time, values) if notices else group), notices


def drop_impossible(
    source: str, values: Mapping[str, FloatArray], most: float = MAX_VALUE
) -> tuple[dict[str, FloatArray], list[Notice]]:
    """Take impossibly large values as missing, in channels (n,) of one source, and say so."""
    kept, notices = dict(values), []
    for name, x in values.items():
        if large := int(np.sum(np.abs(x) > most)):
            kept[name] = within_range(x, most)
            notices.append(notice("impossible-values", source, variable=name, count=large))
    return kept, notices


def longest_allowed(time: FloatArray) -> float:
    """Return the longest distance between samples [s] that may be interpolated across."""
    return _longest_step(float(np.median(np.diff(time)))) if time.size > 1 else MAX_GAP


def _longest_step(period: float) -> float:
    return max(MAX_GAP, Limits.gap_periods * period)


def stretches(time: FloatArray) -> list[slice]:
    """Split rising times (n,) s where the hole between neighbors is too long; slices of two samples and more."""
    cuts = np.flatnonzero(np.diff(time) > longest_allowed(time)) + 1
    return [slice(a, b) for a, b in pairwise([0, *cuts.tolist(), time.size]) if b - a > 1]


def finite(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return times and values (n,) of the samples whose value is finite."""
    good = np.isfinite(values)
    return time[good], values[good]


def complete(values: FloatArray) -> BoolArray:
    """Tell which rows of (n, k) values hold no NaN or infinity."""
    return np.asarray(np.isfinite(values).all(axis=1))


@dataclass(frozen=True)
class Grid:
    """Uniform grid: `size` multiples of the period from `first / rate` on, later by `phase`, on the log's own clock."""

    first: int
    size: int
    rate: float
    phase: float = 0.0  #: s

    @property
    def time(self) -> FloatArray:
        """Points of the grid, shape (size,) [s]."""
        return (self.first + np.arange(self.size)) / self.rate + self.phase

    def position(self, time: FloatArray) -> FloatArray:
        """Return times (n,) s as fractional indices of the points."""
        return (time - self.phase) * self.rate - self.first

    def covered(self, start: float, stop: float) -> slice:
        """Return the indices of the points between two times [s], which may lie outside the grid."""
        low, high = self.position(np.array([start - TIME_TOLERANCE, stop + TIME_TOLERANCE]))
        return slice(int(np.ceil(low)), int(np.floor(high)) + 1)


def grid_rate(rates: Iterable[float]) -> float:
    """Return the lowest of `GRID_RATES` [Hz] that no channel of these rates [Hz] exceeds, or the highest."""
    fastest = max(rates, default=0.0)
    return next((rate for rate in GRID_RATES if fastest <= SAME_RATE * rate), GRID_RATES[-1])


def inertial_phase(groups: Iterable[Channels], rate: float) -> float:
    """Return the phase [s] of the fastest gyro or accelerometer whose samples a grid of `rate` [Hz] can hold, or zero.

    Interpolation between samples colors their noise, most of all midway; faster sensors are low-passed and decimated. The phase,
    half a period at most, is the circular mean of their times over one period; zero where most of them have no phase in common,
    as those of a clock of another rate, and where the multiples of the period are as good.
    """
    held = [g for g in groups if INERTIAL & g.values.keys() and 0.0 < g.rate <= SAME_RATE * rate]
    if not held:
        return 0.0
    turn = np.exp(2j * np.pi * rate * max(held, key=lambda g: g.rate).time).mean()
    phase = float(np.angle(turn)) / (2.0 * np.pi * rate)
    return phase if abs(turn) > 0.5 and abs(phase) > TIME_TOLERANCE else 0.0


def make_grid(start: float, stop: float, rate: float, width: int, place: str, phase: float = 0.0) -> Grid:
    """Lay a grid of `rate` [Hz] and `phase` [s] over a record [s] of `width` variables; `place` is for error messages."""
    if not 1.0 <= rate <= 10_000.0:
        raise FlightError(
            f"{place}: a grid of {rate:g} Hz makes no sense; choose a rate between 1 and 10000 Hz"
        )
    if (stop - start) * rate * width > Limits.cells:
        raise FlightError(
            f"{place}: the record lasts {stop - start:.0f} s, too long for a grid of {rate:g} Hz; "
            "check the unit of the time, cut the log, or choose a lower rate"
        )
    if np.spacing(max(abs(start), abs(stop))) * rate > TIME_RESOLUTION:
        raise FlightError(
            f"{place}: its clock begins at {start:g} s, where numbers of 64 bits do not distinguish the samples of {rate:g} Hz; "
            "check the unit of the time"
        )
    covered = Grid(0, 0, rate, phase).covered(start, stop)
    count = covered.stop - covered.start
    if count < 2:
        raise FlightError(
            f"{place}: the record lasts {stop - start:.2g} s, less than two samples of {rate:g} Hz; "
            "check the unit of the time, or choose a higher rate"
        )
    return Grid(covered.start, count, rate, phase)


def grid_channels(
    channels: Sequence[Channels], rate: float | None, place: str
) -> tuple[Grid, dict[str, FloatArray], dict[str, SourceRate]]:
    """Bring channels, each on its own clock, onto one grid of `rate` [Hz], by default as fast as the fastest channel.

    Parameters
    ----------
    channels : of a flight
    rate : Hz; None chooses it by `grid_rate`
    place : for error messages

    Returns
    -------
    grid : from the first to the last sample of any variable
    data : variable -> (n,), NaN where there is no data
    sources : variable -> how it was recorded
    """
    groups = []
    for group in channels:
        values = dict(group.values)
        if set(EULER) <= values.keys() and not set(QUATERNION) & values.keys():
            # a quaternion has no jumps to interpolate across
            q = quaternions_of(np.column_stack([values.pop(name) for name in EULER]))
            values = {**dict(zip(QUATERNION, q.T, strict=True)), **values}
        groups.append(Channels(group.source, group.time, values))
    clocks = [group.time for group in groups if group.time.size > 1]
    lacks = "no variable of the registry has two samples; check the topics or the mapping"
    empty = FlightError(f"{place}: {lacks}")
    if not clocks:
        raise empty
    start, stop = float(min(t[0] for t in clocks)), float(max(t[-1] for t in clocks))
    sources: dict[str, SourceRate] = {}
    for group in groups:
        known = {n: source_rate(group.source, group.time[np.isfinite(x)]) for n, x in group.values.items()}
        sources.update(known)
    rate = grid_rate(source.rate for source in sources.values()) if rate is None else rate
    width = sum(len(group.values) for group in groups) + len(EULER)
    grid = make_grid(start, stop, rate, width, place, inertial_phase(groups, rate))
    samples = sum(t.size for t in clocks)
    if (stop - start) * rate > Limits.emptiness * max(samples, Limits.counted):
        raise FlightError(
            f"{place}: only {samples} samples in {stop - start:.0f} s: a clock is damaged, or in another unit; "
            "check the unit of the time, or cut the log"
        )
    data: dict[str, FloatArray] = {}
    for group in groups:
        data.update(_grid_group(grid, group))
        for name, x in group.values.items():
            sources[name] = sources[name].on(grid, group.time[np.isfinite(x)])
        if "q0" in group.values:
            sources |= dict.fromkeys(EULER, sources["q0"])
    if not data:  # no number is finite
        raise empty
    return grid, {name: np.ascontiguousarray(data[name]) for name in VARIABLES if name in data}, sources


def _grid_group(grid: Grid, group: Channels) -> dict[str, FloatArray]:
    """Resample a group: the attitude as a quaternion, the rest one by one."""
    data: dict[str, FloatArray] = {}
    names = list(group.values)
    if set(QUATERNION) <= set(names):
        parts = normalized(np.column_stack([group.values[name] for name in QUATERNION]))
        good = complete(parts)
        if good.any():
            q = normalized(resample(grid, group.time[good], continuous(parts[good]), smooth=True))
            data |= dict(zip((*QUATERNION, *EULER), [*q.T, *euler_angles(q).T], strict=True))
        names = [name for name in names if name not in QUATERNION]
    for name in names:  # one by one: splines of all at once would fill the memory with a long record
        known = np.isfinite(group.values[name])
        t, x = group.time[known], group.values[name][known, None]
        for part in stretches(t) if name in WRAPPED else ():
            x[part] = np.unwrap(x[part], axis=0)
        out = resample(grid, t, x, smooth=VARIABLES[name].kind == "measurement")[:, 0]
        data[name] = wrap(out) if name in WRAPPED else out
    return data


def resample(grid: Grid, time: FloatArray, values: FloatArray, *, smooth: bool) -> FloatArray:
    """Bring samples (n, k), finite, at rising times (n,) s onto the grid: slow ones are interpolated, fast ones decimated.

    Decimation makes the samples uniform at their own rate before the low-pass: interpolating onto the grid first
    would fold the beat between both rates into the pass band. Slow ones are interpolated by cubic splines with `smooth`.

    Returns
    -------
    (grid.size, k), NaN in gaps and outside the record
    """
    out, points_of_grid = np.full((grid.size, values.shape[1]), np.nan), grid.time
    for part in stretches(time):
        t, x = time[part], values[part]
        covered = grid.covered(float(t[0]), float(t[-1]))
        low, high = max(covered.start, 0), min(covered.stop, grid.size)
        if high <= low:
            continue
        points = points_of_grid[low:high]
        rate = 1.0 / float(np.median(np.diff(t)))
        # uniform samples of such a clock would fill the memory
        clumped = rate > Limits.sample_rate or (t[-1] - t[0]) * rate > Limits.clumping * t.size
        if clumped or rate <= SAME_RATE * grid.rate:
            out[low:high] = _interpolate(points, t, x, smooth and not clumped)
            continue
        uniform = t[0] + np.arange(int(np.ceil((t[-1] - t[0]) * rate - TIME_TOLERANCE)) + 1) / rate
        slow = low_pass(_interpolate(uniform, t, x, smooth=True), rate, grid.rate)
        out[low:high] = _interpolate(points, uniform, slow, smooth=True)
    return out


def _interpolate(at: FloatArray, t: FloatArray, x: FloatArray, smooth: bool) -> FloatArray:
    """Interpolate by cubic splines, or linearly; samples that clump would make a spline swing."""
    steps = np.diff(t)
    if smooth and t.size > 3 and steps.min() > 0.1 * np.median(steps):
        from scipy.interpolate import CubicSpline

        return np.asarray(CubicSpline(t, x)(np.clip(at, t[0], t[-1])), dtype=np.float64)
    return np.column_stack([np.interp(at, t, column) for column in x.T])


def low_pass(values: FloatArray, rate: float, grid_rate: float) -> FloatArray:
    """Low-pass of zero phase of uniform samples (n, k) at `rate` [Hz], before decimation to `grid_rate` [Hz].

    The amplitude at f is 1 / (1 + (f / (CUTOFF grid_rate))**(2 ORDER)), with both frequencies as tan(pi f / rate) in the
    digital filter.
    """
    from scipy.signal import butter, sosfiltfilt

    sos = butter(ORDER, CUTOFF * grid_rate, fs=rate, output="sos")
    pad = min(values.shape[0] - 1, int(3.0 * rate / (CUTOFF * grid_rate)))
    return np.asarray(sosfiltfilt(sos, values, axis=0, padlen=pad), dtype=np.float64)


def interpolate_by_rates(
    grid: Grid,
    data: Mapping[str, FloatArray],
    sources: Mapping[str, SourceRate],
    channels: Sequence[Channels],
) -> tuple[dict[str, FloatArray], list[Notice]]:
    """Return the columns with a slowly logged attitude that follows the body rates between its samples, and a notice.

    A spline through an attitude of 5 Hz cuts the corners of every quick maneuver. The rates are integrated instead;
    the slowly changing rotation between the integral and the logged attitude is interpolated linearly. `channels` are
    as recorded, each on its own clock, the attitude as a quaternion.
    """
    known = sources.get("q0")
    logged = next((g for g in channels if set(QUATERNION) <= g.values.keys()), None)
    if (
        known is None
        or logged is None
        or not {*RATES, *QUATERNION} <= data.keys()
        or not 0.0 < known.rate < Limits.attitude_rate
        or min(sources[name].rate for name in RATES) < Limits.rate_ratio * known.rate
    ):
        return dict(data), []
    rates = np.column_stack([data[name] for name in RATES])
    out = np.column_stack([data[name] for name in QUATERNION])
    parts = normalized(np.column_stack([logged.values[name] for name in QUATERNION]))
    good = complete(parts)
    time, parts = logged.time[good], parts[good]
    for run in run_slices(complete(rates)):
        own = grid.time[run]
        inside = (time >= own[0]) & (time <= own[-1])
        if np.count_nonzero(inside) < 2:
            continue
        turned = integrate_rates(rates[run], grid.rate)
        there = normalized(np.column_stack([np.interp(time[inside], own, column) for column in turned.T]))
        offset = continuous(product(parts[inside], conjugate(there)))
        part = replace(grid, first=grid.first + run.start, size=run.stop - run.start)
        found = product(normalized(resample(part, time[inside], offset, smooth=False)), turned)
        valid = complete(found) & complete(out[run])
        out[run] = np.where(valid[:, None], found, out[run])
    valid = complete(out)
    out[valid] = continuous(out[valid])
    columns = dict(zip((*QUATERNION, *EULER), [*out.T, *euler_angles(out).T], strict=True))
    told = notice("attitude-follows-rates", logged.source, rate=known.rate)
    return {name: columns.get(name, x) for name, x in data.items()}, [told]


def integrate_rates(rates: FloatArray, rate: float) -> FloatArray:
    """Return the attitude (n, 4) after turning at body rates (n, 3), rad/s, sampled at `rate` [Hz], from no rotation.

    The rate of a step is the mean of its ends. Products of ever longer stretches are taken at once, so that a long
    flight takes as many passes as its length has binary digits.
    """
    angle = 0.5 * (rates[1:] + rates[:-1]) / rate
    out = np.concatenate([[[1.0, 0.0, 0.0, 0.0]], quaternions_about(angle)])
    reach = 1
    while reach < len(out):
        out[reach:] = product(out[:-reach], out[reach:])
        reach *= 2
    return continuous(normalized(out))
