"""Recorded channels -> one uniform grid: anti-alias low-pass per contiguous stretch, never across a gap.

Attitudes are interpolated as quaternions, headings and bank angles without their jumps by a turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.base.rotations import continuous, euler_angles, normalized, quaternions_of, wrap
from stoop.base.variables import EULER, QUATERNION, VARIABLES, WRAPPED
from stoop.errors import FlightError
from stoop.flight.channels import Channels, SourceRate, source_rate, stretches

CUTOFF: Final = (
    0.3  #: of the grid rate: 30 Hz at 100 Hz; -35 dB at 50 Hz, -76 dB at 90 Hz, 0.02 % lost at 10 Hz
)
ORDER: Final = 4  #: of the Butterworth filter, which runs forward and backward
TIME_TOLERANCE: Final = 1e-6  #: s; a grid point this close to the end of a stretch still belongs to it
MAX_SAMPLE_RATE: Final = 1e5  #: Hz; a clock that seems to run faster is not one of a sensor
MAX_CLUMPING: Final = (
    20.0  #: times as many uniform samples as there are; then the median period is not that of the clock
)
MAX_CELLS: Final = 100_000_000  #: numbers in a gridded flight (0.8 GB)
MAX_EMPTINESS: Final = 1000.0  #: points of the grid for each sample that was recorded
MIN_COUNTED: Final = (
    200  #: samples; a grid of that many times MAX_EMPTINESS points is never refused for its emptiness
)


@dataclass(frozen=True)
class Grid:
    """Uniform grid whose points are whole multiples of the period on the log's own clock.

    Attributes
    ----------
    first : index of the first point: its time is first / rate
    size : number of points
    rate : Hz
    """

    first: int
    size: int
    rate: float

    @property
    def time(self) -> FloatArray:
        """Points of the grid, shape (size,) [s]."""
        return (self.first + np.arange(self.size)) / self.rate

    def within(self, start: float, stop: float) -> slice:
        """Return the points from start to stop [s], both included."""
        low = int(np.ceil((start - TIME_TOLERANCE) * self.rate)) - self.first
        high = int(np.floor((stop + TIME_TOLERANCE) * self.rate)) - self.first
        return slice(max(low, 0), min(max(high + 1, 0), self.size))


def make_grid(start: float, stop: float, rate: float, width: int, place: str) -> Grid:
    """Lay a grid over a record.

    Parameters
    ----------
    start, stop : s
    rate : Hz
    width : number of variables that it must hold
    place : for the error message
    """
    if not 1.0 <= rate <= 10_000.0:
        raise FlightError(
            f"{place}: a grid of {rate:g} Hz makes no sense; choose a rate between 1 and 10000 Hz"
        )
    if (stop - start) * rate * width > MAX_CELLS:
        raise FlightError(
            f"{place}: the record lasts {stop - start:.0f} s, too long for a grid of {rate:g} Hz; "
            "cut the log, or choose a lower rate"
        )
    first = int(np.ceil((start - TIME_TOLERANCE) * rate))
    return Grid(first, int(np.floor((stop + TIME_TOLERANCE) * rate)) - first + 1, rate)


def grid_channels(
    channels: Sequence[Channels], rate: float, place: str
) -> tuple[Grid, dict[str, FloatArray], dict[str, SourceRate]]:
    """Bring all channels onto one grid.

    Parameters
    ----------
    channels : each on its own clock
    rate : Hz
    place : for error messages

    Returns
    -------
    grid : from the first to the last sample of any variable
    data : variable -> (n,), NaN where there is no data
    sources : variable -> how it was recorded
    """
    channels = [_with_quaternion(c) for c in channels]
    clocks = [c.time for c in channels if c.time.size > 1]
    if not clocks:
        raise FlightError(
            f"{place}: no variable of the registry has two samples; check the topics or the mapping"
        )
    start, stop = float(min(t[0] for t in clocks)), float(max(t[-1] for t in clocks))
    grid = make_grid(start, stop, rate, sum(len(c.values) for c in channels) + len(EULER), place)
    samples = sum(t.size for t in clocks)
    if (stop - start) * rate > MAX_EMPTINESS * max(samples, MIN_COUNTED):
        raise FlightError(
            f"{place}: only {samples} samples in {stop - start:.0f} s: a clock is damaged, or in another unit; "
            "check the unit of the time, or cut the log"
        )
    data: dict[str, FloatArray] = {}
    sources: dict[str, SourceRate] = {}
    for group in channels:
        data.update(_grid_group(grid, group))
        known = {n: source_rate(group.source, group.time[np.isfinite(x)]) for n, x in group.values.items()}
        sources.update({angle: known["q0"] for angle in EULER if "q0" in known} | known)
    return grid, {name: np.ascontiguousarray(data[name]) for name in VARIABLES if name in data}, sources


def _with_quaternion(channels: Channels) -> Channels:
    """Turn recorded Euler angles into a quaternion, which has no jumps to interpolate across."""
    if not set(EULER) <= set(channels.values) or set(QUATERNION) & set(channels.values):
        return channels
    angles = np.column_stack([channels.values[name] for name in EULER])
    parts = dict(zip(QUATERNION, quaternions_of(angles).T, strict=True))
    rest = {name: x for name, x in channels.values.items() if name not in EULER}
    return Channels(channels.source, channels.time, {**parts, **rest})


def _grid_group(grid: Grid, group: Channels) -> dict[str, FloatArray]:
    """Resample a group: the attitude as a quaternion, the rest in blocks of one kind and the same missing samples."""
    data: dict[str, FloatArray] = {}
    names = list(group.values)
    if set(QUATERNION) <= set(names):
        parts = normalized(np.column_stack([group.values[name] for name in QUATERNION]))
        good = complete(parts)
        if good.any():
            q = normalized(resample(grid, group.time[good], continuous(parts[good]), smooth=True))
            data |= dict(zip((*QUATERNION, *EULER), [*q.T, *euler_angles(q).T], strict=True))
        names = [name for name in names if name not in QUATERNION]
    blocks: dict[tuple[str, bytes], list[str]] = {}
    for name in names:
        kind = name if name in WRAPPED else VARIABLES[name].kind
        blocks.setdefault((kind, np.packbits(np.isfinite(group.values[name])).tobytes()), []).append(name)
    for block in blocks.values():
        values = np.column_stack([group.values[name] for name in block])
        good = complete(values)
        t, x = group.time[good], values[good]
        circular = block[0] in WRAPPED
        for part in stretches(t) if circular else ():
            x[part] = np.unwrap(x[part], axis=0)
        out = resample(grid, t, x, smooth=VARIABLES[block[0]].kind == "measurement")
        data |= dict(zip(block, (wrap(out) if circular else out).T, strict=True))
    return data


def resample(grid: Grid, time: FloatArray, values: FloatArray, *, smooth: bool) -> FloatArray:
    """Bring samples onto the grid.

    Parameters
    ----------
    grid : where to
    time : (n,) s, increasing
    values : (n, k), finite
    smooth : interpolate by cubic splines where the samples are slower than the grid

    Returns
    -------
    (grid.size, k), NaN in gaps and outside the record
    """
    out = np.full((grid.size, values.shape[1]), np.nan)
    for part in stretches(time):
        t, x = time[part], values[part]
        at = grid.within(float(t[0]), float(t[-1]))
        if at.stop > at.start:
            out[at] = _resample_stretch(grid, at, t, x, smooth)
    return out


def _resample_stretch(grid: Grid, at: slice, t: FloatArray, x: FloatArray, smooth: bool) -> FloatArray:
    """Interpolate slow samples; decimate fast ones.

    Decimation makes the samples uniform at their own rate before the low-pass: interpolating onto the grid first
    would fold the beat between both rates into the pass band.
    """
    points = (grid.first + np.arange(at.start, at.stop)) / grid.rate
    rate = 1.0 / float(np.median(np.diff(t)))
    if rate > MAX_SAMPLE_RATE or (t[-1] - t[0]) * rate > MAX_CLUMPING * t.size:  # would fill memory
        return _interpolate(points, t, x, smooth=False)
    if rate <= 1.02 * grid.rate:
        return _interpolate(points, t, x, smooth)
    uniform = t[0] + np.arange(int(np.ceil((t[-1] - t[0]) * rate - TIME_TOLERANCE)) + 1) / rate
    slow = low_pass(_interpolate(uniform, t, x, smooth=True), rate, grid.rate)
    return _interpolate(points, uniform, slow, smooth=True)


def _interpolate(at: FloatArray, t: FloatArray, x: FloatArray, smooth: bool) -> FloatArray:
    """Interpolate by cubic splines, or linearly; samples that clump would make a spline swing."""
    steps = np.diff(t)
    if smooth and t.size > 3 and steps.min() > 0.1 * np.median(steps):
        from scipy.interpolate import CubicSpline

        return np.asarray(CubicSpline(t, x)(np.clip(at, t[0], t[-1])), dtype=np.float64)
    return np.column_stack([np.interp(at, t, column) for column in x.T])


def low_pass(values: FloatArray, rate: float, grid_rate: float) -> FloatArray:
    """Low-pass of zero phase before decimation to `grid_rate`.

    Parameters
    ----------
    values : (n, k), uniform samples without holes
    rate : Hz, of the samples
    grid_rate : Hz, of the grid to come; the amplitude at f is 1 / (1 + (f / (CUTOFF grid_rate))**(2 ORDER)),
        with both frequencies as tan(pi f / rate) in the digital filter
    """
    from scipy.signal import butter, sosfiltfilt

    sos = butter(ORDER, CUTOFF * grid_rate, fs=rate, output="sos")
    pad = min(values.shape[0] - 1, int(3.0 * rate / (CUTOFF * grid_rate)))
    return np.asarray(sosfiltfilt(sos, values, axis=0, padlen=pad), dtype=np.float64)


def complete(values: FloatArray) -> BoolArray:
    """Tell which rows of (n, k) values hold no NaN or infinity."""
    return np.asarray(np.isfinite(values).all(axis=1))
