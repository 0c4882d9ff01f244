"""Logs read in a child: each case ends in an error of ours, or in a recording that keeps its promises and lists what is wrong."""

from __future__ import annotations

import hashlib
import importlib
import json
import traceback
import warnings
from contextlib import ExitStack
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

import numpy as np
from hypothesis import strategies as st
from studies.robustness.damage import damaged
from studies.robustness.sample_logs import Sample, samples
from studies.robustness.trials import (
    BAD,
    CONTAINED,
    LISTED,
    READ,
    SAME,
    UNNOTICED,
    Bounds,
    Child,
    Ended,
    promise,
)

from stoop import logs
from stoop.errors import StoopError
from stoop.flight import describe, load
from stoop.logs import compiled, guard
from stoop.logs.recording import reason

READER, FLIGHT = "reader", "flight"  #: what is asked: the reader alone; a flight and its summary
FLIGHT_SHARES = {
    "mapping": 1.0,
    "stoop-netcdf": 0.5,
}  #: of the cases of a damaged log that go the whole way; 0.1 of others
GUARDED = {
    "matlab": "scipy.io", "matlab-7.3": "h5py", "netcdf-3": "scipy.io", "netcdf-4": "h5py", "parquet": "pyarrow.parquet",
    "rosbag": "rosbags.rosbag2", "hdf5": "h5py", "netcdf": "scipy.io",
}  # fmt: skip  #: format -> others' code in C that reads it
LIBRARIES = (
    "pandas",
    "scipy.signal",
    "scipy.io",
    "h5py",
    "pyarrow.parquet",
    "rosbags.rosbag2",
    "stoop.flight.air_data",
)
MISTAKES = (
    TypeError, LookupError, AttributeError, NameError, ArithmeticError, StopIteration, RecursionError, AssertionError,
)  # fmt: skip  #: exceptions of our own code that no damage excuses
BOUNDS = Bounds()


@st.composite
def damaged_logs(draw, form: str) -> tuple[int, Sample]:
    """Draw a damaged log of a reader, and the number of the sound one."""
    sound = samples(form)
    index = draw(st.integers(0, len(sound) - 1))
    one = sound[index]
    other = draw(st.sampled_from([sample for sample in sound if sample.form == one.form]))
    name = draw(st.sampled_from(one.targets))
    content = draw(damaged(one.files[name], other.files[draw(st.sampled_from(other.targets))], one.form))
    return index, replace(one, files={**one.files, name: content})


def ways(share: float) -> st.SearchStrategy[str]:
    """Return what is asked: a flight in a share of the cases."""
    return st.integers(0, 99).map(lambda k: FLIGHT if k >= 100 * (1.0 - share) else READER)


def try_drawn(folder: Path, log: Sample, way: str, guarded: bool = False) -> str:
    """Read a log that has no sound twin."""
    return LISTED if _ask(guarded, way, *log.write(folder))[1] else READ


def try_damaged(folder: Path, form: str, index: int, log: Sample, way: str, guarded: bool = False) -> str:
    """Read a damaged log, and compare it with the sound one."""
    numbers, defects = _ask(guarded, way, *log.write(folder))
    usual = sound(form, index, way)
    if defects - usual[1]:
        return LISTED
    return SAME if numbers == usual[0] else UNNOTICED


@cache
def sound(form: str, index: int, way: str) -> tuple[str, frozenset[str]]:
    """Return what is read of a sound log; nothing where it cannot be read by this way."""
    with TemporaryDirectory(prefix="stoop-") as name:
        try:
            return _ask(False, way, *samples(form)[index].write(Path(name)))
        except StoopError:
            return "", frozenset()


def contained(form: str, child: Child, apart: Child, *given) -> Ended:
    """Try a case; a failure of others' code once more as users read it, in a process of its own."""
    ended = child(*given)
    if ended.outcome not in BAD or form not in GUARDED:
        return ended
    again = apart(*given, True)
    return again if again.outcome in BAD else Ended(CONTAINED, f"{ended.message}; {again.message}")


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

    def add(name: str, values) -> None:
        check.update(name.encode("utf-8", "surrogatepass"))
        check.update(np.ascontiguousarray(values).tobytes())

    def add_clock(name: str, time) -> None:
        grows = time.size and np.isfinite(time).all() and (np.diff(time) > 0.0).all()
        promise(grows, "the time is empty, not finite, or does not grow")
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
        promise(recording.streams, "no stream")
        for name, stream in sorted(recording.streams.items()):
            add_clock(name, stream.time)
            for key, values in sorted(stream.columns.items()):
                fits = values.dtype == np.float64 and values.shape == stream.time.shape
                promise(fits, f"{name} {key} is {values.dtype} {values.shape}")
                add(key, values)
        check.update(repr(sorted(recording.parameters.items())).encode())
        defects = frozenset(map(str, recording.defects))
    for line in defects:
        promise(line.isprintable(), f"a defect of more than one line: {line[:200]!r}")
    return check.hexdigest(), defects


class OwnFaultError(BaseException):
    """An exception that a mistake of our own code raises; no `Exception`, which readers take for damage."""


def in_this_process():
    """Let readers that end in others' code do in this very process what their child would do.

    They call whatever is raised damage, as libraries raise anything; what our own code raises by mistake is a
    `BrokenPromiseError` here.
    """
    modules = [
        importlib.import_module(f"stoop.logs.{name}")
        for name in ("guard", "matlab", "netcdf", "parquet", "rosbag")
    ]

    def here(known: str, path: Path, folder: Path, limits: guard.Limits) -> None:
        with warnings.catch_warnings(), ExitStack() as patches:
            warnings.simplefilter("ignore")  # a child's are not seen
            for module in modules:
                patches.enter_context(mock.patch.object(module, "reason", _watched_reason))
            try:
                guard.run_task(known, folder)
            except OwnFaultError as error:
                promise(False, str(error))

    return mock.patch.object(guard, "run_child", here)


def _watched_reason(error: BaseException, most: int = 120) -> str:
    """Return the message of an exception, unless it is one of `MISTAKES`, and the innermost frame is ours."""
    *_, last = traceback.extract_tb(error.__traceback__)
    if isinstance(error, MISTAKES) and Path(last.filename).is_relative_to(Path(guard.__file__).parents[1]):
        raise OwnFaultError(f"{type(error).__name__} at {Path(last.filename).name}:{last.lineno}: {error}")
    return reason(error, most)


def impatient(seconds: int):
    """Give the child of a reader so much time of the processor, and not what users' logs are given."""
    before = guard.run_child

    def soon(known: str, path: Path, folder: Path, limits: guard.Limits) -> None:
        task = json.loads((folder / guard.TASK).read_text())
        task["limits"]["seconds"] = seconds
        (folder / guard.TASK).write_text(json.dumps(task))
        before(known, path, folder, limits)

    return mock.patch.object(guard, "run_child", soon)


@cache
def prepare() -> None:
    """Load what readers need once, so that copies of this process need not.

    Texts of pandas may be Arrow's, whose allocator takes a GiB of addresses when it is first asked: not from a case's room.
    """
    for name in LIBRARIES:
        importlib.import_module(name)
    importlib.import_module("pandas").Series(["text"]).isna()
    sound("csv", 0, FLIGHT)  # loads what is imported on the way to a flight
    compiled.blackbox()
