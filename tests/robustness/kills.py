"""Verbs that are killed before a change of a file and started again: what they leave are the files of an undisturbed run."""

import os
import signal
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from unittest import mock

from robustness.small_runs import STORES, check_file, reproducible_outputs, written

from stoop.base.files import SCRATCH
from stoop.cli.main import main

#: events that change files, beside open for writing
CHANGES: Final = ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "sqlite3.connect")


def run_and_kill(words: tuple[str, ...], folder: Path, change: int = 0, kind: int = signal.SIGKILL) -> int:
    """Run a verb in a copy of this process, in a folder, with a signal before a change of a file (0: none).

    Return its exit code, or minus the signal that it died of; the number of changes of a whole run is in the file ``changes``.
    """
    child, code = os.fork(), 1
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    try:
        os.chdir(folder)
        sys.stdout = (folder / "stdout").open("w", encoding="utf-8")
        sys.stderr = (folder / "stderr").open("w", encoding="utf-8")
        os.dup2(sys.stderr.fileno(), 2)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        count = 0

        def note(event: str, given: tuple[Any, ...]) -> None:
            nonlocal count
            writes = event == "open" and isinstance(given[2], int) and given[2] & (os.O_WRONLY | os.O_RDWR)
            count += bool(writes or event in CHANGES)
            if (writes or event in CHANGES) and count == change:
                os.kill(os.getpid(), kind)

        sys.addaudithook(note)
        with reproducible_outputs(), mock.patch.object(sys, "argv", ["stoop", *words]):
            code = main()
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        (folder / "changes").write_text(str(count))
    finally:
        os._exit(code)


def differences(expected: Mapping[str, bytes], out: Path) -> str:
    """Return the files that are not those of an undisturbed run, stores left out."""
    there = {name: content for name, content in written(out).items() if not name.endswith(STORES)}
    return ", ".join(sorted(n for n in expected.keys() | there.keys() if expected.get(n) != there.get(n)))


def check_whole(out: Path) -> None:
    """Read the files of a killed run; what is left over does not pile up."""
    hidden = [path.name for path in out.iterdir() if path.name.startswith(SCRATCH)]
    assert len(hidden) <= 1
    for path in sorted(p for p in out.iterdir() if p.name not in hidden and not p.name.endswith("-journal")):
        check_file(path)
