"""Where tasks are computed: a caller's executor, processes on this machine, or a Dask cluster (extra `distributed`)."""

from __future__ import annotations

import logging
import multiprocessing
import os
import re
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from queue import SimpleQueue
from typing import Any, Final, Protocol, TypeAlias, final

from stoop.base.extras import install
from stoop.base.memory import keep_freed_memory
from stoop.errors import CampaignError, StoopError
from stoop.parallel.plan import Task
from stoop.parallel.worker import Report, perform

_SAFE: Final = "what is done is safe"


class Workers(Protocol):
    """Workers of an open pool."""

    def capacity(self) -> int:
        """Return how many tasks should be under way: few, for each takes memory."""

    def submit(self, task: Task) -> Future[Report]:
        """Begin a task."""

    def failure(self, error: BaseException) -> StoopError | None:
        """Return why a task that has no report ends the campaign; None to submit it once more."""

    def status(self) -> str:
        """Return why nothing advances, empty if all is well; CampaignError if nothing ever will."""
        return ""


class Pool(Protocol):
    """A place to compute tasks."""

    def open(self) -> AbstractContextManager[Workers]:
        """Return the workers for the length of a campaign; tasks that have not begun at its end are canceled by then."""


def processors() -> int:
    """Return how many processors this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


@final
@dataclass(frozen=True)
class Given(Workers):
    """An executor of the caller (threads, processes, MPI), who also shuts it down."""

    executor: Executor
    ahead: int | None = None  #: tasks submitted at once; None is twice the processors

    @contextmanager
    def open(self) -> Iterator[Workers]:
        """Return the workers: the pool itself, as the executor is open already."""
        yield self

    def capacity(self) -> int:
        """Return how many tasks are submitted at once."""
        return self.ahead or 2 * processors()

    def submit(self, task: Task) -> Future[Report]:
        """Begin a task."""
        try:
            return self.executor.submit(perform, task.work, task.text, task.stops)
        except RuntimeError as error:  # broken, or shut down
            raise self.failure(error) from None

    def failure(self, error: BaseException) -> StoopError:
        """Return what became of the executor."""
        reason, remedy = f"failed ({type(error).__name__}: {error})", "start again with another"
        if isinstance(error, BrokenExecutor):
            reason, remedy = "broke: one of its workers died", "make a new one and start again"
        elif isinstance(error, CancelledError):
            reason, remedy = "was shut down", "make a new one and start again"
        return CampaignError(f"the executor {reason}; {remedy}")


# Processes on this machine. Each worker has a thread and a pipe of its own in the driver. A worker that is killed, in
# whatever it is doing, so leaves nothing locked and nothing half sent that another one waits for: its pipe ends, its task
# is lost, the others work on. (`concurrent.futures.ProcessPoolExecutor` shares one pipe and one lock among all workers,
# and ends them all.)

_Call: TypeAlias = tuple["Future[Report]", Task]
ONE_THREAD: Final = (
    "STOOP_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS",
)  # fmt: skip


class WorkerLostError(Exception):
    """A worker ended in the middle of a task, which may well succeed on another one."""


@final
@dataclass(frozen=True)
class LocalProcesses:
    """Processes on this machine, with one thread each for kernels and for linear algebra."""

    workers: int = field(default_factory=processors)  #: one is a process, too

    @contextmanager
    def open(self) -> Iterator[Workers]:
        """Return the workers; each starts with its first task. At the end idle ones end, the others are killed."""
        if hasattr(signal, "pthread_sigmask"):
            # multiprocessing's helper process: starting it later would let Ctrl-C through to a worker
            from multiprocessing import resource_tracker

            resource_tracker.ensure_running()
        calls: SimpleQueue[_Call | None] = SimpleQueue()
        threads = [_WorkerThread(calls) for _ in range(self.workers)]
        for thread in threads:
            thread.start()
        try:
            yield _LocalWorkers(calls, 2 * self.workers)
        finally:
            for thread in threads:
                thread.leave()
            for _ in threads:
                calls.put(None)
            for thread in threads:
                thread.join()


@final
class _LocalWorkers(Workers):
    def __init__(self, calls: SimpleQueue[_Call | None], ahead: int) -> None:
        self._calls, self._ahead = calls, ahead

    def capacity(self) -> int:
        return self._ahead

    def submit(self, task: Task) -> Future[Report]:
        future: Future[Report] = Future()
        self._calls.put((future, task))
        return future

    def failure(self, error: BaseException) -> StoopError | None:
        if isinstance(error, WorkerLostError):
            return None
        if isinstance(error, StoopError):
            return error
        return CampaignError(f"the workers cannot be reached ({type(error).__name__}: {error}); start again")


class _WorkerThread(threading.Thread):
    """Passes tasks on to one process through a pipe, and starts a new one when it dies."""

    _pipe: Connection

    def __init__(self, calls: SimpleQueue[_Call | None]) -> None:
        super().__init__(daemon=True, name="stoop-campaign")
        self._calls = calls
        self._process: SpawnProcess | None = None
        self._busy = self._leaving = self._ready = False
        self._lock = threading.Lock()

    def run(self) -> None:
        """Pass tasks on until there are no more; the idle process has 5 s to end by itself, so that it cleans up."""
        if hasattr(signal, "pthread_sigmask"):  # inherited by the workers: Ctrl-C is the driver's business
            signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        while (call := self._calls.get()) is not None:
            future, task = call
            if not future.set_running_or_notify_cancel():
                continue
            try:
                self._begin()
                if not self._ready:
                    self._ready = bool(self._pipe.recv())
                self._pipe.send((task.work, task.text, task.stops))
                future.set_result(self._pipe.recv())
            except (EOFError, OSError) as error:
                future.set_exception(self._cause_of_loss(error))
            except Exception as error:
                future.set_exception(error)
            with self._lock:
                self._busy = False
        if self._process is not None:
            self._pipe.close()
            self._end(self._process, 5.0)

    def leave(self) -> None:
        """End the task under way and begin none."""
        with self._lock:
            self._leaving = True
            if self._busy and self._process is not None:
                with suppress(OSError):
                    self._process.kill()

    def _begin(self) -> None:
        """Start a process if there is none."""
        with self._lock:
            if self._leaving:
                raise EOFError
            self._busy = True
            if self._process is None:
                context = multiprocessing.get_context("spawn")
                pipe, other = context.Pipe()
                process = context.Process(target=serve, args=(other,), daemon=True)
                try:
                    process.start()
                finally:
                    other.close()
                self._process, self._pipe, self._ready = process, pipe, False

    def _cause_of_loss(self, error: Exception) -> Exception:
        """Return what the end of the pipe means: a process that was killed is replaced, one that cannot start is not."""
        with self._lock:
            process, self._process = self._process, None
        if process is None:
            return WorkerLostError(str(error))
        self._end(process, 1.0)
        code = process.exitcode
        if not self._ready and code is not None and code > 0:
            return CampaignError(
                f"worker processes do not start (exit code {code}); "
                "a script must call execute under if __name__ == '__main__'"
            )
        return WorkerLostError(f"exit code {code}")

    @staticmethod
    def _end(process: SpawnProcess, patience: float) -> None:
        """Wait for the end of a process, s, and then kill it in whatever it is doing."""
        process.join(patience)
        with suppress(OSError):
            process.kill()
        process.join()


def serve(pipe: Connection) -> None:
    """Compute tasks as a worker, on one thread: they come, and reports go, through the pipe, until it is closed."""

    def end_with_driver() -> None:  # even if it is killed
        driver = multiprocessing.parent_process()
        if driver is not None:
            driver.join()
            os._exit(1)

    threading.Thread(target=end_with_driver, daemon=True).start()
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    keep_freed_memory()
    if "numpy" in sys.modules:  # the main script has imported it: too late for the above
        import threadpoolctl

        threadpoolctl.threadpool_limits(1)
    pipe.send(True)
    while True:
        try:
            task = pipe.recv()
        except (EOFError, OSError):
            return
        pipe.send(perform(*task))


# A Dask cluster. Futures are passed on by hand: those of `Client.get_executor` stay undone for ever when the connection
# breaks while a result is being fetched, and the bare ones are not for `concurrent.futures.wait`. They are awaited on the
# client's own loop: Dask's callbacks share one thread among all clients of a process, and one that was closed while it
# fetched a result may hold it for ever.

_ADDRESS: Final = re.compile(r"(tcp|tls|ws|wss)://(?:\[([^\s/\[\]]+)\]|([^\s/:\[\]]+)):(\d{1,5})")
_ATTEMPT: Final = 0.2  #: s between attempts to reach the scheduler


@final
@dataclass(frozen=True)
class Dask:
    """The workers of a Dask scheduler.

    Raises
    ------
    CampaignError
        It is no such address.
    """

    address: str  #: "tcp://host:port"
    timeout: float = 10.0  #: s to wait for the scheduler

    def __post_init__(self) -> None:
        self._parts()

    def _parts(self) -> tuple[str, str, int]:
        """Return protocol, host and port."""
        found = _ADDRESS.fullmatch(self.address)
        if found is None or not 0 < int(found[4]) < 1 << 16:
            raise CampaignError(
                f"scheduler {self.address!r}: is no address; give tcp://HOST:PORT as dask scheduler prints it"
            )
        return found[1], found[2] or found[3], int(found[4])

    @contextmanager
    def open(self) -> Iterator[Workers]:
        """Return the workers.

        Raises
        ------
        CampaignError
            The scheduler cannot be reached, or the extra is not installed.
        """
        try:
            from distributed import Client
        except ImportError:
            raise CampaignError(
                f"a Dask scheduler needs the package distributed; {install('distributed')}"
            ) from None
        # the campaign reports a lost scheduler in one line: the log of Dask's client is switched off
        loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client")]
        levels = [logger.level for logger in loggers]
        for logger in loggers:
            logger.setLevel(logging.CRITICAL)
        try:
            client = self._connect(Client)
            try:
                yield _DaskWorkers(client, self.address, self.timeout)
            finally:
                with suppress(Exception):  # in any state: the campaign's own error counts
                    client.close(timeout=self.timeout)
        finally:
            for logger, level in zip(loggers, levels, strict=True):
                logger.setLevel(level)

    def _connect(self, make: type[Any]) -> Any:
        """Return a client, once the scheduler answers; over plain TCP it speaks first.

        A client that fails leaves threads behind, which complain later, and waits for ever where something else than
        a scheduler listens; so none is made before.
        """
        end = time.monotonic() + self.timeout
        protocol, host, port = self._parts()
        try:
            while True:
                patience = max(end - time.monotonic(), _ATTEMPT)
                try:
                    with socket.create_connection((host, port), patience) as connection:
                        if protocol == "tcp" and not connection.recv(1):
                            raise ConnectionResetError("what listens there hangs up")
                    break
                except OSError:
                    if time.monotonic() + _ATTEMPT > end:
                        raise
                time.sleep(_ATTEMPT)
            client: Any = object.__new__(make)
            try:
                client.__init__(self.address, timeout=self.timeout, set_as_default=False)
            except BaseException:
                client.status = "closed"  # else it tries to close itself when it is collected
                raise
            return client
        except Exception as error:  # a stranger's answer may be anything, a lack of memory included
            raise CampaignError(
                f"scheduler {self.address}: cannot be reached ({_first_line(error)}); check the address, and that "
                "dask scheduler runs there"
            ) from error


@final
class _DaskWorkers(Workers):
    def __init__(self, client: Any, address: str, timeout: float) -> None:
        self._client, self._address, self._timeout = client, address, timeout
        self._link = client.scheduler_comm  # another one after a reconnection: then our tasks are forgotten
        self._perform = _portable_perform()
        self._checked, self._threads, self._silent = -2.0, 0, False

    def capacity(self) -> int:
        self._count_threads()
        return 2 * max(self._threads, 1)

    def submit(self, task: Task) -> Future[Report]:
        future: Future[Report] = Future()
        future.set_running_or_notify_cancel()

        async def settle() -> None:  # as Dask's one was settled, whatever fetching its result raises
            try:
                future.set_result(await theirs.result())
            except Exception as error:
                future.set_exception(error)
            except BaseException:  # asyncio's cancellation is none of the driver's exceptions
                future.set_exception(CancelledError())

        self._check()
        theirs = self._client.submit(self._perform, task.work, task.text, task.stops, pure=False)
        self._client.loop.add_callback(settle)
        return future

    def failure(self, error: BaseException) -> StoopError | None:
        from distributed import KilledWorker

        if isinstance(error, KilledWorker):
            return None
        if isinstance(error, CancelledError) or self._is_gone():
            return self._lost()
        if isinstance(error, OSError):  # the connection broke while the result was fetched
            return None
        return CampaignError(f"cluster {self._address}: {_first_line(error)}; {_SAFE}, start again")

    def status(self) -> str:
        self._check()
        self._count_threads()
        if self._silent:
            return f"waiting for the scheduler {self._address} to answer"
        return "" if self._threads else f"waiting for a worker to join {self._address}"

    def _is_gone(self) -> bool:
        return self._client.status != "running" or self._client.scheduler_comm is not self._link

    def _check(self) -> None:
        if self._is_gone():
            raise self._lost()

    def _count_threads(self) -> None:
        """Count the threads of the workers, every 2 s."""
        now = time.monotonic()
        if now - self._checked < 2.0 and self._threads:
            return
        self._checked = now
        try:
            self._threads = sum(self._client.nthreads(callback_timeout=self._timeout).values())
            self._silent = False
        except TimeoutError:
            self._silent = True
        except Exception as error:
            raise self._lost() from error

    def _lost(self) -> CampaignError:
        advice = f"{_SAFE}: start the same command again when it is back"
        return CampaignError(f"scheduler {self._address}: lost; {advice}")


def _portable_perform() -> Callable[[str, str, list[int | None]], Report]:
    """Return a function that is sent whole, as an inner one is, not as the name of something to import.

    A worker without the package cannot even unpickle such a name: it dies, and its successor, too.
    """

    def call(work: str, text: str, stops: list[int | None]) -> Report:
        try:
            from stoop.parallel.worker import perform
        except (ImportError, AttributeError) as error:
            what = f"its worker has no stoop, or another version ({error}); install the same as here"
            return {"worker": "", "environment": {}, "results": [], "failure": what, "trace": ""}
        return perform(work, text, stops)

    return call


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
