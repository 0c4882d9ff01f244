"""Verbs on small inputs: what they write undisturbed; times and the command, which differ by nature, are held."""

import contextlib
import csv
import io
import json
import os
import re
import sqlite3
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import ExitStack, contextmanager
from functools import cache
from importlib import resources
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any, Final, NamedTuple
from unittest import mock

from robustness.trials import BrokenPromiseError, lay_out, promise

from stoop.base.npz import read_arrays
from stoop.base.toml import parse_source
from stoop.cli.main import USER_ERROR, main
from stoop.errors import StoopError
from stoop.flight import load_flight
from stoop.optimize import load_tagged
from stoop.parallel.pools import Given
from stoop.results.result import from_json, to_json
from stoop.vehicle import load_vehicle

MANEUVER: Final = """
duration = 12.0
rate = 50.0
airspeed = 35.0
altitude = 200.0
input = [{ control = "elevator", shape = "3-2-1-1", start = 1.0, step = 0.3, amplitude = 0.2 }]
"""
ERROR: Final = "stoop: error: "
OUT: Final = "out"  #: where every verb writes
TIMED: Final = ("bounds", "gusts", "run", "sensor_delays")  #: decisions whose seconds are in result.json
STORES: Final = ".sqlite"  #: ending of stores, which hold what was done in the order in which it was done
IDENTIFY: Final = ("identify", "sim.nc", "--vehicle", "v.toml", "--maneuver", "0:8")
TO: Final = ("-o", OUT)
COMMANDS: Final[Mapping[str, tuple[str, ...]]] = {
    "identify": (*IDENTIFY, "--validate", "8:12", *TO),
    "search": (*IDENTIFY, "--optimizer", "de-rand-1-bin", "--generations", "8", *TO),
    "bootstrap": (*IDENTIFY, "--bootstrap", "100", *TO),
    "validate": ("validate", "model", "sim.nc", "--maneuver", "8:12", *TO),
    "compatibility": ("compatibility", "sim.nc", *TO),
    "structure": ("structure", "v.toml", "sim.nc", "--maneuver", "0:8", *TO),
    "maneuvers": ("maneuvers", "sim.nc", *TO),
    "state-space": ("export", "model", "--to", "state-space", *TO),
    "flight": ("simulate", "v.toml", "--maneuver", "m.toml", "-o", f"{OUT}/flight.nc"),
    "table": ("simulate", "v.toml", "--maneuver", "m.toml", "-o", f"{OUT}/flight.csv"),
    "map": ("map", "table.csv", "-o", f"{OUT}/map.toml"),
    "propagate": ("propagate", "model", "--draws", "100", "-o", f"{OUT}/propagation.html"),
    "look": ("look", "table.csv", "-o", f"{OUT}/look.html"),
    "compare": (
        "compare", "--optimizers", "ps-gde-lm,de-rand-1-bin", "--problems", "paper-N", "--seeds", "3", "--budget", "300", *TO,
    ),
    "verify": ("verify", "frequency", "--runs", "2", *TO),
}  # fmt: skip  #: name -> command on the inputs


def files_of_a_flight() -> dict[str, bytes]:
    source = resources.files("stoop").joinpath("data/twin_boom.toml").read_text(encoding="utf-8")
    source = source.replace("notes = [", 'model = { reduce = "longitudinal" }\nnotes = [')
    return {"v.toml": source.encode(), "m.toml": MANEUVER.encode()}


@cache
def inputs() -> Mapping[str, bytes]:
    with TemporaryDirectory(prefix="stoop-") as place, contextlib.chdir(place):
        folder = Path(place)
        lay_out(folder, files_of_a_flight())
        done(("simulate", "twin-boom", "--maneuver", "m.toml", "-o", "sim.nc"))
        done(("simulate", "twin-boom", "--maneuver", "m.toml", "-o", "table.csv"))
        (folder / "model").mkdir()
        done((*IDENTIFY, "-o", "model"))
        found = (path for path in sorted(folder.rglob("*")) if path.is_file())
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


