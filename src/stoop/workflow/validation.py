"""Validation: a fitted model predicts windows of flights that it was not fitted to."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from stoop.assessment.baseline import BaselineManeuver
from stoop.base.files import write_text_atomic
from stoop.base.notices import Notice, as_notice, notice, of_severity
from stoop.checks.vehicle import require_channels
from stoop.errors import FlightError, StoopError
from stoop.estimate.predict import predicted
from stoop.flight import Flight, without, without_faults
from stoop.flight.maneuvers import find_maneuvers
from stoop.problem.windows import Window, parse_window
from stoop.results.result import Identification, ManeuverResult, ManeuverTrace, Validation
from stoop.vehicle.notation import symbols
from stoop.workflow.curves import Simulated, channel_units, maneuver_curves
from stoop.workflow.identified import Identified, read_identified
from stoop.workflow.notices import basis_notices, data_notices, lag_notices, search_notices, window_of
from stoop.workflow.outputs import RESULT
from stoop.workflow.provenance import by_name, file_hashes, flight_files, versions

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
        from stoop.report import write_validation

        folder.mkdir(parents=True, exist_ok=True)
        page, data = (folder / name for name in NAMES)
        write_validation(self.identification, page)
        write_text_atomic(data, self.record.to_json())


@dataclass(frozen=True, eq=False)
class Flights:
    """Flights to predict: by name, and what each was called when it was fitted (None where it was not)."""

    identified: Identified
    known: Mapping[str, Flight]
    fitted_as: Mapping[str, str | None]

    def overlapping(self, window: Window) -> ManeuverResult | None:
        """Return a fitted maneuver with which a window shares samples."""
        for m in self.identified.result.maneuvers:
            of_flight = m.role == "fit" and m.flight == self.fitted_as[window.flight]
            if of_flight and window.start < m.stop and m.start < window.stop:
                return m
        return None

    def check(self, window: Window) -> None:
        """Refuse a window that was fitted."""
        other = self.overlapping(window)
        if other is not None:
            raise FlightError(
                f"maneuver {window}: overlaps {other.start:g}:{other.stop:g}, to which the model was fitted; "
                "only what was not fitted can be predicted; choose another window"
            )

    def candidates(self) -> tuple[list[Window], list[Notice]]:
        """Return the candidate maneuvers that can be predicted, and why others cannot."""
        windows, skipped = [], []
        for name, flight in self.known.items():
            for maneuver in find_maneuvers(flight):
                window = Window(name, maneuver.start, maneuver.stop)
                reason = self._obstacle(window)
                if reason:
                    skipped.append(notice("window-skipped", str(window), reason=reason))
                else:
                    windows.append(window)
        if not windows:
            first = f" ({skipped[0]})" if skipped else ""
            raise FlightError(
                f"{', '.join(self.known)}: no maneuver was found to predict{first}; name windows with "
                "--maneuver START:STOP"
            )
        return windows, skipped

    def _obstacle(self, window: Window) -> str:
        if self.overlapping(window) is not None:
            return "the model was fitted there"
        try:
            predicted(self.identified.vehicle, self.known, [window], [{}])
        except FlightError as error:
            return str(error).removeprefix(f"{window}: ")
        return ""


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
    known = by_name(flights, "validate")
    identified = read_identified(source)
    for flight in flights:
        require_channels(identified.vehicle, flight, f"which result {source} is")
    given = Flights(identified, known, {name: identified.name_of(one) for name, one in known.items()})
    notices: list[Notice] = []
    try:
        fitted = identified.fitted_maneuvers()
    except StoopError as error:
        fitted = []
        notices.append(notice("no-lag-baseline", reason=str(error)))
    if maneuvers:
        windows = [parse_window(text, known) for text in maneuvers]
        for window in windows:
            given.check(window)
    else:
        windows, skipped = given.candidates()
        notices += skipped
    return _predicted(given, windows, fitted, notices, command)


def _predicted(
    given: Flights,
    windows: Sequence[Window],
    fitted: Sequence[BaselineManeuver],
    notices: list[Notice],
    command: str,
) -> Validated:
    identified, vehicle = given.identified, given.identified.vehicle
    results: list[ManeuverResult] = []
    traces: list[ManeuverTrace] = []
    doubts: list[Notice | str] = []
    of_data: list[Notice | str] = []
    used = []
    for name, flight in given.known.items():
        own = [w for w in windows if w.flight == name]
        if not own:
            continue
        flight = without_faults(without(flight, [(w.start, w.stop) for w in own]))
        biases = identified.biases(given.fitted_as[name])
        prepared, simulated = predicted(vehicle, {name: flight}, own, [biases] * len(own))
        found, drawn = maneuver_curves(vehicle, [Simulated("validation", prepared, simulated)], fitted)
        used.append(flight)
        results += found
        traces += drawn
        of_data += [*flight.notices, *of_severity(prepared.notices, "info")]
        doubts += of_severity(prepared.notices, "warning")
    status = search_notices(identified.result.status, identified.result.advice)
    warnings = [*status, *_diverging(results), *map(as_notice, doubts)]
    record = _record(identified, used, tuple(results), warnings, data_notices([*notices, *of_data]), command)
    result = replace(
        identified.result,
        maneuvers=record.maneuvers,
        notices=(*warnings, *basis_notices(vehicle, {}, 0.0), *data_notices([*notices, *of_data])),
        versions=record.versions,
        inputs={RESULT: record.result, **record.inputs},
    )
    drawn_result = Identification(
        result=result,
        traces=tuple(traces),
        vehicle=vehicle.name,
        equations=vehicle.kernel().latex,
        units=channel_units(vehicle),
        symbols=symbols(vehicle),
        command=command,
    )
    return Validated(record, drawn_result)


def _diverging(maneuvers: Sequence[ManeuverResult]) -> list[Notice]:
    lost = [(m, tuple(c for c, f in m.channels.items() if not math.isfinite(f.rmse))) for m in maneuvers]
    return [notice("simulation-diverges", window_of(m), channels=names) for m, names in lost if names]


def _record(
    identified: Identified,
    flights: Sequence[Flight],
    maneuvers: tuple[ManeuverResult, ...],
    warnings: Sequence[Notice],
    notes: Sequence[Notice],
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
        warnings=tuple(map(str, [*warnings, *lag_notices(maneuvers)])),
        notes=tuple(map(str, notes)),
        versions=versions(),
        inputs=file_hashes(flight_files(flights)),
        command=command,
    )
