"""How far a fit is, in a file that another program reads while it goes on."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.files import write_file
from stoop.errors import OutputError
from stoop.estimate.iterates import Candidate
from stoop.results.result import ManeuverTrace

FORMAT: Final = "stoop-progress/1"
INTERVAL: Final = 0.5  #: s between two writes
MAX_SAMPLES: Final = 200  #: of a curve
MAX_KEPT: Final = 2000  #: likewise, of a result
CURVES: Final = ("measured", "simulated")
MAX_COSTS: Final = 2000  #: in the history


class ProgressFile:
    """Keeps the latest state of a fit in a JSON file, written whole; a file that cannot be written ends no fit.

    It holds ``work`` (what is done now), ``seconds``, ``cost``, ``costs`` (seconds and cost of each improvement), ``parameters``
    (name to value, unit and bounds, SI) and ``curves``: of each piece its maneuver, time, s, and measured and simulated
    readings of each channel, SI, at most `MAX_SAMPLES` of them. At the end ``maneuvers`` holds the curves of the result's
    maneuvers, in their order, fitted or predicted.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._began = path, time.monotonic()
        self._written = -math.inf
        self._content: dict[str, Any] = {"format": FORMAT, "work": "", "costs": []}

    def turn_to(self, work: str) -> None:
        """Note what is done now."""
        self._content["work"] = work
        self._write()

    def keep(self, traces: Sequence[ManeuverTrace]) -> None:
        """Keep the curves of a result."""
        self._content["maneuvers"] = [_trace(trace) for trace in traces]
        self._write()

    def note(self, work: str) -> None:
        """Note what is done now, to be written with the next point."""
        self._content["work"] = work

    def see(self, candidate: Candidate) -> None:
        """Note a point of the search, unless the last was noted a moment ago."""
        if time.monotonic() - self._written >= INTERVAL:
            cost, costs = candidate.cost, self._content["costs"]
            if not costs or costs[-1][1] != cost:
                costs.append([round(time.monotonic() - self._began, 2), _rounded(cost)])
                del costs[: max(0, len(costs) - MAX_COSTS)]
            values = candidate.parameters
            parameters = {
                p.name: {"value": _rounded(values[p.name], 8), "unit": p.unit, "bounds": [p.lower, p.upper]}
                for p in candidate.problem.layout.parameters
            }
            self._content |= {"cost": _rounded(cost), "parameters": parameters, "curves": _curves(candidate)}
            self._write()

    def _write(self) -> None:
        self._written = time.monotonic()
        self._content["seconds"] = round(self._written - self._began, 2)
        with suppress(OutputError):
            write_file(self._path, json.dumps(self._content, allow_nan=False))


def _trace(trace: ManeuverTrace) -> dict[str, Any]:
    every = slice(None, None, max(1, math.ceil(len(trace.time) / MAX_KEPT)))
    own = trace.channels.items()
    channels = {name: {kind: _listed(getattr(one, kind)[every]) for kind in CURVES} for name, one in own}
    return {"time": _listed(trace.time[every], 8), "channels": channels}


def _curves(candidate: Candidate) -> list[dict[str, Any]]:
    out, names = [], candidate.problem.layout.vehicle.outputs
    for piece, simulated in zip(candidate.problem.pieces, candidate.simulate(), strict=True):
        every = slice(None, None, max(1, math.ceil(len(piece.time) / MAX_SAMPLES)))
        columns = zip(names, piece.whole[every].T, simulated[every].T, strict=True)
        channels = {n: dict(zip(CURVES, (_listed(z), _listed(y)), strict=True)) for n, z, y in columns}
        out.append({"maneuver": piece.maneuver, "time": _listed(piece.time[every], 8), "channels": channels})
    return out


def _listed(values: FloatArray, digits: int = 5) -> list[float | None]:
    return [_rounded(v, digits) for v in np.asarray(values).tolist()]


def _rounded(value: float, digits: int = 6) -> float | None:
    return float(f"{value:.{digits}g}") if math.isfinite(value) else None
