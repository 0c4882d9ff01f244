"""Arrays of a fitted model in its folder: the curves of its maneuvers, and the state of its estimate."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.npz import read_arrays
from stoop.errors import StoopError
from stoop.results.result import ChannelTrace, ManeuverTrace

MAX_BYTES: Final = 2**28
"""To which an archive may unfold."""
DAMAGED: Final = (ValueError, EOFError, OSError, RuntimeError, KeyError, zipfile.BadZipFile, zlib.error)
READINGS: Final = ("measured", "simulated", "deviation")


@dataclass(frozen=True, eq=False)
class Curves:
    """Curves of each maneuver, trajectories and cost of the search (k, 2), and the command line that fitted the model."""

    traces: tuple[ManeuverTrace, ...] = ()
    convergence: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    command: str = ""


def packed(arrays: Mapping[str, Any]) -> bytes:
    """Return arrays as an archive; the same arrays give the same bytes."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def unpacked(content: bytes, where: str) -> dict[str, Any]:
    """Return the arrays of an archive; raises `StoopError` if it is damaged."""
    try:
        return dict(read_arrays(io.BytesIO(content), MAX_BYTES))
    except DAMAGED as error:
        raise StoopError(f"{where}: cannot be read ({error}); fit again") from None


def packed_curves(curves: Curves) -> bytes:
    """Return curves as an archive, one array for each curve: ``maneuver.kind.name``."""
    command = np.frombuffer(curves.command.encode(), dtype=np.uint8)
    arrays: dict[str, Any] = {"convergence": curves.convergence, "command": command}
    for i, trace in enumerate(curves.traces):
        arrays[f"{i}.time"] = trace.time
        for name, channel in trace.channels.items():
            known = {kind: getattr(channel, kind) for kind in READINGS}
            arrays |= {f"{i}.{kind}.{name}": x for kind, x in known.items() if x is not None}
        arrays |= {f"{i}.input.{name}": x for name, x in trace.inputs.items()}
        arrays |= {f"{i}.baseline.{name}": x for name, x in trace.baseline.items()}
    return packed(arrays)


def unpacked_curves(content: bytes, count: int, where: str) -> Curves:
    """Return the curves of so many maneuvers; raises `StoopError` if the archive is damaged or of another result."""
    arrays = unpacked(content, where)
    try:
        traces = tuple(_trace(arrays, i) for i in range(count))
        command = arrays["command"].tobytes().decode("utf-8", errors="replace")
        convergence = np.reshape(np.asarray(arrays["convergence"], dtype=np.float64), (-1, 2))
        return Curves(traces, convergence, command)
    except (*DAMAGED, TypeError, AttributeError) as error:
        raise StoopError(f"{where}: does not belong to the result beside it ({error}); fit again") from None


def without_curves(count: int) -> Sequence[ManeuverTrace]:
    """Return maneuvers without curves, of a folder that holds none."""
    return [ManeuverTrace(np.empty(0), {}) for _ in range(count)]


def _curve(arrays: Mapping[str, Any], key: str) -> FloatArray:
    """Return a curve (n,) as it is kept: a conversion would multiply the memory of small integers."""
    values: FloatArray = arrays[key]
    if values.dtype != np.float64 or values.ndim != 1:
        raise ValueError(f"{key} is no curve")
    return values


def _trace(arrays: Mapping[str, Any], index: int) -> ManeuverTrace:
    """Return the curves of one maneuver, each as long as its time."""
    time = _curve(arrays, f"{index}.time")
    groups: dict[str, dict[str, FloatArray]] = {kind: {} for kind in (*READINGS, "input", "baseline")}
    for key in arrays:
        number, _, rest = key.partition(".")
        kind, _, name = rest.partition(".")
        if number == str(index) and kind in groups:
            values = _curve(arrays, key)
            if values.shape != time.shape:
                raise ValueError(f"{key} has {values.size} samples for {time.size} times")
            groups[kind][name] = values
    simulated, deviation, measured = groups["simulated"], groups["deviation"], groups["measured"]
    channels = {n: ChannelTrace(x, simulated[n], deviation.get(n)) for n, x in measured.items()}
    return ManeuverTrace(time, channels, groups["input"], groups["baseline"])
