"""Driver, workers and scheduler are killed at random moments; the table does not notice, and nothing is done twice."""

from __future__ import annotations

import os
import random
import shutil
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil
import pytest
from recovery.campaign_case import LOG, STOPS, TASKS

import stoop

CASE = Path(__file__).with_name("campaign_case.py")
KILLS = 8
AGAIN = 5  #: executions that one kill may cost: what is under way or on its way to the store


@dataclass
class Scene:
    """A folder, the log of executions in it, and the driver."""

    folder: Path
    code: Path
    options: list[str]
    driver: psutil.Popen | None = None
    started: list[psutil.Popen] = field(default_factory=list)
    ends: list[tuple[int, set[str]]] = field(default_factory=list)

    @property
    def environment(self) -> dict[str, str]:
        return {**os.environ, LOG: str(self.folder / "log"), "PYTHONPATH": str(self.code)}

    def start(self, *words: str, name: str = "driver") -> psutil.Popen:
        with (self.folder / f"{name}.err").open("w") as errors:
            process = psutil.Popen(
                [sys.executable, *words],
                env=self.environment,
                cwd=self.folder,
                stdout=errors,
                stderr=errors,
                stdin=subprocess.DEVNULL,
            )
        self.started.append(process)
        return process

    def drive(self) -> psutil.Popen:
        """Return the running driver, started if need be: the same command each time."""
        if self.driver is None or self.driver.poll() is not None:
            self.driver = self.start(str(self.code / CASE.name), "store.sqlite", "table.csv", *self.options)
        return self.driver

    def executed(self) -> list[str]:
        with suppress(FileNotFoundError):
            return (self.folder / "log").read_text().split()
        return []

    def committed(self) -> set[str]:
        """Return the tasks in the store; a half-written transaction is rolled back by this."""
        with closing(sqlite3.connect(self.folder / "store.sqlite")) as store:
            if not store.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
                return set()
            keys = {key for (key,) in store.execute("SELECT key FROM runs")}
        done = {str(int(key.partition("/")[0])) for key in keys}
        assert len(keys) == len(done) * len(STOPS), "a task is committed whole or not at all"
        return done

    def note_end(self) -> None:
        self.ends.append((len(self.executed()), self.committed()))

    def finish(self) -> bytes:
        """Let the driver come to its end; return the table."""
        driver = self.drive()
        assert driver.wait() == 0, self.errors()
        return (self.folder / "table.csv").read_bytes()

    def errors(self) -> str:
        return (self.folder / "driver.err").read_text()

    def check_nothing_done_twice(self, kills: int) -> None:
        executed = self.executed()
        for length, committed in self.ends:
            assert not committed & set(executed[length:])
        assert len(set(executed)) == TASKS
        assert len(executed) - TASKS <= AGAIN * kills


def wait_until(true: Callable[[], bool]) -> None:
    while not true():
        time.sleep(0.002)


def await_moment(scene: Scene, chance: random.Random, startup: float) -> bool:
    """Wait for a random moment: in the driver's first second, or a few executions from now; False if it was done."""
    driver = scene.drive()
    if startup:
        time.sleep(chance.uniform(0.0, startup))
    else:
        goal = len(scene.executed()) + chance.randint(1, 8)
        wait_until(lambda: len(scene.executed()) >= goal or driver.poll() is not None)
        time.sleep(chance.uniform(0.0, 0.03))
    assert not driver.poll(), scene.errors()
    return driver.poll() is None


def kill_driver(scene: Scene, workers_end_too: bool) -> None:
    driver = scene.drive()
    family = driver.children(recursive=True) if workers_end_too else []
    driver.kill()
    driver.wait()
    _, alive = psutil.wait_procs(family)
    assert not alive, "workers outlive their driver"
    scene.note_end()


def kill_child(scene: Scene, chance: random.Random) -> None:
    """Kill a worker process, be it at work or just starting."""

    def workers() -> list[psutil.Process]:
        found = []
        for child in scene.drive().children():
            with suppress(psutil.Error):
                if any("spawn_main" in word for word in child.cmdline()):
                    found.append(child)
        return found

    wait_until(lambda: bool(workers()))
    with suppress(psutil.NoSuchProcess):
        chance.choice(sorted(workers(), key=lambda p: p.pid)).kill()


