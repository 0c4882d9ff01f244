"""Driver and workers are killed at random moments; the table does not notice, and nothing is done twice."""

import os
import random
import shutil
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

import psutil
import pytest
from recovery.campaign_case import LOG, STOPS, TASKS

import stoop

CASE = Path(__file__).with_name("campaign_case.py")
AGAIN = 5  #: executions that one kill may cost: what is under way or on its way to the store


class Campaign:
    """A folder, the log of executions in it, and the driver: the same command each time."""

    def __init__(self, folder: Path, code: Path) -> None:
        folder.mkdir()
        self.folder, self.code = folder, code
        self.process: psutil.Popen | None = None
        self.ends: list[tuple[int, set[str]]] = []  #: executions and committed tasks when a driver was killed

    def start(self) -> psutil.Popen:
        if self.process is None or self.process.poll() is not None:
            words = [sys.executable, self.code / CASE.name, "store.sqlite", "table.csv", "--workers", "2"]
            environment = {**os.environ, LOG: str(self.folder / "log"), "PYTHONPATH": str(self.code)}
            with (self.folder / "driver.err").open("w") as errors:
                self.process = psutil.Popen(
                    words, env=environment, cwd=self.folder, stdout=errors, stderr=errors, stdin=subprocess.DEVNULL
                )  # fmt: skip
        return self.process

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
        assert self.start().wait() == 0, (self.folder / "driver.err").read_text()
        return (self.folder / "table.csv").read_bytes()

    def await_moment(self, chance: random.Random, kind: str) -> bool:
        """Wait for a random moment: in the driver's first second, or a few executions from now; False if it was done."""
        driver = self.start()
        if kind == "startup":
            time.sleep(chance.uniform(0.0, 1.0))
        else:
            goal = len(self.executed()) + chance.randint(1, 8)
            while len(self.executed()) < goal and driver.poll() is None:
                time.sleep(0.002)
            time.sleep(chance.uniform(0.0, 0.03))
        assert not driver.poll(), (self.folder / "driver.err").read_text()
        return driver.poll() is None

    def kill_driver(self) -> None:
        driver = self.start()
        family = driver.children(recursive=True)
        driver.kill()
        driver.wait()
        _, alive = psutil.wait_procs(family)
        assert not alive, "workers outlive their driver"
        self.ends.append((len(self.executed()), self.committed()))

    def kill_worker(self, chance: random.Random) -> None:
        workers: list[psutil.Process] = []
        while not workers and self.start().poll() is None:
            for child in self.start().children():
                with suppress(psutil.Error):
                    if any("spawn_main" in word for word in child.cmdline()):
                        workers.append(child)
        with suppress(psutil.NoSuchProcess, IndexError):
            chance.choice(sorted(workers, key=lambda p: p.pid)).kill()


@pytest.fixture(scope="module")
def code(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the package: a store is refused when somebody edits the sources meanwhile."""
    folder, ignored = tmp_path_factory.mktemp("code"), shutil.ignore_patterns("__pycache__")
    for package in Path(stoop.__file__).parents[1].glob("stoop*"):
        shutil.copytree(package, folder / package.name, ignore=ignored)
    shutil.copy(CASE, folder)
    return folder


@contextmanager
def campaign(folder: Path, code: Path) -> Iterator[Campaign]:
    one = Campaign(folder, code)
    try:
        yield one
    finally:
        if one.process is not None and one.process.poll() is None:
            for each in (*one.process.children(recursive=True), one.process):
                with suppress(psutil.NoSuchProcess):
                    each.kill()
            one.process.wait()


def test_a_killed_campaign_ends_with_the_undisturbed_table(tmp_path: Path, code: Path) -> None:
    chance, kinds = random.Random(1), ["startup"] * 2 + ["driver"] * 3 + ["worker"] * 3  # noqa: S311
    chance.shuffle(kinds)
    with campaign(tmp_path / "undisturbed", code) as plain:
        undisturbed = plain.finish()
        assert sorted(map(int, plain.executed())) == list(range(TASKS))
    before = psutil.Process().children(recursive=True)  # of other tests: multiprocessing keeps a helper
    while kinds:  # a quick machine may be done before the last kill: then there is another campaign
        left = len(kinds)
        with campaign(tmp_path / str(left), code) as one:
            while kinds and one.await_moment(chance, kinds[-1]):
                if kinds.pop() == "worker":
                    one.kill_worker(chance)
                else:
                    one.kill_driver()
            assert one.finish() == undisturbed
            executed = one.executed()
        for length, committed in one.ends:
            assert not committed & set(executed[length:])
        assert len(set(executed)) == TASKS
        assert len(executed) - TASKS <= AGAIN * (left - len(kinds))
        assert not set(psutil.Process().children(recursive=True)) - set(before)
