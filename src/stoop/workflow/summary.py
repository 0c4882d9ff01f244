"""What a result says: notices of what makes it doubtful and what its figures rest on, and its numbers as text tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from stoop.assessment.contributions import contribution_notices
from stoop.assessment.error_bars import ErrorBars
from stoop.assessment.prior_conflicts import prior_tests
from stoop.assessment.verdict import CONFIRMED
from stoop.base.notices import Notice, as_notice, attempt, notice, of_severity, paragraph
from stoop.base.variables import EULER, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.checks.excitation import excitation_notices
from stoop.checks.vehicle import check_lift, check_rotors, inertia_notices
from stoop.estimate.estimate import Estimate
from stoop.flight import Flight
from stoop.prediction.predict import ForceFigures
from stoop.results.result import ManeuverResult, ParameterEstimate, Result
from stoop.results.uncertainty import COMPONENTS, ParameterIdentifiability, Repeatability
from stoop.vehicle import Vehicle

#: kinds of faults that affect a fit -> code
SENSOR_FAULTS: Final = {
    **dict.fromkeys(("wrong sign", "wrong unit", "inconsistent"), "sensor-fault"),
    **dict.fromkeys(("clipped", "stuck"), "sensor-fault-left-out"),
}
PRIOR_CONFLICT: Final = 5.0  #: prior standard deviations, from which a bias contradicts its prior
MIN_CORRELATION_TIME: Final = 2.0  #: samples; from here on residuals count as colored
BASIC_METHODS: Final = ("corrected", "cramer_rao")  #: of uncertainty, that every result has
#: channels of the table of figures
SHOWN: Final = (*VELOCITY, "V", "alpha", "beta", *RATES, *EULER, *SPECIFIC_FORCE)


def fit_warnings(
    parameters: Mapping[str, ParameterEstimate],
    bars: ErrorBars,
    maneuvers: Sequence[ManeuverResult],
    fit: Estimate,
    flights: Mapping[str, Flight],
) -> tuple[Notice, ...]:
    """Return what makes a result doubtful, the most serious first."""
    vehicle, windows = fit.problem.layout.vehicle, fit.prepared.windows
    read = {*vehicle.outputs, *vehicle.inputs, *vehicle.measured}
    spans = [(m.flight, m.start, m.stop) for m in maneuvers if m.role == "fit"]
    sensor_faults = [  # suspected, of sensors that the fit reads, within its windows
        notice(SENSOR_FAULTS[fault.kind], flight.name, fault=fault.message)
        for flight in flights.values()
        for fault in flight.faults
        if fault.variable in read and fault.kind in SENSOR_FAULTS
        if any(name == flight.name and a < fault.stop and fault.start < b for name, a, b in spans)
    ]
    found = [*search_notices(fit.outcome.status, fit.outcome.advice), *sensor_faults]
    if left_out := tuple(name for name in COMPONENTS if name in bars.left_out):
        found.append(notice("components-left-out", components=left_out))
    found += attempt(found, [], check_lift, vehicle, flights)
    found += attempt(found, [], inertia_notices, vehicle, fit.estimates)
    found += attempt(found, [], prior_conflicts, fit, bars)
    # Missing rates, and a missing airspeed, by whose square every coefficient is divided; a pose tells them.
    recorded = np.any([np.isfinite(p.measured).any(axis=0) for p in fit.problem.pieces], axis=0)
    pairs = zip(vehicle.outputs, recorded, strict=True)
    missing = [name for name, there in pairs if not there and not vehicle.positions]
    if rates := tuple(name for name in RATES if name in missing):
        found.append(notice("rates-not-recorded", channels=rates))
    if "V" in missing:
        found.append(notice("airspeed-not-measured", airspeed=vehicle.value("reference.airspeed")))
    found += check_rotors(vehicle, flights, windows)
    found += attempt(found, [], excitation_notices, fit.problem, fit.z)
    found += attempt(found, [], contribution_notices, fit, bars.contributions)
    # Parameters at a bound, those that rest on it, and those not identifiable, of one reason together.
    at_bound = tuple(name for name, p in parameters.items() if p.at_bound)
    vanishing = (name for name in at_bound if name.endswith((".lag", ".dead_zone")))
    absent = tuple(name for name in vanishing if parameters[name].estimate == 0.0)
    doubtful = tuple(name for name in at_bound if name not in absent)
    found += [notice("at-bound", parameters=doubtful)] if doubtful else []
    found += [notice("at-zero", parameters=absent, count=len(absent))] if absent else []
    if bars.conditional:
        found.append(notice("conditional-on-bound", held=at_bound, parameters=tuple(bars.conditional)))
    reasons: dict[str, list[str]] = {}
    for name, one in bars.identifiability.items():
        named = one.reason is not None and one.reason.code == "systematic-residuals"
        if not one.identifiable and not parameters[name].at_bound and not named:
            reasons.setdefault(str(one.reason), []).append(name)
    for reason, names in reasons.items():
        found.append(notice("not-identifiable", parameters=tuple(names), count=len(names), reason=reason))
    found += [*lag_notices(maneuvers), *of_severity((*fit.prepared.notices, *fit.notices), "warning")]
    return tuple(found)


def prior_conflicts(fit: Estimate, bars: ErrorBars) -> list[Notice]:
    """Return the parameters whose priors the flight contradicts, and the biases that lie far outside of theirs.

    Such a bias takes up an error of thrust, mass, a unit or an axis.
    """
    layout, found = fit.problem.layout, list[Notice]()

    def add(name: str, window: object, estimate: float, ratio: float, prior: float, mean: float) -> None:
        values = {"estimate": estimate, "ratio": abs(ratio), "prior": prior, "mean": mean}
        found.append(notice("prior-conflict", name, window=str(window), **values))

    for one in prior_tests(fit, bars).conflicts:
        add(one.name, "the fit", one.estimate, one.ratio, one.prior, one.mean)
    for n, x in zip(layout.nuisances, fit.z[layout.dimension :].tolist(), strict=True):
        if n.is_bias and abs(x) > PRIOR_CONFLICT:
            add(n.name, fit.prepared.windows[n.maneuver], n.center + n.scale * x, x, n.scale, n.center)
    return found


def basis_notices(vehicle: Vehicle, flights: Mapping[str, Flight], correlation: float) -> list[Notice]:
    """Return what the figures rest on; `correlation` is the correlation time of the residuals, samples."""
    found = [notice("vehicle-file-note", text=text) for text in vehicle.file.notes]
    for flight in flights.values():
        if "V" in vehicle.outputs and flight.air is not None and flight.air.method != "none":
            source, method = flight.sources.get("V"), flight.air.method
            rebuilt = source is None or source.source == "reconstructed"
            channels = ("V", "alpha", "beta") if rebuilt else ("alpha", "beta")
            found.append(notice("air-data-reconstructed", flight.name, channels=channels, method=method))
    if correlation > MIN_CORRELATION_TIME:
        found.append(notice("residuals-colored", samples=correlation))
    return found


def data_notices(found: Iterable[Notice | str]) -> list[Notice]:
    """Return what was found in the data, each once; a warning about a flight is information about a fit to parts of it."""
    return [replace(as_notice(one, "info", "flight"), severity="info") for one in dict.fromkeys(found)]


def search_notices(status: str, advice: str) -> list[Notice]:
    """Return the warning about a search that has not confirmed an optimum."""
    return [] if status in CONFIRMED else [notice("no-confirmed-optimum", advice=advice)]


def refusal(result: Result, source: str) -> list[Notice]:
    """Return the warning about a result, read from a source, that its verdict refuses."""
    return [notice("model-refused", source)] if result.verdict.grade == "do not use" else []


def lag_notices(maneuvers: Sequence[ManeuverResult]) -> list[Notice]:
    """Name the channels in which a first-order lag matches as well as the model."""
    weak = [(m, tuple(c for c, one in m.channels.items() if one.lost)) for m in maneuvers]
    return [notice("lag-not-beaten", m.window, role=m.role, channels=names) for m, names in weak if names]


def estimates_table(
    parameters: Mapping[str, ParameterEstimate], truth: Mapping[str, float] | None = None
) -> str:
    """Return estimates with standard errors, intervals and remarks; beside the truth where it is known."""
    wide = max([len("parameter"), *map(len, parameters)])
    heads = ["estimate", "std error", "95 % from", "to", "start", *(["truth"] if truth else [])]
    head = f"{'parameter':{wide}} " + " ".join(f"{text:>11}" for text in heads)
    lines = [head + (f" {'sigmas off':>10}" if truth else "") + "  unit"]
    for name, p in parameters.items():
        error = _number(p.std_error, p.identifiable)
        cells = [_number(p.estimate), error, *map(_number, (p.ci95_lower, p.ci95_upper, p.start))]
        if truth:
            known = truth.get(name, math.nan)
            off = (p.estimate - known) / p.std_error if p.std_error > 0.0 else math.nan
            cells += [_number(known), f"{off:10.2f}" if math.isfinite(off) else "-".rjust(10)]
        remark = "  at bound" if p.at_bound else "" if p.identifiable else "  not identifiable"
        lines.append(f"{name:{wide}} {' '.join(cells)}  {p.unit}{remark}")
    return "\n".join(lines)


def methods_table(result: Result) -> str:
    """Return the standard errors of every method side by side; in brackets where not identifiable."""
    wide = max([len("parameter"), *map(len, result.parameters)])
    lines = [f"{'parameter':{wide}} " + " ".join(f"{name:>11}" for name in result.uncertainty)]
    for name, p in result.parameters.items():
        spreads = [m.parameters.get(name) for m in result.uncertainty.values()]
        cells = ["".rjust(11) if s is None else _number(s.std_error, p.identifiable) for s in spreads]
        lines.append(f"{name:{wide}} {' '.join(cells)}".rstrip())
    return "\n".join(lines)


def _number(value: float, identifiable: bool = True) -> str:
    """Return a number of eleven characters; a standard error in brackets where the parameter is not identifiable."""
    if not math.isfinite(value):
        return "-".rjust(11)
    return f"{value:11.4g}" if identifiable else f"({value:.3g})".rjust(11)


def advice_by_doubt(found: Mapping[str, ParameterIdentifiability]) -> dict[str, list[str]]:
    """Return for each doubt one line per advice, the parameters that share it joined."""
    shared: dict[str, dict[str, list[str]]] = {}
    for name, one in found.items():
        if one.advice:
            advice = paragraph(one.advice)
            shared.setdefault(str(one.doubt), {}).setdefault(advice, []).append(name)
    return {d: [f"{', '.join(names)}: {text}" for text, names in own.items()] for d, own in shared.items()}


def forces_table(figures: Sequence[ForceFigures]) -> str:
    """Return the residuals of the specific force below 5 Hz: of the model, a constant, static thrust, m/s2."""
    lines = [f"{'window':24} {'role':10} {'axis':4} {'model':>8} {'constant':>9} {'static thrust':>13}"]
    for one in figures:
        head = f"{f'{one.window.start:g}:{one.window.stop:g}':24} {one.role:10}"
        for axis, a in one.axes.items():
            lines.append(f"{head} {axis:4} {a.model:8.3f} {a.constant:9.3f} {a.static:13.3f}")
    return "\n".join(lines)


def repeatability_lines(found: Repeatability) -> list[str]:
    """Return whether maneuvers fitted alone agree: how many parameters were compared, and which; none if not asked for."""
    if not found.maneuvers:
        return []
    lines = [str(found.summary())]
    for verdict in ("scatter", "agree"):
        own = {name: one for name, one in found.parameters.items() if one.verdict == verdict}
        named = [f"{name} ({1 + one.degrees} maneuvers, p = {one.p_value:.2g})" for name, one in own.items()]
        lines += [f"{verdict}: {', '.join(named)}"] if named else []
    return [*lines, *map(str, found.remarks)]


def figures_table(maneuvers: Sequence[ManeuverResult]) -> str:
    """Return the figures of every channel and maneuver, one below the other; in brackets where the motion is below the noise."""
    lines = [
        "U: Theil's inequality coefficient (0 perfect, 1 worst; low-passed at 10 Hz); lag: that of a first-order lag;",
        "fit: 100 (1 - rms error / rms motion); S/N: motion over noise; (U): motion below the noise, judges nothing;",
        "band %: share of readings within the 95 % band of a prediction",
    ]
    for m in maneuvers:
        channels = [m.channels[c] for c in SHOWN if c in m.channels]
        ratios = [one.signal_to_noise for one in channels]
        rows = {
            "U": [f"({one.theil:.2f})" if one.below_noise else f"{one.theil:.3f}" for one in channels],
            "lag": [_decimals(one.baseline_theil, 3) for one in channels],
            "R2": [_decimals(one.r2, 2) for one in channels],
            "fit %": [_decimals(one.fit_percent, 0) for one in channels],
            "S/N": [f"{ratio:.2g}" if ratio < 100.0 else ">100" for ratio in ratios],
        }
        if any(math.isfinite(one.within) for one in channels):  # of a prediction: 95 % for a right model
            rows["band %"] = [_decimals(100.0 * one.within, 0) for one in channels]
        lines += [f"{m.window} ({m.role})", "  " + "".join(f"{c:>7}" for c in SHOWN if c in m.channels)]
        lines += [f"  {''.join(f'{cell:>7}' for cell in cells)}  {name}" for name, cells in rows.items()]
    return "\n".join(lines)


def _decimals(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) and abs(value) < 1e4 else "-"
