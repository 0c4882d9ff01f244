"""Verbs with closed or broken streams, bad environments and tight limits: a result or one line, never a traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest
from crossed import crossed

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a POSIX shell and /dev/full")
NOWHERE = "/proc/nowhere"
DIMENSIONS = ("--template", "glider", "--mass", "2.1", "--span", "2.5", "--area", "0.4")
IDENTIFY = ("--vehicle", "twin-boom", "--maneuver", "0:8", "--method", "equation-error")
CHEAP: Mapping[str, Sequence[str]] = {
    "version": ("--version",),
    "help": ("--help",),
    "no verb": ("nosuch",),
    "vehicle": ("vehicle",),
    "vehicle new": ("vehicle", "new", *DIMENSIONS, "-o", "v.toml"),
    "info": ("info", "FLIGHT"),
}
LONG: Mapping[str, Sequence[str]] = {
    "look": ("look", "FLIGHT", "-o", "page.html"),
    "simulate": ("simulate", "twin-boom", "--maneuver", "MANEUVER", "-o", "f.nc"),
    "identify": ("identify", "FLIGHT", *IDENTIFY, "-o", "result"),
    "export": ("export", "twin-boom", "--to", "simulink", "-o", "e"),
    "validate": ("validate", "MODEL", "FLIGHT", "--maneuver", "20:28", "-o", "v"),
    "compare": ("compare", "--optimizers", "ga", "--problems", "paper-N", "--seeds", "1", "--budget", "50",
                "--workers", "1", "-o", "c"),
    "reproduce": ("reproduce", "noise", "--runs", "1", "--workers", "1", "-o", "r"),
}  # fmt: skip
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


@pytest.fixture
def place(tmp_path: Path, flight_file: Path, examples: Path) -> dict[str, str]:
    maneuver = examples / "maneuver_3211.toml"
    return {"FLIGHT": str(flight_file), "MANEUVER": str(maneuver), "MODEL": str(tmp_path / "model")}


SURROUNDINGS = (*STREAMS, *LIMITS, *ENVIRONMENTS)


def check(verb: Sequence[str], names: Mapping[str, str], folder: Path, around: Sequence[str]) -> None:
    words = [names.get(word, word) for word in verb]
    if "MODEL" in verb:
        assert ended(["identify", names["FLIGHT"], *IDENTIFY, "-o", names["MODEL"]], folder).returncode == 0
    for i, (shell, codes) in enumerate({**STREAMS, **LIMITS}.items()):
        if shell not in around:
            continue
        (inside := folder / f"limits-{i}").mkdir()
        done = ended(words, inside, shell)
        assert done.returncode in ((2,) if words == ["nosuch"] else codes), (shell, done.stderr)
    for name, changes in ENVIRONMENTS.items():
        if name not in around:
            continue
        (inside := folder / name).mkdir()
        done = ended(words, inside, changes=changes)
        assert done.returncode == 2 * (words == ["nosuch"]), (name, done.stderr)
        warnings = [line for line in done.stderr.splitlines() if "cache" in line]
        assert len(warnings) <= 1
        assert all(line.startswith("stoop: warning: ") for line in warnings)


@pytest.mark.parametrize("name", CHEAP)
def test_cheap_verbs(name: str, place: dict[str, str], tmp_path: Path) -> None:
    check(CHEAP[name], place, tmp_path, SURROUNDINGS)


@pytest.mark.parametrize("name", LONG)
def test_long_verbs(name: str, place: dict[str, str], tmp_path: Path) -> None:
    """Each in a third of the surroundings: what meets them is the same for all verbs."""
    check(LONG[name], place, tmp_path, [one for verb, one in crossed(LONG, SURROUNDINGS) if verb == name])


def test_an_error_and_an_output_that_is_full_are_one_line(tmp_path: Path) -> None:
    """The page that stood in the output when the error came cannot be written either."""
    program = "import sys; from stoop.cli import main as m; from stoop.errors import StoopError\n"
    program += "def run(words):\n  print('a page'); raise StoopError('no file')\n"
    program += "m.one_verb = run\nsys.exit(m.main())"
    done = subprocess.run(
        ["bash", "-c", 'exec "$@" >/dev/full', "bash", sys.executable, "-c", program, "info"],
        cwd=tmp_path, capture_output=True, text=True, encoding="utf-8", check=False,
        env={n: x for n, x in os.environ.items() if n != "PYTHONUNBUFFERED"},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (2, "stoop: error: no file\n")


def test_an_unwritable_cache_is_one_warning(examples: Path, tmp_path: Path) -> None:
    words = ["simulate", "twin-boom", "--maneuver", str(examples / "maneuver_3211.toml"), "-o", "f.nc"]
    done = ended(words, tmp_path, changes={"STOOP_CACHE_DIR": NOWHERE})
    assert done.returncode == 0
    (line,) = done.stderr.splitlines()
    assert line.startswith("stoop: warning: the cache cannot be written")
    assert (tmp_path / "f.nc").exists()
