"""Trials of hostile inputs: every case ends in an error of ours or in a result that keeps its promises.

Cases run in a copy of this process (fork), one after the other; when it dies, the case at hand is to blame, and another
copy continues. The copy is limited in memory; the time of a case is limited by the system, which ends the process whatever
code it is in, in seconds of the processor, so that a busy machine causes no hangs.
"""

from __future__ import annotations

import faulthandler
import gc
import json
import os
import shutil
import signal
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from stoop.base import notices
from stoop.base.notices import Notice
from stoop.errors import StoopError

REFUSED, LISTED, UNNOTICED, SAME, READ, LIMIT, CONTAINED = (
    "refused", "listed", "unnoticed", "same", "read", "limit", "contained",
)  # fmt: skip
GOOD: Final = {
    REFUSED: "an error of ours, in one line",
    LISTED: "read or done, and what is wrong is listed",
    UNNOTICED: "read, with other numbers than the sound file, and nothing listed",
    SAME: "read, with the very numbers of the sound file",
    READ: "read or done, of a file that has no sound twin",
    LIMIT: "an error of ours: it asks for more memory than there is",
    CONTAINED: "others' code died or ran on; in a process of its own, this is an error of ours, or a reading",
}  #: outcome -> meaning
BAD: Final = {
    "fault": "an exception of another kind, a warning, or a result that is not what it promises",
    "crash": "the process died",
    "hang": "more processor time than a case may take",
    "memory": "more memory than a case may take",
}  #: the same, of failures
STATM: Final = Path("/proc/self/statm")  #: pages of memory of this process
PAGE: Final = 4096  #: bytes of memory
MAX_FILE: Final = 2**28  #: bytes of a file that may be written


@dataclass(frozen=True)
class Bounds:
    """What a case may take."""

    seconds: int = 3  #: of processor time
    wall: float = 120.0  #: s without an answer after which the process is ended
    address_space: int = 2**30  #: bytes beyond what the process has at its beginning
    memory: int = 2**28  #: bytes


@dataclass(frozen=True)
class Case:
    """A hostile input by its number, what is asked of it, and what was done to it.

    ``run`` is given an empty folder and returns an outcome of `GOOD`; an error of ours is `REFUSED`, any other a fault.
    """

    number: int
    way: str
    damage: str
    run: Callable[[Path], str]

    def ended(self, outcome: str, message: str = "") -> Tried:
        """Return the case with its outcome."""
        return Tried(self.number, self.way, self.damage, outcome, message)


@dataclass(frozen=True)
class Tried:
    """A case by its number, what was asked, the first damage, and the outcome: one of `GOOD` and `BAD`, and its message."""

    number: int
    way: str
    damage: str
    outcome: str
    message: str


Cases = Callable[[int], Case]  #: the same number gives the same case


class BrokenPromiseError(Exception):
    """A result is not what it promises to be."""


def try_case(case: Case, folder: Path) -> Tried:
    """Run a case in an empty folder, and leave that empty."""
    try:
        try:
            outcome = case.run(folder)
        except MemoryError:  # perhaps of the garbage of the cases before
            _empty(folder)
            gc.collect()
            outcome = case.run(folder)
    except StoopError as error:
        message = str(error).replace(str(folder), "")
        if not (message and message.isprintable()):
            return case.ended("fault", f"a message of more than one line, or none: {message[:200]!r}")
        return case.ended(LIMIT if "memory" in message else REFUSED, message)
    except MemoryError:
        return case.ended("memory", "MemoryError")
    except BrokenPromiseError as error:
        return case.ended("fault", f"broken promise: {error}")
    except Exception as error:
        return case.ended("fault", _message(error))
    finally:
        _empty(folder)
    return case.ended(outcome)


