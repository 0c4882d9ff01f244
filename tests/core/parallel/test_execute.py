"""The result does not depend on who does the work, in which order, or how often it was interrupted."""

import itertools
import signal
import sqlite3
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from helpers.works import HERE, failing, walks

from stoop.parallel import CampaignError, Given, LocalProcesses, Plan, Pool, Run, Tally, environment, execute
from stoop.parallel.loop import MAX_LOSSES
from stoop.parallel.plan import Task
from stoop.parallel.worker import Report, perform


class Here:
    """Does one task at a time, the last one first, in this thread; `before` is called before each."""

    def __init__(self, before: Callable[[], None] = lambda: None) -> None:
        self.before = before
        self.submitted = self.most = 0

    @contextmanager
    def open(self):  # type: ignore[no-untyped-def]
        yield self

    def capacity(self) -> int:
        return 3

    def submit(self, task: Task) -> Future[Report]:
        self.submitted += 1
        self.before()
        future: Future[Report] = Future()
        future.set_result(perform(task.work, task.text, task.stops))
        return future

    def failure(self, error: BaseException) -> None:
        return None

    def status(self) -> str:
        return ""


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "log"


def lines(log: Path) -> list[str]:
    return sorted(log.read_text().splitlines()) if log.exists() else []


def test_whoever_does_it_the_bytes_are_the_same(tmp_path: Path, log: Path) -> None:
    plan, tables = walks(log, 4, (None, 3, 7)), []
    with ThreadPoolExecutor(3) as executor:
        pools: list[Pool] = [Here(), Given(executor), LocalProcesses(2)]
        texts = [str(list(execute(plan, tmp_path / f"{i}.sqlite", p).items())) for i, p in enumerate(pools)]
    assert len(set(texts)) == 1
    assert texts[0].startswith("[('000/3', {'step': 3, 'x': ")
    for i in range(3):
        with closing(sqlite3.connect(tmp_path / f"{i}.sqlite")) as stored:
            tables.append(stored.execute("SELECT * FROM runs ORDER BY key").fetchall())
    assert tables[0] == tables[1] == tables[2]


def test_a_prefix_is_computed_once_and_more_runs_extend_a_store(tmp_path: Path, log: Path) -> None:
    found = execute(walks(log, 2, (7, None, 3)), tmp_path / "s", Here())
    assert lines(log) == ["0 [3, 7, None]", "1 [3, 7, None]"]
    assert list(found) == ["000/3", "000/7", "000/None", "001/3", "001/7", "001/None"]
    assert [found[f"000/{stop}"]["step"] for stop in (3, 7, None)] == [3, 7, 100]  # type: ignore[call-overload,index]
    log.unlink()
    first = execute(walks(log, 2, (3,)), tmp_path / "t", Here())
    more = execute(walks(log, 3, (3, 7)), tmp_path / "t", Here())
    assert lines(log) == ["0 [3]", "0 [7]", "1 [3]", "1 [7]", "2 [3, 7]"]
    assert first.items() <= more.items()
    idle = Here()
    assert execute(walks(log, 2, (3,)), tmp_path / "t", idle) == first
    with pytest.raises(Exception, match="other settings"):
        execute(replace(walks(log, 2), settings={"map": "tent"}), tmp_path / "t", idle)
    assert not idle.submitted


def test_few_tasks_are_under_way_at_once(tmp_path: Path, log: Path) -> None:
    queued: list[int] = []
    with ThreadPoolExecutor(1) as executor:
        given = Given(executor, ahead=4)
        execute(walks(log, 30), tmp_path / "s", given, lambda _: queued.append(executor._work_queue.qsize()))
        with suppress(CampaignError):
            execute(failing("plain", log), tmp_path / "f", given)
        assert executor.submit(threading.active_count).result(), "the caller's executor stays open"
    assert max(queued) <= 4


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_a_task_that_answers_an_interrupt_with_its_best_has_no_result(kind: int, tmp_path: Path) -> None:
    """A search does so, and half of it must not count as one that came to its end."""
    before = signal.signal(kind, signal.default_int_handler)
    plan = Plan("p", {}, (Run("1", f"{HERE}:interrupted", {"signal": int(kind)}),))
    try:
        with pytest.raises(KeyboardInterrupt):
            execute(plan, tmp_path / "s.sqlite", Here())
    finally:
        signal.signal(kind, before)
    with closing(sqlite3.connect(tmp_path / "s.sqlite")) as store:
        assert store.execute("SELECT count(*) FROM runs").fetchone() == (0,)


def test_ctrl_c_keeps_what_was_done(tmp_path: Path, log: Path) -> None:
    count = iter(range(100))

    def press() -> None:
        if next(count) == 7:
            signal.raise_signal(signal.SIGINT)

    plan = walks(log, 12)
    with pytest.raises(KeyboardInterrupt):
        execute(plan, tmp_path / "s", Here(press))
    assert len(lines(log)) == 7
    seen: list[Tally] = []
    whole = execute(plan, tmp_path / "s", Here(), seen.append)
    assert seen[0].restored == 7, "those that had ended and were not yet looked at included"
    assert len(lines(log)) == 12
    assert whole == execute(plan, tmp_path / "other", Here())


