"""Hostile logs over all readers: damaged ones, and those drawn from the grammars of their formats.

Every case ends in an error of ours, or in a recording that keeps its promises and lists what was wrong.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import traceback
import warnings
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any, Final
from unittest import mock

import numpy as np

from stoop import logs
from stoop.base.arrays import FloatArray
from stoop.errors import StoopError
from stoop.flight import describe, load
from stoop.logs import compiled, guard
from stoop.logs.recording import reason
from stoop_studies.robustness.array_grammars import ARRAY_GRAMMARS
from stoop_studies.robustness.damaged_logs import damaged
from stoop_studies.robustness.log_grammars import GRAMMARS, SHARES, Draw
from stoop_studies.robustness.sample_logs import samples
from stoop_studies.robustness.trials import (
    BAD,
    CONTAINED,
    LISTED,
    READ,
    SAME,
    UNNOTICED,
    Bounds,
    BrokenPromiseError,
    Case,
    Cases,
    Tried,
    try_all,
)

READER, FLIGHT = "reader", "flight"  #: what is asked: the reader alone; a flight and its summary
FLIGHT_SHARE: Final = 0.1  #: of the cases that go the whole way
DRAWN_FLIGHT_SHARE: Final = 0.5  #: the same of drawn logs, most of which are read
FLIGHT_SHARES: Final = {"mapping": 1.0, "stoop-netcdf": 0.5}  #: of readers that do little before
GUARDED: Final = {
    "matlab": "scipy.io", "matlab-7.3": "h5py", "netcdf-3": "scipy.io", "netcdf-4": "h5py", "parquet": "pyarrow.parquet",
    "rosbag": "rosbags.rosbag2",
}  #: what ends in others' code, and in whose  # fmt: skip
DRAWN: Final = {**GRAMMARS, **ARRAY_GRAMMARS}  #: format -> its logs drawn at random
DRAWN_GUARDED: Final = {
    "matlab": "scipy.io",
    "hdf5": "h5py",
    "netcdf": "scipy.io",
    "parquet": "pyarrow.parquet",
}
WITH_REASONS: Final = ("matlab", "netcdf", "parquet", "rosbag")  #: modules that list exceptions as damage
MISTAKES: Final = (
    TypeError, LookupError, AttributeError, NameError, ArithmeticError, StopIteration, RecursionError, AssertionError,
)  #: exceptions of our own code that no damage excuses  # fmt: skip
LIBRARIES: Final = ("pandas", "scipy.signal", "scipy.io", "stoop.flight.air_data")
BOUNDS: Final = Bounds()


@dataclass(frozen=True)
class Series:
    """Cases 0, 1, ... of a format and a seed.

    ``drawn``: logs drawn from the grammar of ``form`` (key of `DRAWN`), otherwise damaged ones (key of `SAMPLES`).
    ``guarded``: others' code runs in a process of its own, as it does for users. ``data``: folder of real logs to damage
    too, may be empty.
    """

    form: str
    seed: int
    drawn: bool = False
    guarded: bool = False
    data: str = ""

    @property
    def library(self) -> str:
        """The library in C that reads the format; empty where none does."""
        return (DRAWN_GUARDED if self.drawn else GUARDED).get(self.form, "")

    def way(self, rng: Random) -> str:
        """Draw what is asked of a case."""
        usual = DRAWN_FLIGHT_SHARE if self.drawn else FLIGHT_SHARE
        return FLIGHT if rng.random() < FLIGHT_SHARES.get(self.form, usual) else READER


def log_cases(series: Series) -> Cases:
    """Return the cases of a series."""
    return lambda number: (drawn_case if series.drawn else damaged_case)(series, number)


def drawn_case(series: Series, number: int) -> Case:
    """Return a log drawn from the grammar of its format; its damage is the share of hostile choices."""
    rng = Random(f"drawn {series.form} {series.seed} {number}")  # noqa: S311  no secret
    way, share = series.way(rng), rng.choice(SHARES)
    log = DRAWN[series.form](Draw(rng, share))

    def run(folder: Path) -> str:
        return LISTED if _ask(series.guarded, way, *log.write(folder))[1] else READ

    return Case(number, way, f"{100 * share:g} % hostile", run)


def damaged_case(series: Series, number: int) -> Case:
    """Return a damaged log."""
    rng = Random(f"{series.form} {series.seed} {number}")  # noqa: S311  no secret
    logs_of_reader = samples(series.form, series.data)
    index = rng.randrange(len(logs_of_reader))
    sound = logs_of_reader[index]
    way = series.way(rng)
    name = rng.choice(sound.targets)
    partner = rng.choice([s for s in logs_of_reader if s.form == sound.form])
    other = partner.files[rng.choice(partner.targets)]
    damage, content = damaged(rng, sound.files[name], other, sound.form)
    broken = replace(sound, files={**sound.files, name: content})

    def run(folder: Path) -> str:
        numbers, defects = _ask(series.guarded, way, *broken.write(folder))
        usual = _sound(series.form, series.data, index, way)
        if defects - usual[1]:
            return LISTED
        return SAME if numbers == usual[0] else UNNOTICED

    return Case(number, way, damage, run)


@cache
def _sound(form: str, data: str, index: int, way: str) -> tuple[str, frozenset[str]]:
    """Return what is read of the sound log; nothing where it cannot be read by this way."""
    with TemporaryDirectory(prefix="stoop-") as name:
        try:
            return _ask(False, way, *samples(form, data)[index].write(Path(name)))
        except StoopError:
            return "", frozenset()


def _ask(guarded: bool, way: str, path: Path, mapping: Path | None) -> tuple[str, frozenset[str]]:
    """Do `ask`; others' code runs in this process, or as it does for users in a child, with little time."""
    with impatient(BOUNDS.seconds) if guarded else in_this_process():
        return ask(path, mapping, way)


