"""Plant defects one at a time and say which tier of the tests notices: ``python scripts/mutants.py [--tier full] [NAME ...]``.

``tests/mutants/mutants.toml`` holds the defects. Each is planted into a copy of ``src``, which comes first in PYTHONPATH;
then the test that was seen to fail with it runs, the tests of its room, and the whole standard tier, until a test fails;
with ``--tier full`` the full tier, too. The programs of the environment come first in PATH. Exit code 1: fewer than 95 %
were noticed by the standard tier, or one by neither tier that ran; 2: a defect cannot be planted, or tests fail without one.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
MUTANTS: Final = ROOT / "tests" / "mutants" / "mutants.toml"
SHARE: Final = 0.95  #: of the defects, that the standard tier has to notice
PYTEST: Final = ("pytest", "-x", "-q", "-p", "no:cacheprovider", "--tb=line", "-rfE")
FAILED: Final = re.compile(r"^(?:FAILED|ERROR) (tests/.+?\.py(?:::.*?)?)(?: - .*)?$", re.MULTILINE)
KILLED: Final = (1, 2)  #: exit codes of pytest: a test failed, or a module could not be collected


@dataclass(frozen=True)
class Mutant:
    """A planted defect, and how it was noticed."""

    name: str
    file: str
    old: str
    new: str
    defect: str
    killed_by: str = ""
    tier: str = ""  #: that noticed it
    test: str = ""  #: that noticed it
    seconds: float = 0.0  #: of all runs until then

    @property
    def room(self) -> str:
        """Return the folder of the tests of its room, or of its package, or an empty text."""
        package, room, *_ = Path(self.file).parts[1:]
        folder = f"tests/core/{room}" if package == "stoop" else f"tests/{package.removeprefix('stoop_')}"
        return folder if (ROOT / folder).is_dir() else ""

    @property
    def recorded(self) -> tuple[str, ...]:
        """Return the test that was seen to notice it, if it is still there."""
        return (self.killed_by,) if (ROOT / self.killed_by.partition("::")[0]).is_file() else ()

    def runs(self, tier: str) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Return the tier of each run and its arguments, the most promising first."""
        for at in ("standard", "full")[: 2 if tier == "full" else 1]:
            if self.recorded:
                yield at, self.recorded
            if self.room:
                yield at, (self.room,)
            yield at, ()


class Runner:
    """Runs tests on copies of the sources, below one folder; all of it ends with an interruption."""

    def __init__(self, scratch: Path) -> None:
        self.scratch, self.stopped = scratch, False
        self._processes: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()

    def judged(self, mutant: Mutant, tier: str) -> Mutant:
        """Plant a defect and run tests until one fails."""
        began, source = time.monotonic(), self._copy(mutant)
        try:
            for at, arguments in mutant.runs(tier):
                test = self.first_failure(source, ["--tier", at, *arguments])
                if test or self.stopped:
                    return replace(mutant, tier=at, test=test, seconds=time.monotonic() - began)
        finally:
            shutil.rmtree(source.parent, ignore_errors=True)
        return replace(mutant, seconds=time.monotonic() - began)

    def first_failure(self, source: Path, arguments: Sequence[str]) -> str:
        """Return the test that failed, or an empty text; what was not collected has not failed."""
        surroundings = {**os.environ, "PYTHONPATH": str(source)}
        with self._lock:
            if self.stopped:
                return ""
            process = subprocess.Popen(
                [*PYTEST, *arguments], cwd=ROOT, env=surroundings, text=True, start_new_session=True,
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            )  # fmt: skip
            self._processes.add(process)
        output, _ = process.communicate()
        with self._lock:
            self._processes.discard(process)
        found = FAILED.search(output)
        if self.stopped:
            return ""
        if process.returncode < 0 or "Fatal Python error" in output or "Timeout (" in output:
            return "a test that crashed or hung"
        if process.returncode in (3, 4) and not found and "conftest" not in output:
            raise RuntimeError(f"pytest {' '.join(arguments)} did not run:\n{output[-2000:]}")
        return found[1] if found and process.returncode in KILLED else ""

    def stop(self) -> None:
        """End all processes, and those that they started."""
        with self._lock:
            self.stopped = True
            for process in self._processes:
                with suppress(OSError):
                    os.killpg(process.pid, signal.SIGKILL)

    def _copy(self, mutant: Mutant) -> Path:
        source = self.scratch / mutant.name / "src"
        shutil.copytree(ROOT / "src", source)
        (source.parent / "examples").symlink_to(ROOT / "examples")  # beside the sources, as in a working copy
        place = source.parent / mutant.file
        place.write_text(place.read_text("utf-8").replace(mutant.old, mutant.new), encoding="utf-8")
        return source


def main() -> int:
    """Judge the chosen defects, print each as soon as it is known, and then the shares."""
    arguments = _arguments()
    chosen = _chosen(arguments.names)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with tempfile.TemporaryDirectory(prefix="stoop-mutants-") as scratch:
        runner, found = Runner(Path(scratch)), list[Mutant]()
        with ThreadPoolExecutor(arguments.jobs) as workers:
            try:
                known = [test for m in chosen for test in m.recorded]
                sound = workers.submit(runner.first_failure, ROOT / "src", ["--tier", "all", *known])
                if known and (test := sound.result()):
                    _refuse(f"{test} fails without a planted defect")
                futures = [workers.submit(runner.judged, m, arguments.tier) for m in chosen]
                for future in as_completed(futures):
                    found.append(future.result())
                    print(_line(found[-1]), flush=True)
            except BaseException:
                runner.stop()
                workers.shutdown(cancel_futures=True)
                raise
    return _summary(found, arguments.tier)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Plant defects one at a time; say which tests notice.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="defects; all without one")
    parser.add_argument("--tier", choices=("standard", "full"), default="standard", help="last that runs")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="defects at the same time")
    return parser.parse_args()


def _chosen(names: Sequence[str]) -> list[Mutant]:
    every = {one["name"]: Mutant(**one) for one in tomllib.loads(MUTANTS.read_text("utf-8"))["mutant"]}
    if unknown := [name for name in names if name not in every]:
        _refuse(f"no such defect: {', '.join(unknown)}")
    chosen = [every[name] for name in names or every]
    for m in chosen:
        if not (ROOT / m.file).is_file() or (ROOT / m.file).read_text("utf-8").count(m.old) != 1:
            _refuse(f"{m.name}: its `old` does not occur exactly once in {m.file}; plant it elsewhere")
    return chosen


def _refuse(message: str) -> None:
    print(message, file=sys.stderr)
    sys.exit(2)


def _line(m: Mutant) -> str:
    how = f"{m.tier}, {m.test}" if m.test else f"NOT NOTICED: {m.defect}"
    return f"{m.name}: {how} ({m.seconds:.0f} s)"


def _summary(found: Sequence[Mutant], tier: str) -> int:
    total, in_standard = len(found), sum(m.tier == "standard" for m in found)
    living = [m.name for m in found if not m.test]
    shares = f"standard {in_standard} of {total} ({in_standard / total:.0%})"
    if tier == "full":
        shares += f", standard and full {total - len(living)} of {total} ({1 - len(living) / total:.0%})"
    print(
        f"planted defects noticed by {shares}"
        + (f"; not by any: {', '.join(sorted(living))}" if living else "")
    )
    return int(in_standard < SHARE * total or (tier == "full" and bool(living)))


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
