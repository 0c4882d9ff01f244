"""Files that stoop keeps for itself, made hostile: states of searches, stores of campaigns, compiled kernels, flights.

They are no texts: a tree says what they hold (arrays with their types and shapes, rows of tables, attributes), and a writer
makes the file of it, whatever it says.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import sqlite3
from contextlib import closing, suppress
from functools import cache
from pathlib import Path
from random import Random
from typing import Any, Final

import numpy as np
from scipy.io import netcdf_file

from stoop.base import cache as kernel_cache
from stoop.flight import describe, load, save
from stoop.parallel.plan import Plan, Run, to_text
from stoop.parallel.store import _TABLES, SCHEMA, _seal, forget, open_store
from stoop_studies.robustness.document_trees import (
    Branch,
    Document,
    Node,
    to_json,
    tree_of,
)
from stoop_studies.robustness.log_grammars import Draw
from stoop_studies.robustness.sample_logs import samples
from stoop_studies.robustness.search_states import (
    ask_state,
    draw_state,
    kept_states,
    with_hostile_leaves,
    write_state,
)
from stoop_studies.robustness.trials import READ, BrokenPromiseError

ENVIRONMENT: Final = {"numpy": "2.0", "stoop": "1.0"}
STATEMENTS: Final = (
    "DROP TABLE runs",
    "DROP TABLE meta",
    "ALTER TABLE runs ADD COLUMN more TEXT",
    "CREATE TABLE other (a)",
    "CREATE INDEX i ON runs (result)",
    "CREATE TRIGGER t AFTER INSERT ON meta BEGIN DELETE FROM runs; END",
    "DROP TABLE runs; CREATE VIEW runs AS WITH RECURSIVE c(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM c) "
    "SELECT n AS key, n AS identity, n AS result, n AS checksum FROM c",
    "DROP TABLE meta; CREATE VIEW meta AS SELECT 'schema' AS name, zeroblob(900000000) AS value, '' AS checksum",
    "DROP TABLE runs; CREATE TABLE runs (key, identity, result, checksum)",
    "PRAGMA application_id = 7",
    "PRAGMA user_version = 7",
    "PRAGMA encoding = 'UTF-16'",
    "UPDATE runs SET result = CAST(result AS BLOB)",
    "UPDATE meta SET value = NULL",
    "UPDATE runs SET key = 3.5",
    "UPDATE runs SET result = CAST(x'ff80' AS TEXT)",
    "INSERT INTO runs SELECT key || 'x', identity, zeroblob(300000000), checksum FROM runs",
)
INSERTS: Final = {
    "meta": "INSERT OR REPLACE INTO meta VALUES (?, ?, ?)",
    "runs": "INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?)",
}


# stores of campaigns

PLAN: Final = Plan("table", {"n": 1}, tuple(Run(f"run {i}", "math:sin", {"x": i}) for i in range(3)))


@cache
def kept_stores() -> tuple[Node, ...]:
    """Return the content of a store that is half done, and of one that was just begun."""
    meta = {
        "schema": SCHEMA,
        "plan": PLAN.name,
        "settings": to_text(dict(PLAN.settings), "s"),
        "environment": to_text(dict(ENVIRONMENT), "e"),
    }
    rows: list[Node] = [[name, value, ""] for name, value in meta.items()]
    runs: list[Node] = [[run.key, run.identity, '{"y":1.5}', ""] for run in PLAN.runs[:2]]
    return tuple(Branch([("meta", list(rows)), ("runs", some), ("sql", [])]) for some in (runs, []))


def draw_store(draw: Draw) -> Node:
    """Draw a store with hostile cells whose checksums fit, and hostile statements."""
    store = with_hostile_leaves(draw, draw.rng.choice(kept_stores()))
    parts: dict[str, Any] = dict(store.pairs) if isinstance(store, Branch) else {}
    return Branch(
        [
            *((k, v) for k, v in parts.items() if k != "sql"),
            ("sql", [draw.rng.choice(STATEMENTS)] if draw.bad() else []),
        ]
    )


def _cell(node: Any) -> Any:
    if isinstance(node, bool | int) and abs(node) < 2**63:
        return int(node)
    return node if isinstance(node, float | str | None) else json.dumps(str(node)[:1000])


def write_store(node: Node, rng: Random) -> bytes:
    """Write a store; checksums are those of the rows, unless a row has its own."""
    parts: dict[str, Any] = dict(node.pairs) if isinstance(node, Branch) else {}
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as connection:
        for statement in _TABLES:
            connection.execute(statement)
        for table, width in (("meta", 2), ("runs", 3)):
            rows = parts.get(table)
            for row in rows if isinstance(rows, list) else []:
                cells = [_cell(one) for one in row] if isinstance(row, list) else [_cell(row)]
                cells = (cells + [None] * width)[:width]
                with suppress(sqlite3.Error, UnicodeEncodeError, OverflowError):
                    connection.execute(INSERTS[table], (*cells, _seal(*cells)))
        statements = parts.get("sql")
        for statement in statements if isinstance(statements, list) else ():
            with suppress(sqlite3.Error, TypeError, ValueError):
                connection.executescript(statement)
        return connection.serialize()


def ask_store(folder: Path, content: bytes, rng: Random) -> str:
    """Open a store, add a run, read all; or remove it."""
    path = folder / "runs.sqlite"
    path.write_bytes(content)
    if rng.random() < 0.1:
        forget(path)
        return READ
    with open_store(path, PLAN, ENVIRONMENT) as store:
        missing = store.missing(PLAN.runs)
        store.add(missing, ['{"y":2.5}'] * len(missing))
        results = store.results(PLAN.runs)
    if set(results) != {run.key for run in PLAN.runs}:
        raise BrokenPromiseError("a run is not there")
    with open_store(path, PLAN, ENVIRONMENT) as store:
        if store.results(PLAN.runs) != results:
            raise BrokenPromiseError("written and read differ")
    return READ


# compiled kernels

FILES: Final = {
    "equations.py": b"x = 1\n",
    "sizes.txt": b"1 2 3 4 5 6",
    "__pycache__/a.nbi": b"\x80\x04pickle",
}


def kept_manifests() -> tuple[Node, ...]:
    """Return the manifest of a folder of compiled kernels."""
    return (tree_of({name: hashlib.sha256(content).hexdigest() for name, content in sorted(FILES.items())}),)


def ask_cache(folder: Path, content: bytes, rng: Random) -> str:
    """Damage a folder of compiled kernels, or its manifest: only what was sealed counts as intact."""
    place = folder / "kernels"
    (place / "__pycache__").mkdir(parents=True, mode=0o700)
    place.chmod(0o700)
    for name, data in FILES.items():
        (place / name).write_bytes(data)
    (place / kernel_cache.MANIFEST).write_bytes(content)
    (manifest,) = kept_manifests()
    try:
        known = json.loads(content) == json.loads(to_json(manifest, rng))
    except (ValueError, RecursionError):
        known = False
    victim, way = place / rng.choice(tuple(FILES)), rng.randrange(9)
    if way == 1:
        victim.write_bytes(victim.read_bytes() + b"x")
    elif way == 2:
        victim.unlink()
    elif way == 3:
        (place / "more.py").write_bytes(b"")
    elif way == 4:
        (place / "link").symlink_to("/etc/passwd")
    elif way == 5:
        victim.chmod(0o666)
        place.chmod(0o755)
    elif way == 6:
        os.truncate(victim, 2**27)  # sparse
    elif way == 7:
        os.truncate(place / kernel_cache.MANIFEST, 2**27)
    elif way == 8:
        victim.unlink()
        os.mkfifo(victim)
    intact = kernel_cache.intact(place)
    if (known or way == 0) and intact != (known and way == 0):
        raise BrokenPromiseError(f"taken for what it is not: damage {way}")
    return READ


# flights of our own


@cache
def _flight() -> dict[str, Any]:
    """Return the attributes, and the arrays with their units, of a flight that was saved."""
    (sample, *_) = samples("stoop-netcdf")
    opened: Any = netcdf_file(
        io.BytesIO(sample.files[sample.targets[0]]), mmap=False
    )  # whose types lack the attributes
    with opened as file:
        attributes = dict(file._attributes)
        columns: dict[str, Any] = {
            name: (one.dimensions, one[:].copy(), dict(one._attributes))
            for name, one in file.variables.items()
        }
    return {"attributes": attributes, "columns": columns}


@cache
def kept_flights() -> tuple[Node, ...]:
    """Return the attributes of a flight, those that are JSON as trees."""
    pairs: list[tuple[str, Node]] = []
    for key, value in _flight()["attributes"].items():
        text = value.decode() if isinstance(value, bytes) else value
        with suppress(ValueError, TypeError):
            text = tree_of(json.loads(text))
        pairs.append((key, float(text) if isinstance(text, np.generic | np.ndarray) else text))
    return (Branch(pairs),)


def write_flight(node: Node, rng: Random) -> bytes:
    """Write a flight with these attributes."""
    sink = io.BytesIO()
    file = netcdf_file(sink, "w", version=2)
    for name, (dimensions, values, units) in _flight()["columns"].items():
        for dimension, size in zip(dimensions, values.shape, strict=True):
            if dimension not in file.dimensions:
                file.createDimension(dimension, size)
        column = file.createVariable(name, values.dtype, dimensions)
        column[:] = values
        for key, unit in units.items():
            setattr(column, key, unit)
    for key, value in node.pairs if isinstance(node, Branch) else ():
        name = key.encode("ascii", "replace").decode().replace("\0", "")[:200] or "x"
        if name in ("dimensions", "variables", "fp", "filename", "version_byte", "flush", "close", "sync"):
            continue
        if isinstance(value, bool | int | float):
            setattr(file, name, np.float64(min(max(float(np.clip(value, -1e308, 1e308)), -1e308), 1e308)))
        else:
            setattr(
                file,
                name,
                value.encode("utf-8", "replace") if isinstance(value, str) else to_json(value, rng),
            )
    file.flush()
    return sink.getvalue()


def ask_flight(folder: Path, content: bytes, rng: Random) -> str:
    """Read a flight and describe it; write it and read it again."""
    path = folder / "flight.nc"
    path.write_bytes(content)
    flight = load(path)
    describe(flight)
    if not all(str(one).isprintable() for one in (*flight.notices, *flight.faults)):
        raise BrokenPromiseError("a notice steers a terminal")
    if rng.random() < 0.3:
        save(flight, folder / "again.nc")
        again = load(folder / "again.nc")
        if [again.notices, again.sources, again.rate] != [flight.notices, flight.sources, flight.rate]:
            raise BrokenPromiseError("written and read differ")
    return READ


KEPT_FILES: Final = {
    "state": Document(draw_state, ask_state, write_state, kept_states, "words"),
    "store": Document(draw_store, ask_store, write_store, kept_stores, "pages"),
    "kernel cache": Document(
        lambda draw: with_hostile_leaves(draw, kept_manifests()[0]),
        ask_cache,
        to_json,
        kept_manifests,
        "lines",
    ),
    "flight": Document(
        lambda draw: with_hostile_leaves(draw, kept_flights()[0]),
        ask_flight,
        write_flight,
        kept_flights,
        "words",
    ),
}  #: name -> kind of file
