"""Verbs that are killed at random moments and started again: what they leave are the files of an undisturbed run.

Half of the kills come after a random time, half right before the n-th change of a file (open for writing, rename, removal), where
it would hurt most. One in five is SIGTERM or SIGINT, at which a verb ends by itself. After each kill every file must be whole,
and what was made for one run only must not pile up.
"""

from __future__ import annotations

import contextlib
import csv
import io
import os
import signal
import sqlite3
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any, Final
from unittest import mock

from studies.robustness.small_runs import (
    COMMANDS,
    OUT,
    SEARCH,
    STORES,
    inputs,
    reproducible_outputs,
    undisturbed,
    written,
)
from studies.robustness.trials import lay_out
from studies.robustness.verb_outputs import check_file

from stoop.base.files import SCRATCH
from stoop.base.npz import read_arrays
from stoop.cli.main import INTERRUPTED, main
from stoop.optimize import load_state

INTERRUPTIONS: Final = ("identify", "search", "bootstrap", "compare", "reproduce", "verify")
MOST: Final = 4  #: kills of one run from its beginning to its end
TERMINATED: Final = 0.2  #: share of the kills that ask the process to end
REQUESTS: Final = (signal.SIGTERM, signal.SIGINT)
BY_CHANGE: Final = 0.5  #: share of the kills before a change of a file
PATIENCE: Final = 60.0  #: s for a run, and for its end after a request
CHANGES: Final = (
    "os.mkdir",
    "os.rename",
    "os.remove",
    "os.rmdir",
    "sqlite3.connect",
)  #: beside open for writing


@dataclass(frozen=True)
class Kill:
    """A signal at a time (s) after the start, or before so many changes of files."""

    kind: signal.Signals
    after: float = 0.0
    change: int = 0

    def __str__(self) -> str:
        """Return the signal, and what its moment was drawn by."""
        return f"{self.kind.name} {'before a change of a file' if self.change else 'at any time'}"


@dataclass(frozen=True)
class Baseline:
    """A run in a copy of this process: its length, s, and its changes of files."""

    seconds: float
    changes: int


def killed(name: str, rng: Random, most: int = MOST) -> tuple[list[Kill], str]:
    """Kill a verb up to so many times until it ends; return the kills, and what is wrong after the last."""
    words, kills = COMMANDS[name], list[Kill]()
    with TemporaryDirectory(prefix="stoop-") as place:
        folder = Path(place)
        lay_out(folder, inputs())
        (folder / OUT).mkdir()
        while len(kills) < most:
            kill = drawn(baseline(name), rng)
            ending = run_and_kill((*words, *resumed(folder / OUT)), folder, kill)
            if ending == 0:
                break
            kills.append(kill)
            expected = (-kill.kind, INTERRUPTED) if kill.kind in REQUESTS else (-kill.kind,)
            problem = broken(folder) if ending in expected else f"{ending}: {_message(folder)}"
            if problem:
                return kills, problem
        else:
            ending = run_and_kill((*words, *resumed(folder / OUT)), folder)
        if ending:
            return kills, f"{ending} in the end: {_message(folder)}"
        return kills, differences(undisturbed(words), folder / OUT)


def drawn(one: Baseline, rng: Random) -> Kill:
    """Draw a kill."""
    kind = rng.choice(REQUESTS) if rng.random() < TERMINATED else signal.SIGKILL
    if rng.random() < BY_CHANGE:
        return Kill(kind, change=rng.randint(1, one.changes))
    return Kill(kind, after=rng.uniform(0.0, one.seconds))


def resumed(out: Path) -> tuple[str, ...]:
    """Return what the same command needs to go on from what lies in a folder."""
    if (out / SEARCH).exists():
        return ("--resume",)
    return ("--overwrite",) if (out / "result.json").exists() else ()


@cache
def baseline(name: str) -> Baseline:
    """Return how long a verb takes in a copy of this process, and how many files it changes."""
    with TemporaryDirectory(prefix="stoop-") as place:
        folder = Path(place)
        lay_out(folder, inputs())
        (folder / OUT).mkdir()
        began = time.monotonic()
        ending = run_and_kill(COMMANDS[name], folder)
        seconds = time.monotonic() - began
        if ending or (problem := differences(undisturbed(COMMANDS[name]), folder / OUT)):
            raise RuntimeError(f"{name}: {ending}: {_message(folder) if ending else problem}")
        return Baseline(seconds, int((folder / "changes").read_text()))


