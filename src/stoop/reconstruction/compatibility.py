"""Data compatibility: which sensors are off, which channels contradict each other, and the flight without these errors.

Noise covariance and instrument errors are estimated alternately, the latter by Levenberg-Marquardt, until both converge.
Error bars count the color of the residuals, and that these may be in step with what is estimated: the aircraft reacts to the
gusts that its vanes read, and the noise of gyros and accelerometers is in the motion that the vanes are compared with.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np

from stoop import optimize
from stoop.assessment.contributions import systematic_shifts
from stoop.assessment.covariance import standard_errors
from stoop.assessment.error_bars import Identifiability, Uncertainty, estimate_uncertainty, identifiability
from stoop.base.arrays import FloatArray
from stoop.base.blas import on_one_blas_thread
from stoop.base.notices import Notice, distinct, notice, of_severity
from stoop.base.numbers import finite_or_none
from stoop.base.text import Summarized
from stoop.base.units import DEGREE
from stoop.base.variables import EULER, POSITION, QUATERNION, VELOCITY, WRAPPED
from stoop.errors import IdentificationError
from stoop.estimate.noise import correlation_times
from stoop.flight import VARIABLES, Flight
from stoop.flight.air_data import RECONSTRUCTED, flow, with_air
from stoop.flight.flight import Gridded, on_circle, with_attitude
from stoop.flight.instrument_errors import RATES_DELAY, instrument_errors
from stoop.problem.evidence import PieceEvidence, Unknown
from stoop.reconstruction.kinematics import INPUTS, OUTPUTS
from stoop.reconstruction.problem import LATE, PIECES, Pieces, Problem, cut_pieces
from stoop.vehicle.channels import rigid_states
from stoop.vehicle.delays import delayed

FORMAT: Final = "stoop-compatibility/1"
MIN_SIGMAS: Final = 3.0  #: standard errors by which something is off
USUAL_ERRORS: Final = {
    "m/s2": 0.3, "rad/s": 0.01, "rad": 2.0 * DEGREE, "m/s": 1.0, "s": 0.03, "1": 0.05, "m": 0.3,
}  #: by unit: less is what good sensors do  # fmt: skip
_AIR: Final = ("V", "airspeed_pitot", "alpha", "beta")


@dataclass(frozen=True)
class ChannelNoise:
    """Prior knowledge of the residual of a channel, SI, and the notice of a residual that is too large."""

    least: float  #: no channel is trusted further
    first: float  #: before anything is known
    usual: float  #: rms that gusts and ordinary sensors leave
    code: str


CHANNELS: Final = {
    **dict.fromkeys(_AIR[:2], ChannelNoise(0.05, 1.0, 2.0, "air-data-inconsistent")),
    **dict.fromkeys(_AIR[2:], ChannelNoise(1e-4, 0.03, 3.0 * DEGREE, "air-data-inconsistent")),
    **dict.fromkeys(EULER, ChannelNoise(1e-4, 0.03, 2.0 * DEGREE, "attitude-inconsistent")),
    "psi": ChannelNoise(1e-4, 0.03, 4.0 * DEGREE, "attitude-inconsistent"),
    **dict.fromkeys(VELOCITY, ChannelNoise(0.01, 0.5, 0.7, "velocity-inconsistent")),
    **dict.fromkeys(POSITION, ChannelNoise(0.02, 2.0, 2.0, "position-inconsistent")),
}
_SETTINGS: Final = optimize.Settings(iterations=60, gain=1e-8, predicted=1e-6, stall=0, stall_damping=np.inf)
#: trial steps of all searches together, times pieces: sound flights take 12 to 560; a record that no errors of instruments
#: explain would go on for minutes
MAX_STEPS: Final = 900


@dataclass(frozen=True, eq=False)
class Estimate:
    """A finished compatibility fit."""

    pieces: Pieces
    problem: Problem  #: with the final weights
    z: FloatArray  #: (E,), the optimum
    uncertainty: Uncertainty  #: of the whole vector, in prior standard deviations
    systematic: FloatArray  #: (k,), SI, by which residuals in step with each unknown, such as those of gusts, may shift it
    identifiability: tuple[Identifiability, ...]  #: of the instrument errors
    converged: bool  #: whether noise and estimates converged

    @property
    def values(self) -> dict[str, float]:
        """Estimates of the unknowns, SI."""
        found = self.problem.values(self.z[None, :])[0]
        return {u.name: float(value) for u, value in zip(self.problem.unknowns, found, strict=True)}

    @property
    def errors(self) -> dict[str, float]:
        """Standard errors of the unknowns, corrected for color and with what systematic residuals may shift, SI."""
        sigma = standard_errors(self.uncertainty.corrected)[: self.problem.shared] * self.problem.scales
        sigma = np.hypot(sigma, self.systematic)
        return {u.name: float(value) for u, value in zip(self.problem.unknowns, sigma, strict=True)}


@dataclass(frozen=True)
class InstrumentError:
    """One instrument error."""

    estimate: float
    std_error: float  #: corrected for colored residuals, and with the next
    #: by which residuals that are in step with it may shift it: gusts to which the aircraft reacts, noise of the gyros and
    #: accelerometers that is integrated
    systematic: float
    cramer_rao: float  #: standard error that takes them for white
    prior_mean: float
    prior_std: float
    identifiable: bool
    reason: str  #: why not, or empty
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


@dataclass(frozen=True, repr=False)
class Compatibility(Summarized):
    """Result of a compatibility check."""

    flight: str
    findings: Mapping[str, InstrumentError]  #: by instrument error
    channels: Mapping[str, Consistency]
    traces: tuple[Trace, ...]
    #: warnings: what contradicts, the worst first, and faults of the flight; then all else
    notices: tuple[Notice, ...]

    def document(self, versions: Mapping[str, str], inputs: Mapping[str, str]) -> str:
        """Return the JSON of the result; what is not a finite number is null."""

        def finite(values: Mapping[str, Any]) -> dict[str, Any]:
            return {k: finite_or_none(v) if isinstance(v, float) else v for k, v in values.items()}

        content = {
            "format": FORMAT,
            "flight": self.flight,
            "pieces": [[float(t.time[0]), float(t.time[-1])] for t in self.traces],
            "unknowns": {name: finite(asdict(one)) for name, one in self.findings.items()},
            "channels": {name: finite(asdict(one)) for name, one in self.channels.items()},
            "warnings": [str(found) for found in of_severity(self.notices, "warning")],
            "notes": [str(found) for found in of_severity(self.notices, "info")],
            "versions": dict(versions),
            "inputs": dict(inputs),
        }
        return json.dumps(content, indent=1, allow_nan=False) + "\n"

    @staticmethod
    @on_one_blas_thread
    def of(flight: Flight, windows: Sequence[tuple[float, float]] = ()) -> tuple[Compatibility, Estimate]:
        """Estimate the instrument errors of a flight, and find channels that contradict each other.

        Parameters
        ----------
        flight : Flight
        windows : sequence of (start, stop), s on the log's own clock; the airborne part without any

        Raises
        ------
        FlightError
            The flight holds nothing that could be compared.
        IdentificationError
            The kinematics cannot be integrated from the recorded inputs.
        """
        found = _estimate(cut_pieces(flight.without_faults(), windows))
        problem, values, errors = found.problem, found.values, found.errors
        white = standard_errors(found.uncertainty.cramer_rao)[: problem.shared] * problem.scales
        findings = {}
        shifts = found.systematic.tolist()
        for u, one, plain, shift in zip(problem.unknowns, found.identifiability, white, shifts, strict=True):
            numbers = (values[u.name], errors[u.name], shift, float(plain), u.mean, u.std)
            reason = "" if one.reason is None else str(one.reason)
            findings[u.name] = InstrumentError(*numbers, one.identifiable, reason, u.unit, u.meaning)
        left, moved = np.concatenate(problem.errors(found.z)), []
        for piece in problem.pieces:
            known = np.isfinite(piece.measured)
            mean = np.where(known, piece.measured, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
            moved.append(piece.measured - mean)
        movement = np.concatenate(moved)
        seen = {n: i for i, n in enumerate(OUTPUTS) if np.isfinite(left[:, i]).any()}
        pairs = {n: (left[:, i], movement[:, i]) for n, i in seen.items()}
        channels = {
            n: Consistency(_rms(x), _rms(whole), VARIABLES[n].unit) for n, (x, whole) in pairs.items()
        }
        traces = []
        for i, piece in enumerate(problem.pieces):
            readings = (piece.measured, problem.outputs(found.z, i))
            both = [{name: x[:, OUTPUTS.index(name)] for name in channels} for x in readings]
            traces.append(Trace(piece.time[:: piece.every], *both))
        air = () if flight.air is None else flight.air.notices
        faults = [fault.notice for fault in flight.faults]
        of_flight = [one for one in flight.notices if one not in faults and one not in air]
        notices = distinct(
            [
                *_contradictions(channels),
                *_errors_found(findings),
                *([] if found.converged else [notice("channel-weights-not-converged")]),
                *(replace(fault, severity="warning") for fault in faults),
                *(replace(one, severity="info") for one in (*of_flight, *found.pieces.notices)),
                *_wind_agreement(found),
            ]
        )
        return Compatibility(flight.name, findings, channels, tuple(traces), notices), found


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def _estimate(pieces: Pieces) -> Estimate:
    """Estimate instrument errors and initial states from the logged channels."""
    sigma = np.array([CHANNELS[name].first for name in OUTPUTS])
    problem = Problem(instrument_errors(pieces.logged), pieces.pieces, sigma)
    # everything at its prior, the wind as the air data reconstruction has it
    z, converged, air = np.zeros(problem.extra), False, pieces.flight.air
    for i, unknown in enumerate(problem.unknowns):
        if air is not None and np.isfinite(air.wind_n) and unknown.name in ("wind.n", "wind.e"):
            z[i] = ((air.wind_n if unknown.name == "wind.n" else air.wind_e) - unknown.mean) / unknown.std
    left = MAX_STEPS // len(pieces.pieces)
    for _ in range(12):
        end = optimize.refine(problem, z, 0, replace(_SETTINGS, iterations=min(_SETTINGS.iterations, left)))
        left -= end.iterations
        if not np.isfinite(end.cost):
            raise IdentificationError(
                f"{pieces.flight.name}: the recorded rates and accelerations cannot be integrated; "
                "look for wild samples with stoop info"
            )
        normal = problem.jacobian(end.z, 0, problem.residuals(end.z[None, :], 0)[0])[0].gram()
        error = np.sqrt(np.diag(np.linalg.inv(normal)))[: problem.shared]
        change = np.abs(end.z - z)[: problem.shared] / error
        z = end.z
        # new weights may still change an estimate by so many standard errors
        converged = left > 0 and float(np.max(change, initial=0.0)) < 0.2
        if converged or left <= 0:
            break
        # half of the way, or channels take turns in being believed
        problem = replace(problem, sigma=np.sqrt(problem.sigma * _sigma(problem, z)))
    found = estimate_uncertainty(_sensitivities(problem, z), np.eye(problem.extra))
    names = [u.name for u in problem.unknowns]
    names += [f"start {i}" for i in range(problem.extra - problem.shared)]
    unknowns, known = [Unknown(name, "parameter", 0.0, 1.0, prior=1.0) for name in names], []
    judged = identifiability(unknowns, found.information, found.corrected)[: problem.shared]
    coloring, noise = found.coloring, found.noise
    shifts = systematic_shifts(coloring.segments, found.information, noise, problem.shared) * problem.scales
    # of the prior's
    sigmas = np.hypot(standard_errors(found.corrected)[: problem.shared], shifts / problem.scales)
    for one, value, sigma in zip(judged, problem.values(z[None, :])[0], sigmas, strict=True):
        reason = notice("delay-beyond-margin", one.name, margin=PIECES.margin)
        if one.name.endswith(".delay") and abs(float(value)) > PIECES.margin:
            known.append(replace(one, identifiable=False, reason=reason))
        elif one.identifiable and sigma > 1.0:
            known.append(replace(one, identifiable=False, reason=notice("systematic-shift", one.name)))
        else:
            known.append(one)
    return Estimate(pieces, problem, z, found, shifts, tuple(known), converged)


def _sigma(problem: Problem, z: FloatArray) -> FloatArray:
    """Return the weighting of each channel: its noise times the root of its correlation time.

    Channels were recorded at different rates and interpolated; one that is sampled ten times between two of
    its own readings must not count ten times.
    """
    errors = problem.errors(z)
    together = np.concatenate(errors)
    repeats = correlation_times(errors, problem.pieces[0].dt * problem.pieces[0].every)
    out = np.ones(len(OUTPUTS))
    for i, name in enumerate(OUTPUTS):
        seen = together[np.isfinite(together[:, i]), i]
        if seen.size:
            power = max(float(np.mean(seen**2)), CHANNELS[name].least ** 2)
            out[i] = np.sqrt(power * repeats[i])
    return out


def _sensitivities(problem: Problem, z: FloatArray) -> list[PieceEvidence]:
    """Return whitened residuals and sensitivities of each piece, channels that were measured only."""
    r = problem.residuals(z[None, :], 0)[0]
    J, _ = problem.jacobian(z, 0, r)
    used = np.flatnonzero(np.any([np.isfinite(p.measured).any(axis=0) for p in problem.pieces], axis=0))
    out, first = [], 0
    for piece, own, part in zip(problem.pieces, J.present, J.parts, strict=False):  # the last are priors
        block = slice(first, first + piece.measured.size)
        shape = (len(piece.measured), len(OUTPUTS))
        seen = np.isfinite(piece.measured[:, used])
        residual = np.where(seen, -r[block].reshape(shape)[:, used], np.nan)
        slopes = np.zeros((*residual.shape, problem.extra))
        slopes[:, :, own] = part.T.reshape(*shape, -1)[:, used]
        out.append(PieceEvidence(residual, slopes))
        first = block.stop
    return out


def _contradictions(channels: Mapping[str, Consistency]) -> list[Notice]:
    """Return which kinds of channels contradict the inertial data, the worst first."""
    over = {n: one.rms / CHANNELS[n].usual for n, one in channels.items() if one.rms > CHANNELS[n].usual}
    by_code: dict[str, list[str]] = {}
    for name in sorted(over, key=lambda n: -over[n]):
        rms, unit = channels[name].rms, channels[name].unit
        shown = f"{rms / DEGREE:.3g} deg" if unit == "rad" else f"{rms:.3g} {unit}"
        by_code.setdefault(CHANNELS[name].code, []).append(f"{name} by {shown} rms")
    found = [notice(code, residuals=tuple(shown)) for code, shown in by_code.items()]
    return [*found, notice("inconsistent-no-calibration")] if found else []


def _errors_found(findings: Mapping[str, InstrumentError]) -> list[Notice]:
    """Return the sensors that are evidently off."""
    out = []
    for name, one in findings.items():
        if one.is_evident and not name.startswith("wind"):
            angle = one.unit.startswith("rad")
            unit, factor = (one.unit.replace("rad", "deg"), DEGREE) if angle else (one.unit, 1.0)
            numbers = f"{one.estimate / factor:.3g} +- {one.std_error / factor:.2g}"
            shown = numbers if unit == "1" else f"{numbers} {unit}"
            values = {"value": one.estimate, "std": one.std_error}
            out.append(notice("instrument-error", name, meaning=one.meaning, shown=shown, **values))
    return out


def _wind_agreement(found: Estimate) -> list[Notice]:
    """Compare the steady wind with that of the air data reconstruction, which uses the whole flight."""
    air, values, errors = found.pieces.flight.air, found.values, found.errors
    if air is None or "wind.n" not in values or not np.isfinite(air.wind_n):
        return []
    north, east = values["wind.n"], values["wind.e"]
    both = (north - air.wind_n, "n", air.wind_n_std), (east - air.wind_e, "e", air.wind_e_std)
    distance = max(abs(x) / float(np.hypot(errors[f"wind.{axis}"], std)) for x, axis, std in both)
    code = "winds-agree" if distance < MIN_SIGMAS else "winds-disagree"
    others = {"other_north": air.wind_n, "other_east": air.wind_e, "distance": distance}
    return [notice(code, "", north=north, east=east, **others)]


def corrected_flight(found: Estimate) -> Flight:
    """Return the flight as sensors without the errors that were found would have logged it.

    Biases, scales and positions of vanes are undone together, as they were estimated; delays where they are evident, for
    shifting smooths. Air data without vanes are reconstructed anew.
    """
    flight, values = found.pieces.flight, found.values
    evident = {one.name for one in found.identifiability if one.identifiable and one.name.endswith(".delay")}
    delays = {n: values[n] for n in evident if abs(values[n]) > 2.0 * found.errors[n]}
    columns, sources = {}, dict(flight.sources)
    for name in VARIABLES:
        if name not in flight.names or flight.sources[name].source == RECONSTRUCTED:
            continue
        late = RATES_DELAY if name in ("p", "q", "r") else LATE.get(name, "")
        x, samples = flight.column(name), -delays.get(late, 0.0) * flight.rate
        if name in WRAPPED:  # between pi and -pi there is no value: interpolate on the circle
            x = np.asarray(np.arctan2(delayed(np.sin(x), samples), delayed(np.cos(x), samples)))
        else:
            x = delayed(x, samples)
        moved = (i + round(samples) for i in sources[name].readings)
        sources[name] = replace(sources[name], readings=tuple(moved))
        if name in (*INPUTS, *EULER, *_AIR):  # reading = scale * truth + bias
            x = np.asarray((x - values.get(f"{name}.bias", 0.0)) / values.get(f"{name}.scale", 1.0))
        columns[name] = x
    vanes = ("V", "alpha", "beta")
    if set(vanes) <= columns.keys() and "vane.x" in values:  # flow at the reference point
        moving = rigid_states({name: columns[name] for name in vanes})
        omega = np.column_stack([columns[name] for name in "pqr"])
        arm = np.array([values[f"vane.{axis}"] for axis in "xyz"])
        velocity = np.column_stack([moving[name] for name in "uvw"]) - np.cross(omega, arm)
        columns |= dict(zip(vanes, flow(velocity), strict=True))
    for axis in "ne":
        if f"wind.{axis}" in values and f"wind_{axis}" in columns:
            columns[f"wind_{axis}"] = np.full(flight.time.size, values[f"wind.{axis}"])
    whole = with_attitude(on_circle({name: x for name, x in columns.items() if name not in QUATERNION}))
    # an attitude that was logged in part keeps its parts
    ordered = {name: whole[name] for name in VARIABLES if name in whole and name in flight.sources}
    of_air = () if flight.air is None else flight.air.notices
    made = replace(
        flight,
        data=Gridded(flight.time, ordered),
        sources={name: sources[name] for name in ordered},
        air=None,
        notices=(*(one for one in flight.notices if one not in of_air), notice("corrected", flight.name)),
    )
    return with_air(made)
