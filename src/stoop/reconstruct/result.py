"""The result of a compatibility check as plain data, and as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from stoop.assess.covariance import standard_errors
from stoop.base.arrays import FloatArray
from stoop.flight import VARIABLES, Flight, without_faults
from stoop.reconstruct.equations import OUTPUTS
from stoop.reconstruct.estimate import Estimate, estimate
from stoop.reconstruct.prepare import prepare
from stoop.reconstruct.words import air_data_agree, unexplained, warnings

FORMAT: Final = "stoop-compatibility/1"


@dataclass(frozen=True)
class Finding:
    """One unknown.

    Attributes
    ----------
    estimate, std_error, cramer_rao : float
        The error corrected for colored residuals, and the one that takes them for white.
    prior_mean, prior_std : float
    identifiable : bool
    reason : str
        Why not, or empty.
    unit, meaning : str
    """

    estimate: float
    std_error: float
    cramer_rao: float
    prior_mean: float
    prior_std: float
    identifiable: bool
    reason: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class Consistency:
    """One channel: rms of measured minus reconstructed, rms movement within the pieces, SI."""

    rms: float
    movement: float
    unit: str


@dataclass(frozen=True)
class Trace:
    """One piece: time (m,) s, and by channel measured and reconstructed (m,), SI."""

    time: FloatArray
    measured: Mapping[str, FloatArray]
    reconstructed: Mapping[str, FloatArray]


@dataclass(frozen=True)
class Compatibility:
    """What a compatibility check found.

    Attributes
    ----------
    flight : str
    findings : mapping of unknown to Finding
    channels : mapping of channel to Consistency
    traces : tuple of Trace
    warnings, notes : tuple of str
    """

    flight: str
    findings: Mapping[str, Finding]
    channels: Mapping[str, Consistency]
    traces: tuple[Trace, ...]
    warnings: tuple[str, ...]
    notes: tuple[str, ...]

    def document(self, versions: Mapping[str, str], inputs: Mapping[str, str]) -> str:
        """Return the JSON of the result; what is not a finite number is null."""
        content = {
            "format": FORMAT,
            "flight": self.flight,
            "pieces": [[float(t.time[0]), float(t.time[-1])] for t in self.traces],
            "unknowns": {name: _finite(asdict(one)) for name, one in self.findings.items()},
            "channels": {name: _finite(asdict(one)) for name, one in self.channels.items()},
            "warnings": self.warnings,
            "notes": self.notes,
            "versions": dict(versions),
            "inputs": dict(inputs),
        }
        return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _finite(values: Mapping[str, Any]) -> dict[str, Any]:
    return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in values.items()}


def check(flight: Flight, windows: Sequence[tuple[float, float]] = ()) -> tuple[Compatibility, Estimate]:
    """Estimate what the sensors of a flight do to its channels, and say what contradicts.

    Parameters
    ----------
    flight : Flight
    windows : sequence of (start, stop), s on the log's own clock; the airborne part without any
    """
    found = estimate(prepare(without_faults(flight), windows))
    left = unexplained(found)
    result = Compatibility(
        flight.name,
        _findings(found),
        {name: Consistency(rms, moved, VARIABLES[name].unit) for name, (rms, moved) in left.items()},
        _traces(found, tuple(left)),
        tuple(dict.fromkeys((*warnings(found), *(fault.message for fault in flight.faults)))),
        tuple(dict.fromkeys((*_told(flight), *found.prepared.notes, *air_data_agree(found)))),
    )
    return result, found


def _told(flight: Flight) -> list[str]:
    """Return what was said of the log, less its faults, which are warnings here, and its air data."""
    air = () if flight.air is None else tuple(map(str, flight.air.notices))
    faults = {fault.message for fault in flight.faults}
    return [note for note in map(str, flight.notices) if note not in faults and note not in air]


def _findings(found: Estimate) -> dict[str, Finding]:
    values, errors = found.values, found.errors
    white = standard_errors(found.uncertainty.cramer_rao)[: found.problem.shared] * found.problem.scales
    return {
        u.name: Finding(
            values[u.name],
            errors[u.name],
            float(plain),
            u.mean,
            u.std,
            one.identifiable,
            one.reason,
            u.unit,
            u.meaning,
        )
        for u, one, plain in zip(found.problem.unknowns, found.judged, white, strict=True)
    }


def _traces(found: Estimate, channels: Sequence[str]) -> tuple[Trace, ...]:
    columns = {name: OUTPUTS.index(name) for name in channels}
    out = []
    for i, piece in enumerate(found.problem.pieces):
        simulated = found.problem.outputs(found.z, i)
        out.append(
            Trace(
                piece.time[:: piece.every],
                {name: piece.measured[:, j] for name, j in columns.items()},
                {name: simulated[:, j] for name, j in columns.items()},
            )
        )
    return tuple(out)
