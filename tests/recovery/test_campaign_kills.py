"""Driver and workers are killed at random moments; the table does not notice, and nothing is done twice."""

from __future__ import annotations

import os
import random
import shutil
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
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
                [sys.executable, *words], env=self.environment, cwd=self.folder, stdout=errors, stderr=errors,
                stdin=subprocess.DEVNULL,
            )  # fmt: skip
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


def await_moment(scene: Scene, chance: random.Random, startup: float) -> bool:
    """Wait for a random moment: in the driver's first second, or a few executions from now; False if it was done."""
    driver = scene.drive()
    if startup:
        time.sleep(chance.uniform(0.0, startup))
    else:
        goal = len(scene.executed()) + chance.randint(1, 8)
        while len(scene.executed()) < goal and driver.poll() is None:
            time.sleep(0.002)
        time.sleep(chance.uniform(0.0, 0.03))
    assert not driver.poll(), scene.errors()
    return driver.poll() is None


def kill_driver(scene: Scene) -> None:
    driver = scene.drive()
    family = driver.children(recursive=True)
    driver.kill()
    driver.wait()
    _, alive = psutil.wait_procs(family)
    assert not alive, "workers outlive their driver"
    scene.ends.append((len(scene.executed()), scene.committed()))


def kill_worker(scene: Scene, chance: random.Random) -> None:
    """Kill a worker process, be it at work or just starting."""
    workers: list[psutil.Process] = []
    while not workers:
        for child in scene.drive().children():
            with suppress(psutil.Error):
                if any("spawn_main" in word for word in child.cmdline()):
                    workers.append(child)
    with suppress(psutil.NoSuchProcess):
        chance.choice(sorted(workers, key=lambda p: p.pid)).kill()


def test_a_killed_campaign_ends_with_the_undisturbed_table(
    tmp_path: Path, code: Path, undisturbed: bytes
) -> None:
    chance = random.Random(1)  # noqa: S311
    kinds = ["startup"] * 2 + ["driver"] * 3 + ["worker"] * (KILLS - 5)
    chance.shuffle(kinds)
    before = psutil.Process().children(recursive=True)  # of other tests: multiprocessing keeps a helper
    while kinds:  # a quick machine may be done before the last kill: then there is another campaign
        left = len(kinds)
        scene = Scene(tmp_path / str(left), code, ["--workers", "2"])
        scene.folder.mkdir()
        with ended(scene):
            while kinds and await_moment(scene, chance, 1.0 if kinds[-1] == "startup" else 0.0):
                if kinds.pop() == "worker":
                    kill_worker(scene, chance)
                else:
                    kill_driver(scene)
            assert scene.finish() == undisturbed
            scene.check_nothing_done_twice(left - len(kinds))
            assert not set(psutil.Process().children(recursive=True)) - set(before)
