"""The driver: hands out tasks, commits what comes back, counts."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from stoop.errors import CampaignError, StoopError
from stoop.parallel.canonical import Json, from_text
from stoop.parallel.environment import differences, environment
from stoop.parallel.plan import Plan, Task, tasks
from stoop.parallel.pool import Hands, Pool
from stoop.parallel.sources import work_sources
from stoop.parallel.store import Store, open_store
from stoop.parallel.task import Report

LOSSES: Final = 5  #: times that one task may take its worker along while no other task ends
_POLL = 0.5  #: s between looks at the workers while nothing comes back


@dataclass(frozen=True)
class Tally:
    """How far a campaign is.

    Attributes
    ----------
    done : runs in the store, of this plan
    total : runs of the plan
    restored : runs that were there before
    seconds : s, since the start
    seconds_left : s, from the speed so far; None before the first task has ended
    note : why nothing moves; empty if all is well
    """

    done: int
    total: int
    restored: int
    seconds: float
    seconds_left: float | None
    note: str = ""


def execute(
    plan: Plan, path: Path, pool: Pool, watch: Callable[[Tally], None] | None = None
) -> dict[str, Json]:
    """Do what of a plan is not yet done, and return the results of all of its runs.

    Each task is committed to the store as it ends. Whatever ends this function (an error, Ctrl-C, a kill), what is
    committed stays, and calling it again with the same plan goes on from there.

    Parameters
    ----------
    plan : Plan
    path : Path
        The store; made if it is not there. Its folder is made, too.
    pool : Pool
        `LocalProcesses`, `Dask`, or `Given` for any executor. It is not opened when nothing is left to do.
    watch : callable, optional
        Told a `Tally` at the start, after each task, and about twice a second meanwhile.

    Returns
    -------
    dict of str to Json
        Key to result, sorted by key; the same to the last bit whatever the pool, the interruptions and the order in which
        tasks ended.

    Raises
    ------
    OutputError
        The store is not fit, see :func:`stoop.parallel.store.open_store`, or cannot be written.
    CampaignError
        A run failed, workers die over and over, or cannot be reached.
    """
    here = {**environment(), **work_sources(run.work for run in plan.runs)}
    with open_store(path, plan, here) as store:
        left = tasks(store.missing(plan.runs))
        drive = _Drive(store, deque(left), len(plan.runs), watch or _ignore, here)
        drive.tell("")
        if left:
            with pool.open() as hands:
                drive.until_done(hands)
        return {key: from_text(text) for key, text in store.results(plan.runs).items()}


def _ignore(tally: Tally) -> None:
    """Watch nothing."""


@dataclass
class _Drive:
    """A campaign under way."""

    store: Store
    queue: deque[Task]
    total: int
    watch: Callable[[Tally], None]
    environment: Mapping[str, str]
    flying: dict[Future[Report], Task] = field(default_factory=dict)
    losses: Counter[str] = field(default_factory=Counter)
    began: float = field(default_factory=time.monotonic)

    def __post_init__(self) -> None:
        self.left = sum(len(task.runs) for task in self.queue)
        self.restored = self.total - self.left

    def tell(self, note: str) -> None:
        """Tell the watcher how far we are."""
        done, seconds = self.total - self.left, time.monotonic() - self.began
        fresh = done - self.restored
        seconds_left = seconds / fresh * self.left if fresh else None
        self.watch(Tally(done, self.total, self.restored, seconds, seconds_left, note))

    def until_done(self, hands: Hands) -> None:
        """Work until nothing is left."""
        try:
            while self.queue or self.flying:
                self._submit(hands)
                ended, _ = wait(self.flying, _POLL, FIRST_COMPLETED)
                for future in ended:
                    self._take(future, hands)
                self.tell(hands.note())
        except BaseException:
            self._keep_what_ended(hands)
            raise

    def _submit(self, hands: Hands) -> None:
        room = hands.width() - len(self.flying)
        for _ in range(min(room, len(self.queue))):
            self.flying[hands.submit(self.queue[0])] = self.queue[0]
            self.queue.popleft()

    def _take(self, future: Future[Report], hands: Hands) -> None:
        """Commit what came back; one transaction."""
        task = self.flying[future]
        try:
            report = future.result()
        except Exception as error:
            del self.flying[future]
            self._again(task, error, hands.judge(error))
            return
        _check(report, task, self.environment)
        self.store.add(task.runs, report["results"])
        del self.flying[future]
        self.left -= len(task.runs)
        self.losses.clear()

    def _again(self, task: Task, error: Exception, reason: StoopError | None) -> None:
        """Put a lost task behind the others, unless it is hopeless."""
        if reason is not None:
            raise reason from error
        self.queue.append(task)
        key = task.runs[0].key
        self.losses[key] += 1
        if self.losses[key] >= LOSSES:
            raise CampaignError(
                f"run {key}: its worker died {LOSSES} times ({error}), and no other task ended meanwhile; see whether the memory "
                "is enough, and whether the run works by itself; what is done is safe"
            ) from error

    def _keep_what_ended(self, hands: Hands) -> None:
        """Commit what is done although the campaign ends here."""
        for future in [f for f in self.flying if f.done()]:
            with suppress(StoopError):
                self._take(future, hands)


def _check(report: Report, task: Task, here: Mapping[str, str]) -> None:
    """Refuse a failure, and results of a worker that computes otherwise."""
    unlike = differences(here, report["environment"])
    if unlike:
        raise CampaignError(
            f"worker {report['worker']}: not the environment of this process ({unlike}); install the same on all machines, "
            "edit nothing meanwhile, and start again; what is done is safe"
        )
    if report["failure"]:
        error = CampaignError(
            f"run {task.runs[0].key}: {report['failure']}; mend that and start again, what is done is safe"
        )
        if report["trace"]:
            error.add_note(report["trace"])
        raise error
