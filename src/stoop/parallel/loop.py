"""The driver: submits tasks, commits what comes back, counts."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from stoop.base.interrupts import delayed_interrupts
from stoop.errors import CampaignError, StoopError
from stoop.parallel.plan import Json, Plan, Task, from_text, tasks
from stoop.parallel.pools import Given, LocalProcesses, Pool, Workers
from stoop.parallel.store import Store, open_store
from stoop.parallel.worker import Report, differences, environment

MAX_LOSSES: Final = 5  #: of the worker of one task while no other task ends


@dataclass(frozen=True)
class Tally:
    """Progress of a campaign."""

    done: int  #: runs in the store, of this plan
    total: int  #: runs of the plan
    restored: int  #: runs that were there before
    seconds: float  #: s, since the start
    seconds_left: float | None  #: s, from the speed so far; None before the first task has ended
    note: str = ""  #: why nothing advances; empty if all is well


def execute(
    plan: Plan, path: Path, pool: Pool | Executor | None = None, watch: Callable[[Tally], None] | None = None
) -> dict[str, Json]:
    """Compute what of a plan is not yet done, and return the results of all of its runs.

    Each task is committed to the store as it ends. Whatever ends this function (an error, Ctrl-C, a kill), what is
    committed stays, and calling it again with the same plan goes on from there.

    Parameters
    ----------
    plan : Plan
    path : Path
        The store; made if it is not there. Its folder is made, too.
    pool : Pool or Executor
        `LocalProcesses` (by default), `Dask`, or any executor. It is not opened when nothing is left to do.
    watch : callable, optional
        Called with a `Tally` at the start, after each task, and about twice a second meanwhile.

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
    here = environment(run.work for run in plan.runs)
    with open_store(path, plan, here) as store:
        missing, began = store.missing(plan.runs), time.monotonic()
        driver = _Driver(store, tasks(missing), len(missing), here)

        def report(note: str) -> None:
            done, seconds = len(plan.runs) - driver.left, time.monotonic() - began
            restored = len(plan.runs) - len(missing)
            seconds_left = seconds / (done - restored) * driver.left if done > restored else None
            if watch is not None:
                watch(Tally(done, len(plan.runs), restored, seconds, seconds_left, note))

        report("")
        if missing:
            with (Given(pool) if isinstance(pool, Executor) else pool or LocalProcesses()).open() as workers:
                driver.run(workers, report)
        return {key: from_text(text) for key, text in store.results(plan.runs).items()}


class _Driver:
    """A campaign under way; `left` counts its runs that are not yet done."""

    def __init__(self, store: Store, queue: list[Task], left: int, here: dict[str, str]) -> None:
        self._store, self._queue, self.left, self._here = store, deque(queue), left, here
        self._under_way: dict[Future[Report], Task] = {}
        self._losses: Counter[str] = Counter()

    def run(self, workers: Workers, report: Callable[[str], None]) -> None:
        """Compute until nothing is left; what is done when an error ends the campaign is committed."""
        try:
            while self._queue or self._under_way:
                for _ in range(min(workers.capacity() - len(self._under_way), len(self._queue))):
                    self._under_way[workers.submit(self._queue[0])] = self._queue[0]
                    self._queue.popleft()
                with delayed_interrupts():
                    ended, _ = wait(self._under_way, 0.5, FIRST_COMPLETED)
                for future in ended:
                    self._commit(future, workers)
                report(workers.status())
        except BaseException:
            with delayed_interrupts():
                done = [future for future in self._under_way if future.done()]
                for future in self._under_way:
                    future.cancel()
                for future in done:
                    with suppress(StoopError):
                        self._commit(future, workers)
            raise

    def _commit(self, future: Future[Report], workers: Workers) -> None:
        """Commit the results of a task in one transaction; queue a lost task behind the others."""
        task = self._under_way[future]
        key = task.runs[0].key
        try:
            report = future.result()
        except Exception as error:
            del self._under_way[future]
            reason = workers.failure(error)
            if reason is not None:
                raise reason from error
            self._queue.append(task)
            self._losses[key] += 1
            if self._losses[key] >= MAX_LOSSES:
                raise CampaignError(
                    f"run {key}: its worker died {MAX_LOSSES} times ({error}), and no other task ended meanwhile; see "
                    "whether the memory is enough, and whether the run works by itself; what is done is safe"
                ) from error
            return
        unlike = differences(self._here, report["environment"])
        if unlike:
            raise CampaignError(
                f"worker {report['worker']}: not the environment of this process ({unlike}); install the same on all "
                "machines, edit nothing meanwhile, and start again; what is done is safe"
            )
        if report["failure"]:
            remedy = "correct that and start again, what is done is safe"
            failed = CampaignError(f"run {key}: {report['failure']}; {remedy}")
            if report["trace"]:
                failed.add_note(report["trace"])
            raise failed
        self._store.add(task.runs, report["results"])
        del self._under_way[future]
        self.left -= len(task.runs)
        self._losses.clear()
