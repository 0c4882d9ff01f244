"""What the user must know, in plain words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from stoop.flight import Flight
from stoop.identify.fit import Fit
from stoop.identify.result import ManeuverResult, ParameterEstimate
from stoop.job.errorbars import ErrorBars
from stoop.vehicle import Vehicle

COLORED = 2.0  #: correlation time in samples from which residuals count as colored


def statements(vehicle: Vehicle, flights: Mapping[str, Flight], color: float) -> tuple[str, ...]:
    """Return what the figures rest on."""
    rebuilt = [
        f"{flight.name}: {_rebuilt(flight)} are reconstructed from inertial velocity, attitude and a steady wind "
        f"({flight.air.method}), not measured by a vane; agreement with them is agreement with that reconstruction."
        for flight in flights.values()
        if flight.air is not None and flight.air.method != "none"
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
    out += [
        f"{f.name}: {fault.message}."
        for f in flights.values()
        for fault in f.faults
        if fault.kind == "wrong sign"
    ]
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
    out += [
        f"{n} cannot be told from this flight: {j.reason}."
        for n, j in bars.judged.items()
        if not j.identifiable and not parameters[n].at_bound
    ]
    for m in maneuvers:
        weak = [c for c, f in m.channels.items() if f.theil > f.baseline_theil]
        if weak:
            out.append(
                f"{m.flight} {m.start:g}:{m.stop:g} ({m.role}): no better than a first-order lag in {', '.join(weak)}."
            )
    out += list(fit.warnings)
    return tuple(out)
