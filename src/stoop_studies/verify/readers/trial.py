"""One case: a sound log, damaged; read through the entry point that users take; and what came of it."""

from __future__ import annotations

import gc
import hashlib
import json
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from stoop import logs
from stoop.errors import StoopError
from stoop.flight import describe, load
from stoop.logs import guard
from stoop_studies.verify.readers.damage import Sample, damaged
from stoop_studies.verify.readers.samples import samples

if TYPE_CHECKING:
    from stoop.flight import Flight
    from stoop.logs import Recording

READ, FLIGHT, GUARD = "read", "flight", "guard"  #: reader alone; to a flight; reader in its own process
FLIGHT_SHARE: Final = 0.1  #: of the cases that go the whole way
FLIGHT_SHARES: Final = {"mapping": 1.0, "stoop-netcdf": 0.5}  #: of readers that do little before
CONTAINED: Final = "contained"  #: others' code died or ran too long, in a process of its own
GOOD: Final = ("refused", "listed", "unnoticed", "same", "limit", CONTAINED)
BAD: Final = ("fault", "crash", "hang", "memory")
GUARDED: Final = {
    "matlab": "scipy.io", "matlab-7.3": "h5py", "netcdf-3": "scipy.io", "netcdf-4": "h5py", "parquet": "pyarrow.parquet",
    "rosbag": "rosbags.rosbag2",
}  #: what ends in others' code, and in whose  # fmt: skip


@dataclass(frozen=True)
class Series:
    """Cases 0, 1, ... of a reader and a seed.

    Attributes
    ----------
    reader : str
        Key of `stoop_studies.verify.readers.samples.SAMPLES`.
    seed : int
    guarded : bool
        Whether others' code runs in a process of its own, as it does for users.
    data : str
        Folder of real logs to damage, too; may be empty.
    """

    reader: str
    seed: int
    guarded: bool = False
    data: str = ""

    @property
    def samples(self) -> tuple[Sample, ...]:
        """Its sound logs."""
        return samples(self.reader, self.data)


@dataclass(frozen=True)
class Case:
    """What is tried: a damaged log, beside which sound one of its series; by what way; what damage came first."""

    series: Series
    index: int
    broken: Sample
    way: str
    damage: str


@dataclass(frozen=True)
class Verdict:
    """What came of a case, by the words of `GOOD` and `BAD`, and its message."""

    outcome: str
    said: str = ""


@dataclass(frozen=True)
class Content:
    """What was read of a log: a hash of all of its numbers, and what is wrong with it."""

    numbers: str
    defects: frozenset[str]


class BrokenPromiseError(Exception):
    """A recording is not what it promises to be."""


def make_case(series: Series, number: int) -> Case:
    """Return a case, the same for the same words."""
    rng = Random(f"{series.reader} {series.seed} {number}")  # noqa: S311  no secret
    index = rng.randrange(len(series.samples))
    sound = series.samples[index]
    share = FLIGHT_SHARES.get(series.reader, FLIGHT_SHARE)
    way = GUARD if series.guarded else FLIGHT if rng.random() < share else READ
    name = rng.choice(sound.targets)
    partner = rng.choice([s for s in series.samples if s.form == sound.form])
    other = partner.files[rng.choice(partner.targets)]
    damage, content = damaged(rng, sound.files[name], other, sound.form)
    return Case(series, index, replace(sound, files={**sound.files, name: content}), way, damage)


def try_case(case: Case, folder: Path) -> Verdict:
    """Read a damaged log in an empty folder, and leave that empty."""
    try:
        try:
            found = ask(*case.broken.write(folder), case.way)
        except MemoryError:  # perhaps of the garbage of the cases before
            gc.collect()
            found = ask(*case.broken.write(folder), case.way)
    except StoopError as error:
        return _refusal(str(error).replace(str(folder), ""))
    except MemoryError:
        return Verdict("memory", "MemoryError")
    except BrokenPromiseError as error:
        return Verdict("fault", f"broken promise: {error}")
    except Exception as error:
        return Verdict("fault", _trace(error))
    finally:
        for file in folder.iterdir():
            file.unlink()
    sound = _sound(case.series, case.index, FLIGHT if case.way == FLIGHT else READ)
    if found.defects - (sound.defects if sound else frozenset()):
        return Verdict("listed")
    return Verdict("same" if sound and found.numbers == sound.numbers else "unnoticed")


