"""A block bootstrap of the joint fit of `benchmarks.joint`: 1000 replicates on two processes, their start included.

Then one of 200 replicates of README's V-tail: what the whole command takes with it, over the same without it.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.command import timed
from benchmarks.jobs import VTAIL, identify_vtail
from benchmarks.table import Row
from stoop.assessment.bootstrap import bootstrap_plan
from stoop.assessment.error_bars import ErrorBars
from stoop.estimate.fit import Options, fit
from stoop.parallel import LocalProcesses, execute
from stoop_studies.verify.scenes import Scene, in_white_noise

PART = "bootstrap"
REPLICATES = 1000
WORKERS = 2
ASKED = 60.0  #: s on two processors
VTAIL_REPLICATES = 200


def run() -> list[Row]:
    """Bootstrap one fit."""
    scene: Scene = in_white_noise(0)
    found = fit(scene.start, scene.flights, scene.windows, Options())
    began = time.perf_counter()
    plan = bootstrap_plan(found, ErrorBars.of(found), 0, REPLICATES)
    with tempfile.TemporaryDirectory() as folder:
        results = execute(plan, Path(folder) / "bootstrap.sqlite", LocalProcesses(WORKERS))
    wall = time.perf_counter() - began
    endings = [ending for told in results.values() for ending in told["endings"]]
    layout = found.problem.layout
    size = f"{layout.dimension} parameters, {layout.extra} initial states and biases, {WORKERS} processes"
    return [
        Row(PART, f"{REPLICATES} replicates, 4 maneuvers", wall, "s", ASKED, note=size),
        Row(PART, "of them by a full search", float(np.sum(np.array(endings) == "refined"))),
        _vtail(),
    ]


def _vtail() -> Row:
    figure = f"stoop identify --bootstrap {VTAIL_REPLICATES} of README's V-tail, over the same without"
    if not VTAIL.exists():
        return Row(PART, figure, None, note="shared folder not found: set STOOP_SHARED")
    with tempfile.TemporaryDirectory() as folder:
        words, cache = identify_vtail(str(Path(folder) / "out")), Path(folder) / "cache"
        timed(words, cache, cores=WORKERS)
        plain = timed(words, cache, cores=WORKERS)
        whole = timed((*words, "--bootstrap", str(VTAIL_REPLICATES)), cache, cores=WORKERS)
    note = (
        f"processor time: {whole.processor:.3g} s against {plain.processor:.3g} s; wall {whole.ended:.3g} s"
    )
    return Row(PART, figure, whole.processor / plain.processor, note=note)
