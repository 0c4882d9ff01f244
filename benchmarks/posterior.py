"""The posterior of README's V-tail, 48 parameters: the whole command on two cores, over the same without it."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Final

from benchmarks.command import timed
from benchmarks.jobs import VTAIL, identify_vtail
from benchmarks.table import Row
from stoop.results.uncertainty import MethodIntervals

PART: Final = "posterior"
CORES: Final = 2


def run() -> list[Row]:
    """Identify without and with a posterior; read the diagnostics of the sampler from its result."""
    figure = "stoop identify --posterior of README's V-tail, over the same without"
    if not VTAIL.exists():
        return [Row(PART, figure, None, note="shared folder not found: set STOOP_SHARED")]
    with tempfile.TemporaryDirectory(prefix="stoop-posterior-") as name:
        out, cache = Path(name) / "out", Path(name) / "cache"
        words = identify_vtail(str(out))
        timed(words, cache, cores=CORES)
        plain = timed(words, cache, cores=CORES)
        whole = timed((*words, "--posterior"), cache, cores=CORES)
        result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    told = result["uncertainty"]["posterior"]["figures"]
    seconds = f"{whole.processor:.3g} s against {plain.processor:.3g} s"
    return [
        Row(PART, figure, whole.processor / plain.processor, note=f"processor time: {seconds}"),
        Row(PART, "the same: wall time", whole.ended, "s", note="two cores"),
        Row(PART, "greatest R-hat of its parameters", told["rhat"], at_most=MethodIntervals.MAX_RHAT),
        Row(PART, "least effective sample size, tails", told["ess_tail"]),
        Row(PART, "its gradients", told["gradients"]),
    ]
