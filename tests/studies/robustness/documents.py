"""Documents that stoop reads, made hostile: a sound one with some edits of its tree or of its bytes, and what is asked of it.

Every case ends in an error of ours, or in what the document promises: numbers that are finite and in order, and that are the
same once they are written and read again.
"""

from __future__ import annotations

import json
import math
import tomllib
import types
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Literal, get_args, get_origin, get_type_hints

import numpy as np
from hypothesis import strategies as st
from studies.robustness import kept_files, readers
from studies.robustness.damage import damaged
from studies.robustness.hostile import damaged_trees, to_json, to_toml
from studies.robustness.sample_logs import CSV_MAPPING, samples
from studies.robustness.small_runs import inputs
from studies.robustness.trials import READ, promise

from stoop.assessment.uncertainty import agreement
from stoop.base.notices import Notice
from stoop.errors import StoopError
from stoop.estimate.noise import read_covariance
from stoop.flight.mapping import read_flight_mapping
from stoop.input_design.windows_file import expanded, read_windows
from stoop.input_design.windows_file import written as windows_text
from stoop.report.identification import render_validation
from stoop.results.result import Result, from_json, read_result
from stoop.simulation.maneuver import check_maneuver, load_maneuver
from stoop.vehicle import load_vehicle, parse_vehicle
from stoop.vehicle.builtin import BUILT_IN, builtin_text
from stoop.vehicle.symbolic import build_model
from stoop.vehicle_draft.draft import draft
from stoop.vehicle_draft.geometry import Geometry
from stoop.vehicle_draft.request import Request
from stoop.workflow.export import model_data
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.load import load
from stoop.workflow.outputs import RESULT, with_values
from stoop.workflow.summary import (
    advice_by_doubt,
    estimates_table,
    figures_table,
    methods_table,
    repeatability_lines,
)

SOUND = Path(__file__).with_name("sound")
NOTICES = (
    ("vehicle-file-note", "warning", {"text": "Inertia is assumed."}), ("residuals-colored", "info", {"samples": 5.0}),
    ("of-a-later-version", "info", {}), ("not-identifiable", "warning", {"parameters": ["Cmq"], "count": 2, "reason": "d"}),
)  # fmt: skip
NAMES = ("CLalpha", "Cmalpha", "Cmq", "Cmelevator", "q", "V", "wind_n", "a.nc")


@dataclass(frozen=True)
class Document:
    """A kind of document: what is asked of it, how a tree of it is written, sound ones, and the form of its bytes."""

    ask: Callable[[Path, int], object]  #: path, and a number for what is asked in some cases only
    write: Callable[[object], bytes]
    sound: Callable[[], list]
    name: str = "document.toml"
    form: str = "lines"
    more: st.SearchStrategy | None = None  #: of trees that are drawn otherwise


def ask_vehicle(path: Path, number: int) -> None:
    """Read a vehicle; write it and read it again; make some equations."""
    vehicle = load_vehicle(path)
    numbers = vehicle.parameters
    promise(all(math.isfinite(p.value) for p in numbers), "a number is not finite")
    promise(all(p.lower < p.upper for p in numbers if p.free), "the bounds of a free number are empty")
    promise(repr(vehicle).isprintable(), "the name steers a terminal")
    _ = vehicle._repr_html_(), vehicle.structure, vehicle.states, vehicle.inputs, vehicle.outputs
    if number % 3 == 0:
        values = {p.name: p.value for p in numbers if p.free}
        same = {p.name: p.value for p in parse_vehicle(with_values(vehicle, values), "again").parameters}
        kept = all(math.isclose(same[name], x, rel_tol=1e-9) for name, x in values.items())
        promise(kept, "written and read differ")
    if number == 1:
        build_model(vehicle)


def ask_mapping(path: Path, number: int) -> None:
    """Read a mapping; some read a table by it, some make a flight of that."""
    if number % 3 == 0:
        read_flight_mapping(path)
        return
    table = path.with_name("a.csv")
    table.write_bytes(samples("csv")[0].files["a.csv"])
    readers.ask(table, path, (readers.READER, readers.FLIGHT)[number % 2])


