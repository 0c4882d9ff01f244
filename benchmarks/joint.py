"""A joint fit with its error bars: four maneuvers, 32 coefficients, initial states and biases; flights in memory.

The flight, the wrong starting values and the way are those of `stoop verify coverage` with white noise. What the same number
of trajectories takes alone says how much of the time is anything else. That number leaves out the second differences of the
error bars, so each estimator is also compared with what its own fit and error bars spend in compiled trajectories.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from benchmarks.table import Row
from stoop.assessment.error_bars import ErrorBars
from stoop.estimate import methods
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import Options, OutputErrorEstimate, fit
from stoop.kernels.kernel import Kernel
from stoop_studies.verify.scenes import Scene, in_white_noise

PART = "joint"
SEEDS = 5
ROUNDS = 3
ASKED = 1.0  #: s on two processors, warm
BATCH = 64  #: trajectories at once
METHODS = ("output-error", "filter-error", "multiple-shooting")
MOST = 3.0  #: processor time over that of the compiled trajectories


def run() -> list[Row]:
    """Fit several flights, each a few times; the least time of each counts."""
    scenes = [in_white_noise(seed) for seed in range(SEEDS)]
    fits = [_identified(scene, seed) for seed, scene in enumerate(scenes)]
    wall, processor = (
        np.array([_least(lambda s=s, i=i: _identified(s, i), clock) for i, s in enumerate(scenes)])
        for clock in (time.perf_counter, time.process_time)
    )
    alone = np.array([_flown(f) for f in fits])
    layout, spent = fits[0].problem.layout, [f.trajectories for f in fits]
    size = f"{layout.dimension} parameters, {layout.extra} initial states and biases; {SEEDS} flights"
    return [
        Row(PART, "fit and error bars, 4 maneuvers", float(np.median(wall)), "s", ASKED, note=size),
        Row(PART, "the same, processor time", float(np.median(processor)), "s"),
        Row(PART, "its trajectories", float(np.median(spent)), note=f"{min(spent):.0f} to {max(spent):.0f}"),
        Row(
            PART,
            "processor time over that of its trajectories alone",
            float(np.median(processor / alone)),
            note="what residuals, linear algebra and error bars add",
        ),
        *(_beside_its_kernel(name, scenes[0]) for name in METHODS),
    ]


def _beside_its_kernel(name: str, scene: Scene) -> Row:
    """Compare the processor time of a fit and its error bars with what it spends in compiled code."""

    def identify() -> Estimate:
        found: Estimate = methods.find(name).fitter()(scene.start, scene.flights, scene.windows, Options())
        ErrorBars.of(found)
        return found

    identify()
    measured = []
    for _ in range(ROUNDS):
        with _compiled() as spent:
            begun = time.process_time()
            identify()
            measured.append((time.process_time() - begun, sum(spent)))
    whole, inside = min(measured)
    note = f"{whole:.2g} s, {inside:.2g} s of it compiled"
    return Row(PART, f"{name}, over its own trajectories", whole / inside, at_most=MOST, note=note)


@contextmanager
def _compiled() -> Iterator[list[float]]:
    """Collect the processor time of every call of a kernel's functions, s; on one thread (`STOOP_THREADS=1`)."""
    spent, share = list[float](), Kernel.share

    def timed(self: Kernel, *arguments: Any) -> None:
        begun = time.process_time()
        share(self, *arguments)
        spent.append(time.process_time() - begun)

    Kernel.share = timed  # type: ignore[method-assign]
    try:
        yield spent
    finally:
        Kernel.share = share  # type: ignore[method-assign]


def _identified(scene: Scene, seed: int) -> OutputErrorEstimate:
    options = Options(seed=seed)
    found = fit(scene.start, scene.flights, scene.windows, options)
    ErrorBars.of(found)
    return found


def _flown(found: OutputErrorEstimate) -> float:
    """Return the processor time of as many trajectories, outputs kept, s."""
    problem = found.problem
    Z = np.repeat(found.z[None, :], BATCH, axis=0)

    def fly() -> None:
        for i, piece in enumerate(problem.pieces):
            rows, start = problem.candidates(Z, i)
            problem.layout.vehicle.kernel().trajectories(rows, start, piece.inputs, piece.dt)

    return _least(fly, time.process_time) * found.trajectories / BATCH


def _least(call: Callable[[], object], clock: Callable[[], float]) -> float:
    call()
    times = []
    for _ in range(ROUNDS):
        begun = clock()
        call()
        times.append(clock() - begun)
    return min(times)
