"""Damaged logs over all readers: every case ends in an error of ours, or in a recording that lists what was wrong.

Cases run in a copy of this process (fork), one after the other; when it dies, the case at hand is to blame, and another
copy continues. The copy is limited in memory; the time of a case is limited by the system, which ends the process whatever
code it is in, in seconds of the processor, so that a busy machine causes no hangs.
"""

from __future__ import annotations

import faulthandler
import gc
import hashlib
import importlib
import json
import os
import signal
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import asdict, dataclass, replace
from functools import cache
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any, Final
from unittest import mock

import numpy as np
import pandas as pd

from stoop import logs
from stoop.base.arrays import FloatArray
from stoop.errors import StoopError
from stoop.flight import describe, load
from stoop.logs import guard
from stoop.report.sheet import Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify.damaged_logs import DAMAGES, Sample, damaged
from stoop_studies.verify.sample_logs import SAMPLES, samples
from stoop_studies.verify.study import Samples, Verification, page_table, records_of, work

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
SECONDS: Final = 3  #: of processor time that a case may take
WALL: Final = 120.0  #: s without an answer after which a process is ended
ROOM: Final = 2**30  #: bytes of address space beyond what the process has at its beginning
SWELL: Final = 2**28  #: bytes of memory that a case may take
PAGE: Final = 4096  #: bytes of memory
MAX_FILE: Final = 2**28  #: bytes of a file that may be written
LIBRARIES: Final = ("pandas", "scipy.signal", "scipy.io", "stoop.flight.air_data")
RUN_CASES: Final = 250  #: of one run
GUARDED_CASES: Final = 1  #: the same with the reader in its own process: each starts an interpreter
APART: Final = " apart"  #: behind the name of a reader: in its own process
OUTCOMES: Final = (*GOOD, *BAD)
NAMES: Final = {
    "refused": "an error of ours, in one line",
    "listed": "read, and the damage is listed",
    "unnoticed": "read, with other numbers than the sound log, and nothing listed",
    "same": "read, with the very numbers of the sound log",
    "limit": "an error of ours: it asks for more memory than there is",
    CONTAINED: "others' code died or ran on; in a process of its own, this is an error of ours, or a reading",
    "fault": "an exception of another kind, a warning, or a recording that is not what it promises",
    "crash": "the process died",
    "hang": f"more than {SECONDS} s of processor time",
    "memory": f"more than {SWELL >> 20} MiB more than before",
}
WAYS: Final = {
    READ: "the reader",
    FLIGHT: "to a flight",
    GUARD: "the reader, others' code in a process of its own",
}
LEAD: Final = f"""\
Small logs of every kind are damaged at random and read. {RUN_CASES} cases are one run: a process is copied, may take \
{ROOM >> 20} MiB more than it has, and reads one log after the other; when it dies, the log at hand is to blame. Most \
cases call the reader (`stoop.logs.read`), one in ten goes on to a flight and the summary of `stoop info`; all cases with \
a damaged mapping do."""
READING: Final = """\
No log has a checksum over its numbers but that of the Crazyflie, packed ones, and HDF5 and Parquet where asked for: a changed \
number elsewhere is another measurement, and a log that ends where a message ends is a shorter log. Such cases are read \
without a notice."""
PACKED: Final = """\
What is packed (gzip, variables of MATLAB) is opened, damaged inside and packed again in half of the cases, and a Crazyflie's \
checksum is made to fit, so that it is the reader that meets the damage. A quarter of all logs is damaged twice."""


@dataclass(frozen=True)
class Series:
    """Cases 0, 1, ... of a reader (key of `SAMPLES`) and a seed.

    ``guarded``: others' code runs in a process of its own, as it does for users. ``data``: folder of real logs to damage
    too, may be empty.
    """

    reader: str
    seed: int
    guarded: bool = False
    data: str = ""


@dataclass(frozen=True)
class Tried:
    """A case by its number, how it was read, the first damage, and the outcome: one of `GOOD` and `BAD`, and its message."""

    number: int
    way: str
    damage: str
    outcome: str
    said: str


