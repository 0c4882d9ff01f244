"""How long a user waits: for the first estimates, with and without compiled modules, and for help."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.table import Row
from stoop.workflow.demo import TABLE_1

PART = "startup"
REPEATS = 5


@dataclass(frozen=True)
class Run:
    """One run of the command: wall time to the last awaited line and to the end, processor time, s."""

    shown: float
    ended: float
    processor: float


def run() -> list[Row]:
    """Measure the demo and the help page in processes of their own."""
    with tempfile.TemporaryDirectory(prefix="stoop-startup-") as scratch:
        return list(_rows(Path(scratch)))


def _rows(scratch: Path) -> Iterator[Row]:
    demo = ("demo", "-o", str(scratch / "demo"))
    cold = _timed(demo, TABLE_1, scratch / "cache")
    warm = [_timed(demo, TABLE_1, scratch / "cache") for _ in range(REPEATS)]
    help_page = [_timed(("--help",), (), scratch / "cache") for _ in range(REPEATS)]
    yield Row(
        PART, "stoop demo, warm: estimates printed", _median(warm, "shown"), "s", at_most=3.0,
        note=_note(warm, "shown"),
    )  # fmt: skip
    yield Row(PART, "stoop demo, warm: report written", _median(warm, "ended"), "s")
    yield Row(
        PART, "stoop demo, empty cache: report written", cold.ended, "s", at_most=60.0,
        note="once; compiling included",
    )  # fmt: skip
    yield Row(
        PART, "stoop --help", _median(help_page, "ended"), "s", at_most=0.3,
        note=_note(help_page, "ended"),
    )  # fmt: skip


def _note(runs: Sequence[Run], field: str) -> str:
    least = min(getattr(r, field) for r in runs)
    used = _median(runs, "processor")
    return f"from process start, median of {len(runs)}; least {least:.2g} s, processor time {used:.2g} s"


def _median(runs: Sequence[Run], field: str) -> float:
    return float(np.median([getattr(r, field) for r in runs]))


def _timed(words: Sequence[str], awaited: Sequence[str], cache: Path) -> Run:
    """Run stoop; note when every awaited name has begun a printed line."""
    before, begun, shown = _processor(), time.perf_counter(), 0.0
    missing = set(awaited)
    with subprocess.Popen(
        [sys.executable, "-m", "stoop", *words],
        env=os.environ | {"STOOP_CACHE_DIR": str(cache)},
        stdout=subprocess.PIPE,
        text=True,
    ) as child:
        for line in child.stdout or ():
            missing.discard(next(iter(line.split()), ""))
            if awaited and not missing and not shown:
                shown = time.perf_counter() - begun
    ended = time.perf_counter() - begun
    if child.returncode or missing:
        raise RuntimeError(
            f"stoop {words[0]}: exit code {child.returncode}, not printed: {missing or 'none'}"
        )
    return Run(shown, ended, _processor() - before)


def _processor() -> float:
    """Return the processor time of finished children, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
