"""Dask: out of reach, without workers, with unfit workers, lost on the way; one line each, and nothing lost."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
from unit.parallel.works import failing, walks

from stoop.parallel import CampaignError, Dask, LocalProcesses, Tally, execute

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
    "address",
    ["nonsense", "nonsense://x:1", "127.0.0.1:8786", "tcp://127.0.0.1", "tcp://:1", "tcp://a:0", "tcp://a:99999", "tcp://a b:1",
     "tcp://[::1:1", "tcp://a:1/", ""],
)  # fmt: skip
def test_what_is_no_address(address: str) -> None:
    with pytest.raises(
        CampaignError, match=rf"^scheduler {re.escape(repr(address))}: is no address; give tcp://"
    ):
        Dask(address)


@pytest.mark.parametrize("address", ["tcp://[::1]:8786", "tls://10.0.0.1:1", "tcp://node-3.cluster:65535"])
def test_what_is_an_address(address: str) -> None:
    assert Dask(address).address == address


@contextmanager
def stranger(says: bytes, hangs_up: bool = False) -> Iterator[str]:
    """Listen as something that is no scheduler; return the address."""

    def listen() -> None:
        with suppress(OSError):
            while True:
                caller, _ = door.accept()
                caller.sendall(says)
                callers.append(caller)
                if hangs_up:
                    caller.close()

    callers: list[socket.socket] = []
    with closing(socket.create_server(("127.0.0.1", 0))) as door:
        listener = threading.Thread(target=listen, daemon=True)
        listener.start()
        yield f"tcp://127.0.0.1:{door.getsockname()[1]}"
        door.shutdown(socket.SHUT_RDWR)
        listener.join()
    for caller in callers:
        caller.close()


def out_of_reach(folder: Path, address: str) -> None:
    with pytest.raises(CampaignError, match=f"^scheduler {re.escape(address)}: cannot be reached") as caught:
        execute(walks(folder / "log", 1), folder / "s", Dask(address, timeout=0.3))
    assert "\n" not in caught.value.args[0]


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "tls://[::1]:1", "tcp://no.such.host.invalid:8786"])
def test_a_scheduler_out_of_reach(tmp_path: Path, address: str) -> None:
    out_of_reach(tmp_path, address)


def test_something_else_that_hangs_up_or_says_nothing(tmp_path: Path) -> None:
    with stranger(b"", hangs_up=True) as address:
        out_of_reach(tmp_path, address)
    with stranger(b"") as address:
        out_of_reach(tmp_path, address)


def test_there_is_one_line_and_nothing_after_it(tmp_path: Path) -> None:
    """A process of its own: Dask's client complains when it is collected, and at the end."""
    code = (
        "import sys; from pathlib import Path; from unit.parallel.works import walks\n"
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


def test_after_a_wrong_address_the_right_command_is_taken(tmp_path: Path) -> None:
    out_of_reach(tmp_path, "tcp://127.0.0.1:1")
    other = replace(walks(tmp_path / "log", 1), settings={"map": "tent"})
    assert list(execute(other, tmp_path / "s", LocalProcesses(1))) == ["000/None"]


def test_without_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(CampaignError, match=r"pip install '\.\[distributed\]'"):
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

        with callback_that_does_not_end(c.address):
            assert execute(plan, tmp_path / "s", Dask(c.address), watch) == reference
        assert notes[-1] == ""
        assert f"waiting for a worker to join {c.address}" in notes
        assert len(log.read_text().splitlines()) == 10
        with pytest.raises(CampaignError, match=r"^run bad: ValueError: first;"):
            execute(failing("plain", log), tmp_path / "f", Dask(c.address))
        lose_scheduler(c, tmp_path)


@contextmanager
def callback_that_does_not_end(address: str) -> Iterator[None]:
    """Hold the one thread for callbacks that Dask has in a process, as a client that closes at the wrong time does."""
    from distributed import Client

    end = threading.Event()
    with Client(address, set_as_default=False) as other:
        task = other.submit(int)
        task.add_done_callback(lambda _: end.wait())
        try:
            yield
        finally:
            end.set()


def lose_scheduler(c: Cluster, folder: Path) -> None:
    def watch(tally: Tally) -> None:
        if tally.done:
            c.processes[0].kill()

    with pytest.raises(CampaignError, match=rf"^scheduler {c.address}: lost"):
        execute(walks(folder / "other", 5000), folder / "lost", Dask(c.address), watch)
