"""Run the tests of the project, or its checks: ``python3 scripts/test.py [--environment DIR] [WHAT ...]``.

Without words the standard tests run: what protects correctness; the name of a package (``core``, ``tune``; of the studies
``stoop_studies``) runs those in its folder alone. ``checks`` are the style, types, layers, structure and
documentation, each by its name too; ``full`` are the tests that take longer or need more packages; ``studies`` campaigns
and distributions at full power; ``mutants`` plants defects and prints which tier kills each. The environment is made if it
is not there, and what the chosen words need is installed into it from this folder: Python 3.11 is all that is needed. A
command that fails does not keep the others from running.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OLDEST = (3, 11)
WINDOWS = os.name == "nt"


def _tests(tier: str) -> list[str]:
    """Return the command of a tier: three workers, because some wait, with some GB of kernels each."""
    return ["pytest", "-q", "-n", "3", "--dist", "loadfile", "--tier", tier]


#: name -> command of the environment; {scratch} is thrown away
CHECKS = {
    "lint": ["ruff", "check", "."],
    "format": ["ruff", "format", "--check", "."],
    "types": ["mypy"],
    "layers": ["lint-imports"],
    "interface": ["python", "scripts/interface.py", "--check"],
    "structure": ["python", "scripts/structure.py"],
    "docs": ["sphinx-build", "-q", "-W", "--keep-going", "docs", "{scratch}/site"],
}
TESTS = {tier: _tests(tier) for tier in ("standard", "full", "studies")}
TESTS["mutants"] = ["python", "scripts/mutants.py", "--tier", "full"]
#: word -> standard tests of that package; "studies" is a tier
PACKAGES = {
    f"stoop_{name}" if name in TESTS else name: [*_tests("standard"), f"tests/{name}"]
    for name in ("core", "draft", "plan", "analysis", "export", "tune", "fleet", "app", "studies")
}
COMMANDS = TESTS | PACKAGES | CHECKS
#: command -> extras that it needs
EXTRAS = {n: "test" if n in PACKAGES or n == "standard" else "test,full" for n in TESTS | PACKAGES}
# PyFlyt asks for NumPy below 2, and flies with 2, which drone-models asks for.
PYFLYT = ["--no-deps", "pyflyt>=0.29", "pybullet>=3.2.6"]


def main() -> int:
    """Make the environment, run the commands, say which failed."""
    arguments = _arguments()
    folder = arguments.environment.resolve()
    words = arguments.what or ["standard"]
    chosen = [n for w in words for n in (CHECKS if w == "checks" else [w])]
    installed = _install(folder, ",".join(sorted({EXTRAS.get(n, "test,check,docs") for n in chosen})))
    failed = [] if installed else ["install"]
    with tempfile.TemporaryDirectory(prefix="stoop-checks-") as scratch:
        commands = {n: [w.format(scratch=scratch) for w in COMMANDS[n]] for n in chosen if installed}
        failed += [name for name, command in commands.items() if not _run(name, command, folder)]
    print(f"\nfailed: {', '.join(failed)}" if failed else f"\nall passed: {', '.join(chosen)}", flush=True)
    return 1 if failed else 0


def _arguments() -> argparse.Namespace:
    if sys.version_info < OLDEST:
        sys.exit("stoop needs Python 3.11 or later; run this with python3.11")
    parser = argparse.ArgumentParser(description="Run the tests or the checks of the project.")
    known = [*TESTS, *PACKAGES, "checks", *CHECKS]
    parser.add_argument("what", metavar="WHAT", nargs="*", help=f"{', '.join(known)} (default: standard)")
    parser.add_argument("--environment", metavar="DIR", type=Path, default=ROOT / ".venv-test")
    arguments = parser.parse_args()
    if unknown := set(arguments.what) - set(known):
        parser.error(f"there is no check '{min(unknown)}'; choose from {', '.join(known)}")
    return arguments


def _install(folder: Path, extras: str) -> bool:
    """Make the environment and install the package as it is now: by uv where it can be had, otherwise by pip."""
    python = _programs(folder) / ("python.exe" if WINDOWS else "python")
    if not _works(python):
        other = folder.is_file() or (folder.exists() and any(folder.iterdir()))
        if other and not (folder / "pyvenv.cfg").exists():
            print(
                f"{folder} is no virtual environment: name another folder by --environment", file=sys.stderr
            )
            return False
        if not _run("environment", [sys.executable, "-m", "venv", "--clear", str(folder)], folder):
            return False
    pip = [str(python), "-m", "pip", "install", "--quiet"]
    uv = shutil.which("uv") or shutil.which("uv", path=str(_programs(folder)))
    if uv is None and _run("uv", [*pip, "uv"], folder):
        uv = shutil.which("uv", path=str(_programs(folder)))
    steps = [["--reinstall-package", "stoop", f".[{extras}]"]]
    if "full" in extras:
        steps.append(PYFLYT)
    for step in steps:
        by_uv = [uv or "", "pip", "install", "--quiet", "--python", str(python), *step]
        by_pip = [*pip, *(w for w in step if w not in ("--reinstall-package", "stoop"))]
        if not (uv and _run("install", by_uv, folder)) and not _run("install", by_pip, folder):
            return False
    return True


def _works(python: Path) -> bool:
    """Return whether the environment is whole."""
    try:
        return subprocess.run([python, "-c", "import pip"], capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def _programs(folder: Path) -> Path:
    """Return the folder of the environment's programs."""
    return folder / ("Scripts" if WINDOWS else "bin")


def _run(name: str, command: Sequence[str], folder: Path) -> bool:
    """Run a command of the environment, or one with its path, and return whether it succeeded."""
    threads = {
        "OPENBLAS_NUM_THREADS": "1",
        "STOOP_THREADS": "1",
    }  # those of three processes would wait for each other
    print(f"\n=== {name}: {' '.join(command)}", flush=True)
    began = time.monotonic()
    path = os.pathsep.join([str(_programs(folder)), os.environ.get("PATH", "")])
    program = shutil.which(command[0], path=str(_programs(folder))) or command[0]
    environment: Mapping[str, str] = os.environ | {"PATH": path} | threads
    environment = {
        n: v for n, v in environment.items() if n != "PYTHONDONTWRITEBYTECODE"
    }  # workers would compile all
    code: int | str
    try:
        if not Path(program).is_absolute():
            raise FileNotFoundError(2, f"{program} is not in {_programs(folder)}")
        code = _wait(
            subprocess.Popen([program, *command[1:]], cwd=ROOT, env=environment, stdin=subprocess.DEVNULL)
        )
    except OSError as error:
        code = error.strerror
    print(
        f"=== {name}: {'ok' if code == 0 else f'failed ({code})'}, {time.monotonic() - began:.0f} s",
        flush=True,
    )
    return code == 0


def _wait(process: subprocess.Popen[bytes]) -> int:
    """Wait for a process; an interruption is passed on, and it has half a minute to end what it started."""
    try:
        return process.wait()
    except KeyboardInterrupt:
        process.send_signal(signal.SIGTERM if WINDOWS else signal.SIGINT)
        try:
            process.wait(30)
        except subprocess.TimeoutExpired:
            process.kill()
        raise


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
