"""Documents that stoop reads: each ends in an error of ours, or is what it promises, also once it is written and read again."""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from robustness import readers
from robustness.corpus import Case, sound
from robustness.trials import READ, promise

from stoop.assessment.uncertainty import agreement
from stoop.errors import StoopError
from stoop.estimate.noise import read_covariance
from stoop.flight import describe, load_flight, save_flight
from stoop.flight.mapping import FlightMapping
from stoop.optimize import create, load_tagged, minimize, save_state
from stoop.optimize.minimize import Stop
from stoop.parallel.plan import Plan, Run
from stoop.parallel.store import forget, open_store
from stoop.report.identification import render_validation
from stoop.results.result import from_json, read_result
from stoop.simulation.maneuver import load_maneuver
from stoop.vehicle import load_vehicle, parse_vehicle
from stoop.vehicle.builtin import BUILT_IN, builtin_text
from stoop.vehicle.symbolic import build_model
from stoop.workflow import summary
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.load import load as load_model
from stoop.workflow.outputs import with_values
from stoop_draft.vehicle_draft.draft import draft
from stoop_draft.vehicle_draft.geometry import Geometry
from stoop_draft.vehicle_draft.request import Request
from stoop_export.export import model_data
from stoop_plan.input_design.windows_file import expanded, read_windows
from stoop_plan.input_design.windows_file import written as windows_text


def ask_vehicle(path: Path, number: int) -> None:
    vehicle = load_vehicle(path)
    numbers = vehicle.parameters
    promise(all(math.isfinite(p.value) for p in numbers), "a number is not finite")
    promise(all(p.lower < p.upper for p in numbers if p.free), "the bounds of a free number are empty")
    promise(repr(vehicle).isprintable(), "the name steers a terminal")
    _ = vehicle._repr_html_(), vehicle.structure, vehicle.outputs
    if number % 3 == 0:
        values = {p.name: p.value for p in numbers if p.free}
        same = {p.name: p.value for p in parse_vehicle(with_values(vehicle, values), "again").parameters}
        kept = all(math.isclose(same[name], x, rel_tol=1e-9) for name, x in values.items())
        promise(kept, "written and read differ")
    if number == 1:
        build_model(vehicle)


def ask_mapping(path: Path, number: int) -> None:
    if number % 3 == 0:
        FlightMapping.read(path)
        return
    table = path.with_name("a.csv")
    table.write_bytes(sound("csv")[0].files["a.csv"])
    readers.ask(table, path, (readers.READER, readers.FLIGHT)[number % 2])