def ask(path: Path, mapping: Path | None, way: str) -> tuple[str, frozenset[str]]:
    """Read a log as a recording or to a flight; return a hash of its numbers, and its defects.

    A stream without a growing clock, a column of another type or length, or a defect of several lines is a
    `BrokenPromiseError`.
    """
    check = hashlib.blake2b(digest_size=8)

    def add(name: str, values: FloatArray) -> None:
        check.update(name.encode("utf-8", "surrogatepass"))
        check.update(np.ascontiguousarray(values).tobytes())

    def add_clock(name: str, time: FloatArray) -> None:
        if not time.size or not np.isfinite(time).all() or not (np.diff(time) > 0.0).all():
            raise BrokenPromiseError("the time is empty, not finite, or does not grow")
        add(name, time)

    if way == FLIGHT:
        flight = load(path, mapping)
        describe(flight)
        add_clock("time", flight.time)
        for name in sorted(flight.channels):
            add(name, flight.data[name].to_numpy())
        defects = frozenset(map(str, flight.notices))
    else:
        recording = logs.read(path, mapping)
        if not recording.streams:
            raise BrokenPromiseError("no stream")
        for name, stream in sorted(recording.streams.items()):
            add_clock(name, stream.time)
            for key, values in sorted(stream.columns.items()):
                if values.dtype != np.float64 or values.shape != stream.time.shape:
                    raise BrokenPromiseError(f"{name} {key} is {values.dtype} {values.shape}")
                add(key, values)
        check.update(repr(sorted(recording.parameters.items())).encode())
        defects = frozenset(map(str, recording.defects))
    for line in defects:
        if not line.isprintable():
            raise BrokenPromiseError(f"a defect of more than one line: {line[:200]!r}")
    return check.hexdigest(), defects


class OwnFaultError(BaseException):
    """An exception that a mistake of our own code raises; no `Exception`, which readers take for damage."""


def in_this_process() -> AbstractContextManager[Any]:
    """Let readers that end in others' code do in this very process what their child would do.

    They call whatever is raised damage, as libraries raise anything; what our own code raises by mistake is a
    `BrokenPromiseError` here.
    """
    modules = [importlib.import_module(f"stoop.logs.{name}") for name in ("guard", *WITH_REASONS)]

    def here(known: str, path: Path, folder: Path, limits: guard.Limits) -> None:
        with warnings.catch_warnings(), ExitStack() as patches:
            warnings.simplefilter("ignore")  # a child's are not seen
            for module in modules:
                patches.enter_context(mock.patch.object(module, "reason", _watched_reason))
            try:
                guard.run_task(known, folder)
            except OwnFaultError as error:
                raise BrokenPromiseError(str(error)) from None

    return mock.patch.object(guard, "run_child", here)


def _watched_reason(error: BaseException, most: int = 120) -> str:
    """Return the message of an exception, unless it is one of `MISTAKES`, and the innermost frame is ours."""
    *_, last = traceback.extract_tb(error.__traceback__)
    if isinstance(error, MISTAKES) and Path(last.filename).is_relative_to(Path(guard.__file__).parents[1]):
        raise OwnFaultError(f"{type(error).__name__} at {Path(last.filename).name}:{last.lineno}: {error}")
    return reason(error, most)


def impatient(seconds: int) -> AbstractContextManager[Any]:
    """Give the child of a reader so much time of the processor, and not what users' logs are given."""
    before = guard.run_child

    def soon(known: str, path: Path, folder: Path, limits: guard.Limits) -> None:
        task = json.loads((folder / guard.TASK).read_text())
        task["limits"]["seconds"] = seconds
        (folder / guard.TASK).write_text(json.dumps(task))
        before(known, path, folder, limits)

    return mock.patch.object(guard, "run_child", soon)


@cache
def prepare(library: str) -> None:
    """Load what a reader needs once, so that copies of this process need not.

    Texts of pandas may be Arrow's, whose allocator takes a GiB of addresses when it is first asked: not from a case's room.
    """
    for name in (*LIBRARIES, library or "pandas"):
        importlib.import_module(name)
    importlib.import_module("pandas").Series(["text"]).isna()
    _sound("csv", "", 0, FLIGHT)  # loads what is imported on the way to a flight


def try_logs(series: Series, count: int) -> Iterator[Tried]:
    """Try the first cases of a series; a failure of others' code once more as users read it, in a process of its own."""
    prepare(series.library)
    if series.form == "blackbox":
        compiled.blackbox()  # once, and in no case's time
    if not series.drawn:
        samples(series.form, series.data)
    bounds = replace(BOUNDS, memory=2**40) if series.guarded else BOUNDS  # not of this process
    for tried in try_all(log_cases(series), range(count), bounds):
        if series.library and not series.guarded and tried.outcome in BAD:
            guarded, number = replace(series, guarded=True), tried.number
            (again,) = try_all(log_cases(guarded), range(number, number + 1), bounds)
            message = f"{tried.outcome}: {tried.message}; {again.message}"
            yield again if again.outcome in BAD else replace(tried, outcome=CONTAINED, message=message)
        else:
            yield tried