def _refusal(message: str) -> Verdict:
    if not (message and message.isprintable()):
        return Verdict("fault", f"a message of more than one line, or none: {message[:200]!r}")
    return Verdict("limit" if "memory" in message else "refused", message)


def _trace(error: BaseException) -> str:
    at = error.__traceback__
    while at is not None and at.tb_next is not None and "stoop" in at.tb_next.tb_frame.f_code.co_filename:
        at = at.tb_next
    place = f"{Path(at.tb_frame.f_code.co_filename).name}:{at.tb_lineno}" if at is not None else ""
    return f"{type(error).__name__} at {place}: {' '.join(str(error).split())[:120]}"


@cache
def _sound(series: Series, index: int, way: str) -> Content | None:
    """Return what is read of the sound log; None where it cannot be read by this way."""
    with TemporaryDirectory(prefix="stoop-") as name, in_this_process():
        try:
            return ask(*series.samples[index].write(Path(name)), way)
        except StoopError:
            return None


def ask(path: Path, mapping: Path | None, way: str) -> Content:
    """Read a log by one of the ways, and see that what came is what was promised."""
    if way == FLIGHT:
        flight = load(path, mapping)
        describe(flight)
        return _of_flight(flight)
    return _of_recording(logs.read(path, mapping))


def _of_recording(recording: Recording) -> Content:
    check = hashlib.blake2b(digest_size=8)
    if not recording.streams:
        raise BrokenPromiseError("no stream")
    for name, stream in sorted(recording.streams.items()):
        _check_clock(stream.time)
        _add(check, name, stream.time)
        for key, values in sorted(stream.columns.items()):
            if values.dtype != np.float64 or values.shape != stream.time.shape:
                raise BrokenPromiseError(f"{name} {key} is {values.dtype} {values.shape}")
            _add(check, key, values)
    check.update(repr(sorted(recording.parameters.items())).encode())
    return Content(check.hexdigest(), _lines(map(str, recording.defects)))


def _of_flight(flight: Flight) -> Content:
    check = hashlib.blake2b(digest_size=8)
    _check_clock(flight.time)
    for name in sorted(map(str, flight.data.data_vars)):
        _add(check, name, flight.data[name].to_numpy())
    return Content(check.hexdigest(), _lines(map(str, flight.notices)))


def _check_clock(time: Any) -> None:
    if not time.size or not np.isfinite(time).all() or not (np.diff(time) > 0.0).all():
        raise BrokenPromiseError("the time is empty, not finite, or does not grow")


def _add(check: Any, name: str, values: Any) -> None:
    check.update(name.encode("utf-8", "surrogatepass"))
    check.update(np.ascontiguousarray(values).tobytes())


def _lines(messages: Iterable[str]) -> frozenset[str]:
    found = frozenset(messages)
    for line in found:
        if not line.isprintable():
            raise BrokenPromiseError(f"a defect of more than one line: {line[:200]!r}")
    return found


@contextmanager
def _children_run_by(run_child: Any) -> Iterator[None]:
    before = guard.run_child
    guard.run_child = run_child
    try:
        yield
    finally:
        guard.run_child = before


@contextmanager
def in_this_process() -> Iterator[None]:
    """Let readers that end in others' code do in this very process what their child would do."""

    def here(known: str, path: Path, folder: Path, limits: guard.Limits) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a child's are not seen
            guard.run_task(known, folder)

    with _children_run_by(here):
        yield


@contextmanager
def impatient(seconds: int) -> Iterator[None]:
    """Give the child of a reader so much time of the processor, and not what users' logs are given."""
    before = guard.run_child

    def soon(known: str, path: Path, folder: Path, limits: guard.Limits) -> None:
        task = json.loads((folder / guard.TASK).read_text())
        task["limits"]["seconds"] = seconds
        (folder / guard.TASK).write_text(json.dumps(task))
        before(known, path, folder, limits)

    with _children_run_by(soon):
        yield
