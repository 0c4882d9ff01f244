"""Logs read as users read them: an error of ours, or a recording that keeps its promises and lists what is wrong."""

import importlib
import traceback
import warnings
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from unittest import mock

import numpy as np
from robustness.corpus import Case, sound
from robustness.trials import LISTED, READ, promise

from stoop import logs
from stoop.flight import describe, load_flight
from stoop.logs import compiled, guard
from stoop.logs.recording import reason

READER, FLIGHT = "reader", "flight"  #: what is asked: the reader alone; a flight and its summary
OURS = (
    "ulog", "px4-csv", "dataflash", "dataflash-text", "crazyflie", "blackbox", "csv", "mapping", "stoop-netcdf",
)  # fmt: skip  #: formats that code of our own reads
GUARDED = ("matlab", "matlab-7.3", "netcdf-3", "netcdf-4", "parquet", "rosbag", "netcdf", "hdf5")
"""Formats that code of others reads."""
LIBRARIES = ("pandas", "scipy.io", "h5py", "pyarrow.parquet", "rosbags.rosbag2", "stoop.flight.air_data")
MISTAKES = (
    TypeError, LookupError, AttributeError, NameError, ArithmeticError, StopIteration, RecursionError, AssertionError,
)  # fmt: skip  #: exceptions of our own code that no damage excuses


def read_case(folder: Path, case: Case) -> str:
    with in_this_process():
        return LISTED if ask(*case.write(folder), case.way) else READ


def ask_apart(folder: Path, case: Case) -> str:
    ask(*case.write(folder), case.way)
    return READ


def ask(path: Path, mapping: Path | None, way: str) -> frozenset[str]:
    """Read a log as a recording or to a flight, see to what it promises, and return its defects."""
    if way == FLIGHT:
        flight = load_flight(path, mapping)
        describe(flight)
        check_clock(flight.time)
        defects = frozenset(map(str, flight.notices))
    else:
        recording = logs.read(path, mapping)
        promise(recording.streams, "no stream")
        for name, stream in recording.streams.items():
            check_clock(stream.time)
            for key, values in stream.columns.items():
                fits = values.dtype == np.float64 and values.shape == stream.time.shape
                promise(fits, f"{name} {key} is {values.dtype} {values.shape}")
        defects = frozenset(map(str, recording.defects))
    for line in defects:
        promise(line.isprintable(), f"a defect of more than one line: {line[:200]!r}")
    return defects


def check_clock(time: np.ndarray) -> None:
    grows = time.size and np.isfinite(time).all() and (np.diff(time) > 0.0).all()
    promise(grows, "the time is empty, not finite, or does not grow")


class OwnFaultError(BaseException):
    """An exception that a mistake of our own code raises; no `Exception`, which readers take for damage."""


def in_this_process():
    """Let readers do here what their child would do; what our own code raises by mistake is a `BrokenPromiseError`."""
    names = ("guard", "matlab", "netcdf", "parquet", "rosbag")
    modules = [importlib.import_module(f"stoop.logs.{n}") for n in names]

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


@cache
def prepare() -> None:
    """Load what readers need once, not from a case's room; texts of pandas may be Arrow's, whose allocator takes a GiB."""
    for name in LIBRARIES:
        importlib.import_module(name)
    importlib.import_module("pandas").Series(["text"]).isna()
    compiled.blackbox()
    assert sound("csv")
