"""Validation: a fitted model predicts windows of flights that it was not fitted to."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from stoop.assessment.verdict import diverged
from stoop.base.files import make_folder, write_files
from stoop.base.notices import Notice, as_notice, notice, of_severity
from stoop.checks.vehicle import require_channels
from stoop.errors import FlightError, StoopError
from stoop.estimate.fitted_filter import FittedFilter
from stoop.estimate.initial_state import FittedModel
from stoop.estimate.predict import predict
from stoop.flight import Flight, without, without_faults
from stoop.flight.maneuvers import find_maneuvers
from stoop.problem.prepare import decoupled, prepare
from stoop.problem.windows import Window, parse_window
from stoop.results.result import Identification, ManeuverResult, ManeuverTrace, plain
from stoop.vehicle.notation import symbols
from stoop.workflow import outputs
from stoop.workflow.curves import Simulated, channel_units, maneuver_curves
from stoop.workflow.outputs import RESULT, Identified, file_hashes
from stoop.workflow.summary import basis_notices, data_notices, lag_notices, refusal, search_notices

NAMES = ("validation.html", "validation.json")


@dataclass(frozen=True, eq=False)
class Validation:
    """What ``validation.json`` holds (schema ``stoop-validation/1``, see ``docs/validation.md``)."""

    vehicle: str  #: its name
    result: str  #: SHA-256 of the ``result.json`` that was validated
    maneuvers: tuple[ManeuverResult, ...]  #: with the same figures as in ``result.json``
    #: channels that have a figure of the trivial model, and in how many of them the model beats it
    compared: int
    better: int
    warnings: tuple[str, ...]  #: what is doubtful, and what was found while preparing the data
    notes: tuple[str, ...]
    versions: Mapping[str, str]  #: as in ``result.json``
    inputs: Mapping[str, str]
    command: str = ""  #: how it was made

    def to_json(self) -> str:
        """Return the validation as JSON text; NaN and infinities become ``null``."""
        document = {"schema": "stoop-validation/1", **plain(self)}
        return json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


@dataclass(frozen=True, eq=False)
class Validated:
    """A finished validation: its record, and what the page draws."""

    record: Validation
    identification: Identification

    def save(self, folder: Path) -> None:
        """Write ``validation.html`` and ``validation.json`` into a folder, both or none.

        Raises `OutputError`: they cannot be written.
        """
        from stoop.report.identification import render_validation

        make_folder(folder)
        texts = render_validation(self.identification), self.record.to_json()
        write_files(folder, dict(zip(NAMES, texts, strict=True)))


def validate(
    source: Path, flights: Sequence[Flight], maneuvers: Sequence[str] = (), command: str = ""
) -> Validated:
    """Predict windows of flights with a fitted model.

    `source` is the folder of stoop identify, or the ``result.json`` in it; `maneuvers` are
    ``[FLIGHT@]START:STOP[#LOADING]``, or the candidate maneuvers of each flight when empty.

    Raises
    ------
    StoopError
        One line that says what is wrong and what to do.
    """
    known = outputs.by_name(flights, "validate")
    identified = outputs.read_identified(source)
    vehicle = identified.vehicle
    of = identified.result
    floors = {c: one.noise for m in of.maneuvers if m.role == "fit" for c, one in m.channels.items()}
    found_by = FittedFilter.of_result(vehicle, of.noise_covariance, of.process_noise)
    model = FittedModel(vehicle, of.covariance, of.noise_covariance, found_by)
    for flight in flights:
        require_channels(vehicle, flight, f"which result {source} is")
    fitted_as = {name: identified.name_of(one) for name, one in known.items()}
    of_data: list[Notice | str] = []
    try:
        fitted = identified.fitted_maneuvers()
    except StoopError as error:
        fitted = []
        of_data.append(notice("no-lag-baseline", reason=str(error)))

    windows, skipped = _windows(identified, known, fitted_as, maneuvers)
    of_data += skipped
    results: list[ManeuverResult] = []
    traces: list[ManeuverTrace] = []
    doubts: list[Notice | str] = []
    used = []
    for name, flight in known.items():
        own = [w for w in windows if w.flight == name]
        if not own:
            continue
        flight = without_faults(without(flight, [(w.start, w.stop) for w in own]))
        biases = identified.biases(fitted_as[name])
        ahead = predict(model, {name: flight}, own, [biases] * len(own))
        group = Simulated(
            "validation", ahead.prepared, ahead.readings, None, ahead.deviations, ahead.innovations
        )
        found, drawn = maneuver_curves(vehicle, [group], fitted, noise=model.noise, floors=floors)
        used.append(flight)
        results += found
        traces += drawn
        of_data += [*flight.notices, *of_severity(ahead.prepared.notices, "info")]
        doubts += of_severity(ahead.prepared.notices, "warning")

    lost = [(m, diverged(m, model.noise)) for m in results]
    warnings = [
        *search_notices(identified.result.status, identified.result.advice),
        *refusal(identified.result, str(identified.folder)),
        *(notice("simulation-diverges", m.window, channels=names) for m, names in lost if names),
        *map(as_notice, doubts),
    ]
    notes = data_notices(of_data)
    better = [one.better for m in results for one in m.channels.values() if one.compared]
    (digest,) = file_hashes([identified.folder / RESULT]).values()
    record = Validation(
        vehicle=vehicle.name,
        result=digest,
        maneuvers=tuple(results),
        compared=len(better),
        better=sum(better),
        warnings=tuple(map(str, [*warnings, *lag_notices(results)])),
        notes=tuple(map(str, notes)),
        versions=outputs.versions(),
        inputs=file_hashes(outputs.flight_files(used)),
        command=command,
    )
    result = replace(
        identified.result,
        maneuvers=record.maneuvers,
        notices=(*warnings, *basis_notices(vehicle, {}, 0.0), *notes),
        versions=record.versions,
        inputs={RESULT: digest, **record.inputs},
    )
    page = Identification(
        result=result,
        traces=tuple(traces),
        vehicle=vehicle.name,
        equations=vehicle.kernel().latex,
        units=channel_units(vehicle),
        symbols=symbols(vehicle),
        command=command,
    )
    return Validated(record, page)


def _windows(
    identified: Identified,
    known: Mapping[str, Flight],
    fitted_as: Mapping[str, str | None],
    maneuvers: Sequence[str],
) -> tuple[list[Window], list[Notice]]:
    """Return the windows to predict, refused where they were fitted; or all candidates, and why others cannot be."""

    def overlapping(window: Window) -> ManeuverResult | None:
        """Return a fitted maneuver with which a window shares samples."""
        for m in identified.result.maneuvers:
            of_flight = m.role == "fit" and m.flight == fitted_as[window.flight]
            if of_flight and window.start < m.stop and m.start < window.stop:
                return m
        return None

    def obstacle(window: Window) -> str:
        """Return why a candidate cannot be predicted."""
        if overlapping(window) is not None:
            return "the model was fitted there"
        try:
            prepare(decoupled(identified.vehicle, known, [window]), known, [window])
        except FlightError as error:
            return str(error).removeprefix(f"{window}: ")
        return ""

    windows = [parse_window(text, known) for text in maneuvers]
    for window in windows:
        other = overlapping(window)
        if other is not None:
            raise FlightError(
                f"maneuver {window}: overlaps {other.start:g}:{other.stop:g}, to which the model was fitted; "
                "only what was not fitted can be predicted; choose another window"
            )
    skipped: list[Notice] = []
    if not windows:
        maneuvers_of = ((name, m) for name, flight in known.items() for m in find_maneuvers(flight))
        candidates = [Window(name, m.start, m.stop) for name, m in maneuvers_of]
        reasons = {window: obstacle(window) for window in candidates}
        skipped = [notice("window-skipped", str(w), reason=reason) for w, reason in reasons.items() if reason]
        windows = [window for window, reason in reasons.items() if not reason]
        if not windows:
            first = f" ({skipped[0]})" if skipped else ""
            raise FlightError(
                f"{', '.join(known)}: no maneuver was found to predict{first}; name windows with --maneuver START:STOP"
            )
    return windows, skipped