def ask_maneuver(path: Path, number: int) -> None:
    """Read a maneuver, make its inputs, and ask whether a vehicle can fly it."""
    maneuver = load_maneuver(path)
    time, deflections = maneuver.time, maneuver.deflections().values()
    promise((np.diff(time) > 0.0).all(), "the time does not grow")
    promise(
        all(x.shape == time.shape and np.isfinite(x).all() for x in deflections), "an input is not finite"
    )
    check_maneuver(vehicles()[number // 17], maneuver)


def ask_windows(path: Path, number: int) -> None:
    """Read windows, write them, and read them again."""

    def rounded(one):  # as a file holds it
        digits = {"start": f"{one.start:.13g}", "stop": f"{one.stop:.13g}"}
        rest = {"information": round(one.information, 3), "gain": round(one.gain, 3)}
        return one.model_copy(
            update={**{key: float(x) for key, x in digits.items()}, **{k: str(x) for k, x in rest.items()}}
        )

    found, again = read_windows(path), path.with_name("again.toml")
    again.write_text(windows_text(found, "stoop \x1b", ("a\nb",)), encoding="utf-8")
    promise(list(map(rounded, found)) == list(map(rounded, read_windows(again))), "written and read differ")
    expanded([str(path)], [])


def ask_geometry(path: Path, number: int) -> None:
    """Read a geometry; draft some vehicles from it, whose files must be read again."""
    geometry = Geometry.load(path)
    if number < 2:
        request = Request(None, None, None, None, None, None, geometry, None, "handbook")
        parse_vehicle(draft(request, []).text, "drafted")


def ask_covariance(path: Path, number: int) -> None:
    """Read a covariance."""
    matrix = read_covariance(path, ("p", "q", "r"))
    promise(matrix.shape == (3, 3) and np.linalg.eigvalsh(matrix)[0] > 0.0, "no covariance")


def ask_result(path: Path, number: int) -> None:
    """Read a result; write it and read it again; print it; make some pages."""
    result = read_result(path)
    text = result.to_json()
    promise(from_json(text).to_json() == text, "written and read differ")
    shown = [repr(result), *map(str, result.notices), *map(str, result.trust), *result.warnings]
    promise(all(one.isprintable() for one in shown), "a notice steers a terminal")
    estimates_table(result.parameters)
    methods_table(result)
    figures_table(result.maneuvers)
    repeatability_lines(result.repeatability)
    advice_by_doubt(result.identifiability.parameters)
    _ = result._repr_html_(), result.verdict.headline, result.extensions.standing
    if number < 5:
        bare = replace(result, maneuvers=())  # whose curves no file keeps
        render_validation(FittedModel(vehicles()[0], bare))


def ask_identification(path: Path, number: int) -> None:
    """Read the folder of an identification, whose result is damaged, as it is exported."""
    path.with_name("vehicle.toml").write_bytes(inputs()["model/vehicle.toml"])
    model = load(path.parent)
    promise(np.isfinite(model_data(model).vehicle.values).all(), "a number is not finite")
    result = model.result
    with suppress(StoopError):  # of the same windows
        agreement({"a": result, "b": result})


def of_type(kind) -> st.SearchStrategy:
    """Return trees of JSON for a type of a field of a result; a number that does not exist is null."""
    origin, inner = get_origin(kind), get_args(kind)
    if kind is Notice:
        return st.sampled_from(NOTICES).map(
            lambda one: {"code": one[0], "severity": one[1], "subject": "", "values": one[2], "message": "a"}
        )
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        sentences = {f.name for f in fields(kind) if f.metadata}
        parts = {
            n: st.lists(st.just("A sentence."), max_size=2) if n in sentences else of_type(x)
            for n, x in hints.items()
        }
        return st.fixed_dictionaries(parts)
    if origin is tuple:
        return (
            st.lists(of_type(inner[0]), max_size=2)
            if inner[-1] is ...
            else st.tuples(*map(of_type, inner)).map(list)
        )
    if origin in (Mapping, dict):
        return st.dictionaries(st.sampled_from(NAMES), of_type(inner[1]), max_size=3)
    if origin in (types.UnionType, Literal):
        return st.sampled_from(inner) if origin is Literal else st.one_of(*map(of_type, inner))
    plain = {
        bool: st.booleans(), int: st.integers(0, 40), str: st.sampled_from(("", "a", "q", *NAMES)), types.NoneType: st.none(),
        float: st.sampled_from((1.0, -0.3, 1.0, None)),
    }  # fmt: skip
    return plain.get(kind, st.lists(st.lists(plain[float], min_size=2, max_size=2), min_size=2, max_size=2))


@st.composite
def results(draw):
    """Draw a result some of whose parts are drawn by their types."""
    tree = json.loads(inputs()["model/result.json"])
    hints = get_type_hints(Result)
    optional = sorted(tree.keys() & hints.keys() - {"parameters", "covariance", "maneuvers", "trust"})
    for name in draw(st.lists(st.sampled_from(optional), max_size=4, unique=True)):
        tree[name] = draw(of_type(hints[name]))
    return draw(damaged_trees([tree]))


def rows(tree) -> bytes:
    """Write lists of lists as comma-separated values."""
    lines = (one if isinstance(one, list) else [one] for one in (tree if isinstance(tree, list) else [tree]))
    return b"\n".join(b",".join(to_json(cell).strip(b'"') for cell in line) for line in lines)


@cache
def vehicles() -> tuple:
    """Return the built-in vehicles."""
    return tuple(parse_vehicle(builtin_text(name), name) for name in BUILT_IN)


def toml(*names: str) -> Callable[[], list]:
    """Return what reads sound documents of the folder."""
    return lambda: [tomllib.loads((SOUND / f"{name}.toml").read_text(encoding="utf-8")) for name in names]


def kept_vehicles() -> list:
    """Return the vehicles of the package and two with all that a vehicle file may say."""
    return [*toml("aircraft", "multirotor")(), *(tomllib.loads(builtin_text(name)) for name in BUILT_IN)]


def kept_results() -> list:
    """Return the result of a small identification."""
    return [json.loads(inputs()["model/result.json"])]


MATRIX = [[1.0, 0.01, 0.01], [0.01, 1.0, 0.01], [0.01, 0.01, 1.0]]
DOCUMENTS = {
    "vehicle": Document(ask_vehicle, to_toml, kept_vehicles),
    "mapping table": Document(
        ask_mapping, to_toml, lambda: [tomllib.loads(CSV_MAPPING.decode()), *toml("mapping")()]
    ),
    "maneuver": Document(ask_maneuver, to_toml, toml("maneuver")),
    "windows": Document(ask_windows, to_toml, toml("windows")),
    "geometry": Document(ask_geometry, to_toml, toml("geometry")),
    "covariance": Document(ask_covariance, rows, lambda: [MATRIX, [[0.1, 0.2, 0.3]]]),
    "result": Document(ask_result, to_json, kept_results, RESULT, more=results()),
    "identification": Document(ask_identification, to_json, kept_results, RESULT, more=results()),
    "state": Document(kept_files.ask_state, kept_files.write_state, kept_files.kept_states, form="words"),
    "store": Document(kept_files.ask_store, kept_files.write_store, kept_files.kept_stores, form="pages"),
    "kernel cache": Document(kept_files.ask_cache, to_json, kept_files.kept_manifests),
    "flight": Document(
        kept_files.ask_flight, kept_files.write_flight, kept_files.kept_flights, "flight.nc", "words"
    ),
}  #: name -> kind of document


@st.composite
def documents(draw, kind: str) -> bytes:
    """Draw a document: an edited tree, or the bytes of a sound one damaged."""
    document, sound = DOCUMENTS[kind], DOCUMENTS[kind].sound()
    if draw(st.integers(0, 3)):
        trees = damaged_trees(sound)
        return document.write(draw(trees if document.more is None else trees | document.more))
    one, other = draw(st.sampled_from(sound)), draw(st.sampled_from(sound))
    return draw(damaged(document.write(one), document.write(other), document.form))


def try_document(folder: Path, kind: str, content: bytes, number: int) -> str:
    """Ask a document; ``number``, from 0 to 99, says what is asked in some cases only."""
    path = folder / DOCUMENTS[kind].name
    path.write_bytes(content)
    DOCUMENTS[kind].ask(path, number)
    return READ


def prepare(kind: str) -> None:
    """Load what documents need once, so that copies of this process need not."""
    readers.prepare()
    vehicles()
    inputs()
    DOCUMENTS[kind].sound()
