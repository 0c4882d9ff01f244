"""Dask: out of reach, without workers, with unfit workers, lost on the way; one line each, and nothing lost."""

import os
import re
import socket
import socketserver
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from helpers.works import failing, walks

from stoop.parallel import CampaignError, Dask, LocalProcesses, Tally, execute

TESTS = Path(__file__).parents[2]


@dataclass
class Cluster:
    folder: Path
    port: int
    processes: list[subprocess.Popen[bytes]] = field(default_factory=list)

    @property
    def address(self) -> str:
        return f"tcp://127.0.0.1:{self.port}"

    def worker(self, *python: str, path: str = str(TESTS)) -> subprocess.Popen[bytes]:
        words = ("--no-nanny", "--nthreads", "2", "--local-directory", ".")
        return self.start("worker", self.address, *words, python=python, path=path)

    def start(self, *words: str, python: Any = (), path: str = str(TESTS)) -> subprocess.Popen[bytes]:
        command = [sys.executable, *python, "-m", "dask", *words, "--no-dashboard"]
        environment = {**os.environ, "PYTHONPATH": path}
        process = subprocess.Popen(command, cwd=self.folder, env=environment, stderr=subprocess.DEVNULL)
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


@contextmanager
def stranger(says: bytes, hangs_up: bool = False) -> Iterator[str]:
    """Listen as something that is no scheduler; return the address."""

    def answer(caller: socket.socket, *_: object) -> None:
        caller.sendall(says)
        if not hangs_up:
            over.wait()

    over = threading.Event()
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), answer) as server:  # type: ignore[arg-type]
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"tcp://127.0.0.1:{server.server_address[1]}"
        over.set()
        server.shutdown()


def test_a_scheduler_out_of_reach(tmp_path: Path) -> None:
    """Nobody, something else that hangs up, and something else that says nothing; then the right command is taken."""
    nobody = ("tcp://127.0.0.1:1", "tls://[::1]:1", "tcp://no.such.host.invalid:8786")
    with stranger(b"", True) as rude, stranger(b"") as silent:
        for address in (*nobody, rude, silent):
            told = f"^scheduler {re.escape(address)}: cannot be reached"
            with pytest.raises(CampaignError, match=told) as caught:
                execute(walks(tmp_path / "log", 1), tmp_path / "s", Dask(address, timeout=0.3))
            assert "\n" not in caught.value.args[0]
    other = replace(walks(tmp_path / "log", 1), settings={"map": "tent"})
    assert list(execute(other, tmp_path / "s", LocalProcesses(1))) == ["000/None"]


def test_there_is_one_line_and_nothing_after_it(tmp_path: Path) -> None:
    """A process of its own: Dask's client complains when it is collected, and at the end."""
    code = (
        "import sys; from pathlib import Path; from helpers.works import walks\n"
        "from stoop.parallel import CampaignError, Dask, execute\n"
        "try: execute(walks(Path('log'), 1), Path('s'), Dask(sys.argv[1], 0.3))\n"
        "except CampaignError as error: print(error.args[0], file=sys.stderr)\n"
    )
    with stranger(b"SSH-2.0-OpenSSH\r\n") as banner:
        for address in ("nonsense", "tcp://127.0.0.1", "tcp://127.0.0.1:1", banner):
            done = subprocess.run(
                [sys.executable, "-c", code, address],
                cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(TESTS)}, capture_output=True, text=True, check=True,
            )  # fmt: skip
            assert done.stderr.startswith("scheduler "), done.stderr
            assert len(done.stderr.splitlines()) == 1, done.stderr


def test_without_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(CampaignError, match=r"pip install '\.\[distributed\]'"):
        execute(walks(tmp_path / "log", 1), tmp_path / "s", Dask("tcp://127.0.0.1:1"))


def test_one_cluster_from_its_beginning_to_its_end(tmp_path: Path) -> None:
    """In one test, for a cluster takes its time to start."""
    log, bare = tmp_path / "log", tmp_path / "bare"
    bare.mkdir()
    for place in Path(pytest.__file__).parents[1].iterdir():
        if "stoop" not in place.name and place.suffix != ".pth":
            (bare / place.name).symlink_to(place)
    plan = walks(log, 10, (3, None))
    reference = execute(walks(log, 10, (3, None)), tmp_path / "reference", LocalProcesses(1))
    log.unlink()
    with cluster(tmp_path) as c:
        c.start("scheduler", "--host", "127.0.0.1", "--port", str(c.port))
        unfit = c.worker("-S", path=str(bare))
        told = r"^run .*: its worker has no stoop, .*; install the same as here"
        with pytest.raises(CampaignError, match=told):
            execute(plan, tmp_path / "s", Dask(c.address, timeout=60.0))
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

        def lose(tally: Tally) -> None:
            if tally.done:
                c.processes[0].kill()

        with pytest.raises(CampaignError, match=rf"^scheduler {c.address}: lost"):
            execute(walks(tmp_path / "other", 5000), tmp_path / "lost", Dask(c.address), lose)