@pytest.fixture(scope="module")
def code(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the package: a store is refused when somebody edits the sources meanwhile."""
    folder = tmp_path_factory.mktemp("code")
    shutil.copytree(
        Path(stoop.__file__).parent, folder / "stoop", ignore=shutil.ignore_patterns("__pycache__")
    )
    shutil.copy(CASE, folder)
    return folder


@pytest.fixture(scope="module")
def undisturbed(code: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    scene = Scene(tmp_path_factory.mktemp("undisturbed"), code, ["--workers", "2"])
    with ended(scene):
        table = scene.finish()
    assert sorted(map(int, scene.executed())) == list(range(TASKS))
    return table


@contextmanager
def ended(scene: Scene) -> Iterator[None]:
    """Leave no process behind, whatever happens."""
    try:
        yield
    finally:
        for process in scene.started:
            if process.poll() is None:
                for each in (*process.children(recursive=True), process):
                    with suppress(psutil.NoSuchProcess):
                        each.kill()
                process.wait()


def test_processes(tmp_path: Path, code: Path, undisturbed: bytes) -> None:
    chance = random.Random(1)  # noqa: S311
    kinds = ["startup"] * 2 + ["driver"] * 3 + ["worker"] * (KILLS - 5)
    chance.shuffle(kinds)
    before = psutil.Process().children(recursive=True)  # of other tests: multiprocessing keeps a helper
    while kinds:  # a quick machine may be done before the last kill: then there is another campaign
        scene = Scene(tmp_path / str(len(kinds)), code, ["--workers", "2"])
        scene.folder.mkdir()
        with ended(scene):
            kills = disturb(scene, kinds, chance)
            assert scene.finish() == undisturbed
            scene.check_nothing_done_twice(kills)
            assert not set(psutil.Process().children(recursive=True)) - set(before)


def disturb(scene: Scene, kinds: list[str], chance: random.Random) -> int:
    """Kill as the list says, from its end, until it is empty or the campaign done; return how often."""
    left = len(kinds)
    while kinds and await_moment(scene, chance, 1.0 if kinds[-1] == "startup" else 0.0):
        if kinds.pop() == "worker":
            kill_child(scene, chance)
        else:
            kill_driver(scene, workers_end_too=True)
    return left - len(kinds)


@dataclass
class Cluster:
    """A Dask scheduler and two workers, each a process that is started again when it has ended."""

    scene: Scene
    port: int
    scheduler: psutil.Popen | None = None
    workers: list[psutil.Popen] = field(default_factory=list)

    @property
    def address(self) -> str:
        return f"tcp://127.0.0.1:{self.port}"

    def revive(self) -> None:
        if self.scheduler is None or self.scheduler.poll() is not None:
            words = ("--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard")
            self.scheduler = self._dask("scheduler", *words)
        self.workers = [w for w in self.workers if w.poll() is None]
        while len(self.workers) < 2:
            words = ("--no-nanny", "--nthreads", "1", "--no-dashboard", "--local-directory", "scratch")
            self.workers.append(self._dask("worker", self.address, *words))

    def lose_scheduler(self) -> None:
        """Kill the scheduler; the driver says so in one line, the workers end."""
        assert self.scheduler is not None
        self.scheduler.kill()
        self.scheduler.wait()
        assert self.scene.drive().wait() == 2
        assert self.scene.errors().splitlines()[-1] == (
            f"stoop: error: scheduler {self.address}: lost; what is done is safe: "
            "start the same command again when it is back"
        )
        assert "Traceback" not in self.scene.errors()
        _, starting = psutil.wait_procs(self.workers, 3.0)
        for worker in starting:  # these never knew it, and would wait for it
            worker.kill()
            worker.wait()
        self.scene.note_end()

    def _dask(self, part: str, *words: str) -> psutil.Popen:
        return self.scene.start("-m", "dask", part, *words, name=part)


def free_port() -> int:
    with closing(socket.socket()) as s:
        s.bind(("127.0.0.1", 0))
        port: int = s.getsockname()[1]
    return port


def test_dask(tmp_path: Path, code: Path, undisturbed: bytes) -> None:
    chance = random.Random(2)  # noqa: S311
    kinds = ["driver"] * 4 + ["scheduler"] * 3 + ["worker"] * (KILLS - 7)
    chance.shuffle(kinds)
    cluster = Cluster(Scene(tmp_path, code, []), free_port())
    scene = cluster.scene
    scene.options = ["--scheduler", cluster.address]
    with ended(scene):
        for kind in kinds:
            cluster.revive()
            assert await_moment(scene, chance, 0.0), "done before the last kill: more tasks are needed"
            if kind == "worker":
                chance.choice(cluster.workers).kill()
            elif kind == "driver":
                kill_driver(scene, workers_end_too=False)
            else:
                cluster.lose_scheduler()
        cluster.revive()
        assert scene.finish() == undisturbed
        scene.check_nothing_done_twice(KILLS)
