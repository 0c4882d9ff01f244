"""Data compatibility: which sensors are off, which channels contradict each other, and the result as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np

from stoop.assess.covariance import standard_errors
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, distinct, notice, of_severity
from stoop.base.units import DEGREE
from stoop.base.variables import EULER, POSITION, VELOCITY
from stoop.flight import VARIABLES, Flight, without_faults
from stoop.reconstruct.estimate import Estimate, estimate, residuals
from stoop.reconstruct.kinematics import OUTPUTS
from stoop.reconstruct.pieces import cut_pieces

FORMAT: Final = "stoop-compatibility/1"
MIN_SIGMAS: Final = 3.0  #: standard errors by which something is off
USUAL_ERRORS: Final = {
    "m/s2": 0.3, "rad/s": 0.01, "rad": 2.0 * DEGREE, "m/s": 1.0, "s": 0.03, "1": 0.05, "m": 0.3,
}  #: by unit: less is what good sensors do  # fmt: skip
USUAL_RESIDUALS: Final = {
    "V": 2.0, "airspeed_pitot": 2.0, "alpha": 3.0 * DEGREE, "beta": 3.0 * DEGREE,
    "phi": 2.0 * DEGREE, "theta": 2.0 * DEGREE, "psi": 4.0 * DEGREE,
    "vn": 0.7, "ve": 0.7, "vd": 0.7, "pn": 2.0, "pe": 2.0, "pd": 2.0,
}  #: rms that gusts and ordinary sensors leave  # fmt: skip
_CONTRADICTIONS: Final = {
    **dict.fromkeys(EULER, "attitude-inconsistent"),
    **dict.fromkeys(VELOCITY, "velocity-inconsistent"),
    **dict.fromkeys(POSITION, "position-inconsistent"),
    **dict.fromkeys(("V", "airspeed_pitot", "alpha", "beta"), "air-data-inconsistent"),
}


@dataclass(frozen=True)
class Finding:
    """One instrument error.

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

    @property
    def is_evident(self) -> bool:
        """Whether the sensor is off by more than good sensors are, and surely so."""
        limit = max(USUAL_ERRORS[self.unit], MIN_SIGMAS * self.std_error)
        return self.identifiable and abs(self.estimate - self.prior_mean) > limit


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
    """Result of a compatibility check.

    Attributes
    ----------
    flight : str
    findings : mapping of instrument error to Finding
    channels : mapping of channel to Consistency
    traces : tuple of Trace
    notices : tuple of Notice
        Warnings: what contradicts, the worst first, and faults of the flight; information: all else.
    """

    flight: str
    findings: Mapping[str, Finding]
    channels: Mapping[str, Consistency]
    traces: tuple[Trace, ...]
    notices: tuple[Notice, ...]

    def document(self, versions: Mapping[str, str], inputs: Mapping[str, str]) -> str:
        """Return the JSON of the result; what is not a finite number is null."""
        content = {
            "format": FORMAT,
            "flight": self.flight,
            "pieces": [[float(t.time[0]), float(t.time[-1])] for t in self.traces],
            "unknowns": {name: _finite(asdict(one)) for name, one in self.findings.items()},
            "channels": {name: _finite(asdict(one)) for name, one in self.channels.items()},
            "warnings": [str(found) for found in of_severity(self.notices, "warning")],
            "notes": [str(found) for found in of_severity(self.notices, "info")],
            "versions": dict(versions),
            "inputs": dict(inputs),
        }
        return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _finite(values: Mapping[str, Any]) -> dict[str, Any]:
    return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in values.items()}


def check(flight: Flight, windows: Sequence[tuple[float, float]] = ()) -> tuple[Compatibility, Estimate]:
    """Estimate what the sensors of a flight do to its channels, and find what contradicts.

    Parameters
    ----------
    flight : Flight
    windows : sequence of (start, stop), s on the log's own clock; the airborne part without any
    """
    found = estimate(cut_pieces(without_faults(flight), windows))
    findings, channels = _findings(found), _channels(found)
    air = () if flight.air is None else flight.air.notices
    faults = [fault.notice for fault in flight.faults]
    of_flight = [one for one in flight.notices if one not in faults and one not in air]
    notices = distinct(
        [
            *_contradictions(channels),
            *_off(findings),
            *([] if found.converged else [notice("channel-weights-not-converged")]),
            *(replace(fault, severity="warning") for fault in faults),
            *(replace(one, severity="info") for one in (*of_flight, *found.pieces.notices)),
            *_wind_agreement(found),
        ]
    )
    return Compatibility(flight.name, findings, channels, _traces(found, tuple(channels)), notices), found


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
        for u, one, plain in zip(found.problem.unknowns, found.identifiability, white, strict=True)
    }


