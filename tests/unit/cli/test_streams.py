"""Verbs with closed or broken streams, bad environments and tight limits: a result or one line, never a traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a POSIX shell and /dev/full")
NOWHERE = "/proc/nowhere"
#: shell around the command -> exit codes
STREAMS = {
    'exec "$@" >&-': (0,),
    'exec "$@" 2>&-': (0,),
    'exec "$@" <&-': (0,),
    'exec "$@" <&- >&- 2>&-': (0,),
    'exec "$@" >/dev/full': (2,),
    'exec "$@" 2>/dev/full': (0,),
    'exec "$@" >/dev/full 2>&1': (2,),
    '"$@" | true; exit ${PIPESTATUS[0]}': (0, 141),  # 0: written before the reader ended
    '("$@" 2>&1 >&3 | true; exit ${PIPESTATUS[0]}) 3>&1': (0,),
}
LIMITS = {
    'ulimit -n 8; exec "$@"': (0, 2),
    'ulimit -v 2000000; exec "$@"': (0,),
    'ulimit -f 8; exec "$@"': (0, 2),
}
ENVIRONMENTS: Mapping[str, Mapping[str, str]] = {
    "dumb terminal, C": {"TERM": "dumb", "LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0"},
    "no home": {"HOME": NOWHERE, "STOOP_CACHE_DIR": ""},
    "no cache": {"STOOP_CACHE_DIR": NOWHERE},
    "no TMPDIR": {"TMPDIR": NOWHERE},
    "neither": {"TMPDIR": NOWHERE, "STOOP_CACHE_DIR": NOWHERE},
}


def ended(
    words: Sequence[str], folder: Path, shell: str = 'exec "$@"', changes: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a command as users do, in a folder; its errors are lines of stoop's own."""
    environment = os.environ | (changes or {})
    environment = {name: value for name, value in environment.items() if value and name != "PYTHONUNBUFFERED"}
    command = ["bash", "-c", shell, "bash", sys.executable, "-m", "stoop", *words]
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, encoding="utf-8"
    )
    assert "Traceback" not in done.stdout + done.stderr, done.stderr
    errors = [line for line in done.stderr.splitlines() if "rror" in line]
    assert all(line.startswith("stoop: error: ") for line in errors)
    assert len(errors) <= 1
    assert len(errors) == (done.returncode == 2) or "2>" in shell
    return done


def test_version(tmp_path: Path) -> None:
    for shell, codes in {**STREAMS, **LIMITS}.items():
        done = ended(["--version"], tmp_path, shell)
        assert done.returncode in codes, (shell, done.stderr)
    for name, changes in ENVIRONMENTS.items():
        done = ended(["--version"], tmp_path, changes=changes)
        assert (done.returncode, done.stderr) == (0, ""), name
