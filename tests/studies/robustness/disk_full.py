"""Verbs on a disk that is full at some point: one error line, the old files as they were, nothing half-written.

The disk is a small file system in memory, which a copy of this process makes for itself in a name space of its own (Linux); it
has room for what is there, and for so many blocks, or so many files, more. Where the system gives no such name spaces,
no file may become longer than so many bytes instead.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Final

from studies.robustness.interruptions import broken, differences
from studies.robustness.small_runs import (
    COMMANDS,
    OUT,
    SEARCH,
    STORES,
    inputs,
    run,
    undisturbed,
    written,
)
from studies.robustness.trials import (
    REFUSED,
    SAME,
    Bounds,
    BrokenPromiseError,
    lay_out,
)

BLOCK: Final = 4096  #: bytes of a file system in memory
MORE: Final = 2  #: blocks or files beyond those that a verb leaves
PLENTY: Final = 2**26  #: bytes of a disk with space
NEW_USER, NEW_MOUNTS, REMOUNT = 0x10000000, 0x00020000, 32  #: of Linux' sched.h and mount.h
BLOCKS, FILES, LENGTH = "too few blocks", "too few files", "files too short"  #: how a disk is full
OLD: Final = b"what was there before\n"
BOUNDS: Final = Bounds(seconds=20)


def try_full_disk(folder: Path, name: str, number: int) -> str:
    """Try a verb of `COMMANDS` on a disk that is full at a point drawn at random, with old files in every other case."""
    rng = Random(f"disk full {name} {number}")  # noqa: S311  no secret
    expected, old = undisturbed(COMMANDS[name]), bool(rng.getrandbits(1))
    how = rng.choice((BLOCKS, BLOCKS, FILES)) if has_name_spaces() else LENGTH
    blocks = sum(-(-len(content) // BLOCK) for content in expected.values()) + MORE
    longest = max(map(len, expected.values()))
    room = rng.randrange({BLOCKS: blocks, FILES: len(expected) + MORE, LENGTH: longest}[how])
    return in_a_copy(lambda: on_full_disk(name, folder, how, room, old))


def on_full_disk(name: str, folder: Path, how: str, room: int, old: bool) -> str:
    """Run a verb with so much room, check what it leaves, and run it again with space; raises a `BrokenPromiseError`."""
    words, out = COMMANDS[name], folder / OUT
    out.mkdir()
    resize = short_files if how == LENGTH else Disk(out).resize
    before = dict.fromkeys(undisturbed(words).keys() - {SEARCH}, OLD) if old else {}
    if name in ("compare", "reproduce", "figure", "verify"):  # these know their own files by their content
        before = {place: content for place, content in undisturbed(words).items() if place in before}
    lay_out(out, before)
    lay_out(folder, inputs())
    os.chdir(folder)
    again = ("--overwrite",) if old else ()
    os.environ["TMPDIR"], tempfile.tempdir = OUT, None
    resize(how, room)
    ended = run((*words, *again))
    resize("", 0)
    if ended.code == 0:
        outcome = SAME
    else:
        outcome = REFUSED
        errors = [line for line in ended.stderr_lines if "error" in line or "Traceback" in line]
        if ended.code != 2 or len(errors) != 1 or not errors[0].startswith("stoop: error: "):
            raise BrokenPromiseError(f"exit code {ended.code}: {' | '.join(ended.stderr_lines[-3:])}")
        check_rest(before, folder)
        again = ("--resume",) if (out / SEARCH).exists() else again
        ended = run((*words, *again))
        if ended.code:
            raise BrokenPromiseError(f"with space again {ended.code}: {' | '.join(ended.stderr_lines[-3:])}")
    if unlike := differences(undisturbed(words), out):
        raise BrokenPromiseError(unlike)
    return outcome


def check_rest(before: Mapping[str, bytes], folder: Path) -> None:
    """Refuse anything but the old files, and what is done: a search's state and a store, both whole."""
    there = written(folder / OUT)
    kept = {name: x for name, x in there.items() if name != SEARCH and not name.endswith(STORES)}
    if changed := [name for name in before if kept.pop(name, None) != before[name]]:
        raise BrokenPromiseError(f"old files changed: {', '.join(changed)}")
    if kept:
        raise BrokenPromiseError(f"left: {', '.join(kept)}")
    if not before and (problem := broken(folder)):
        raise BrokenPromiseError(problem)


class Disk:
    """A file system in memory, at a folder that is empty; it is there for this process alone, and ends with it."""

    kind = "tmpfs"

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        user, group = os.getuid(), os.getgid()
        _checked(_libc().unshare(NEW_USER | NEW_MOUNTS))
        for name, content in (("setgroups", "deny"), ("uid_map", f"0 {user} 1"), ("gid_map", f"0 {group} 1")):
            Path("/proc/self", name).write_text(content)
        self._mount(0, f"size={PLENTY}")

    def resize(self, how: str, room: int, flags: int = 0) -> None:
        """Leave room for so many blocks or files; plenty if neither is few; with further flags of mount."""
        used = os.statvfs(self._folder)
        blocks = used.f_blocks - used.f_bfree + room if how == BLOCKS else PLENTY // BLOCK
        files = used.f_files - used.f_ffree + room if how == FILES else PLENTY // BLOCK
        # at least one: none would be no limit
        self._mount(REMOUNT | flags, f"size={max(blocks, 1) * BLOCK},nr_inodes={max(files, 1)}")

    def _mount(self, flags: int, options: str) -> None:
        _checked(
            _libc().mount(b"stoop", os.fsencode(self._folder), self.kind.encode(), flags, options.encode())
        )


@cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _checked(result: int) -> None:
    if result:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def short_files(how: str, room: int) -> None:
    """Let no file become longer than so many bytes; any length if `how` is empty."""
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room if how else most, most))


@cache
def has_name_spaces() -> bool:
    """Return whether this system lets a process make file systems for itself."""
    if not hasattr(os, "fork"):
        return False
    with TemporaryDirectory(prefix="stoop-") as folder, suppress(BrokenPromiseError):
        return in_a_copy(lambda: Disk(Path(folder)).kind) == Disk.kind
    return False


def in_a_copy(work: Callable[[], str]) -> str:
    """Return what a function returns in a copy of this process; its exceptions are raised here."""
    source, target = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            try:
                message = ["", work()]
            except BaseException as error:
                kind = type(error).__name__ if not isinstance(error, BrokenPromiseError) else ""
                message = [f"{kind}: {error}".removeprefix(": ")]
            os.write(target, json.dumps(message).encode()[: 2**15])
        finally:
            os._exit(0)
    os.close(target)
    with os.fdopen(source, "rb") as answer:
        text = answer.read()
    ending = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if not text:
        raise BrokenPromiseError(f"the process ended with {ending}")
    problem, *results = json.loads(text)
    if problem:
        raise BrokenPromiseError(problem)
    return str(results[0])
