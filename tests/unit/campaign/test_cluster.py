"""Dask: out of reach, without workers, with unfit workers, lost on the way; one line each, and nothing lost."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from unit.campaign.works import failing, walks

from stoop.campaign import CampaignError, Dask, LocalProcesses, Tally, execute

TESTS = Path(__file__).parents[2]


@dataclass
class Cluster:
    """A scheduler and workers, as real processes."""

    folder: Path
    port: int
    processes: list[subprocess.Popen[bytes]] = field(default_factory=list)

    @property
    def address(self) -> str:
        return f"tcp://127.0.0.1:{self.port}"

    def scheduler(self) -> subprocess.Popen[bytes]:
        return self.start([], "scheduler", "--host", "127.0.0.1", "--port", str(self.port))

    def worker(self, *, path: str = str(TESTS), python: tuple[str, ...] = ()) -> subprocess.Popen[bytes]:
        return self.start(
            python,
            "worker",
            self.address,
            "--no-nanny",
            "--nthreads",
            "2",
            "--local-directory",
            ".",
            path=path,
        )

    def start(self, python: object, *words: str, path: str = str(TESTS)) -> subprocess.Popen[bytes]:
        assert isinstance(python, tuple | list)
        process = subprocess.Popen(
            [sys.executable, *python, "-m", "dask", *words, "--no-dashboard"],
            cwd=self.folder,
            env={**os.environ, "PYTHONPATH": path},
            stderr=subprocess.DEVNULL,
        )
        self.processes.append(process)
        return process


@contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    with closing(socket.socket()) as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    found = Cluster(folder, port)
    try:
        yield found
    finally:
        for process in found.processes:
            process.kill()
            process.wait()


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:1", "nonsense://x:1", "tcp://no.such.host.invalid:8786", ""]
)
def test_a_scheduler_out_of_reach(tmp_path: Path, address: str) -> None:
    with pytest.raises(CampaignError, match=f"^scheduler {re.escape(address)}: cannot be reached") as caught:
        execute(walks(tmp_path / "log", 1), tmp_path / "s", Dask(address, timeout=0.2))
    assert "\n" not in caught.value.args[0]


def test_without_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(CampaignError, match=r"pip install 'stoop\[distributed\]'"):
        execute(walks(tmp_path / "log", 1), tmp_path / "s", Dask("tcp://127.0.0.1:1"))


def without_stoop(folder: Path) -> str:
    """Return a path on which everything is but stoop."""
    import distributed

    for place in Path(distributed.__file__).parents[1].iterdir():
        if "stoop" not in place.name and place.suffix != ".pth":
            (folder / place.name).symlink_to(place)
    return str(folder)


def test_one_cluster_from_its_beginning_to_its_end(tmp_path: Path) -> None:
    """In one test, for a cluster takes its time to start."""
    log, bare = tmp_path / "log", tmp_path / "bare"
    bare.mkdir()
    plan = walks(log, 10, (3, None))
    reference = execute(walks(log, 10, (3, None)), tmp_path / "reference", LocalProcesses(1))
    log.unlink()
    with cluster(tmp_path) as c:
        c.scheduler()
        unfit = c.worker(path=without_stoop(bare), python=("-S",))
        with pytest.raises(
            CampaignError, match=r"^run .*: its worker has no stoop, .*; install the same as here"
        ):
            execute(plan, tmp_path / "s", Dask(c.address))
        assert unfit.poll() is None, "it can be used for other things"
        unfit.kill()
        unfit.wait()
        notes: list[str] = []

        def watch(tally: Tally) -> None:
            if tally.note and not any(notes):
                c.worker()
            notes.append(tally.note)

        assert execute(plan, tmp_path / "s", Dask(c.address), watch) == reference
        assert notes[-1] == ""
        assert f"waiting for a worker to join {c.address}" in notes
        assert len(log.read_text().splitlines()) == 10
        with pytest.raises(CampaignError, match=r"^run bad: ValueError: first;"):
            execute(failing("plain", log), tmp_path / "f", Dask(c.address))
        lose_scheduler(c, tmp_path)


def lose_scheduler(c: Cluster, folder: Path) -> None:
    def watch(tally: Tally) -> None:
        if tally.done:
            c.processes[0].kill()

    began = time.monotonic()
    with pytest.raises(CampaignError, match=rf"^scheduler {c.address}: lost"):
        execute(walks(folder / "other", 5000), folder / "lost", Dask(c.address), watch)
    assert time.monotonic() - began < 60.0
