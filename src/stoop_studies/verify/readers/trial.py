"""One case: a sound log, damaged; read by the door that users take; and what came of it, judged."""

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
from stoop_studies.verify.readers.damage import damaged
from stoop_studies.verify.readers.sample import Sample
from stoop_studies.verify.readers.samples import samples

if TYPE_CHECKING:
    from stoop.flight import Flight
    from stoop.logs import Recording

READ, FLIGHT, GUARD = (
    "read",
    "flight",
    "guard",
)  #: reader alone; the whole way to a flight; reader in its own process
SHARE: Final = 0.1  #: of the cases that go the whole way
SHARES: Final = {"mapping": 1.0, "stoop-netcdf": 0.5}  #: of readers that do little before
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
    """What came of a case, by the words of `GOOD` and `BAD`, and what was said."""

    outcome: str
    said: str = ""


@dataclass(frozen=True)
class Told:
    """What a sound or damaged log tells: a word for all of its numbers, and what is wrong with it."""

    numbers: str
    defects: frozenset[str]


class BrokenPromiseError(Exception):
    """A recording is not what it promises to be."""


def make_case(series: Series, number: int) -> Case:
    """Return a case, the same for the same words."""
    rng = Random(f"{series.reader} {series.seed} {number}")  # noqa: S311  no secret
    logs_ = samples(series.reader, series.data)
    index = rng.randrange(len(logs_))
    sound = logs_[index]
    way = GUARD if series.guarded else FLIGHT if rng.random() < SHARES.get(series.reader, SHARE) else READ
    name = rng.choice(sound.targets)
    partner = rng.choice([s for s in logs_ if s.form == sound.form])
    other = partner.files[rng.choice(partner.targets)]
    damage, content = damaged(rng, sound.files[name], other, sound.form)
    return Case(series, index, replace(sound, files={**sound.files, name: content}), way, damage)


def _asked(case: Case, folder: Path) -> Told:
    """Ask, and ask again without the garbage of the cases before, which is none of this one's memory."""
    try:
        return ask(*case.broken.write(folder), case.way)
    except MemoryError:
        gc.collect()
    return ask(*case.broken.write(folder), case.way)


def try_case(case: Case, folder: Path) -> Verdict:
    """Read a damaged log in an empty folder, and leave that empty."""
    try:
        told = _asked(case, folder)
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
    return _held(told, _sound(case.series, case.index, FLIGHT if case.way == FLIGHT else READ))


def _refusal(said: str) -> Verdict:
    if not (said and said.isprintable()):
        return Verdict("fault", f"a message of more than one line, or none: {said[:200]!r}")
    return Verdict("limit" if "memory" in said else "refused", said)


def _trace(error: BaseException) -> str:
    at = error.__traceback__
    while at is not None and at.tb_next is not None and "stoop" in at.tb_next.tb_frame.f_code.co_filename:
        at = at.tb_next
    place = f"{Path(at.tb_frame.f_code.co_filename).name}:{at.tb_lineno}" if at is not None else ""
    return f"{type(error).__name__} at {place}: {' '.join(str(error).split())[:120]}"


def _held(told: Told, sound: Told | None) -> Verdict:
    """Compare with what the sound log told."""
    if told.defects - (sound.defects if sound else frozenset()):
        return Verdict("listed")
    return Verdict("same" if sound and told.numbers == sound.numbers else "unnoticed")


@cache
def _sound(series: Series, index: int, way: str) -> Told | None:
    """Return what the sound log tells; None where it cannot be read by this way."""
    with TemporaryDirectory(prefix="stoop-") as name, in_this_process():
        try:
            return ask(*samples(series.reader, series.data)[index].write(Path(name)), way)
        except StoopError:
            return None


def ask(path: Path, mapping: Path | None, way: str) -> Told:
    """Read a log by one of the ways, and see that what came is what was promised."""
    if way == FLIGHT:
        flight = load(path, mapping)
        describe(flight)
        return _of_flight(flight)
    return _of_recording(logs.read(path, mapping))


def _of_recording(recording: Recording) -> Told:
    check = hashlib.blake2b(digest_size=8)
    if not recording.streams:
        raise BrokenPromiseError("no stream")
    for name, stream in sorted(recording.streams.items()):
        _see_clock(stream.time)
        _add(check, name, stream.time)
        for key in sorted(stream.columns):
            values = stream.columns[key]
            if values.dtype != np.float64 or values.shape != stream.time.shape:
                raise BrokenPromiseError(f"{name} {key} is {values.dtype} {values.shape}")
            _add(check, key, values)
    check.update(repr(sorted(recording.parameters.items())).encode())
    return Told(check.hexdigest(), _lines(map(str, recording.defects)))


def _of_flight(flight: Flight) -> Told:
    check = hashlib.blake2b(digest_size=8)
    _see_clock(flight.time)
    for name in sorted(map(str, flight.data.data_vars)):
        _add(check, name, flight.data[name].to_numpy())
    return Told(check.hexdigest(), _lines(map(str, flight.notices)))


def _see_clock(time: Any) -> None:
    if not time.size or not np.isfinite(time).all() or not (np.diff(time) > 0.0).all():
        raise BrokenPromiseError("the time is empty, not finite, or does not grow")


def _add(check: Any, name: str, values: Any) -> None:
    check.update(name.encode("utf-8", "surrogatepass"))
    check.update(np.ascontiguousarray(values).tobytes())


def _lines(said: Iterable[str]) -> frozenset[str]:
    found = frozenset(said)
    for line in found:
        if not line.isprintable():
            raise BrokenPromiseError(f"a defect of more than one line: {line[:200]!r}")
    return found


@contextmanager
def in_this_process() -> Iterator[None]:
    """Let readers that end in others' code do in this very process what their child would do."""
    before = guard.launch

    def here(reader: str, path: Path, folder: Path, limits: guard.Limits) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a child's are not seen
            guard.answer(reader, folder)

    guard.launch = here
    try:
        yield
    finally:
        guard.launch = before


@contextmanager
def impatient(seconds: int) -> Iterator[None]:
    """Give the child of a reader so much time of the processor, and not what users' logs are given."""
    before = guard.launch

    def soon(reader: str, path: Path, folder: Path, limits: guard.Limits) -> None:
        task = json.loads((folder / guard.TASK).read_text())
        task["limits"]["seconds"] = seconds
        (folder / guard.TASK).write_text(json.dumps(task))
        before(reader, path, folder, limits)

    guard.launch = soon
    try:
        yield
    finally:
        guard.launch = before