class Unsettled(Here):
    """Begins one task, and settles it from another thread when the campaign is over, as the end of a worker does."""

    @contextmanager
    def open(self):  # type: ignore[no-untyped-def]
        self.future: Future[Report] = Future()
        self.future.set_running_or_notify_cancel()
        try:
            yield self
        finally:
            sys.settrace(None)
            settling = threading.Thread(target=self.future.set_exception, args=(EOFError(),), daemon=True)
            settling.start()
            settling.join(10.0)
            assert not settling.is_alive(), "the interrupt left a lock behind"

    def submit(self, task: Task) -> Future[Report]:
        if self.submitted:
            return super().submit(task)  # done at once, so that nothing waits
        self.submitted += 1
        return self.future


def enough(tally: Tally) -> None:
    if tally.done:
        raise StopIteration  # the campaign has waited once


def test_ctrl_c_at_any_moment_leaves_no_lock_behind(tmp_path: Path) -> None:
    """At each line and at each return of the standard library's code that takes locks."""
    plan = walks(tmp_path / "log", 2)
    for moment in itertools.count(1):
        moments = itertools.count(1)

        def press(frame: FrameType, event: str, _: object, now: int = moment, left: Any = moments) -> Any:
            if Path(frame.f_code.co_filename).name not in ("_base.py", "threading.py"):
                return None
            if event != "call" and next(left) == now:
                signal.raise_signal(signal.SIGINT)
            return press

        pool = Unsettled(lambda press=press: sys.settrace(press))  # type: ignore[misc]
        with pytest.raises((KeyboardInterrupt, StopIteration)):
            execute(plan, tmp_path / f"{moment}.sqlite", pool, enough)
        if next(moments) <= moment:
            break
    assert moment > 30


def test_a_failure_names_the_run_and_costs_nothing_else(tmp_path: Path, log: Path) -> None:
    for how, what in (
        ("stoop", "elevator: does not move; choose another; correct that"), ("plain", "ValueError: first; correct that"),
        ("leave", "SystemExit: 3;"), ("array", "result 0: a ndarray is not JSON"),
        ("short", "helpers.works:fail must return a list of 1 results"),
    ):  # fmt: skip
        with pytest.raises(CampaignError, match=f"^run bad: {what}") as caught:
            execute(failing(how, log, 5), tmp_path / how, Here())
        assert "\n" not in "".join(map(str, caught.value.args))
        assert len(execute(walks(log, 5), tmp_path / how, Here())) == len(lines(log)) == 5
        log.unlink()
    for work in ("nowhere:f", f"{HERE}:nothing", "no colon", ""):
        with pytest.raises(CampaignError, match=r"^run a: "):
            execute(Plan("p", {}, (Run("a", work, {}),)), tmp_path / "s", Here())


def test_a_worker_with_another_library_is_refused(tmp_path: Path, log: Path) -> None:
    class Elsewhere(Here):
        def submit(self, task: Task) -> Future[Report]:
            future = super().submit(task)
            future.result()["environment"] = {**environment(), "numpy": "0.1"}
            return future

    with pytest.raises(CampaignError, match=r"^worker process \d+ on .*numpy .* here, 0.1 there"):
        execute(walks(log, 3), tmp_path / "s", Elsewhere())
    assert len(execute(walks(log, 3), tmp_path / "s", Here())) == 3


def test_lost_tasks_are_done_again_and_a_hopeless_one_ends_it(tmp_path: Path, log: Path) -> None:
    class Dying(Here):
        def submit(self, task: Task) -> Future[Report]:
            key = task.runs[0].key
            if key != "bad" and key in lost:
                return super().submit(task)
            lost.append(key)
            future: Future[Report] = Future()
            future.set_exception(RuntimeError("died"))
            return future

    lost: list[str] = []
    with pytest.raises(CampaignError, match=rf"^run bad: its worker died {MAX_LOSSES} times .*\(died\)"):
        execute(failing("die", log, 6), tmp_path / "s", Dying())
    assert len(lines(log)) == 6, "the others came first"
    assert len(lost) >= 6 + MAX_LOSSES


def test_a_broken_or_closed_executor(tmp_path: Path, log: Path) -> None:
    executor = ThreadPoolExecutor(1)
    executor.shutdown()
    with pytest.raises(CampaignError, match="executor"):
        execute(walks(log, 1), tmp_path / "s", Given(executor))
    with ProcessPoolExecutor(1) as processes, pytest.raises(CampaignError, match="executor broke"):
        execute(failing("die", log), tmp_path / "s", Given(processes))
