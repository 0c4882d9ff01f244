"""Channels -> gridded data set: attitude as quaternions, angles without jumps, sources remembered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import continuous, euler_angles, normalized, quaternions_of, wrap
from stoop.base.variables import EULER, QUATERNION, VARIABLES, WRAPPED
from stoop.errors import FlightError
from stoop.flight.channels import Channels, SourceRate, source_rate, stretches
from stoop.flight.grid import Grid, complete, make_grid, resample

EMPTY: Final = 1000.0  #: points of the grid for each sample that was recorded
EMPTY_LEAST: Final = (
    200  #: samples; a grid of that many times EMPTY points is never refused for its emptiness
)

Gridded = dict[str, FloatArray]


def build(
    channels: Sequence[Channels], rate: float, place: str
) -> tuple[Grid, Gridded, dict[str, SourceRate]]:
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
    width = sum(len(c.values) for c in channels) + len(EULER)
    grid = make_grid(min(t[0] for t in clocks), max(t[-1] for t in clocks), rate, width, place)
    _refuse_emptiness(clocks, rate, place)
    data: Gridded = {}
    sources: dict[str, SourceRate] = {}
    for group in channels:
        data.update(_grid_group(grid, group))
        sources.update(_sources(group))
    return grid, _in_registry_order(data), sources


def _refuse_emptiness(clocks: Sequence[FloatArray], rate: float, place: str) -> None:
    """Refuse a grid on which next to nothing was recorded: damaged clocks make small logs large."""
    duration = float(max(t[-1] for t in clocks) - min(t[0] for t in clocks))
    samples = sum(t.size for t in clocks)
    if duration * rate > EMPTY * max(samples, EMPTY_LEAST):
        raise FlightError(
            f"{place}: only {samples} samples in {duration:.0f} s: a clock is damaged, or in another unit; "
            "check the unit of the time, or cut the log"
        )


def _sources(group: Channels) -> Mapping[str, SourceRate]:
    known = {name: source_rate(group.source, group.time[np.isfinite(x)]) for name, x in group.values.items()}
    return {**{angle: known["q0"] for angle in EULER if "q0" in known}, **known}


def _with_quaternion(channels: Channels) -> Channels:
    """Turn recorded Euler angles into a quaternion, which has no jumps to interpolate across."""
    if not set(EULER) <= set(channels.values) or set(QUATERNION) & set(channels.values):
        return channels
    angles = np.column_stack([channels.values[name] for name in EULER])
    parts = dict(zip(QUATERNION, quaternions_of(angles).T, strict=True))
    rest = {name: x for name, x in channels.values.items() if name not in EULER}
    return Channels(channels.source, channels.time, {**parts, **rest})


def _grid_group(grid: Grid, group: Channels) -> Gridded:
    data: Gridded = {}
    names = list(group.values)
    if set(QUATERNION) <= set(names):
        data.update(_grid_attitude(grid, group))
        names = [name for name in names if name not in QUATERNION]
    for block in _alike(group, names):
        data.update(_grid_block(grid, group, block))
    return data


def _alike(group: Channels, names: Sequence[str]) -> list[list[str]]:
    """Put together the variables that can be resampled in one go: same kind, same samples missing."""
    blocks: dict[tuple[str, bytes], list[str]] = {}
    for name in names:
        kind = name if name in WRAPPED else VARIABLES[name].kind
        blocks.setdefault((kind, np.packbits(np.isfinite(group.values[name])).tobytes()), []).append(name)
    return list(blocks.values())


def _grid_block(grid: Grid, group: Channels, names: Sequence[str]) -> Gridded:
    values = np.column_stack([group.values[name] for name in names])
    good = complete(values)
    t, x = group.time[good], values[good]
    circular = names[0] in WRAPPED
    if circular:
        x = _unwrapped(t, x)
    out = resample(grid, t, x, smooth=VARIABLES[names[0]].kind == "measurement")
    return dict(zip(names, (wrap(out) if circular else out).T, strict=True))


def _unwrapped(time: FloatArray, values: FloatArray) -> FloatArray:
    out = values.copy()
    for part in stretches(time, values):
        out[part] = np.unwrap(values[part], axis=0)
    return out


def _grid_attitude(grid: Grid, group: Channels) -> Gridded:
    parts = normalized(np.column_stack([group.values[name] for name in QUATERNION]))
    good = complete(parts)
    if not good.any():
        return {}
    quaternions = normalized(resample(grid, group.time[good], continuous(parts[good]), smooth=True))
    columns = [*quaternions.T, *euler_angles(quaternions).T]
    return dict(zip((*QUATERNION, *EULER), columns, strict=True))


def _in_registry_order(data: Gridded) -> Gridded:
    return {name: np.ascontiguousarray(data[name]) for name in VARIABLES if name in data}