def ask_maneuver(path: Path, number: int) -> None:
    maneuver = load_maneuver(path)
    time, inputs = maneuver.time, maneuver.deflections().values()
    promise((np.diff(time) > 0.0).all(), "the time does not grow")
    promise(all(x.shape == time.shape and np.isfinite(x).all() for x in inputs), "an input is not finite")
    maneuver.check(vehicles()[number // 17])


def ask_windows(path: Path, number: int) -> None:
    found, again = read_windows(path), path.with_name("again.toml")
    again.write_text(windows_text(found, "stoop \x1b", ("a\nb",)), encoding="utf-8")
    was, now = ([(x.flight, x.use, round(x.start, 6)) for x in file] for file in (found, read_windows(again)))
    promise(was == now, "written and read differ")
    expanded([str(path)], [])


def ask_geometry(path: Path, number: int) -> None:
    geometry = Geometry.load(path)
    if number < 2:
        request = Request(None, None, None, None, None, None, geometry, None, "handbook")
        parse_vehicle(draft(request, []).text, "drafted")


def ask_covariance(path: Path, number: int) -> None:
    matrix = read_covariance(path, ("p", "q", "r"))
    promise(matrix.shape == (3, 3) and np.linalg.eigvalsh(matrix)[0] > 0.0, "no covariance")


def ask_result(path: Path, number: int) -> None:
    result = read_result(path)
    text = result.to_json()
    promise(from_json(text).to_json() == text, "written and read differ")
    shown = [repr(result), *map(str, result.notices), *map(str, result.trust), *result.warnings]
    promise(all(one.isprintable() for one in shown), "a notice steers a terminal")
    _ = summary.estimates_table(result.parameters), summary.figures_table(result.maneuvers)
    _ = summary.repeatability_lines(result.repeatability), summary.methods_table(result)
    summary.advice_by_doubt(result.identifiability.parameters)
    _ = result._repr_html_(), result.verdict.headline, result.extensions.standing
    if number < 5:
        bare = replace(result, maneuvers=())  # whose curves no file keeps
        render_validation(FittedModel(vehicles()[0], bare))


def ask_identification(path: Path, number: int) -> None:
    model = load_model(path.parent)
    promise(np.isfinite(model_data(model).vehicle.values).all(), "a number is not finite")
    result = model.result
    with suppress(StoopError):  # of the same windows
        agreement({"a": result, "b": result})


PLAN = Plan("table", {"n": 1}, tuple(Run(f"run {i}", "math:sin", {"x": i}) for i in range(3)))
ENVIRONMENT = {"numpy": "2.0", "stoop": "1.0"}


class Bowl:
    dimension, extra, prices = 3, 1, (0.25, 1.0)

    def residuals(self, Z, rung):
        return np.column_stack([Z - 0.3, np.sin(3.0 * Z[:, 0])])

    def costs(self, X, rung):
        return np.sum(self.residuals(np.column_stack([X, np.zeros(len(X))]), rung) ** 2, axis=1)

    def jacobian(self, z, rung, r):
        return np.vstack([np.eye(4), [3.0 * np.cos(3.0 * z[0]), 0.0, 0.0, 0.0]]), 1.0

    def reference(self, rung):
        return 1.0


def ask_state(path: Path, number: int) -> None:
    state, tag = load_tagged(path)
    save_state(path, state, tag)
    again, tag_again = load_tagged(path)
    promise((repr(again), tag_again) == (repr(state), tag), "written and read differ")
    with np.errstate(all="ignore"):
        stop = Stop(generations=state.generation + 2, budget=300.0)
        minimize(create(state.optimizer), Bowl(), seed=1, state=state, stop=stop)


def ask_store(path: Path, number: int) -> None:
    if number < 10:
        forget(path)
        return
    with open_store(path, PLAN, ENVIRONMENT) as store:
        missing = store.missing(PLAN.runs)
        store.add(missing, ['{"y":2.5}'] * len(missing))
        results = store.results(PLAN.runs)
    promise(set(results) == {run.key for run in PLAN.runs}, "a run is not there")
    with open_store(path, PLAN, ENVIRONMENT) as store:
        promise(store.results(PLAN.runs) == results, "written and read differ")


def ask_flight(path: Path, number: int) -> None:
    flight = load_flight(path)
    describe(flight)
    texts = (*flight.notices, *flight.faults)
    promise(all(str(one).isprintable() for one in texts), "a notice steers a terminal")
    if number % 3 == 0:
        save_flight(flight, path.with_name("again.nc"))
        again = load_flight(path.with_name("again.nc"))
        same = [again.notices, again.sources, again.rate] == [flight.notices, flight.sources, flight.rate]
        promise(same, "written and read differ")


@cache
def vehicles() -> tuple:
    return tuple(parse_vehicle(builtin_text(name), name) for name in BUILT_IN)


ASKS: dict[str, Callable[[Path, int], None]] = {
    "vehicle": ask_vehicle, "mapping table": ask_mapping, "maneuver": ask_maneuver, "windows": ask_windows,
    "geometry": ask_geometry, "covariance": ask_covariance, "result": ask_result, "identification": ask_identification,
    "state": ask_state, "store": ask_store, "flight": ask_flight,
}  # fmt: skip  #: kind of document -> what is asked of it; the number says what is asked in some cases only


def read_document(folder: Path, case: Case) -> str:
    path, _ = case.write(folder)
    ASKS[case.kind.partition(":")[2]](path, int(case.way))
    return READ
