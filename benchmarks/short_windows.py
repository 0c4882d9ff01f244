"""Many short windows of unknown initial state: a micro airplane from motion capture, in processor time of one core."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Final

from benchmarks.table import Row
from stoop.workflow.identification import fit
from stoop_studies.verify import capture

PART = "short-windows"
SEED: Final = 2
COUNT: Final = 9
LENGTH: Final = 2.5  #: s
FIRST: Final = 6.0  #: s: the vehicle has begun to be moved
STEP: Final = 5.0  #: s from one window to the next


def run() -> list[Row]:
    """Fit a drafted vehicle to the windows twice; the second fit, its equations compiled, counts."""
    with tempfile.TemporaryDirectory(prefix="stoop-windows-") as name:
        flown, _ = capture.fly("wings", SEED, Path(name))
        flight, vehicle = capture.drafted(flown)
        starts = [FIRST + STEP * i for i in range(COUNT)]
        windows = tuple(f"{start:g}:{start + LENGTH:g}" for start in starts)
        for _ in range(2):
            began = time.process_time()
            job = fit(vehicle, [flight], windows)
            taken = time.process_time() - began
    numbers = len(job.result.parameters)
    what = f"{COUNT} windows of {LENGTH:g} s, pose alone, {numbers} free numbers: fit, tests and verdict"
    return [Row(PART, what, taken, "s", at_most=30.0)]