def _message(error: Exception) -> str:
    """Return an exception in one line, with the place in our own code."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "stoop" in frame.filename] or frames
    return f"{type(error).__name__} at {Path(own[-1].filename).name}:{own[-1].lineno}: {' '.join(str(error).split())[:120]}"


def _as_it_is(detector: str, error: Exception) -> Notice:
    """Let the error of a detector pass."""
    raise error


def _empty(folder: Path) -> None:
    for entry in folder.iterdir():
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry, ignore_errors=True)
        else:
            entry.unlink()


def lay_out(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files, by their places in a folder."""
    for place, content in files.items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_bytes(content)


def try_all(cases: Cases, numbers: range, bounds: Bounds) -> Iterator[Tried]:
    """Try cases by their numbers.

    Raises
    ------
    StoopError
        The system does not say how much memory a process has.
    """
    if not STATM.exists():
        raise StoopError(f"verify robustness: needs {STATM}; run it on Linux")
    while numbers:
        for tried in _until_death(cases, numbers, bounds):
            number = tried.number
            numbers = range(number + 1, numbers.stop)
            # a hang is one that hangs again: not a machine that stood still
            yield from (
                _until_death(cases, range(number, number + 1), bounds)
                if tried.outcome == "hang"
                else (tried,)
            )


def _until_death(cases: Cases, numbers: range, bounds: Bounds) -> Iterator[Tried]:
    """Try cases until all are done, or one takes the process along."""
    with TemporaryDirectory(prefix="stoop-") as place:  # not the child's, which may die
        results, reports = Pipe(duplex=False)
        child = os.fork()  # a worker of a campaign may have no children of multiprocessing's
        if child == 0:
            results.close()
            _work(reports, cases, numbers, bounds, Path(place))  # never comes back
        reports.close()
        number, silent = numbers.start, False
        with results, suppress(EOFError):
            while number < numbers.stop and not (silent := not results.poll(bounds.wall)):
                yield Tried(**json.loads(results.recv_bytes()))
                number += 1
        if silent:
            os.kill(child, signal.SIGKILL)
        ending = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if number == numbers.stop:
        return
    if silent:
        outcome, message = "hang", f"no answer for {bounds.wall:g} s"
    elif ending == -signal.SIGXCPU:
        outcome, message = "hang", f"more than {bounds.seconds} s of processor time"
    else:
        outcome, message = "crash", f"signal {-ending}" if ending < 0 else f"the process ended with {ending}"
    yield cases(number).ended(outcome, message)


def _work(
    reports: Connection[bytes, bytes], cases: Cases, numbers: range, bounds: Bounds, folder: Path
) -> None:
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
        size = int(STATM.read_text().split()[0]) * PAGE + bounds.address_space
        for limit, most in (
            (resource.RLIMIT_AS, size),
            (resource.RLIMIT_CORE, 0),
            (resource.RLIMIT_FSIZE, MAX_FILE),
        ):
            resource.setrlimit(limit, (most, most))
        warnings.simplefilter("error")  # a user would see them
        notices.detector_failed = _as_it_is  # a user would have its notice
        for number in numbers:
            before = resource.getrusage(resource.RUSAGE_SELF)
            soft = int(before.ru_utime + before.ru_stime) + bounds.seconds + 1
            resource.setrlimit(resource.RLIMIT_CPU, (soft, resource.RLIM_INFINITY))
            case, before_run = cases(number), peak()
            tried = try_case(case, folder)
            if (more := peak() - before_run) > bounds.memory:
                tried = case.ended("memory", f"{more >> 20} MiB; {tried.message}")
            reports.send_bytes(json.dumps(asdict(tried)).encode())
    finally:
        os._exit(0)


def count_outcomes(trials: Iterator[Tried]) -> dict[str, Any]:
    """Return ``counts`` of way/damage/outcome, and the cases to look at in ``found``."""
    tried = list(trials)
    counts = Counter(f"{one.way}/{one.damage}/{one.outcome}" for one in tried)
    found = [asdict(one) for one in tried if one.outcome in (*BAD, CONTAINED)]
    return {"counts": dict(sorted(counts.items())), "found": found}
