"""How long a user waits: for the first estimates, with and without compiled modules, and for help."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.command import Run, timed
from benchmarks.table import Row
from stoop.workflow.demo import TABLE_1

PART = "startup"
REPEATS = 5


def run() -> list[Row]:
    """Measure the demo and the help page in processes of their own."""
    with tempfile.TemporaryDirectory(prefix="stoop-startup-") as scratch:
        return list(_rows(Path(scratch)))


def _rows(scratch: Path) -> Iterator[Row]:
    demo = ("demo", "-o", str(scratch / "demo"))
    cold = timed(demo, scratch / "cache", TABLE_1)
    warm = [timed(demo, scratch / "cache", TABLE_1) for _ in range(REPEATS)]
    help_page = [timed(("--help",), scratch / "cache") for _ in range(REPEATS)]
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
