"""Steps: commands of stoop that run as processes of their own and leave all that is known of them in a folder.

A step's folder, such as ``runs/001``, holds its command, its process, its inputs as they were, and what it wrote. Its lock is
held by the process alone, so that any server, also one that was started later, knows whether it still runs. Which process is
asked to stop is kept outside the folder, which may come from someone else: its file `PROCESS` is for people alone.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final, Literal

from stoop.extend.errors import OutputError, StoopError
from stoop.extend.files import write_file
from stoop.extend.text import printable
from stoop_app.places import inside, recalled, remember, tail_of, text_of

State = Literal["running", "done", "failed"]
COMMAND, PROCESS, LOCK, OUTPUT, ERRORS = "command.txt", "process.txt", "lock", "output.txt", "errors.txt"
OWN: Final = frozenset((COMMAND, PROCESS, LOCK, OUTPUT, ERRORS))
COMMANDS: Final = "commands.sh"  #: in the project's folder: all commands, in order
ERROR: Final = "stoop: error: "  #: begins the line in which a verb says what the user can correct
NUMBER: Final = re.compile("[0-9]{3,9}")  #: name of a step's folder
MAX_TEXT: Final = 20_000  #: bytes of an output that are shown
MAX_FILES, MAX_DEPTH = 500, 8  #: files of a step that are listed, and folders in each other
#: kind of a step, which names its folder -> the file that is there when its verb has done its work
PRODUCTS: Final = {
    "info": "flight.nc",
    "map": "mapping.toml",
    "corrections": "mapping.toml",
    "drafts": "vehicle.toml",
    "trims": "",
    "equations": "",
    "maneuvers": "windows.toml",
    "runs": "result.json",
    "exports": "",
    "designs": "design.html",
    "gains": "tuning.html",
    "fleets": "",
}

_children: dict[Path, subprocess.Popen[bytes]] = {}  #: those of this server, to be waited for
_ended: set[Path] = set()


@contextmanager
def blocked_interrupts() -> Iterator[None]:
    """Block Ctrl-C for processes started in the block until they call `unblock_interrupts`: Python itself prints a traceback."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@dataclass(frozen=True)
class Step:
    """One step, by its folder."""

    folder: Path

    @property
    def kind(self) -> str:
        """A key of `PRODUCTS`."""
        return self.folder.parent.name

    @property
    def name(self) -> str:
        """Place in the project's folder, such as ``runs/001``."""
        return f"{self.kind}/{self.folder.name}"

    @property
    def command(self) -> str:
        """The command line, to be given in the project's folder."""
        return self._text(COMMAND).strip()

    @property
    def words(self) -> list[str]:
        """The words of the command line; empty where they cannot be separated."""
        try:
            return shlex.split(self.command)
        except ValueError:  # a quote without its end
            return []

    @property
    def running(self) -> bool:
        """Whether its process is there."""
        if self.folder in _ended:
            return False
        child = _children.get(self.folder)
        if child is not None and child.poll() is not None:
            del _children[self.folder]
            child = None
        alive = child is not None or _is_locked(self.folder / LOCK)
        if not alive:
            _ended.add(self.folder)
        return alive

    @property
    def state(self) -> State:
        """Whether it runs, has done its work, or failed."""
        if self.running:
            return "running"
        product = PRODUCTS[self.kind]
        done = self._has(product) if product else not self.error
        return "done" if done else "failed"

    @property
    def error(self) -> str:
        """What its verb says is wrong; empty where it says nothing, and has written what it should."""
        text, product = self._text(ERRORS), PRODUCTS[self.kind]
        said = [line.removeprefix(ERROR) for line in text.splitlines() if line.startswith(ERROR)]
        if said:
            return said[-1]
        if "Traceback" in text:
            return "this is a bug in stoop; the step's errors.txt has the details"
        if product and not self._has(product):
            if "stoop: interrupted" in text:
                return "stopped before there was a result"
            return "ended without a result: it was killed, or the disk is full"
        return ""

    @property
    def output(self) -> str:
        """What its verb has printed."""
        return self._text(OUTPUT)

    @property
    def findings(self) -> str:
        """What its verb has printed, without the command that it proposes next: the page has a button for that."""
        return self.output.partition("\nnext: ")[0].strip("\n")

    def file(self, name: str) -> Path:
        """Return the path of one of its files; raises `OutputError` where it leads out of the step's folder."""
        return inside(self.folder, name)

    def text(self, name: str) -> str:
        """Return the text of one of its files, see `text_of`."""
        return text_of(self.folder, name)

    @property
    def files(self) -> list[Path]:
        """What its verb has written, no links."""
        found: list[Path] = []
        for base, folders, names in os.walk(self.folder):
            if len(Path(base).relative_to(self.folder).parts) >= MAX_DEPTH or len(found) > MAX_FILES:
                folders.clear()
            own = (Path(base, name) for name in sorted(names)[:MAX_FILES] if name not in OWN)
            found += [p for p in own if p.is_file() and not p.is_symlink()]
        return sorted(found[:MAX_FILES])

    def stop(self) -> None:
        """Ask its process to stop, as Ctrl-C does: a search writes its best so far."""
        if not self.running:
            return
        with contextlib.suppress(OSError, ValueError):  # it has just ended
            process = int(recalled("process", self.folder) or "")
            if os.name == "posix":
                os.killpg(process, signal.SIGINT)
            else:
                os.kill(process, getattr(signal, "CTRL_BREAK_EVENT", signal.SIGTERM))

    def _text(self, name: str) -> str:
        return tail_of(self.folder, name, MAX_TEXT)

    def _has(self, name: str) -> bool:
        with contextlib.suppress(StoopError):
            return self.file(name).is_file()
        return False


