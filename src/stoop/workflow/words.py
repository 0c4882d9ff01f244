"""What the user must know, in plain words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from stoop.base.notices import of_severity
from stoop.estimate.excitation import excitation_notices
from stoop.estimate.fit import Fit
from stoop.estimate.mismatch import unlike
from stoop.estimate.motors_swapped import swapped_motors
from stoop.estimate.rotors_seen import strange_motors
from stoop.flight import Flight
from stoop.results.result import ManeuverResult, ParameterEstimate
from stoop.vehicle import Vehicle
from stoop.vehicle.plausible import inertia_doubts
from stoop.workflow.errorbars import ErrorBars

_WHOLE = ("wrong sign", "wrong unit", "inconsistent")  #: faults of a sensor that hold wherever it is read
_DROPPED = dict.fromkeys(("clipped", "stuck"), "; counted as not measured there")
COLORED = 2.0  #: correlation time in samples from which residuals count as colored


def statements(vehicle: Vehicle, flights: Mapping[str, Flight], color: float) -> tuple[str, ...]:
    """Return what the figures rest on."""
    rebuilt = [
        f"{flight.name}: {_rebuilt(flight)} are reconstructed from inertial velocity, attitude and a steady wind "
        f"({flight.air.method}), not measured by a vane; agreement with them is agreement with that reconstruction."
        for flight in flights.values()
        if flight.air is not None and flight.air.method != "none" and not vehicle.hovers
    ]
    colored = (
        f"Residuals are correlated over about {color:.0f} samples (median channel): the fit weighs them as that "
        "many times fewer independent ones, and the error bars are corrected for their color (Morelli and Klein "
        "1997). Plain Cramer-Rao errors, shown beside, are several times too small."
    )
    return (*vehicle.file.notes, *rebuilt, *([colored] if color > COLORED else []))


def _rebuilt(flight: Flight) -> str:
    source = flight.sources.get("V")
    return "V, alpha and beta" if source is None or source.source == "reconstructed" else "alpha and beta"


def warnings(
    parameters: Mapping[str, ParameterEstimate],
    bars: ErrorBars,
    maneuvers: Sequence[ManeuverResult],
    fit: Fit,
    flights: Mapping[str, Flight],
) -> tuple[str, ...]:
    """Return what is doubtful about a result, most serious first."""
    out = []
    if fit.outcome.status not in ("converged", "target"):
        out.append(f"The search ended without a confirmed optimum: {fit.outcome.advice}.")
    out += _faults(fit, flights, maneuvers)
    out += unlike(fit.problem.layout.vehicle, flights)
    out += inertia_doubts(fit.problem.layout.vehicle, fit.estimates)
    out += _not_measured(fit, maneuvers)
    out += strange_motors(fit.problem.layout.vehicle, flights, fit.prepared.windows)
    out += swapped_motors(fit.problem.layout.vehicle, flights, fit.prepared.windows)
    out += map(str, excitation_notices(fit.problem, fit.z, slowest_rate(fit, flights)))
    held = [name for name, p in parameters.items() if p.at_bound]
    if held:
        out.append(
            f"At a bound, so the number is the box's and not the flight's: {', '.join(held)}. Widen the bounds or fix them."
        )
    if bars.leaning:
        out.append(
            f"Known only if {', '.join(held)} really lies at its bound: {', '.join(bars.leaning)}; otherwise their "
            "error bars would be more than twice as wide."
        )
    out += _untold(parameters, bars)
    for m in maneuvers:
        weak = [c for c, f in m.channels.items() if f.lost]
        if weak:
            out.append(
                f"{m.flight} {m.start:g}:{m.stop:g} ({m.role}): no better than a first-order lag in {', '.join(weak)}."
            )
    out += map(str, of_severity((*fit.prepared.notices, *fit.notices), "warning"))
    return tuple(out)


def _untold(parameters: Mapping[str, ParameterEstimate], bars: ErrorBars) -> list[str]:
    """Name what cannot be told, those of one reason together."""
    reasons: dict[str, list[str]] = {}
    for name, one in bars.judged.items():
        if not one.identifiable and not parameters[name].at_bound:
            reasons.setdefault(one.reason, []).append(name)
    return [f"{', '.join(names)} cannot be told from this flight: {why}." for why, names in reasons.items()]


def _faults(fit: Fit, flights: Mapping[str, Flight], maneuvers: Sequence[ManeuverResult]) -> list[str]:
    """Return what is suspected of sensors that this fit reads, within its windows where it has a time."""
    vehicle = fit.problem.layout.vehicle
    read = {*vehicle.outputs, *vehicle.inputs}
    spans = [(m.flight, m.start, m.stop) for m in maneuvers if m.role == "fit"]
    return [
        f"{flight.name}: {fault.message}{_DROPPED.get(fault.kind, '')}."
        for flight in flights.values()
        for fault in flight.faults
        if fault.variable in read and (fault.kind in _WHOLE or fault.kind in _DROPPED)
        if any(name == flight.name and a < fault.stop and fault.start < b for name, a, b in spans)
    ]


def _not_measured(fit: Fit, maneuvers: Sequence[ManeuverResult]) -> list[str]:
    """Say what a missing airspeed means: every coefficient is divided by its square."""
    vehicle = fit.problem.layout.vehicle
    seen = {
        name
        for i, name in enumerate(vehicle.outputs)
        if any(np.isfinite(p.measured[:, i]).any() for p in fit.problem.pieces)
    }
    unseen = [name for name in ("p", "q", "r") if name in vehicle.outputs and name not in seen]
    silent = [
        f"{', '.join(unseen)} not recorded in any fitted window: damping and moments rest on differences of angles; log "
        "the gyroscope, or name its columns in the mapping ([variables] p, q, r)."
    ]
    if "V" not in vehicle.outputs or "V" in seen:
        return silent if unseen else []
    return [
        *(silent if unseen else []),
        f"No airspeed was measured: it was guessed about V* = {vehicle.value('reference.airspeed'):g} m/s, and every "
        "coefficient is wrong by twice what the guess is off in percent; give air data, or a flight they can be "
        "reconstructed from.",
    ]


def slowest_rate(fit: Fit, flights: Mapping[str, Flight]) -> float:
    """Return the lowest rate at which a compared channel was logged, Hz."""
    outputs = fit.problem.layout.vehicle.outputs
    rates = [f.sources[c].rate for f in flights.values() for c in outputs if c in f.sources]
    return min((rate for rate in rates if rate > 0.0), default=np.inf)
