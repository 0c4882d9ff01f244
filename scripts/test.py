"""Run the checks of the project: ``python3 scripts/test.py [--environment DIR] [CHECK ...]``.

The environment is made if it is not there and stoop is installed into it from this folder, so Python 3.11 is
all it needs. Without names the checks before a commit run, the tests of the standard tier beside the others, which use
what these leave of the processors; one that fails does not keep the others from running. ``quick`` runs ruff and the
tests that take seconds, for while you work; ``full`` the tests that the standard tier leaves out: campaigns and
distributions at full power.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OLDEST = (3, 11)


def _tests(tier: str) -> list[str]:
    """Return the command of a tier: three workers, because some wait, with some GB of kernels each; long files come first."""
    workers = ["-n", "3", "--dist", "loadfile", "--no-loadscope-reorder"]
    durations = ["--durations=10", f"--durations-file=.durations-{tier}.json"]
    return ["pytest", "-q", *workers, "--tier", tier, *durations]


#: name -> command of the environment; {scratch} is thrown away
CHECKS = {
    "lint": ["ruff", "check", "."],
    "format": ["ruff", "format", "--check", "."],
    "types": ["mypy"],
    "layers": ["lint-imports"],
    "structure": ["python", "scripts/structure.py"],
    "tests": _tests("standard"),
    "docs": ["sphinx-build", "-q", "-W", "--keep-going", "docs", "{scratch}/site"],
}
QUICK = {"lint": CHECKS["lint"], "format": CHECKS["format"], "quick tests": _tests("quick")}
FULL = {"full tests": _tests("full")}
ALONE = {"quick": QUICK, "full": FULL}


def main() -> int:
    """Make the environment, run the checks, say which failed."""
    arguments = _arguments()
    folder = arguments.environment.resolve()
    install = _install(folder)
    with tempfile.TemporaryDirectory(prefix="stoop-checks-") as scratch:
        named = {n: CHECKS[n] for n in arguments.checks or CHECKS if n in CHECKS}
        chosen = named or ALONE[arguments.checks[0]]
        commands = {name: [w.format(scratch=scratch) for w in words] for name, words in chosen.items()}
        failed = _failed(commands, folder) if install else ["install"]
    print(f"\nfailed: {', '.join(failed)}" if failed else f"\nall passed: {', '.join(commands)}", flush=True)
    return 1 if failed else 0


def _failed(commands: Mapping[str, Sequence[str]], folder: Path) -> list[str]:
    """Run commands, those beside the tests at the same time, with their output at their end; return those that failed."""
    with ThreadPoolExecutor(1) as other:
        beside = {
            n: other.submit(_run, n, c, folder, whole=True)
            for n, c in commands.items()
            if "tests" in commands and n != "tests"
        }
        ended = {n: _run(n, c, folder) for n, c in commands.items() if n not in beside}
        ended |= {n: run.result() for n, run in beside.items()}
    return [n for n in commands if not ended[n]]


def _arguments() -> argparse.Namespace:
    if sys.version_info < OLDEST:
        sys.exit("stoop needs Python 3.11 or later; run this with python3.11")
    parser = argparse.ArgumentParser(description="Run the checks of the project.")
    parser.add_argument(
        "checks",
        metavar="CHECK",
        nargs="*",
        help=f"quick, full, or some of {', '.join(CHECKS)} (default: these)",
    )
    parser.add_argument("--environment", metavar="DIR", type=Path, default=ROOT / ".venv-test")
    arguments = parser.parse_args()
    unknown = set(arguments.checks) - set(CHECKS) if arguments.checks not in ([n] for n in ALONE) else set()
    if unknown:
        parser.error(f"there is no check '{min(unknown)}'; choose quick, full, or from {', '.join(CHECKS)}")
    return arguments


def _install(folder: Path) -> bool:
    """Make the environment and install the package as it is now, with all that the checks need."""
    if not (folder / "pyvenv.cfg").exists() and not _run(
        "environment", [sys.executable, "-m", "venv", str(folder)], folder
    ):
        return False
    pip = ["python", "-m", "pip", "install", "--quiet"]
    # PyFlyt asks for NumPy below 2, and flies with 2, which drone-models asks for.
    return _run("install", [*pip, ".[test,docs]"], folder) and _run(
        "install PyFlyt", [*pip, "--no-deps", "pyflyt>=0.29", "pybullet>=3.2.6"], folder
    )


def _run(name: str, command: Sequence[str], folder: Path, whole: bool = False) -> bool:
    """Run a command with the environment's programs first, its output `whole` at its end or as it comes; return its success."""
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    path = os.pathsep.join([str(programs), os.environ.get("PATH", "")])
    own = {
        "OPENBLAS_NUM_THREADS": "1",  # threads of three processes would wait for each other
        "STOOP_THREADS": "1",  # likewise
    }
    inherited = {
        n: v for n, v in os.environ.items() if n != "PYTHONDONTWRITEBYTECODE"
    }  # each worker would rewrite all
    head = f"\n=== {name}: {' '.join(command)}"
    if not whole:
        print(head, flush=True)
    began = time.monotonic()
    program = shutil.which(command[0], path=path) or command[0]
    done = subprocess.run(
        [program, *command[1:]],
        cwd=ROOT,
        env={**inherited, "PATH": path, **own},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE if whole else None,
        stderr=subprocess.STDOUT if whole else None,
        text=True,
        errors="replace",
        check=False,
    )
    code, seconds = done.returncode, time.monotonic() - began
    outcome = f"=== {name}: {'ok' if code == 0 else f'failed ({code})'}, {seconds:.0f} s"
    print(f"{head}\n{done.stdout}{outcome}" if whole else outcome, flush=True)
    return code == 0


if __name__ == "__main__":
    sys.exit(main())