class AtOnce(Executor):
    """Does a task when it is given; a pool without processes, whose death would not be that of this one."""

    def submit(self, work: Callable[..., Any], /, *given: Any, **named: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(work(*given, **named))
        return future


@contextmanager
def reproducible_outputs(threads: int = 1) -> Iterator[None]:
    """Hold what differs by nature between runs: elapsed time and command; states are saved at each step, campaigns run here."""
    with ExitStack() as held:
        clock, pool = SimpleNamespace(perf_counter=float), Given(AtOnce(), 1)
        timed = ("workflow.fit_result", "workflow.identification", *(f"strategy.{name}" for name in TIMED))
        for patch in (
            *(mock.patch(f"stoop.{name}.time", clock) for name in timed),
            mock.patch("stoop.cli.options.command_line", return_value="stoop"),
            mock.patch("stoop.workflow.checkpoint.INTERVAL", 0.0),
            mock.patch("stoop.parallel.pools.LocalProcesses.open", side_effect=pool.open),
            mock.patch.dict(os.environ, {"STOOP_THREADS": str(threads)}),
        ):
            held.enter_context(patch)
        yield


class Ended(NamedTuple):
    code: int
    stderr_lines: tuple[str, ...]


def said(words: Sequence[str]) -> tuple[int, str, str]:
    out, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        code = main(words)
    return code, out.getvalue(), errors.getvalue()


def run(words: Sequence[str], threads: int = 1) -> Ended:
    with reproducible_outputs(threads):
        code, _, errors = said(words)
    return Ended(code, tuple(errors.splitlines()))


def done(words: tuple[str, ...]) -> None:
    assert not run(words).code, words


def written(folder: Path) -> dict[str, bytes]:
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_file():
            found[name] = path.read_bytes()
        elif path.name.startswith("."):
            found[f"{name}/"] = b""
    return found


@cache
def undisturbed(words: tuple[str, ...]) -> Mapping[str, bytes]:
    with TemporaryDirectory(prefix="stoop-") as place, contextlib.chdir(place):
        lay_out(Path(place), inputs())
        Path(OUT).mkdir()
        done(words)
        return {name: x for name, x in written(Path(OUT)).items() if not name.endswith(STORES)}


def _no_number(word: str) -> float:
    raise BrokenPromiseError(f"JSON holds {word}")


def _json(path: Path) -> bool:
    json.loads(path.read_text("utf-8"), parse_constant=_no_number)
    return True


def _table(path: Path) -> bool:
    text = path.read_text("utf-8")
    return text.endswith("\n") and len({*map(len, csv.reader(io.StringIO(text)))}) == 1


def _store(path: Path) -> bool:
    with contextlib.closing(sqlite3.connect(path)) as store:
        return store.execute("PRAGMA integrity_check").fetchall() == [("ok",)]


READERS: Final[Mapping[str, Callable[[Path], Any]]] = {
    "result.json": lambda path: _json(path) and to_json(from_json(path.read_text("utf-8"))) == path.read_text("utf-8"),
    ".html": lambda path: bool(re.fullmatch(r"(?is)\s*<!doctype html.*</html>\s*", path.read_text("utf-8"))),
    ".toml": lambda path: parse_source(path.read_text("utf-8"), path.name, StoopError), ".json": _json, ".csv": _table,
    "vehicle.toml": load_vehicle, "v.toml": load_vehicle, ".nc": load_flight, ".xml": ET.parse, "search.npz": load_tagged,
    ".npz": lambda path: read_arrays(io.BytesIO(path.read_bytes()), 2**31), STORES: _store,
}  # fmt: skip  #: name or ending -> how it is read; False where it is cut or damaged


def check_file(path: Path) -> None:
    promise(not path.name.startswith(".") and path.stat().st_size, f"{path.name} was left behind or is empty")
    try:
        read = (READERS.get(path.name) or READERS.get(path.suffix, Path.read_bytes))(path)
        promise(read is not False, f"{path.name} is not whole")
    except (StoopError, ET.ParseError, ValueError) as error:
        raise BrokenPromiseError(f"{path.name} cannot be read: {error}") from error


def command(folder: Path, words: list[str]) -> None:
    """Run a command line in a folder, and look at what it promises; an error of ours is raised as one."""
    with contextlib.chdir(folder):
        code, out, errors = said(words)
    complaints = [line for line in errors.splitlines() if line.startswith(ERROR)]
    odd = next((c for c in out + errors if not (c.isprintable() or c in "\n\t")), "")
    promise(not odd, f"prints {odd!r}")
    promise("Traceback" not in errors, errors[-600:])
    if code == USER_ERROR and len(complaints) == 1:
        raise StoopError(complaints[0].removeprefix(ERROR))
    promise(not code and not complaints, f"ends with {code}, and prints {errors[-200:]!r}")
    if words[-1] == "--json":
        json.loads(out, parse_constant=_no_number)
    results = [path.read_text("utf-8") for path in folder.glob("out/result.json")]
    refused = any('"estimates-refused"' in text for text in results)  # what is said need not hold
    for path in filter(Path.is_file, folder.glob("out/**/*")):
        if not (refused and path.name == "vehicle.toml"):
            check_file(path)
