"""Hostile inputs in a copy of this process, with limits: each ends in an error of ours or in a result that keeps its promises."""

import faulthandler
import os
import resource
import shutil
import signal
import traceback
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from multiprocessing import Pipe
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from hypothesis import HealthCheck, Phase, settings

from stoop.base import notices
from stoop.errors import StoopError

REFUSED, LISTED, READ = "refused", "listed", "read"
BAD = ("fault", "crash", "hang", "memory")  #: outcomes that are failures


class Ended(NamedTuple):
    outcome: str
    message: str = ""


@dataclass(frozen=True)
class Bounds:
    seconds: int = 3  #: of processor time
    wall: float = 300.0  #: s without an answer after which the process is ended
    address_space: int = 2**30  #: bytes beyond what the process has at its beginning
    memory: int = 2**28  #: bytes, of the process or of one that it starts
    file: int = 2**28  #: bytes of a file that may be written


class BrokenPromiseError(Exception):
    """A result is not what it promises to be."""


def promise(kept: object, what: str) -> None:
    if not kept:
        raise BrokenPromiseError(what)


def lay_out(folder: Path, files: Mapping[str, bytes]) -> None:
    for place, content in files.items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_bytes(content)


def try_case(work: Callable[..., str], folder: Path, *given: object) -> Ended:
    try:
        return Ended(work(folder, *given))
    except StoopError as error:
        message = str(error).replace(str(folder), "")
        if not (message and message.isprintable()):
            return Ended("fault", f"a message of more than one line, or none: {message[:200]!r}")
        return Ended(REFUSED, message)
    except MemoryError:
        return Ended("memory", "MemoryError")
    except BrokenPromiseError as error:
        return Ended("fault", f"broken promise: {error}")
    except Exception as error:
        return Ended("fault", "".join(traceback.format_exception(error)[-4:]))
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()


def peak() -> int:
    """Return the largest memory so far of this process, or of one that it started, bytes."""
    every = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return 1024 * max(resource.getrusage(who).ru_maxrss for who in every)


class Child:
    """Calls ``work(folder, *given)``, which returns an outcome, in a copy of this process."""

    def __init__(self, work: Callable[..., str], bounds: Bounds | None = None) -> None:
        self._work, self._bounds, self._pid = work, bounds or Bounds(), 0

    def __call__(self, *given: object) -> Ended:
        """Return how a case ended. A hang is one that hangs again: not a machine that stood still."""
        ended = self._ask(given)
        return self._ask(given) if ended.outcome == "hang" else ended

    def _ask(self, given: tuple[object, ...]) -> Ended:
        if not self._pid:
            self._pipe, other = Pipe()
            self._place = TemporaryDirectory(prefix="stoop-")  # not the child's, which may die
            self._pid = os.fork()
            if self._pid == 0:
                self._pipe.close()
                self._answer(other)  # never comes back
            other.close()
        try:
            self._pipe.send(given)
            if self._pipe.poll(self._bounds.wall):
                return Ended(*self._pipe.recv())
        except (EOFError, ConnectionError):
            return self._buried()
        os.kill(self._pid, signal.SIGKILL)
        self._buried()
        return Ended("hang", f"no answer for {self._bounds.wall:g} s")

    def _buried(self) -> Ended:
        code = os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1])
        self._pid = 0
        self._pipe.close()
        self._place.cleanup()
        if code == -signal.SIGXCPU:
            return Ended("hang", f"more than {self._bounds.seconds} s of processor time")
        return Ended("crash", f"signal {-code}" if code < 0 else f"the process ended with {code}")

    def close(self) -> None:
        if self._pid:
            self._pipe.close()
            os.kill(self._pid, signal.SIGKILL)
            self._buried()

    def _answer(self, pipe) -> None:
        """Answer calls within the limits until none comes; then end the process, whatever happens."""
        try:
            self._limit()
            while True:
                given = pipe.recv()
                used, began = resource.getrusage(resource.RUSAGE_SELF), peak()
                soft = int(used.ru_utime + used.ru_stime) + self._bounds.seconds + 1
                resource.setrlimit(resource.RLIMIT_CPU, (soft, resource.RLIM_INFINITY))
                ended = try_case(self._work, Path(self._place.name), *given)
                more = peak() - began
                if more > self._bounds.memory:
                    ended = Ended("memory", f"{more >> 20} MiB; {ended.message}")
                pipe.send(tuple(ended))
        finally:
            os._exit(0)

    def _limit(self) -> None:
        faulthandler.disable()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for stream in (1, 2):  # neither what libraries print of damage, nor where a process died
            os.dup2(nowhere, stream)
        for one in (signal.SIGINT, signal.SIGXCPU):
            signal.signal(one, signal.SIG_DFL)
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        size = pages * resource.getpagesize() + self._bounds.address_space
        limits = {resource.RLIMIT_AS: size, resource.RLIMIT_CORE: 0, resource.RLIMIT_FSIZE: self._bounds.file}
        for limit, most in limits.items():
            resource.setrlimit(limit, (most, most))
        warnings.simplefilter("error")  # a user would see them
        notices.detector_failed = _raised  # a user would have its notice


def _raised(detector: str, error: Exception) -> notices.Notice:
    raise error


FACTOR = settings.default.max_examples / 100  #: of the cases of a plain run


def cases(count: float) -> settings:
    """Return the settings of a test of so many cases in a plain run, which tries the same each time.

    ``--hypothesis-profile=campaign`` tries a hundred times as many, drawn anew; ``--hypothesis-seed=N`` repeats a campaign.
    """
    return settings(
        max_examples=max(1, round(FACTOR * count)), derandomize=FACTOR <= 1, database=None, deadline=None,
        phases=(Phase.explicit, Phase.generate, Phase.shrink), suppress_health_check=list(HealthCheck),
    )  # fmt: skip


def check(family: str, surface: str, ended: Ended) -> None:
    assert ended.outcome not in BAD, f"{family}, {surface}: {ended.outcome}: {ended.message}"
