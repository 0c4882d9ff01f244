"""Closed or broken streams, bad environments and tight limits: a result or one line, never a traceback."""

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a POSIX shell and /dev/full")
NOWHERE = "/proc/nowhere"
PLAIN = 'exec "$@"'
Done = subprocess.CompletedProcess[str]
FULL = "stoop: error: the output: No space left on device\n"
#: shell around the command, changes of the environment, exit codes
SURROUNDINGS: Mapping[str, tuple[str, Mapping[str, str], tuple[int, ...]]] = {
    "no stdout": ('exec "$@" >&-', {}, (0,)),
    "no stderr": ('exec "$@" 2>&-', {}, (0,)),
    "no stdin": ('exec "$@" <&-', {}, (0,)),
    "no stream": ('exec "$@" <&- >&- 2>&-', {}, (0,)),
    "full stdout": ('exec "$@" >/dev/full', {}, (2,)),
    "full stdout, unbuffered": ('exec "$@" >/dev/full', {"PYTHONUNBUFFERED": "1"}, (2,)),
    "full stderr": ('exec "$@" 2>/dev/full', {}, (0,)),
    "full": ('exec "$@" >/dev/full 2>&1', {}, (2,)),
    "reader leaves": ('"$@" | true; exit ${PIPESTATUS[0]}', {}, (0, 141)),  # 0: written before it left
    "a reader of errors that leaves": ('("$@" 2>&1 >&3 | true; exit ${PIPESTATUS[0]}) 3>&1', {}, (0,)),
    "few files": ('ulimit -n 8; exec "$@"', {}, (0, 2)),
    "little memory": ('ulimit -v 2000000; exec "$@"', {}, (0,)),
    "short files": ('ulimit -f 8; exec "$@"', {}, (0, 2)),
    "dumb terminal, C": (PLAIN, {"TERM": "dumb", "LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0"}, (0,)),
    "no home": (PLAIN, {"HOME": NOWHERE, "STOOP_CACHE_DIR": ""}, (0,)),
    "no cache": (PLAIN, {"STOOP_CACHE_DIR": NOWHERE}, (0,)),
    "no TMPDIR": (PLAIN, {"TMPDIR": NOWHERE}, (0,)),
    "neither": (PLAIN, {"TMPDIR": NOWHERE, "STOOP_CACHE_DIR": NOWHERE}, (0,)),
}


def ended(words: Sequence[str], folder: Path, shell: str, changes: Mapping[str, str]) -> Done:
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    done = subprocess.run(
        ["bash", "-c", shell, "bash", sys.executable, "-m", "stoop", *words], cwd=folder, capture_output=True,
        env={name: value for name, value in (kept | changes).items() if value}, text=True, encoding="utf-8", check=False,
    )  # fmt: skip
    assert "Traceback" not in done.stdout + done.stderr, done.stderr
    errors = [line for line in done.stderr.splitlines() if "rror" in line]
    assert all(line.startswith("stoop: error: ") for line in errors)
    assert len(errors) <= 1
    assert len(errors) == (done.returncode == 2) or "2>" in shell
    warnings = [line for line in done.stderr.splitlines() if "cache" in line]
    assert len(warnings) <= 1
    assert all(line.startswith("stoop: warning: ") for line in warnings)
    return done


@pytest.mark.parametrize("name", SURROUNDINGS)
def test_help_and_a_mistake(name: str, tmp_path: Path) -> None:
    shell, changes, codes = SURROUNDINGS[name]
    done = ended(["--help"], tmp_path, shell, changes)
    assert done.returncode in codes, done.stderr
    assert done.stderr == (FULL if name.startswith("full stdout") else "")
    assert ended(["nosuch"], tmp_path, shell, changes).returncode == 2


BOTH = ("full", "reader leaves", "few files", "little memory", "short files", "no home", "neither")


@pytest.mark.parametrize("name", BOTH)
def test_a_reader_and_a_writer(name: str, tmp_path: Path, flight_file: Path, examples: Path) -> None:
    shell, changes, codes = SURROUNDINGS[name]
    simulate = f"simulate twin-boom -o f.nc --maneuver {examples / 'maneuver_3211.toml'}"
    for words in (["info", str(flight_file)], simulate.split()):
        done = ended(words, tmp_path, shell, changes)
        assert done.returncode in codes, (words, done.stderr)
    assert (tmp_path / "f.nc").exists() or 2 in codes
    assert ("stoop: warning: the cache cannot be written" in done.stderr) == (name in ("no home", "neither"))


def test_a_reader_that_has_left_is_no_error() -> None:
    command = [sys.executable, "-m", "stoop", "--help"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait() == 141


def test_an_error_and_an_output_that_is_full_are_one_line(tmp_path: Path) -> None:
    """The mapping to start from, which stands in the output when the error comes, cannot be written either."""
    (tmp_path / "bare.csv").write_text("t,q\n0,1\n1,2\n")
    done = ended(["info", "bare.csv"], tmp_path, *SURROUNDINGS["full stdout"][:2])
    assert (done.returncode, "needs a mapping" in done.stderr) == (2, True)
