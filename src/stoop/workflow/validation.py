"""Validation: a fitted model predicts windows of flights that it was not fitted to."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Literal

import numpy as np

from stoop.assessment.verdict import diverged
from stoop.base.files import check_targets, write_files
from stoop.base.notices import Notice, as_notice, notice, of_severity
from stoop.base.numbers import count
from stoop.base.packages import hooks
from stoop.base.text import printable
from stoop.base.variables import RATES, SPECIFIC_FORCE
from stoop.checks.vehicle import require_channels
from stoop.errors import FlightError, StoopError
from stoop.estimate.fitted_filter import FittedFilter
from stoop.flight import Flight, without
from stoop.flight.flight import flight_name
from stoop.prediction.initial_state import Predictor
from stoop.prediction.predict import predict, predict_from
from stoop.problem.prepare import Prepared, decoupled
from stoop.problem.windows import Window, Windows
from stoop.results.decisions import switched_off
from stoop.results.result import ManeuverResult, ManeuverTrace, Result, plain, to_json
from stoop.workflow import outputs
from stoop.workflow.curves import Simulated, baseline_maneuver, maneuver_curves
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.flights import Flights, as_flights
from stoop.workflow.load import takes_model
from stoop.workflow.outputs import RESULT, file_hashes
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
    #: from a given initial state: window -> model, draft, straight line, ARX -> mean over the channels of motion of the rms
    #: error over the range
    open_loop: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def to_json(self) -> str:
        """Return the validation as JSON text; NaN and infinities become ``null``."""
        document = {"schema": "stoop-validation/1", **plain(self)}
        return json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


@dataclass(frozen=True, eq=False, repr=False)
class Validated:
    """A finished validation: its record, and the model with the predicted maneuvers in place of the fitted ones."""

    record: Validation
    model: FittedModel

    def __repr__(self) -> str:
        """Return vehicle, and in how many channels the model is better than a lag, on one line."""
        r = self.record
        flown = count(len(r.maneuvers), "maneuver")
        text = f"{flown}, better than a lag in {r.better} of {r.compared} channels"
        return printable(f"<Validated {r.vehicle}: {text}>")

    def save(self, folder: str | Path, overwrite: bool = False) -> None:
        """Write ``validation.html`` and ``validation.json`` into a folder, both or none.

        Raises `OutputError`: they cannot be written, or are there already.
        """
        from stoop.report.identification import render_validation

        check_targets(Path(folder), NAMES, overwrite)
        texts = render_validation(self.model), self.record.to_json()
        write_files(Path(folder), dict(zip(NAMES, texts, strict=True)))


@takes_model
def validate(
    model: FittedModel,
    flights: Flights,
    windows: Windows = (),
    command: str = "",
    initial_state: Mapping[str, float] | Literal["measured"] | None = None,
) -> Validated:
    """Predict windows that were not fitted.

    Parameters
    ----------
    model : FittedModel, or the folder of one
    flights : Flight, path of a log, table or dataset, or a sequence of them
    windows : windows, optional
        The maneuvers found in the flights when absent.
    command : str, optional
        For the page.
    initial_state : mapping, or "measured", optional
        States at the start of each window, SI, from which the model is simulated open loop: ``{"alpha": 0.05}``; the states
        that it leaves out are those measured, as all are of "measured". When absent the initial state and the sensor biases
        are estimated from the second before the window.

    Returns
    -------
    Validated
        ``record`` (figures of each maneuver), ``model.traces`` (curves), ``save(folder)``.

    Raises
    ------
    StoopError
        A window was fitted, or cannot be flown.
    """
    if not (initial_state is None or initial_state == "measured" or isinstance(initial_state, Mapping)):
        raise StoopError(
            f"initial_state = {initial_state!r}: give \"measured\", or states by name in SI such as {{'alpha': 0.05}}"
        )
    known = outputs.by_name(as_flights(flights), "validate")
    vehicle = model.vehicle
    of = model.result
    floors = {c: one.noise for m in of.maneuvers if m.role == "fit" for c, one in m.channels.items()}
    found_by = FittedFilter.of_result(vehicle, of.noise_covariance, of.process_noise)
    coupled = not switched_off(of.decisions, "recorded-motion")
    predictor = Predictor(vehicle, of.covariance, of.noise_covariance, found_by, coupled)
    for flight in known.values():
        require_channels(vehicle, flight, f"which result {model.source} is")
    fitted_as = {name: _fitted_as(model, one) for name, one in known.items()}
    of_data: list[Notice | str] = []
    try:
        flown = model.pieces()
        fitted = [baseline_maneuver(vehicle, "fit", pieces) for pieces in flown]
    except StoopError as error:
        flown, fitted = [], []
        of_data.append(notice("no-lag-baseline", reason=str(error)))

    chosen, skipped = _windows(model, known, fitted_as, Window.several(windows, known))
    of_data += skipped
    results: list[ManeuverResult] = []
    traces: list[ManeuverTrace] = []
    doubts: list[Notice | str] = []
    used, scores = [], dict[str, Mapping[str, float]]()
    for name, flight in known.items():
        own = [w for w in chosen if w.flight == name]
        if not own:
            continue
        flight = without(flight, [(w.start, w.stop) for w in own])
        if not switched_off(of.decisions, "faults"):
            flight = flight.without_faults()
        biases = model.biases(fitted_as[name])
        if initial_state is None:
            ahead = predict(predictor, {name: flight}, own, [biases] * len(own))
        else:
            start = {} if isinstance(initial_state, str) else dict(initial_state)
            ahead = predict_from(predictor, {name: flight}, own, biases, start)
            before = predict_from(_draft(predictor, of), {name: flight}, own, biases, start)
            for rate in hooks("open_loop_scores", dict):
                scores |= rate(vehicle, ahead, before, [*chain(*flown)])
        predicted = (ahead.prepared, ahead.readings, None, ahead.deviations, ahead.innovations)
        group = Simulated("validation", *predicted)
        found, drawn = maneuver_curves(vehicle, [group], fitted, noise=predictor.noise, floors=floors)
        used.append(flight)
        results += found
        traces += drawn
        of_data += [*flight.notices, *of_severity(ahead.prepared.notices, "info")]
        doubts += of_severity(ahead.prepared.notices, "warning")

    lost = [(m, diverged(m, predictor.noise)) for m in results]
    warnings = [
        *search_notices(of.status, of.advice),
        *refusal(of, model.source),
        *(notice("simulation-diverges", m.window, channels=names) for m, names in lost if names),
        *map(as_notice, doubts),
    ]
    notes = data_notices(of_data)
    better = [one.better for m in results for one in m.channels.values() if one.compared]
    digest = _digest(model)
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
        open_loop=scores,
    )
    result = replace(
        of,
        maneuvers=record.maneuvers,
        notices=(*warnings, *basis_notices(vehicle, {}, 0.0), *notes),
        versions=record.versions,
        inputs={RESULT: digest, **record.inputs},
    )
    return Validated(record, replace(model, result=result, traces=tuple(traces), command=command))


def _draft(model: Predictor, result: Result) -> Predictor:
    """Return the model as it was before the fit."""
    own = {p.name for p in model.vehicle.parameters}
    begun = {n: p.start for n, p in result.parameters.items() if n in own and np.isfinite(p.start)}
    starts = {n: {"value": start} for n, start in begun.items()}
    return replace(model, vehicle=model.vehicle.with_numbers(starts))


def _digest(model: FittedModel) -> str:
    """Return the SHA-256 of the ``result.json`` of a model."""
    if model.folder is not None and (file := model.folder / RESULT).exists():
        return next(iter(file_hashes([file]).values()))
    return hashlib.sha256(to_json(model.result).encode()).hexdigest()


def _fitted_as(model: FittedModel, flight: Flight) -> str | None:
    """Return the name under which a flight was fitted: of the same file, or of the same record; None of another."""
    digests = file_hashes(outputs.flight_files([flight])).values()
    read = {digest: flight_name(Path(file)) for file, digest in model.result.inputs.items()}
    fitted = {m.flight for m in model.result.maneuvers}
    by_file = (read[d] for d in digests if read.get(d) in fitted)
    by_record = (one.name for one in model.flights if _same_record(one, flight))
    return next(chain(by_file, by_record), None)


def _same_record(one: Flight, other: Flight) -> bool:
    """Tell whether two flights have the same rates and specific forces at the same times, where both have some."""
    shared = [c for c in (*RATES, *SPECIFIC_FORCE) if c in one.names and c in other.names]
    if not shared or not np.array_equal(one.time, other.time):
        return False
    differences = np.abs([one.column(c) - other.column(c) for c in shared])
    return bool(np.isfinite(differences).any() and not np.nanmax(differences) > 0.0)


def _windows(
    model: FittedModel,
    known: Mapping[str, Flight],
    fitted_as: Mapping[str, str | None],
    given: Sequence[Window],
) -> tuple[list[Window], list[Notice]]:
    """Return the windows to predict, refused where they were fitted; or all candidates, and why others cannot be."""

    def overlapping(window: Window) -> ManeuverResult | None:
        """Return a fitted maneuver with which a window shares samples."""
        for m in model.result.maneuvers:
            of_flight = m.role == "fit" and m.flight == fitted_as[window.flight]
            if of_flight and window.start < m.stop and m.start < window.stop:
                return m
        return None

    def obstacle(window: Window) -> str:
        """Return why a candidate cannot be predicted."""
        if overlapping(window) is not None:
            return "the model was fitted there"
        try:
            Prepared.of(decoupled(model.vehicle, known, [window]), known, [window])
        except FlightError as error:
            return str(error).removeprefix(f"{window}: ")
        return ""

    windows = list(given)
    for window in windows:
        other = overlapping(window)
        if other is not None:
            raise FlightError(
                f"maneuver {window}: overlaps {other.start:g}:{other.stop:g}, to which the model was fitted; "
                "only what was not fitted can be predicted; choose another window"
            )
    skipped: list[Notice] = []
    if not windows:
        maneuvers_of = ((name, m) for name, flight in known.items() for m in flight.find_maneuvers())
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