def run_and_kill(words: tuple[str, ...], folder: Path, kill: Kill | None = None) -> int:
    """Run a verb in a copy of this process, in a folder; return its exit code, or minus the signal that it died of.

    A verb that hangs is ended, and returns minus SIGALRM.
    """
    child = os.fork()
    if child == 0:
        _work(words, folder, kill)  # never comes back
    timed = kill if kill and not kill.change else None  # others act in the child itself
    ending = _wait(child, timed.after if timed else PATIENCE)
    if ending is None and timed:
        os.kill(child, timed.kind)
        ending = _wait(child, PATIENCE)
    if ending is None:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return -signal.SIGALRM
    return ending


def _wait(child: int, seconds: float) -> int | None:
    """Return how a child has ended within so many seconds; None if it has not."""
    end = time.monotonic() + seconds
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() >= end:
            return None
        time.sleep(0.001)


def _work(words: tuple[str, ...], folder: Path, kill: Kill | None) -> None:
    """Run a verb as a process of its own would; then end, whatever happens."""
    code = 1
    try:
        os.chdir(folder)
        sys.stdout = (folder / "stdout").open("w", encoding="utf-8")
        sys.stderr = (folder / "stderr").open("w", encoding="utf-8")
        os.dup2(sys.stderr.fileno(), 2)
        for one in REQUESTS:
            signal.signal(one, signal.SIG_DFL)
        changes = count_changes(kill)
        with reproducible_outputs(), mock.patch.object(sys, "argv", ["stoop", *words]):
            signal.signal(signal.SIGINT, signal.default_int_handler)
            code = main()
            signal.signal(signal.SIGINT, signal.SIG_DFL)
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        (folder / "changes").write_text(str(changes[0]))
    finally:
        os._exit(code)


def count_changes(kill: Kill | None) -> list[int]:
    """Count the changes of files from now on, in a list of one number; kill this process before one of them."""
    count = [0]

    def note(event: str, given: tuple[Any, ...]) -> None:
        writes = event == "open" and isinstance(given[2], int) and given[2] & (os.O_WRONLY | os.O_RDWR)
        if writes or event in CHANGES:
            count[0] += 1
            if kill is not None and count[0] == kill.change:
                os.kill(os.getpid(), kill.kind)

    sys.addaudithook(note)
    return count


def _message(folder: Path) -> str:
    with contextlib.suppress(OSError):
        return " | ".join((folder / "stderr").read_text(encoding="utf-8").splitlines()[-3:])
    return ""


def differences(expected: Mapping[str, bytes], out: Path) -> str:
    """Return which files are not those of an undisturbed run, stores left out; empty if all are."""
    there = {name: content for name, content in written(out).items() if not name.endswith(STORES)}
    unlike = [name for name in expected if name in there and there[name] != expected[name]]
    parts = {
        "missing": sorted(expected.keys() - there.keys()),
        "left": sorted(there.keys() - expected.keys()),
        "other bytes": unlike,
    }
    return "; ".join(f"{what}: {', '.join(names)}" for what, names in parts.items() if names)


def _check_table(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    if len({len(row) for row in csv.reader(io.StringIO(text))}) != 1 or not text.endswith("\n"):
        raise ValueError("cut")


def _check_store(path: Path) -> None:
    with contextlib.closing(sqlite3.connect(path)) as store:
        if store.execute("PRAGMA integrity_check").fetchall() != [("ok",)]:
            raise ValueError("damaged")


def _check_archive(path: Path) -> object:
    """Read the state of a search, or the arrays of a result."""
    if path.name == "search.npz":
        return load_state(path)
    with path.open("rb") as file:
        return read_arrays(file, 2**31)


CHECKS: Final[Mapping[str, Callable[[Path], object]]] = {
    **dict.fromkeys((".json", ".toml", ".html", ".nc"), check_file),
    ".csv": _check_table,
    ".npz": _check_archive,
    STORES: _check_store,
}  #: ending -> reads the whole file, or fails


def broken(folder: Path) -> str:
    """Return which file of a killed run is not whole, and what piles up; empty if nothing is wrong."""
    out = folder / OUT
    hidden = [path.name for path in out.iterdir() if path.name.startswith(SCRATCH)]
    if len(hidden) > 1:
        return f"piles up: {', '.join(hidden)}"
    for path in sorted(out.iterdir()):
        if path.name in hidden:
            continue
        try:
            if path.suffix in CHECKS:
                CHECKS[path.suffix](path)
            elif not path.name.endswith("-journal"):
                return f"{path.name}: nobody knows what this is"
        except Exception as error:
            return f"{path.name} is not whole: {type(error).__name__}: {error}"
    return ""