@dataclass(frozen=True)
class Case:
    """A damaged log by its number, the index of the sound one in its series, how it is read, and the first damage."""

    series: Series
    number: int
    index: int
    broken: Sample
    way: str
    damage: str

    def ended(self, outcome: str, said: str = "") -> Tried:
        """Return the case with its outcome."""
        return Tried(self.number, self.way, self.damage, outcome, said)


class BrokenPromiseError(Exception):
    """A recording is not what it promises to be."""


def make_case(series: Series, number: int) -> Case:
    """Return a case, the same for the same words."""
    rng = Random(f"{series.reader} {series.seed} {number}")  # noqa: S311  no secret
    logs_of_reader = samples(series.reader, series.data)
    index = rng.randrange(len(logs_of_reader))
    sound = logs_of_reader[index]
    share = FLIGHT_SHARES.get(series.reader, FLIGHT_SHARE)
    way = GUARD if series.guarded else FLIGHT if rng.random() < share else READ
    name = rng.choice(sound.targets)
    partner = rng.choice([s for s in logs_of_reader if s.form == sound.form])
    other = partner.files[rng.choice(partner.targets)]
    damage, content = damaged(rng, sound.files[name], other, sound.form)
    return Case(series, number, index, replace(sound, files={**sound.files, name: content}), way, damage)


def try_case(case: Case, folder: Path) -> Tried:
    """Read a damaged log in an empty folder, and leave that empty."""
    try:
        try:
            numbers, defects = ask(*case.broken.write(folder), case.way)
        except MemoryError:  # perhaps of the garbage of the cases before
            gc.collect()
            numbers, defects = ask(*case.broken.write(folder), case.way)
    except StoopError as error:
        message = str(error).replace(str(folder), "")
        if not (message and message.isprintable()):
            return case.ended("fault", f"a message of more than one line, or none: {message[:200]!r}")
        return case.ended("limit" if "memory" in message else "refused", message)
    except MemoryError:
        return case.ended("memory", "MemoryError")
    except BrokenPromiseError as error:
        return case.ended("fault", f"broken promise: {error}")
    except Exception as error:
        own = [f for f in traceback.extract_tb(error.__traceback__) if "stoop" in f.filename]
        place = f"{Path(own[-1].filename).name}:{own[-1].lineno}"
        return case.ended("fault", f"{type(error).__name__} at {place}: {' '.join(str(error).split())[:120]}")
    finally:
        for file in folder.iterdir():
            file.unlink()
    sound = _sound(case.series, case.index, FLIGHT if case.way == FLIGHT else READ)
    if defects - sound[1]:
        return case.ended("listed")
    return case.ended("same" if numbers == sound[0] else "unnoticed")


@cache
def _sound(series: Series, index: int, way: str) -> tuple[str, frozenset[str]]:
    """Return what is read of the sound log; nothing where it cannot be read by this way."""
    with TemporaryDirectory(prefix="stoop-") as name, in_this_process():
        try:
            return ask(*samples(series.reader, series.data)[index].write(Path(name)), way)
        except StoopError:
            return "", frozenset()


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
        for name in sorted(map(str, flight.data.data_vars)):
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


def in_this_process() -> AbstractContextManager[Any]:
    """Let readers that end in others' code do in this very process what their child would do."""

    def here(known: str, path: Path, folder: Path, limits: guard.Limits) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a child's are not seen
            guard.run_task(known, folder)

    return mock.patch.object(guard, "run_child", here)


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
def prepare(reader: str, data: str) -> None:
    """Load what a reader needs once, so that copies of this process need not.

    Texts of pandas may be Arrow's, whose allocator takes a GiB of addresses when it is first asked: not from a case's room.
    """
    for name in (*LIBRARIES, GUARDED.get(reader, "pandas")):
        importlib.import_module(name)
    importlib.import_module("pandas").Series(["text"]).isna()
    samples(reader, data)


def try_all(series: Series, count: int) -> Iterator[Tried]:
    """Try the first cases of a series."""
    if not hasattr(os, "fork"):
        raise StoopError("verify readers: needs a system that can copy processes; run it on Linux or macOS")
    number = 0
    while number < count:
        for tried in _until_death(series, range(number, count)):
            number = tried.number + 1
            if series.reader in GUARDED and not series.guarded and tried.outcome in BAD:
                # once more as users read it: others' code in a process of its own, which may die
                (again,) = _until_death(replace(series, guarded=True), range(tried.number, number))
                said = f"{tried.outcome}: {tried.said}; {again.said}"
                yield again if again.outcome in BAD else replace(tried, outcome=CONTAINED, said=said)
            else:
                yield tried


