"""Verbs on small inputs, for faults of the machine: what they write undisturbed, and how to run them in a copy of this process.

Two things in a result differ by nature from run to run, and are the same here: the time it took (``seconds`` in
result.json, and on the page), and the command on the page, which may have gained ``--resume``.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future
from contextlib import ExitStack, contextmanager
from functools import cache
from importlib import resources
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any, Final, NamedTuple
from unittest import mock

from studies.robustness.trials import BrokenPromiseError, lay_out, promise

from stoop.base.toml import parse_source
from stoop.cli.main import main
from stoop.errors import StoopError
from stoop.flight import load
from stoop.parallel.pools import Given
from stoop.results.result import from_json, to_json
from stoop.vehicle import load_vehicle

MANEUVER: Final = """\
format = "stoop-maneuver/1"
duration = 12.0
rate = 50.0
airspeed = 35.0
altitude = 200.0

[[input]]
control = "elevator"
shape = "3-2-1-1"
start = 1.0
step = 0.3
amplitude = 0.2
"""
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
    """Return the files that the verbs read, by name."""
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
    """How a verb ended: its exit code, and the lines on stderr."""

    code: int
    stderr_lines: tuple[str, ...]


def run(words: tuple[str, ...], threads: int = 1) -> Ended:
    with (
        reproducible_outputs(threads),
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()) as stderr,
    ):
        code = main(words)
    return Ended(code, tuple(stderr.getvalue().splitlines()))


def done(words: tuple[str, ...]) -> None:
    assert not run(words).code, words


def written(folder: Path) -> dict[str, bytes]:
    """Return what lies in a folder, hidden and empty folders included; of a folder the content is empty."""
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


def _read_result(path: Path) -> None:
    text = path.read_text("utf-8")
    json.loads(text, parse_constant=_no_number)
    promise(to_json(from_json(text)) == text, "result.json reads as another result")


def _read_page(path: Path) -> None:
    text = path.read_text("utf-8").strip().lower()
    promise(text.startswith("<!doctype html") and text.endswith("</html>"), f"{path.name} is cut off")


READERS: Final[Mapping[str, Callable[[Path], Any]]] = {
    "result.json": _read_result,
    ".json": lambda path: json.loads(path.read_text("utf-8"), parse_constant=_no_number),
    ".html": _read_page,
    "vehicle.toml": load_vehicle,
    "v.toml": load_vehicle,
    ".toml": lambda path: parse_source(path.read_text("utf-8"), path.name, StoopError),
    ".nc": load,
    ".xml": ET.parse,
}  #: name or ending -> how it is read


def check_file(path: Path) -> None:
    """Read an output by its own reader: it is whole, and JSON is without NaN and infinities."""
    promise(not path.name.startswith(".") and path.stat().st_size, f"{path.name} was left behind or is empty")
    try:
        (READERS.get(path.name) or READERS.get(path.suffix, Path.read_bytes))(path)
    except (StoopError, ET.ParseError, ValueError) as error:
        raise BrokenPromiseError(f"{path.name} cannot be read: {error}") from error
