"""Hostile documents: every file but logs that stoop reads, drawn from grammars and damaged as trees and as bytes.

Every case ends in an error of ours, or in what the document promises: numbers that are finite and in order, and that are the
same once they are written and read again.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from stoop.assessment.uncertainty import agreement
from stoop.errors import StoopError
from stoop.estimate.noise import read_covariance
from stoop.flight.mapping import read_flight_mapping
from stoop.problem.windows import Entry, expanded, read_windows, written
from stoop.report.identification import render_validation
from stoop.results.result import from_json, read_result
from stoop.simulation.maneuver import check_maneuver, load_maneuver
from stoop.vehicle import Vehicle, load_vehicle, parse_vehicle
from stoop.vehicle.builtin import BUILT_IN, builtin_text, builtin_vehicle
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
from stoop_studies.robustness import document_grammars as grammars
from stoop_studies.robustness import readers
from stoop_studies.robustness.damaged_logs import damaged
from stoop_studies.robustness.document_trees import Document, Node, damaged_tree, to_json, to_toml, tree_of
from stoop_studies.robustness.kept_files import KEPT_FILES
from stoop_studies.robustness.log_grammars import SHARES, Draw
from stoop_studies.robustness.readers import FLIGHT, READER
from stoop_studies.robustness.result_grammar import RESULT as RESULT_GRAMMAR
from stoop_studies.robustness.sample_logs import CSV_MAPPING, samples
from stoop_studies.robustness.small_runs import inputs
from stoop_studies.robustness.trials import (
    READ,
    SAME,
    Bounds,
    BrokenPromiseError,
    Case,
    Cases,
    Tried,
    try_all,
)
from stoop_studies.robustness.vehicle_grammar import VEHICLE

DRAWN, TREE, BYTES = "drawn", "tree", "bytes"
WAYS: Final = {DRAWN: 0.4, TREE: 0.4, BYTES: 0.2}  #: how a document was made -> share of the cases
SEEDS: Final = (
    8  #: documents without a hostile choice, of the grammar, that are damaged like those kept in files
)
MODEL_SHARE: Final = 0.02  #: of the vehicles whose equations are made
WRITTEN_SHARE: Final = 0.3  #: of the documents that are written and read again, where that is slow
DRAFT_SHARE: Final = 0.02  #: of the geometries from which a vehicle is drafted
PAGE_SHARE: Final = 0.05  #: of the results of which a page is made
CHANNELS: Final = ("p", "q", "r")  #: of a covariance
BOUNDS: Final = Bounds()


def promise(kept: bool, what: str) -> None:
    """Raise `BrokenPromiseError` where a promise is not kept."""
    if not kept:
        raise BrokenPromiseError(what)


def _written(folder: Path, name: str, content: bytes) -> Path:
    path = folder / name
    path.write_bytes(content)
    return path


def ask_vehicle(folder: Path, content: bytes, rng: Random) -> str:
    """Read a vehicle; write it and read it again; make some equations."""
    vehicle = load_vehicle(_written(folder, "v.toml", content))
    numbers = vehicle.parameters
    promise(all(math.isfinite(p.value) for p in numbers), "a number is not finite")
    promise(all(p.lower < p.upper for p in numbers if p.free), "the bounds of a free number are empty")
    promise(repr(vehicle).isprintable(), "the name steers a terminal")
    _ = vehicle._repr_html_(), vehicle.structure, vehicle.states, vehicle.inputs, vehicle.outputs
    if rng.random() < WRITTEN_SHARE:
        values = {p.name: p.value for p in numbers if p.free}
        again = parse_vehicle(with_values(vehicle, values), "again")
        same = {p.name: p.value for p in again.parameters}
        promise(
            all(math.isclose(same[n], x, rel_tol=1e-9) for n, x in values.items()), "written and read differ"
        )
    if rng.random() < MODEL_SHARE:
        build_model(vehicle)
    return READ


@cache
def vehicles() -> tuple[Vehicle, ...]:
    """Return the built-in vehicles."""
    return tuple(parse_vehicle(builtin_text(name), name) for name in BUILT_IN)


def _toml(texts: Callable[[], tuple[str, ...]]) -> Callable[[], tuple[Node, ...]]:
    return lambda: tuple(tree_of(tomllib.loads(text)) for text in texts())


def ask_mapping(folder: Path, content: bytes, rng: Random) -> str:
    """Read a mapping; some read a table by it, some make a flight of that."""
    mapping, way = _written(folder, "m.toml", content), rng.choice((READER, FLIGHT, ""))
    if not way:
        read_flight_mapping(mapping)
        return READ
    table = samples("csv")[0].files["a.csv"]
    readers.ask(_written(folder, "a.csv", table), mapping, way)
    return READ


def ask_maneuver(folder: Path, content: bytes, rng: Random) -> str:
    """Read a maneuver, make its inputs, and ask whether a vehicle can fly it."""
    maneuver = load_maneuver(_written(folder, "m.toml", content))
    time, inputs = maneuver.time, maneuver.deflections()
    promise(bool((np.diff(time) > 0.0).all()), "the time does not grow")
    promise(
        all(x.shape == time.shape and np.isfinite(x).all() for x in inputs.values()), "an input is not finite"
    )
    check_maneuver(rng.choice(vehicles()), maneuver)
    return READ


def ask_windows(folder: Path, content: bytes, rng: Random) -> str:
    """Read windows, write them, and read them again."""
    path = _written(folder, "w.toml", content)
    found = read_windows(path)
    again = read_windows(_written(folder, "w2.toml", written(found, "stoop \x1b", ("a\nb",)).encode()))
    promise([_rounded(one) for one in found] == [_rounded(one) for one in again], "written and read differ")
    expanded([str(path)], [])
    return READ


def _rounded(one: Entry) -> Entry:
    """Return a window as a file holds it."""
    return one.model_copy(update={
        "start": float(f"{one.start:.13g}"), "stop": float(f"{one.stop:.13g}"),
        "information": str(round(one.information, 3)), "gain": str(round(one.gain, 3)),
    })  # fmt: skip


def ask_geometry(folder: Path, content: bytes, rng: Random) -> str:
    """Read a geometry; draft some vehicles from it, whose files must be read again."""
    geometry = Geometry.load(_written(folder, "g.toml", content))
    if rng.random() < DRAFT_SHARE:
        request = Request(None, None, None, None, None, None, geometry, None, "handbook")
        parse_vehicle(draft(request, []).text, "drafted")
    return READ


def ask_covariance(folder: Path, content: bytes, rng: Random) -> str:
    """Read a covariance."""
    matrix = read_covariance(_written(folder, "c.csv", content), CHANNELS)
    promise(matrix.shape == (3, 3) and bool(np.linalg.eigvalsh(matrix)[0] > 0.0), "no covariance")
    return READ


def write_rows(node: Node, rng: Random) -> bytes:
    """Write lists of lists as comma-separated values."""
    rows = node if isinstance(node, list) else [node]
    lines = (",".join(map(_cell, one)) if isinstance(one, list) else _cell(one) for one in rows)
    return "\n".join(lines).encode("utf-8", "surrogatepass")


def _cell(node: Any) -> str:
    return to_json(node, Random(0)).decode("utf-8", "surrogatepass").strip('"')  # noqa: S311  no secret


def ask_result(folder: Path, content: bytes, rng: Random) -> str:
    """Read a result; write it and read it again; print it; make some pages."""
    result = read_result(_written(folder, RESULT, content))
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
    if rng.random() < PAGE_SHARE:
        bare = replace(result, maneuvers=())  # whose curves no file keeps
        render_validation(FittedModel(builtin_vehicle("twin-boom"), bare))
    return READ


def ask_identification(folder: Path, content: bytes, rng: Random) -> str:
    """Read the folder of an identification, whose result is damaged, as it is exported."""
    _written(folder, RESULT, content)
    _written(folder, "vehicle.toml", inputs()["model/vehicle.toml"])
    model = load(folder)
    promise(bool(np.isfinite(model_data(model).vehicle.values).all()), "a number is not finite")
    result = model.result
    with suppress(StoopError):  # of the same windows
        agreement({"a": result, "b": result})
    return READ


def kept_vehicles() -> tuple[str, ...]:
    """Return the files of the built-in vehicles."""
    return tuple(map(builtin_text, BUILT_IN))


def kept_results() -> tuple[Node, ...]:
    """Return the result of a small identification."""
    return (tree_of(json.loads(inputs()["model/result.json"])),)


DOCUMENTS: Final[Mapping[str, Document]] = {
    "vehicle": Document(VEHICLE, ask_vehicle, to_toml, _toml(kept_vehicles)),
    "mapping table": Document(grammars.MAPPING, ask_mapping, to_toml, _toml(lambda: (CSV_MAPPING.decode(),))),
    "maneuver": Document(grammars.MANEUVER, ask_maneuver, to_toml),
    "windows": Document(grammars.WINDOWS, ask_windows, to_toml),
    "geometry": Document(grammars.GEOMETRY, ask_geometry, to_toml),
    "covariance": Document(grammars.COVARIANCE, ask_covariance, write_rows),
    "result": Document(RESULT_GRAMMAR, ask_result, to_json, kept_results),
    "identification": Document(RESULT_GRAMMAR, ask_identification, to_json, kept_results),
    **KEPT_FILES,
}  #: name -> kind of document


@cache
def sound(name: str) -> tuple[Node, ...]:
    """Return the sound documents of a kind: those kept in files, and those of the grammar that are read."""
    document = DOCUMENTS[name]
    found = list(document.kept())
    for seed in range(10 * SEEDS):
        rng = Random(f"sound {name} {seed}")  # noqa: S311  no secret
        tree = document.draw(Draw(rng, 0.0))
        # what fails without a hostile choice is found as a case
        with TemporaryDirectory(prefix="stoop-") as folder, suppress(Exception):
            document.ask(Path(folder), document.write(tree, rng), rng)
            found.append(tree)
        if len(found) >= SEEDS:
            break
    return tuple(found)


def document_cases(name: str, seed: int) -> Cases:
    """Return the cases of a kind of document and a seed."""
    return lambda number: document_case(name, seed, number)


def document_case(name: str, seed: int, number: int) -> Case:
    """Return a document drawn from its grammar, or a sound one damaged as a tree or as bytes."""
    document = DOCUMENTS[name]
    rng = Random(f"{name} {seed} {number}")  # noqa: S311  no secret
    (way,) = rng.choices(tuple(WAYS), tuple(WAYS.values()))
    if way == DRAWN:
        share = rng.choice(SHARES)
        damage, content = f"{100 * share:g} % hostile", document.write(document.draw(Draw(rng, share)), rng)
    else:
        one, other = rng.choice(sound(name)), rng.choice(sound(name))
        if way == TREE:
            damage, tree = damaged_tree(rng, one, other)
            content = document.write(tree, rng)
        else:
            whole = document.write(one, rng)
            damage, content = damaged(rng, whole, document.write(other, rng), document.form)
            if content == whole:
                damage = SAME

    def run(folder: Path) -> str:
        outcome = document.ask(folder, content, rng)
        return SAME if damage == SAME else outcome

    return Case(number, way, damage, run)


@cache
def prepare(name: str) -> None:
    """Load what documents need once, so that copies of this process need not."""
    readers.prepare("")
    vehicles()
    for node in sound(name)[:2]:
        rng = Random(0)  # noqa: S311  no secret
        with TemporaryDirectory(prefix="stoop-") as folder, suppress(Exception):
            DOCUMENTS[name].ask(Path(folder), DOCUMENTS[name].write(node, rng), rng)


def try_documents(name: str, seed: int, count: int) -> Iterator[Tried]:
    """Try the first cases of a kind of document."""
    prepare(name)
    return try_all(document_cases(name, seed), range(count), BOUNDS)