def _until_death(series: Series, numbers: range) -> Iterator[Tried]:
    """Try cases until all are done, or one takes the process along."""
    with TemporaryDirectory(prefix="stoop-") as place:  # not the child's, which may die
        results, reports = Pipe(duplex=False)
        child = os.fork()  # a worker of a campaign may have no children of multiprocessing's
        if child == 0:
            results.close()
            _work(reports, series, numbers, Path(place))  # never comes back
        reports.close()
        number, silent = numbers.start, False
        with results, suppress(EOFError):
            while number < numbers.stop and not (silent := not results.poll(WALL)):
                yield Tried(**json.loads(results.recv_bytes()))
                number += 1
        if silent:
            os.kill(child, signal.SIGKILL)
        ending = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if number == numbers.stop:
        return
    if silent:
        outcome, said = "hang", f"no answer for {WALL:g} s"
    elif ending == -signal.SIGXCPU:
        outcome, said = "hang", f"more than {SECONDS} s of processor time"
    else:
        outcome, said = "crash", f"signal {-ending}" if ending < 0 else f"the process ended with {ending}"
    yield make_case(series, number).ended(outcome, said)


def _work(reports: Connection[bytes, bytes], series: Series, numbers: range, folder: Path) -> None:
    """Try cases within limits of memory and time, and report each; then end the process, whatever happens."""
    import resource

    def peak() -> int:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024

    try:
        faulthandler.disable()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for stream in (1, 2):  # neither what libraries print of damage, nor where a process died
            os.dup2(nowhere, stream)
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.signal(signal.SIGXCPU, signal.SIG_DFL)
        size = int(Path("/proc/self/statm").read_text().split()[0]) * PAGE + ROOM
        for limit, most in (
            (resource.RLIMIT_AS, size),
            (resource.RLIMIT_CORE, 0),
            (resource.RLIMIT_FSIZE, MAX_FILE),
        ):
            resource.setrlimit(limit, (most, most))
        warnings.simplefilter("error")  # a user would see them
        with impatient(SECONDS) if series.guarded else in_this_process():
            for number in numbers:
                before = resource.getrusage(resource.RUSAGE_SELF)
                soft = int(before.ru_utime + before.ru_stime) + SECONDS + 1
                resource.setrlimit(resource.RLIMIT_CPU, (soft, resource.RLIM_INFINITY))
                case, before_reading = make_case(series, number), peak()
                tried = try_case(case, folder)
                if (more := peak() - before_reading) > SWELL and not series.guarded:
                    tried = case.ended("memory", f"{more >> 20} MiB; {tried.said}")
                reports.send_bytes(json.dumps(asdict(tried)).encode())
    finally:
        os._exit(0)


@work
def try_cases(case: str, seed: int, data: str) -> dict[str, Any]:
    """Try the cases of one run; ``case`` is a reader, perhaps with `APART`, ``data`` a folder of real logs, or empty."""
    apart = case.endswith(APART)
    series = Series(case.removesuffix(APART), seed, apart, data)
    return count_outcomes(series, GUARDED_CASES if apart else RUN_CASES)


def count_outcomes(series: Series, count: int) -> dict[str, Any]:
    """Return ``counts`` of way/damage/outcome, and the cases to look at in ``found``."""
    prepare(series.reader, series.data)
    tried = list(try_all(series, count))
    counts = Counter(f"{one.way}/{one.damage}/{one.outcome}" for one in tried)
    found = [asdict(one) for one in tried if one.outcome in (*BAD, CONTAINED)]
    return {"counts": dict(sorted(counts.items())), "found": found}


def tabulate(samples: Samples) -> pd.DataFrame:
    """Return how many cases ended how, one column each, by reader, way and first damage: `count_outcomes` by case."""
    counts = [
        (case.removesuffix(APART), *words.split("/"), number)
        for case, results in samples.items()
        for result in results
        for words, number in result["counts"].items()
    ]
    by = ["reader", "way", "damage"]
    found = pd.DataFrame(counts, columns=[*by, "outcome", "cases"]).pivot_table("cases", by, "outcome", "sum")
    table = found.reindex(columns=list(OUTCOMES)).fillna(0).astype(int)
    table.insert(0, "cases", table.sum(axis=1))
    return table


