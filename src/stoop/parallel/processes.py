"""Processes on this machine, one task each at a time; one that dies is replaced.

Each worker has a thread and a pipe of its own in the driver. A worker that is killed, in whatever it is doing, so leaves
nothing locked and nothing half sent that another one waits for: its pipe ends, its task is lost, the others work on.
(`concurrent.futures.ProcessPoolExecutor` shares one pipe and one lock among all workers, and ends them all.)
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from queue import SimpleQueue
from typing import Final, TypeAlias, final

from stoop.errors import CampaignError, StoopError
from stoop.parallel.plan import Task
from stoop.parallel.pool import Hands, WorkerLostError, processors
from stoop.parallel.task import Report, perform

ONE_THREAD: Final = (
    "STOOP_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS",
)  # fmt: skip
_GRACE = 1.0  #: s that a worker whose pipe has ended has to end itself
_FAREWELL = 5.0  #: s that an idle worker has to tidy up
_Call: TypeAlias = tuple["Future[Report]", Task]


@final
@dataclass(frozen=True)
class LocalProcesses:
    """Processes on this machine, with one thread each for kernels and for linear algebra.

    Attributes
    ----------
    workers : int
        As many as there are processors by default; one is a process, too.
    """

    workers: int = field(default_factory=processors)

    @contextmanager
    def open(self) -> Iterator[Hands]:
        """Return the workers; each starts with its first task."""
        crew = _Crew(self.workers)
        try:
            yield crew
        finally:
            crew.close()


@final
class _Crew:
    def __init__(self, workers: int) -> None:
        _start_tracker()
        self._calls: SimpleQueue[_Call | None] = SimpleQueue()
        self._seats = [_Seat(self._calls) for _ in range(workers)]
        for seat in self._seats:
            seat.start()

    def width(self) -> int:
        return 2 * len(self._seats)

    def submit(self, task: Task) -> Future[Report]:
        future: Future[Report] = Future()
        self._calls.put((future, task))
        return future

    def judge(self, error: BaseException) -> StoopError | None:
        if isinstance(error, WorkerLostError):
            return None
        if isinstance(error, StoopError):
            return error
        return CampaignError(f"the workers cannot be reached ({type(error).__name__}: {error}); start again")

    def note(self) -> str:
        return ""

    def close(self) -> None:
        """Let the idle go and end the others."""
        for seat in self._seats:
            seat.leave()
        for _ in self._seats:
            self._calls.put(None)
        for seat in self._seats:
            seat.join()


class _Seat(threading.Thread):
    """A place for one worker, filled anew when it dies."""

    def __init__(self, calls: SimpleQueue[_Call | None]) -> None:
        super().__init__(daemon=True, name="stoop-campaign")
        self._calls = calls
        self._worker: _Worker | None = None
        self._busy = self._leaving = False
        self._lock = threading.Lock()

    def run(self) -> None:
        """Pass tasks on until there are no more."""
        if hasattr(signal, "pthread_sigmask"):  # inherited by the workers: Ctrl-C is the driver's business
            signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        while (call := self._calls.get()) is not None:
            self._serve(*call)
        if self._worker is not None:
            self._worker.part()

    def leave(self) -> None:
        """End the task under way and begin none."""
        with self._lock:
            self._leaving = True
            if self._busy and self._worker is not None:
                self._worker.kill()

    def _serve(self, future: Future[Report], task: Task) -> None:
        try:
            report = self._take().ask(task)
        except (EOFError, OSError) as error:
            future.set_exception(self._bury(error))
        except Exception as error:
            future.set_exception(error)
        else:
            future.set_result(report)
        with self._lock:
            self._busy = False

    def _take(self) -> _Worker:
        """Return the worker, a new one if need be."""
        with self._lock:
            if self._leaving:
                raise EOFError
            self._busy = True
            if self._worker is None:
                self._worker = _Worker()
            return self._worker

    def _bury(self, error: Exception) -> Exception:
        """Forget a dead worker; return what to make of its death."""
        with self._lock:
            worker, self._worker = self._worker, None
        return WorkerLostError(str(error)) if worker is None else worker.verdict()


class _Worker:
    """One process and the pipe to it."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, other = context.Pipe()
        self._process: SpawnProcess = context.Process(target=attend, args=(other,), daemon=True)
        self._ready = False
        try:
            self._process.start()
        finally:
            other.close()

    def ask(self, task: Task) -> Report:
        """Have a task done; EOFError or OSError when the worker dies over it."""
        if not self._ready:
            self._ready = bool(self._pipe.recv())
        self._pipe.send((task.work, task.text, task.stops))
        report: Report = self._pipe.recv()
        return report

    def part(self) -> None:
        """Let an idle worker end by itself, so that it tidies up."""
        self._pipe.close()
        self._process.join(_FAREWELL)
        self.kill()
        self._process.join()

    def kill(self) -> None:
        """End the process in whatever it is doing."""
        with suppress(OSError):
            self._process.kill()

    def verdict(self) -> Exception:
        """Return what to make of a worker whose pipe has ended: one that was killed is replaced, an unfit one is not."""
        self._process.join(_GRACE)
        self.kill()
        self._process.join()
        code = self._process.exitcode
        if not self._ready and code is not None and code > 0:
            return CampaignError(
                f"worker processes do not start (exit code {code}); "
                "a script must call execute under if __name__ == '__main__'"
            )
        return WorkerLostError(f"exit code {code}")


def _start_tracker() -> None:
    """Start multiprocessing's helper process now: starting it later would let Ctrl-C through to a worker."""
    if hasattr(signal, "pthread_sigmask"):
        from multiprocessing import resource_tracker

        resource_tracker.ensure_running()


def attend(pipe: Connection) -> None:
    """Work as a worker: tasks come and reports go through the pipe, until it is closed."""
    threading.Thread(target=_end_with_driver, daemon=True).start()
    _take_one_thread()
    pipe.send(True)
    while True:
        try:
            words = pipe.recv()
        except (EOFError, OSError):
            return
        pipe.send(perform(*words))


def _end_with_driver() -> None:
    """End this process when the driver ends, be it killed: nobody wants the task any more."""
    driver = multiprocessing.parent_process()
    if driver is not None:
        driver.join()
        os._exit(1)


def _take_one_thread() -> None:
    """Keep to one processor: there is a worker for each."""
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    if "numpy" in sys.modules:  # the main script has imported it: too late for the above
        import threadpoolctl

        threadpoolctl.threadpool_limits(1)
