"""Where tasks are done: what the campaign asks of it, and any executor as such a place."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Protocol, final

from stoop.errors import CampaignError, StoopError
from stoop.parallel.plan import Task
from stoop.parallel.task import Report, perform


class WorkerLostError(Exception):
    """A worker ended in the middle of a task, which may well succeed on another one."""


class Hands(Protocol):
    """Workers at work."""

    def width(self) -> int:
        """Return how many tasks are worth having under way: few, for each takes memory."""

    def submit(self, task: Task) -> Future[Report]:
        """Begin a task."""

    def judge(self, error: BaseException) -> StoopError | None:
        """Return why a task that has no report ends the campaign; None to submit it once more."""

    def note(self) -> str:
        """Return why nothing moves; empty if all is well.

        Raises
        ------
        CampaignError
            It never will.
        """


class Pool(Protocol):
    """Somewhere to work."""

    def open(self) -> AbstractContextManager[Hands]:
        """Return the workers for the length of a campaign; tasks under way at its end are dropped."""


def processors() -> int:
    """Return how many processors this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


@final
@dataclass(frozen=True)
class Given:
    """An executor of the caller's (threads, processes, MPI), who also shuts it down.

    Attributes
    ----------
    executor : concurrent.futures.Executor
    ahead : int, optional
        How many tasks are submitted at once; twice the processors when absent.
    """

    executor: Executor
    ahead: int | None = None

    @contextmanager
    def open(self) -> Iterator[Hands]:
        """Return the workers."""
        hands = _GivenHands(self.executor, self.ahead or 2 * processors())
        try:
            yield hands
        finally:
            hands.drop()


@final
class _GivenHands:
    def __init__(self, executor: Executor, ahead: int) -> None:
        self._executor, self._ahead = executor, ahead
        self._begun: set[Future[Report]] = set()

    def width(self) -> int:
        return self._ahead

    def submit(self, task: Task) -> Future[Report]:
        try:
            future = self._executor.submit(perform, task.work, task.text, task.stops)
        except RuntimeError as error:  # broken, or shut down
            raise self.judge(error) from None
        self._begun.add(future)
        future.add_done_callback(self._begun.discard)
        return future

    def judge(self, error: BaseException) -> StoopError:
        if isinstance(error, BrokenExecutor):
            return CampaignError(
                "the executor broke: one of its workers died; make a new one and start again"
            )
        if isinstance(error, CancelledError):
            return CampaignError("the executor was shut down; make a new one and start again")
        return CampaignError(
            f"the executor failed ({type(error).__name__}: {error}); start again with another"
        )

    def note(self) -> str:
        return ""

    def drop(self) -> None:
        for future in list(self._begun):
            future.cancel()