def summed(table: pd.DataFrame, by: str, names: Sequence[str]) -> pd.DataFrame:
    """Return the sums of `tabulate` over all but the reader, the way or the damage, a row for each name."""
    return table.groupby(level=by).sum().reindex(list(names), fill_value=0).rename_axis(by)


def show(setting: Setting, samples: Samples) -> Findings:
    """Return what came of the damaged logs."""
    found = [
        {"reader": case, "case": one["number"], **{key: one[key] for key in ("damage", "outcome", "said")}}
        for case in sorted(samples, key=lambda case: f"{case}/")
        for result in samples[case]
        for one in result["found"]
    ]
    groups = Counter((r["reader"], r["said"].partition(";")[0]) for r in found if r["outcome"] == CONTAINED)
    contained = tuple((reader, said, str(n)) for (reader, said), n in sorted(groups.items()))
    counts = tabulate(samples)
    readers, damages = summed(counts, "reader", tuple(SAMPLES)), summed(counts, "damage", tuple(DAMAGES))
    ways = summed(counts, "way", tuple(WAYS))
    readers.loc["all"] = counts.sum()
    each = counts.groupby(level=["reader", "damage"]).sum()
    each = each.reindex(pd.MultiIndex.from_product([SAMPLES, DAMAGES], names=each.index.names), fill_value=0)
    by_reader = (
        _table("What came of the damaged logs", readers),
        Table("What the words mean", ("word", "meaning"), tuple(NAMES.items())),
        Prose(READING),
    )
    by_damage = (
        _table("By what was done first", damages),
        Table(
            "What was done", ("damage", "how"), tuple((name, words) for name, (_, words) in DAMAGES.items())
        ),
        Prose(PACKED),
    )
    others = Table("By reader and by what happened", ("reader", "what", "cases"), contained)
    findings = Findings.tabulated(
        f"{counts['cases'].sum():,} damaged logs over all readers",
        LEAD,
        _claims(readers, ways),
        (
            Section("By reader", by_reader),
            Section("By damage", by_damage),
            Section("By way", (_table("By what was asked", ways.rename(WAYS)),)),
            Section("Others' code that died or ran on", (others,)),
        ),
        records_of(each.reset_index()),
    )
    head = ("reader", "case", "damage", "outcome", "said")
    return replace(findings, parts={"found": (head, tuple(tuple(r.values()) for r in found))})


def _table(caption: str, counts: pd.DataFrame) -> Table:
    records = records_of(counts.reset_index())
    return page_table(caption, {name: (name, str) for name in records[0]}, records)


def _claims(readers: pd.DataFrame, ways: pd.DataFrame) -> Iterator[Claim]:
    total, flights = readers.loc["all"], ways.loc[FLIGHT]
    crashed = readers.loc[list(GUARDED), list(BAD)].to_numpy().any()
    for outcome, words in (
        (
            "fault",
            "No case ends in an exception of another kind, a warning, or a recording that breaks its promises",
        ),
        ("crash", "No case ends the process"),
        ("hang", f"No case takes more than {SECONDS} s of processor time"),
        ("memory", f"No case takes more than {SWELL >> 20} MiB"),
    ):
        yield holds(words, not total[outcome], f"{total[outcome]:,} of {total['cases']:,}")
    yield holds(
        "A library that crashes or runs on does not take the process along",
        not crashed,
        f"{total[CONTAINED]} such cases of {total['cases']:,}, all of them refused in one line, or read, by the reader in "
        f"its own process; {ways['cases'][GUARD]:,} further cases were read so from the beginning",
    )
    safe = not flights[list(BAD)].any()
    yield holds("The whole way to a flight is as safe", safe, f"{flights['cases']:,} cases")


EXPERIMENT: Final = Verification(
    "readers",
    show,
    runs=29,
    work="try_cases",
    cases=(*SAMPLES, *(f"{reader}{APART}" for reader in GUARDED)),
    parts=("found",),
    reads_data=True,
)
