"""Notices of an identification: what makes its result doubtful, and what its figures rest on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from stoop.assess.error_bars import ErrorBars
from stoop.base.notices import Notice, as_notice, notice, of_severity
from stoop.estimate.excitation import excitation_notices
from stoop.estimate.fit import Fit
from stoop.estimate.mismatch import unlike
from stoop.estimate.motors_swapped import swapped_motors
from stoop.estimate.rotors_seen import strange_motors
from stoop.flight import Flight
from stoop.flight.faults import Fault
from stoop.results.result import ManeuverResult, ParameterEstimate
from stoop.vehicle import Vehicle
from stoop.vehicle.plausible import inertia_doubts

SENSOR_FAULTS: Final = {
    "wrong sign": "sensor-fault",
    "wrong unit": "sensor-fault",
    "inconsistent": "sensor-fault",
    "clipped": "sensor-fault-left-out",
    "stuck": "sensor-fault-left-out",
}  #: kinds of faults that affect a fit -> code
MIN_CORRELATION_TIME: Final = 2.0  #: samples; from here on residuals count as colored
CONFIRMED: Final = frozenset({"converged", "target"})  #: a search that ended so has found its optimum


def fit_warnings(
    parameters: Mapping[str, ParameterEstimate],
    bars: ErrorBars,
    maneuvers: Sequence[ManeuverResult],
    fit: Fit,
    flights: Mapping[str, Flight],
) -> tuple[Notice, ...]:
    """Return what makes a result doubtful, the most serious first."""
    vehicle, windows = fit.problem.layout.vehicle, fit.prepared.windows
    found: list[Notice | str] = [
        *search_notices(fit.outcome.status, fit.outcome.advice),
        *_sensor_faults(fit, flights, maneuvers),
        *unlike(vehicle, flights),
        *inertia_doubts(vehicle, fit.estimates),
        *_not_measured(fit),
        *strange_motors(vehicle, flights, windows),
        *swapped_motors(vehicle, flights, windows),
        *excitation_notices(fit.problem, fit.z, slowest_rate(fit, flights)),
        *_not_determined(parameters, bars),
        *lag_notices(maneuvers),
        *of_severity((*fit.prepared.notices, *fit.notices), "warning"),
    ]
    return tuple(as_notice(one) for one in found)


def basis_notices(vehicle: Vehicle, flights: Mapping[str, Flight], correlation: float) -> list[Notice]:
    """Return what the figures rest on.

    Parameters
    ----------
    vehicle : Vehicle
    flights : mapping
    correlation : float
        Correlation time of the residuals, samples.
    """
    found = [notice("vehicle-file-note", text=text) for text in vehicle.file.notes]
    for flight in flights.values():
        if flight.air is not None and flight.air.method != "none" and not vehicle.hovers:
            source = flight.sources.get("V")
            rebuilt = source is None or source.source == "reconstructed"
            channels = ("V", "alpha", "beta") if rebuilt else ("alpha", "beta")
            method = flight.air.method
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


def lag_notices(maneuvers: Sequence[ManeuverResult]) -> list[Notice]:
    """Name the channels in which a first-order lag matches as well as the model."""
    weak = [(m, tuple(c for c, one in m.channels.items() if one.lost)) for m in maneuvers]
    return [notice("lag-not-beaten", window_of(m), role=m.role, channels=names) for m, names in weak if names]


def window_of(maneuver: ManeuverResult) -> str:
    """Return a maneuver as ``FLIGHT START:STOP``."""
    return f"{maneuver.flight} {maneuver.start:g}:{maneuver.stop:g}"


def slowest_rate(fit: Fit, flights: Mapping[str, Flight]) -> float:
    """Return the lowest rate at which a compared channel was logged, Hz."""
    outputs = fit.problem.layout.vehicle.outputs
    rates = [f.sources[c].rate for f in flights.values() for c in outputs if c in f.sources]
    return min((rate for rate in rates if rate > 0.0), default=np.inf)


def _not_determined(parameters: Mapping[str, ParameterEstimate], bars: ErrorBars) -> list[Notice]:
    """Name the parameters at a bound, those that rest on it, and those not identifiable, of one reason together."""
    held = tuple(name for name, p in parameters.items() if p.at_bound)
    found = [notice("at-bound", parameters=held)] if held else []
    if bars.conditional:
        found.append(notice("conditional-on-bound", held=held, parameters=tuple(bars.conditional)))
    reasons: dict[str, list[str]] = {}
    for name, one in bars.identifiability.items():
        if not one.identifiable and not parameters[name].at_bound:
            reasons.setdefault(one.reason, []).append(name)
    for reason, names in reasons.items():
        found.append(
            notice("not-identifiable", parameters=tuple(names), count=len(names), reason=str(reason))
        )
    return found


def _sensor_faults(
    fit: Fit, flights: Mapping[str, Flight], maneuvers: Sequence[ManeuverResult]
) -> list[Notice]:
    """Return suspected faults of sensors that this fit reads, within its windows."""
    vehicle = fit.problem.layout.vehicle
    read = {*vehicle.outputs, *vehicle.inputs}
    spans = [(m.flight, m.start, m.stop) for m in maneuvers if m.role == "fit"]

    def fitted(flight: Flight, fault: Fault) -> bool:
        return any(name == flight.name and a < fault.stop and fault.start < b for name, a, b in spans)

    return [
        notice(SENSOR_FAULTS[fault.kind], flight.name, fault=fault.message)
        for flight in flights.values()
        for fault in flight.faults
        if fault.variable in read and fault.kind in SENSOR_FAULTS and fitted(flight, fault)
    ]


def _not_measured(fit: Fit) -> list[Notice]:
    """Return what missing rates and a missing airspeed, by whose square every coefficient is divided, mean."""
    vehicle = fit.problem.layout.vehicle
    recorded = np.any([np.isfinite(p.measured).any(axis=0) for p in fit.problem.pieces], axis=0)
    missing = {name for name, there in zip(vehicle.outputs, recorded, strict=True) if not there}
    rates = tuple(name for name in ("p", "q", "r") if name in missing)
    found = [notice("rates-not-recorded", channels=rates)] if rates else []
    if "V" in missing:
        found.append(notice("airspeed-not-measured", airspeed=vehicle.value("reference.airspeed")))
    return found
