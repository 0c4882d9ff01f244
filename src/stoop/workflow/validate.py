"""Prediction of flights that were not fitted, with the figures of an identification."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from stoop.assess.baseline import BaselineManeuver
from stoop.assess.record import Validation
from stoop.base.files import write_text_atomic
from stoop.base.notices import of_severity
from stoop.errors import FlightError, StoopError
from stoop.estimate.mismatch import check_inputs
from stoop.estimate.predict import predicted
from stoop.flight import VARIABLES, Flight, without, without_faults
from stoop.flight.maneuvers import find_maneuvers
from stoop.problem.windows import Window, parse_window
from stoop.results.result import Identification, ManeuverResult, ManeuverTrace
from stoop.vehicle import Vehicle
from stoop.vehicle.latex import equations, symbols
from stoop.workflow.curves import Flown, maneuver_curves
from stoop.workflow.identified import Identified, read_identified
from stoop.workflow.outputs import RESULT
from stoop.workflow.provenance import file_hashes, flight_files, versions

NAMES = ("validation.html", "validation.json")


@dataclass(frozen=True, eq=False)
class Validated:
    """A finished validation: its record, and what the page draws."""

    record: Validation
    identification: Identification

    def save(self, folder: Path) -> None:
        """Write ``validation.html`` and ``validation.json`` into a folder, each whole or not at all.

        Raises
        ------
        OutputError
            They cannot be written.
        """
        from stoop.report.validation import render_validation

        folder.mkdir(parents=True, exist_ok=True)
        page, data = (folder / name for name in NAMES)
        write_text_atomic(page, render_validation(self.identification))
        write_text_atomic(data, self.record.to_json())


def validate(
    source: Path, flights: Sequence[Flight], maneuvers: Sequence[str] = (), command: str = ""
) -> Validated:
    """Predict windows of flights with a fitted model.

    Parameters
    ----------
    source : Path
        The folder of stoop identify, or the ``result.json`` in it.
    flights : sequence of Flight
    maneuvers : sequence of str
        ``[FLIGHT@]START:STOP[#LOADING]``; the candidate maneuvers of each flight when empty.
    command : str
        For the record.

    Raises
    ------
    StoopError
        One line that says what is wrong and what to do.
    """
    known = _by_name(flights)
    identified = read_identified(source)
    for flight in flights:
        check_inputs(identified.vehicle, flight, f"which result {source} is")
    fitted_as = {name: _fitted_name(identified, flight) for name, flight in known.items()}
    learned, notes = _learned(identified)
    if maneuvers:
        windows = [parse_window(text, known) for text in maneuvers]
        for window in windows:
            _check_fitted(identified, fitted_as, window)
    else:
        windows, skipped = _candidates(identified, known, fitted_as)
        notes += skipped
    spans = {name: [(w.start, w.stop) for w in windows if w.flight == name] for name in known}
    known = {
        name: without_faults(without(flight, spans[name])) for name, flight in known.items() if spans[name]
    }
    return _assembled(identified, known, fitted_as, windows, learned, notes, command)


def _by_name(flights: Sequence[Flight]) -> dict[str, Flight]:
    out = {flight.name: flight for flight in flights}
    if len(out) < len(flights):
        raise FlightError("validate: two flights have the same name; rename one of the files")
    return out


def _fitted_name(identified: Identified, flight: Flight) -> str | None:
    """Return what a flight was called when it was fitted; None for one that was not."""
    digests = file_hashes(flight_files([flight])).values()
    return next((identified.hashes[d] for d in digests if d in identified.hashes), None)


def _overlapping(
    identified: Identified, fitted_as: Mapping[str, str | None], window: Window
) -> ManeuverResult | None:
    """Return a fitted maneuver with which a window shares samples."""
    return next(
        (
            m
            for m in identified.result.maneuvers
            if m.role == "fit"
            and m.flight == fitted_as[window.flight]
            and window.start < m.stop
            and m.start < window.stop
        ),
        None,
    )


def _check_fitted(identified: Identified, fitted_as: Mapping[str, str | None], window: Window) -> None:
    other = _overlapping(identified, fitted_as, window)
    if other is not None:
        raise FlightError(
            f"maneuver {window}: overlaps {other.start:g}:{other.stop:g}, to which the model was fitted; "
            "only what was not fitted can be predicted; choose another window"
        )


def _learned(identified: Identified) -> tuple[list[BaselineManeuver], list[str]]:
    """Return what the lag learns from; where the fitted flights are gone, nothing, and a note."""
    try:
        return identified.learned(), []
    except StoopError as error:
        return [], [f"No first-order lag beside the model: it learns from the fitted flight; {error}"]


def _candidates(
    identified: Identified, flights: Mapping[str, Flight], fitted_as: Mapping[str, str | None]
) -> tuple[list[Window], list[str]]:
    """Return the candidate maneuvers of all flights that can be predicted, and what was passed over."""
    windows, notes = [], []
    for name, flight in flights.items():
        for maneuver in find_maneuvers(flight):
            window = Window(name, maneuver.start, maneuver.stop)
            why = _unfit(identified, flights, fitted_as, window)
            if why:
                notes.append(f"{window}: passed over: {why}")
            else:
                windows.append(window)
    if not windows:
        told = f" ({notes[0]})" if notes else ""
        raise FlightError(
            f"{', '.join(flights)}: no maneuver was found to predict{told}; name windows with --maneuver START:STOP"
        )
    return windows, notes


def _unfit(
    identified: Identified,
    flights: Mapping[str, Flight],
    fitted_as: Mapping[str, str | None],
    window: Window,
) -> str:
    """Say why a candidate cannot be predicted; nothing if it can."""
    if _overlapping(identified, fitted_as, window) is not None:
        return "the model was fitted there"
    try:
        predicted(identified.vehicle, flights, [window], [{}])
    except FlightError as error:
        return str(error).removeprefix(f"{window}: ")
    return ""


def _assembled(
    identified: Identified,
    flights: Mapping[str, Flight],
    fitted_as: Mapping[str, str | None],
    windows: Sequence[Window],
    learned: Sequence[BaselineManeuver],
    notes: list[str],
    command: str,
) -> Validated:
    vehicle = identified.vehicle
    results: list[ManeuverResult] = []
    traces: list[ManeuverTrace] = []
    doubts: list[str] = []
    for name, flight in flights.items():
        own = [w for w in windows if w.flight == name]
        biases = identified.biases(fitted_as[name])
        prepared, simulated = predicted(vehicle, flights, own, [biases] * len(own))
        found, drawn = maneuver_curves(vehicle, [Flown("validation", prepared, simulated)], learned)
        results += found
        traces += drawn
        notes += [*flight.notes, *map(str, of_severity(prepared.notices, "info"))]
        doubts += map(str, of_severity(prepared.notices, "warning"))
    doubts = [*_doubts(identified, results), *doubts]
    record = _record(identified, flights, tuple(results), doubts, tuple(dict.fromkeys(notes)), command)
    return Validated(record, _identification(identified, record, doubts, tuple(traces)))


def _record(
    identified: Identified,
    flights: Mapping[str, Flight],
    maneuvers: tuple[ManeuverResult, ...],
    doubts: Sequence[str],
    notes: tuple[str, ...],
    command: str,
) -> Validation:
    pairs = [(f.theil, f.baseline_theil) for m in maneuvers for f in m.channels.values()]
    compared = [model < lag for model, lag in pairs if math.isfinite(lag)]
    (digest,) = file_hashes([identified.folder / RESULT]).values()
    return Validation(
        vehicle=identified.vehicle.name,
        result=digest,
        maneuvers=maneuvers,
        compared=len(compared),
        better=sum(compared),
        warnings=(*doubts, *_weak(maneuvers)),
        notes=notes,
        versions=versions(),
        inputs=file_hashes(flight_files(flights.values())),
        command=command,
    )


def _doubts(identified: Identified, maneuvers: Sequence[ManeuverResult]) -> tuple[str, ...]:
    """Return what is doubtful whatever the lag says."""
    out = []
    if identified.result.status not in ("converged", "target"):
        out.append(f"The identification ended without a confirmed optimum: {identified.result.advice}.")
    for m in maneuvers:
        lost = [c for c, f in m.channels.items() if not math.isfinite(f.rmse)]
        out += [f"{_where(m)}: the simulation diverges in {', '.join(lost)}."] if lost else []
    return tuple(out)


def _weak(maneuvers: Sequence[ManeuverResult]) -> tuple[str, ...]:
    """Return where the lag is as good."""
    lost = {_where(m): [c for c, f in m.channels.items() if f.lost] for m in maneuvers}
    return tuple(f"{w}: no better than a first-order lag in {', '.join(c)}." for w, c in lost.items() if c)


def _where(m: ManeuverResult) -> str:
    return f"{m.flight} {m.start:g}:{m.stop:g}"


def _identification(
    identified: Identified, record: Validation, doubts: Sequence[str], traces: tuple[ManeuverTrace, ...]
) -> Identification:
    """Return what the page draws: the result that was validated, with the maneuvers that were predicted."""
    vehicle = identified.vehicle
    result = replace(
        identified.result,
        maneuvers=record.maneuvers,
        warnings=tuple(doubts),  # the page says by itself where the lag is as good
        versions=record.versions,
        inputs={RESULT: record.result, **record.inputs},
    )
    return Identification(
        result=result,
        traces=traces,
        vehicle=vehicle.name,
        equations=equations(vehicle),
        units=_units(vehicle),
        symbols=symbols(vehicle),
        statements=vehicle.file.notes,
        notes=record.notes,
        command=record.command,
    )


def _units(vehicle: Vehicle) -> dict[str, str]:
    names = dict.fromkeys((*vehicle.outputs, *vehicle.inputs, *vehicle.controls))
    return {name: VARIABLES[name].unit if name in VARIABLES else "rad" for name in names}
