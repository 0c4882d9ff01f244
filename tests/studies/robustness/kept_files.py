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
import struct
import warnings
import zipfile
import zlib
from contextlib import closing, suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.io import netcdf_file
from studies.robustness.hostile import Raw, to_json
from studies.robustness.sample_logs import samples
from studies.robustness.trials import promise

from stoop.base import cache as kernel_cache
from stoop.flight import describe, load, save
from stoop.optimize import create, load_tagged, minimize, save_state
from stoop.optimize.minimize import Stop
from stoop.parallel.plan import Plan, Run, to_text
from stoop.parallel.store import _TABLES, SCHEMA, _seal, forget, open_store

# states of searches

BLOCK, BOMB = 2**20, 1200  #: bytes of zeros that a packed member repeats, and how often: more than a gigabyte


class Bowl:
    """A cheap problem: a bowl with a nuisance and two rungs."""

    dimension, extra, prices = 3, 1, (0.25, 1.0)

    def residuals(self, Z, rung):
        return np.column_stack([Z - 0.3, np.sin(3.0 * Z[:, 0])])

    def costs(self, X, rung):
        return np.sum(self.residuals(np.column_stack([X, np.zeros(len(X))]), rung) ** 2, axis=1)

    def jacobian(self, z, rung, r):
        return np.vstack([np.eye(4), [3.0 * np.cos(3.0 * z[0]), 0.0, 0.0, 0.0]]), 1.0

    def reference(self, rung):
        return 1.0


@cache
def kept_states() -> list:
    """Return states of the searches at several steps."""
    found = []
    with TemporaryDirectory(prefix="stoop-") as folder:
        for name, steps in (("ps-gde-lm", 0), ("ps-gde-lm", 3), ("ps-gde-lm", 9), ("scipy-least-squares", 1)):
            state = minimize(create(name), Bowl(), seed=1, stop=Stop(generations=steps)).state
            if state is None:
                continue
            save_state(Path(folder) / "s.npz", state, "tag")
            with np.load(Path(folder) / "s.npz") as file:
                arrays = {n: array_tree(file[n]) for n in file.files if n != "header"}
                header = json.loads(file["header"].tobytes())
            while is_odd(len(to_json(header))):
                header["tag"] += "g"
            found.append({"header": header, "arrays": arrays})
    return found


def array_tree(values: np.ndarray) -> dict:
    """Return what a file says of an array."""
    data = values.tobytes().hex()
    return {"descr": values.dtype.str, "fortran_order": False, "shape": list(values.shape), "data": data}


def npy(tree) -> bytes:
    """Return an array as a file holds it, whatever its head says."""

    def literal(node) -> str:
        return node.text if isinstance(node, Raw) else repr(node)[:20_000]

    parts = tree if isinstance(tree, dict) else {"data": tree}
    shape, data = parts.get("shape", 0), parts.get("data")
    extents = f"({' '.join(f'{literal(n)},' for n in shape)})" if isinstance(shape, list) else literal(shape)
    descr, order = literal(parts.get("descr")), literal(parts.get("fortran_order"))
    head = f"{{'descr': {descr}, 'fortran_order': {order}, 'shape': {extents}, }}"
    text = head.encode("utf-8", "replace")[:60_000] + b"\n"
    try:
        content = bytes.fromhex(data)
    except (ValueError, TypeError):
        content = repr(data).encode("utf-8", "replace")[:10_000]
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + content