def _channels(found: Estimate) -> dict[str, Consistency]:
    errors = np.concatenate(residuals(found.problem, found.z))
    movement = []
    for piece in found.problem.pieces:
        known = np.isfinite(piece.measured)
        mean = np.where(known, piece.measured, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
        movement.append(piece.measured - mean)
    moved = np.concatenate(movement)
    return {
        name: Consistency(_rms(errors[:, i]), _rms(moved[:, i]), VARIABLES[name].unit)
        for i, name in enumerate(OUTPUTS)
        if np.isfinite(errors[:, i]).any()
    }


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def _contradictions(channels: Mapping[str, Consistency]) -> list[Notice]:
    """Return which kinds of channels contradict the inertial data, the worst first."""
    over = {n: one.rms / USUAL_RESIDUALS[n] for n, one in channels.items() if one.rms > USUAL_RESIDUALS[n]}
    by_code: dict[str, list[str]] = {}
    for name in sorted(over, key=lambda n: -over[n]):
        rms = _shown(channels[name].rms, channels[name].unit)
        by_code.setdefault(_CONTRADICTIONS[name], []).append(f"{name} by {rms} rms")
    found = [notice(code, residuals=tuple(shown)) for code, shown in by_code.items()]
    return [*found, notice("inconsistent-no-calibration")] if found else []


def _off(findings: Mapping[str, Finding]) -> list[Notice]:
    """Return the sensors that are evidently off."""
    out = []
    for name, one in findings.items():
        if one.is_evident and not name.startswith("wind"):
            unit = one.unit.replace("rad", "deg") if one.unit.startswith("rad") else one.unit
            factor = DEGREE if one.unit.startswith("rad") else 1.0
            shown = (
                f"{one.estimate / factor:.3g} +- {one.std_error / factor:.2g} {unit if unit != '1' else ''}"
            )
            values = {"value": one.estimate, "std": one.std_error}
            out.append(notice("instrument-error", name, meaning=one.meaning, shown=shown.strip(), **values))
    return out


def _wind_agreement(found: Estimate) -> list[Notice]:
    """Compare the steady wind with that of the air data reconstruction, which uses the whole flight."""
    air, values, errors = found.pieces.flight.air, found.values, found.errors
    if air is None or "wind.n" not in values or not np.isfinite(air.wind_n):
        return []
    north, east = values["wind.n"], values["wind.e"]
    distance = max(
        abs(north - air.wind_n) / float(np.hypot(errors["wind.n"], air.wind_n_std)),
        abs(east - air.wind_e) / float(np.hypot(errors["wind.e"], air.wind_e_std)),
    )
    code = "winds-agree" if distance < MIN_SIGMAS else "winds-disagree"
    return [
        notice(code, north=north, east=east, other_north=air.wind_n, other_east=air.wind_e, distance=distance)
    ]


def _shown(value: float, unit: str) -> str:
    """Return a value with its unit, angles in degrees."""
    if unit.startswith("rad"):
        return f"{value / DEGREE:.3g} {unit.replace('rad', 'deg')}"
    return f"{value:.3g} {'' if unit == '1' else unit}".strip()


def _traces(found: Estimate, channels: Sequence[str]) -> tuple[Trace, ...]:
    columns = {name: OUTPUTS.index(name) for name in channels}
    out = []
    for i, piece in enumerate(found.problem.pieces):
        simulated = found.problem.outputs(found.z, i)
        measured = {name: piece.measured[:, j] for name, j in columns.items()}
        rebuilt = {name: simulated[:, j] for name, j in columns.items()}
        out.append(Trace(piece.time[:: piece.every], measured, rebuilt))
    return tuple(out)