def steps(root: Path, kind: str) -> list[Step]:
    """Return the steps of a kind, the oldest first."""
    try:
        places = [p for p in inside(root, kind).iterdir() if NUMBER.fullmatch(p.name) and not p.is_symlink()]
        found = [Step(p) for p in sorted(places, key=lambda p: int(p.name))]
        return [step for step in found if step._has(COMMAND)]
    except (OSError, StoopError):
        return []


def start(
    root: Path, kind: str, words: Callable[[str], Sequence[str]], inputs: Mapping[str, str] | None = None
) -> Step:
    """Start a command in the project's folder.

    Parameters
    ----------
    root : Path
    kind : str
        A key of `PRODUCTS`.
    words : callable
        Takes the place of the step, such as ``runs/001``; returns the command without ``stoop``.
    inputs : mapping of str to str
        Files of the step, name to text, written before it starts.

    Raises
    ------
    OutputError
        The folder cannot be written.
    """
    folder = _new_folder(inside(root, kind))
    step = Step(folder)
    arguments = [str(word) for word in words(step.name)]
    line = shlex.join(["stoop", *arguments])
    try:
        for name, text in (inputs or {}).items():
            write_file(folder / name, text)
        write_file(folder / COMMAND, f"{line}\n")
        with inside(root, COMMANDS).open("a", encoding="utf-8") as log:
            log.write(f"{printable(line)}\n")
        with (
            (folder / OUTPUT).open("wb") as output,
            (folder / ERRORS).open("wb") as errors,
            _locked(folder / LOCK) as kept,
        ):
            _children[folder] = child = _process(arguments, root, output, errors, kept)
        remember("process", folder, str(child.pid))
        write_file(folder / PROCESS, f"{child.pid}\n")
    except OSError as error:
        raise OutputError(f"{step.name}: cannot be started ({error.strerror or error})") from None
    return step


def _new_folder(parent: Path) -> Path:
    try:
        parent.mkdir(parents=True, exist_ok=True)
        number = max((int(p.name) for p in parent.iterdir() if NUMBER.fullmatch(p.name)), default=0)
        while True:  # another browser may take the same number
            number += 1
            with contextlib.suppress(FileExistsError):
                (parent / f"{number:03d}").mkdir()
                return parent / f"{number:03d}"
    except OSError as error:
        raise OutputError(f"{parent}: cannot be written ({error.strerror or error})") from None


def _process(
    arguments: Sequence[str], root: Path, output: IO[bytes], errors: IO[bytes], kept: Sequence[int]
) -> subprocess.Popen[bytes]:
    """Start stoop in a session of its own, which outlives this server."""
    own: dict[str, Any] = (
        {"start_new_session": True, "pass_fds": kept}
        if os.name == "posix"
        else {"creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)}
    )
    # -P: a module that lies in the project's folder is not imported
    with blocked_interrupts():
        return subprocess.Popen(  # noqa: S603
            [sys.executable, "-P", "-m", "stoop", *arguments],
            cwd=root, stdin=subprocess.DEVNULL, stdout=output, stderr=errors, **own,
        )  # fmt: skip


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[list[int]]:
    """Open and lock a file; whoever inherits it keeps the lock. Without such locks the list is empty."""
    with path.open("wb") as handle:
        try:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX)
        except (ImportError, OSError):
            yield []
            return
        yield [handle.fileno()]


def _is_locked(path: Path) -> bool:
    try:
        import fcntl

        with inside(path.parent, path.name).open("rb") as handle:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except (ImportError, OSError, StoopError):
        return False
    return False