def bomb(name: str, stated: int = BLOCK * BOMB) -> bytes:
    """Return a zip with one member of zeros that unfolds to a gigabyte, and states a size."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    packer.compress(bytes(BLOCK))
    packer.flush(zlib.Z_FULL_FLUSH)
    packed = (packer.compress(bytes(BLOCK)) + packer.flush(zlib.Z_FULL_FLUSH)) * BOMB + packer.flush()
    head = struct.pack("<HHHHHIII", 20, 0, 8, 0, 33, 0, len(packed), stated)
    local = b"PK\x03\x04" + head + struct.pack("<HH", len(name), 0) + name.encode()
    central = (
        b"PK\x01\x02\x14\x00" + head + struct.pack("<HHHHHII", len(name), 0, 0, 0, 0, 0, 0) + name.encode()
    )
    tail = b"PK\x05\x06" + struct.pack("<HHHHIIH", 0, 0, 1, 1, len(central), len(local) + len(packed), 0)
    return local + packed + central + tail


def is_odd(size: int) -> bool:
    """Return whether an archive with a header of this size is packed as NumPy does not, or states another size."""
    return (size % 16) // 7 == 2 or size % 50 == 7


def write_state(tree) -> bytes:
    """Write an archive of arrays; by the size of its header, packed, or with a member that states half of its size."""
    parts = tree if isinstance(tree, dict) else {}
    header = to_json(parts.get("header"))
    members = parts.get("arrays") if isinstance(parts.get("arrays"), dict) else {}
    packing = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2)[(len(header) % 16) // 7]
    sink = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(sink, "w") as archive:
        warnings.simplefilter("ignore")  # two members may have one name
        for name, one in {**members, "header": array_tree(np.frombuffer(header, dtype=np.uint8))}.items():
            info = zipfile.ZipInfo(f"{name[:200]}.npy".encode("ascii", "replace").decode().replace("\0", "?"))
            archive.writestr(info, npy(one), packing)
        if len(header) % 50 == 7:  # in the directory, which is written at the end
            archive.infolist()[0].file_size //= 2
    return sink.getvalue()


def ask_state(path: Path, number: int) -> None:
    """Read a state; write it and read it again; go on from it for a few steps."""
    if number == 0:
        path.write_bytes(bomb("header.npy", BLOCK))
    state, tag = load_tagged(path)
    save_state(path, state, tag)
    again, tag_again = load_tagged(path)
    promise((repr(again), tag_again) == (repr(state), tag), "written and read differ")
    with np.errstate(all="ignore"):
        stop = Stop(generations=state.generation + 2, budget=300.0)
        minimize(create(state.optimizer), Bowl(), seed=1, state=state, stop=stop)


# stores of campaigns

ENVIRONMENT = {"numpy": "2.0", "stoop": "1.0"}
PLAN = Plan("table", {"n": 1}, tuple(Run(f"run {i}", "math:sin", {"x": i}) for i in range(3)))
STATEMENTS = (
    "DROP TABLE runs", "DROP TABLE meta", "ALTER TABLE runs ADD COLUMN more TEXT", "CREATE TABLE other (a)",
    "CREATE INDEX i ON runs (result)", "CREATE TRIGGER t AFTER INSERT ON meta BEGIN DELETE FROM runs; END",
    "DROP TABLE runs; CREATE VIEW runs AS WITH RECURSIVE c(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM c) "
    "SELECT n AS key, n AS identity, n AS result, n AS checksum FROM c",
    "DROP TABLE meta; CREATE VIEW meta AS SELECT 'schema' AS name, zeroblob(900000000) AS value, '' AS checksum",
    "DROP TABLE runs; CREATE TABLE runs (key, identity, result, checksum)", "PRAGMA application_id = 7",
    "PRAGMA user_version = 7", "PRAGMA encoding = 'UTF-16'", "UPDATE runs SET result = CAST(result AS BLOB)",
    "UPDATE meta SET value = NULL", "UPDATE runs SET key = 3.5", "UPDATE runs SET result = CAST(x'ff80' AS TEXT)",
)  # fmt: skip

INSERTS = {
    "meta": "INSERT OR REPLACE INTO meta VALUES (?, ?, ?)",
    "runs": "INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?)",
}


@cache
def kept_stores() -> list:
    """Return the content of a store that is half done, and of one that was just begun."""
    texts = {"schema": SCHEMA, "plan": PLAN.name, "settings": to_text(dict(PLAN.settings), "s")}
    meta = [[name, value] for name, value in {**texts, "environment": to_text(ENVIRONMENT, "e")}.items()]
    runs = [[run.key, run.identity, '{"y":1.5}'] for run in PLAN.runs[:2]]
    return [{"meta": meta, "runs": some} for some in (runs, [])]


def write_store(tree) -> bytes:
    """Write a store; checksums are those of the rows."""

    def cell(node):
        if isinstance(node, bool | int) and abs(node) < 2**63:
            return int(node)
        return node if isinstance(node, float | str | None) else json.dumps(str(node)[:1000])

    parts = tree if isinstance(tree, dict) else {}
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as connection:
        for statement in _TABLES:
            connection.execute(statement)
        for table, width in (("meta", 2), ("runs", 3)):
            for row in parts.get(table) if isinstance(parts.get(table), list) else ():
                cells = ([cell(one) for one in row] if isinstance(row, list) else [cell(row)]) + [
                    None
                ] * width
                with suppress(sqlite3.Error, UnicodeEncodeError, OverflowError):
                    connection.execute(INSERTS[table], (*cells[:width], _seal(*cells[:width])))
        return connection.serialize()


def ask_store(path: Path, number: int) -> None:
    """Open a store, add a run, read all; or remove it. In some, something that no store holds was done to it before."""
    if number < 10:
        forget(path)
        return
    if number >= 75:
        with closing(sqlite3.connect(path)) as connection, suppress(sqlite3.Error):
            connection.executescript(STATEMENTS[number % len(STATEMENTS)])
    with open_store(path, PLAN, ENVIRONMENT) as store:
        missing = store.missing(PLAN.runs)
        store.add(missing, ['{"y":2.5}'] * len(missing))
        results = store.results(PLAN.runs)
    promise(set(results) == {run.key for run in PLAN.runs}, "a run is not there")
    with open_store(path, PLAN, ENVIRONMENT) as store:
        promise(store.results(PLAN.runs) == results, "written and read differ")


# compiled kernels

FILES = {"equations.py": b"x = 1\n", "sizes.txt": b"1 2 3 4 5 6", "__pycache__/a.nbi": b"\x80\x04pickle"}


def kept_manifests() -> list:
    """Return the manifest of a folder of compiled kernels."""
    return [{name: hashlib.sha256(content).hexdigest() for name, content in sorted(FILES.items())}]


def ask_cache(path: Path, number: int) -> None:
    """Damage a folder of compiled kernels, or its manifest: only what was sealed counts as intact."""
    place = path.with_name("kernels")
    (place / "__pycache__").mkdir(parents=True, mode=0o700)
    place.chmod(0o700)
    for name, data in FILES.items():
        (place / name).write_bytes(data)
    manifest = path.rename(place / kernel_cache.MANIFEST)
    try:
        known = json.loads(manifest.read_bytes()) == kept_manifests()[0]
    except (ValueError, RecursionError):
        known = False
    victim, way = place / tuple(FILES)[number % 3], number // 3 % 9
    damages = (
        lambda: None,
        lambda: victim.write_bytes(victim.read_bytes() + b"x"),
        lambda: victim.unlink(),
        lambda: (place / "more.py").write_bytes(b""),
        lambda: (place / "link").symlink_to("/etc/passwd"),
        lambda: (victim.chmod(0o666), place.chmod(0o755)),
        lambda: os.truncate(victim, 2**27),  # sparse
        lambda: os.truncate(manifest, 2**27),
        lambda: (victim.unlink(), os.mkfifo(victim)),
    )
    damages[way]()
    if known or way == 0:
        promise(kernel_cache.intact(place) == (known and way == 0), f"taken for what it is not: damage {way}")
    else:
        kernel_cache.intact(place)


# flights of our own


@cache
def _flight() -> tuple[dict, dict]:
    """Return the attributes, and the arrays with their units, of a flight that was saved."""
    sample = samples("stoop-netcdf")[0]
    with netcdf_file(io.BytesIO(sample.files[sample.targets[0]]), mmap=False) as file:
        columns = {
            name: (x.dimensions, x[:].copy(), dict(x._attributes)) for name, x in file.variables.items()
        }
        return dict(file._attributes), columns


def kept_flights() -> list:
    """Return the attributes of a flight, those that are JSON as trees."""
    tree = {}
    for key, value in _flight()[0].items():
        tree[key] = value.decode() if isinstance(value, bytes) else float(value)
        with suppress(ValueError, TypeError):
            tree[key] = json.loads(tree[key])
    return [tree]


def write_flight(tree) -> bytes:
    """Write a flight with these attributes."""
    sink = io.BytesIO()
    file = netcdf_file(sink, "w", version=2)
    for name, (dimensions, values, units) in _flight()[1].items():
        for dimension, size in zip(dimensions, values.shape, strict=True):
            if dimension not in file.dimensions:
                file.createDimension(dimension, size)
        column = file.createVariable(name, values.dtype, dimensions)
        column[:] = values
        for key, unit in units.items():
            setattr(column, key, unit)
    own = ("dimensions", "variables", "fp", "filename", "version_byte", "flush", "close", "sync")
    for key, value in tree.items() if isinstance(tree, dict) else ():
        name = str(key).encode("ascii", "replace").decode().replace("\0", "")[:200] or "x"
        if name not in own:
            number = isinstance(value, bool | int | float)
            text = value.encode("utf-8", "replace") if isinstance(value, str) else to_json(value)
            setattr(file, name, np.float64(float(max(min(value, 1e308), -1e308))) if number else text)
    file.flush()
    return sink.getvalue()


def ask_flight(path: Path, number: int) -> None:
    """Read a flight and describe it; write it and read it again."""
    flight = load(path)
    describe(flight)
    promise(
        all(str(one).isprintable() for one in (*flight.notices, *flight.faults)), "a notice steers a terminal"
    )
    if number % 3 == 0:
        save(flight, path.with_name("again.nc"))
        again = load(path.with_name("again.nc"))
        same = [again.notices, again.sources, again.rate] == [flight.notices, flight.sources, flight.rate]
        promise(same, "written and read differ")
