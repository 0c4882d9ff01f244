"""Recorded channels -> one uniform grid: anti-alias low-pass per contiguous stretch, never across a gap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray
from stoop.errors import FlightError
from stoop.flight.channels import stretches

CUTOFF: Final = (
    0.3  #: of the grid rate: 30 Hz at 100 Hz; -35 dB at 50 Hz, -76 dB at 90 Hz, 0.02 % lost at 10 Hz
)
ORDER: Final = 4  #: of the Butterworth filter, which runs forward and backward
EDGE: Final = 1e-6  #: s; a grid point this close to the end of a stretch still belongs to it
FASTEST: Final = 1e5  #: Hz; a clock that seems to run faster is not one of a sensor
CLUMPED: Final = (
    20.0  #: times as many uniform samples as there are; then the median period is not that of the clock
)
MAX_CELLS: Final = 100_000_000  #: numbers in a gridded flight (0.8 GB)


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
        low = int(np.ceil((start - EDGE) * self.rate)) - self.first
        high = int(np.floor((stop + EDGE) * self.rate)) - self.first
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
    first = int(np.ceil((start - EDGE) * rate))
    return Grid(first, int(np.floor((stop + EDGE) * rate)) - first + 1, rate)


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
    for part in stretches(time, values):
        t, x = time[part], values[part]
        at = grid.within(float(t[0]), float(t[-1]))
        if at.stop > at.start:
            out[at] = _one_stretch(grid, at, t, x, smooth)
    return out


def _one_stretch(grid: Grid, at: slice, t: FloatArray, x: FloatArray, smooth: bool) -> FloatArray:
    points = (grid.first + np.arange(at.start, at.stop)) / grid.rate
    rate = 1.0 / float(np.median(np.diff(t)))
    if rate > FASTEST or (t[-1] - t[0]) * rate > CLUMPED * t.size:  # would fill memory, or divide by nothing
        return _interpolate(points, t, x, smooth=False)
    if rate <= 1.02 * grid.rate:
        return _interpolate(points, t, x, smooth)
    return _decimate(points, t, x, rate, grid.rate)


def _decimate(points: FloatArray, t: FloatArray, x: FloatArray, rate: float, grid_rate: float) -> FloatArray:
    """Make the samples uniform at their own rate, low-pass with zero phase, interpolate what is left.

    Interpolating first would fold the beat between both rates into the pass band.
    """
    uniform = t[0] + np.arange(int(np.ceil((t[-1] - t[0]) * rate - EDGE)) + 1) / rate
    slow = low_pass(_interpolate(uniform, t, x, smooth=True), rate, grid_rate)
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


def complete(values: FloatArray) -> npt.NDArray[np.bool_]:
    """Tell which rows of (n, k) values hold no NaN or infinity."""
    return np.asarray(np.isfinite(values).all(axis=1))
