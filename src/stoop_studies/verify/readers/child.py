"""Cases in a process of their own, one after the other; when it dies, the case at hand is to blame, and another goes on.

The process is a copy of this one (fork), limited in memory. The time of a case is limited by the system, which ends
the process whatever code it is in: in seconds of the processor, so that a busy machine makes no hangs.
"""

from __future__ import annotations

import contextlib
import faulthandler
import importlib
import json
import os
import select
import signal
import warnings
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from stoop.errors import StoopError
from stoop_studies.verify.readers.samples import samples
from stoop_studies.verify.readers.trial import (
    BAD,
    CONTAINED,
    GUARDED,
    Series,
    Verdict,
    impatient,
    in_this_process,
    make_case,
    try_case,
)

SECONDS: Final = 3  #: of processor time that a case may take
WALL: Final = 120.0  #: s without a word after which a process is ended
ROOM: Final = 2**30  #: bytes of address space beyond what the process has at its beginning
SWELL: Final = 2**28  #: bytes; a case that takes more is too hungry
PAGE: Final = 4096  #: bytes of memory
MAX_FILE: Final = 2**28  #: bytes of a file that may be written
LIBRARIES: Final = ("pandas", "scipy.signal", "scipy.io", "stoop.flight.air_data_reconstruction")


@dataclass(frozen=True)
class Tried:
    """A case by its number, what was done, and what came of it."""

    number: int
    way: str
    damage: str
    outcome: str
    said: str


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
    """Try the first cases of a series.

    Raises
    ------
    StoopError
        The system cannot copy processes.
    """
    if not hasattr(os, "fork"):
        raise StoopError("verify readers: needs a system that can copy processes; run it on Linux or macOS")
    number = 0
    while number < count:
        for tried in _until_death(series, range(number, count)):
            contained = series.reader in GUARDED and not series.guarded and tried.outcome in BAD
            yield _guarded(series, tried) if contained else tried
            number = tried.number + 1


def _guarded(series: Series, tried: Tried) -> Tried:
    """Try a case again as users do: others' code in a process of its own, which may die."""
    (again,) = _until_death(replace(series, guarded=True), range(tried.number, tried.number + 1))
    if again.outcome in BAD:
        return again
    return replace(tried, outcome=CONTAINED, said=f"{tried.outcome}: {tried.said}; {again.said}")


def _until_death(series: Series, numbers: range) -> Iterator[Tried]:
    """Try cases until all are done, or one takes the process along."""
    with TemporaryDirectory(prefix="stoop-") as place:  # not the child's, which may die
        end, begin = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(end)
            _work(begin, series, numbers, Path(place))  # never comes back
        os.close(begin)
        number = numbers.start
        with os.fdopen(end, "rb") as pipe:
            while number < numbers.stop and (line := _line(pipe.fileno())):
                yield Tried(**json.loads(line))
                number += 1
            if number < numbers.stop:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(child, signal.SIGKILL if line is None else 0)
        _, status = os.waitpid(child, 0)
        if number < numbers.stop:
            case, death = make_case(series, number), _death(status, line is None)
            yield Tried(number, case.way, case.damage, death.outcome, death.said)


def _line(pipe: int) -> bytes | None:
    """Return a line; nothing at the end, None when none came for long."""
    out = b""
    while not out.endswith(b"\n"):
        ready, _, _ = select.select([pipe], [], [], WALL)
        if not ready:
            return None
        piece = os.read(pipe, 1)
        if not piece:
            return b""
        out += piece
    return out


def _death(status: int, silent: bool) -> Verdict:
    if silent:
        return Verdict("hang", f"no answer for {WALL:g} s")
    if not os.WIFSIGNALED(status):
        return Verdict("crash", f"the process ended with {os.waitstatus_to_exitcode(status)}")
    if os.WTERMSIG(status) == signal.SIGXCPU:
        return Verdict("hang", f"more than {SECONDS} s of processor time")
    return Verdict("crash", f"signal {os.WTERMSIG(status)}")


def _work(pipe: int, series: Series, numbers: range, folder: Path) -> None:
    """Try cases and report each; then end the process, whatever happens."""
    try:
        _silence()
        _limit_memory()
        warnings.simplefilter("error")  # a user would see them
        with impatient(SECONDS) if series.guarded else in_this_process():
            for number in numbers:
                _limit_time()
                case = make_case(series, number)
                before = _peak()
                verdict = try_case(case, folder)
                if _peak() - before > SWELL and not series.guarded:
                    verdict = Verdict("memory", f"{_peak() - before >> 20} MiB; {verdict.said}")
                tried = Tried(number, case.way, case.damage, verdict.outcome, verdict.said)
                os.write(pipe, json.dumps(asdict(tried)).encode() + b"\n")
    finally:
        os._exit(0)


def _silence() -> None:
    """Print nothing: neither what libraries say of damage, nor where a process died."""
    faulthandler.disable()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)


def _limit_memory() -> None:
    import resource

    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGXCPU, signal.SIG_DFL)
    with open("/proc/self/statm", "rb") as file:  # noqa: PTH123  no path of a user
        size = int(file.read().split()[0]) * PAGE
    resource.setrlimit(resource.RLIMIT_AS, (size + ROOM, size + ROOM))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (MAX_FILE, MAX_FILE))


def _limit_time() -> None:
    """Give the process so many seconds from now."""
    import resource

    used = resource.getrusage(resource.RUSAGE_SELF)
    soft = int(used.ru_utime + used.ru_stime) + SECONDS + 1
    resource.setrlimit(resource.RLIMIT_CPU, (soft, resource.RLIM_INFINITY))


def _peak() -> int:
    """Return the most memory [bytes] that this process has had."""
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
