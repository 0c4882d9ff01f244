"""How time and memory of the verbs grow with samples, windows, free parameters, candidates and draws.

A flight of the built-in airplane begins at the truth, so that a fit takes few iterations whatever the size. Each size runs
in a process of its own, once to warm up and once for the processor time; memory is the growth of its peak. The exponent is
the slope of the logarithm over the last two doublings; what every call costs dominates small sizes.

``STOOP_GROWTH=full`` measures the whole range (10 s to 1 h, 64 windows, 8,192 candidates, 102,400 draws).
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmarks.case import RATE
from benchmarks.table import Row
from stoop.assessment.assessment import linearize
from stoop.assessment.bootstrap import bootstrap_plan, refit_chunk
from stoop.assessment.error_bars import ErrorBars
from stoop.estimate.fit import DEFAULTS, OutputErrorEstimate, estimation_problem, fit
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop_analysis.posterior import coordinates, posterior_target
from stoop_analysis.sampling import Chains

PART: Final = "growth"
MEGABYTE: Final = 1e6
MAX_MEMORY: Final = 500.0  #: MB
SHORT: Final = 10.0  #: s, of a window
CHAINS: Final = 4
LIMIT: Final = 600.0  #: s, of one size
Call = Callable[[], object]


@dataclass(frozen=True)
class Growth:
    """One verb over one kind of size: what is called for a size, and the greatest exponent that is asked for."""

    verb: str
    over: str
    sizes: tuple[int, ...]  #: each twice the one before
    largest: int  #: of the whole range
    prepare: Callable[[int], Call]
    exponent: float  #: of the time, at most

    @property
    def measured(self) -> tuple[int, ...]:
        """Sizes of this run."""
        sizes = list(self.sizes)
        while os.environ.get("STOOP_GROWTH") == "full" and 2 * sizes[-1] <= self.largest:
            sizes.append(2 * sizes[-1])
        return tuple(sizes)


def run() -> list[Row]:
    """Measure every verb over its sizes."""
    return [row for growth in GROWTHS for row in _rows(growth)]


def _rows(growth: Growth) -> Iterator[Row]:
    sizes = growth.measured
    times, memory = np.array([_apart(growth, size) for size in sizes]).T
    figure = f"{growth.verb}, {sizes[0]} to {sizes[-1]} {growth.over}"
    each = ", ".join(f"{t:.2g}" for t in times)
    # the clock of one call is good to a tenth
    slope = _exponent(times)
    yield Row(PART, f"{figure}: exponent of time", slope, at_most=growth.exponent + 0.1, note=f"{each} s")
    note = f"exponent {_exponent(np.maximum(memory, 1.0)):.2f}"
    yield Row(PART, f"{figure}: peak memory", float(memory[-1]), "MB", at_most=MAX_MEMORY, note=note)


def _exponent(values: np.ndarray) -> float:
    last = values[-3:]
    return float(np.log2(last[-1] / last[0]) / (len(last) - 1))


def _apart(growth: Growth, size: int) -> tuple[float, float]:
    """Return processor time, s, and memory beyond what the process had before, MB, of a call in a process of its own."""
    words = [sys.executable, "-m", __name__, str(GROWTHS.index(growth)), str(size)]
    done = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True, timeout=LIMIT)
    seconds, memory = map(float, done.stdout.split()[-2:])
    return seconds, memory


def _measure(call: Call) -> None:
    before = _peak()
    call()
    begun = time.process_time()
    call()
    print(time.process_time() - begun, _peak() - before)


def _peak() -> float:
    """Return the greatest memory that this process has had, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0 / MEGABYTE


def _airplane(free: int | None = None) -> Vehicle:
    """Return the built-in airplane with its first `free` free numbers, all by default."""
    vehicle = load_vehicle("twin-boom")
    names = [p.name for p in vehicle.free_parameters]
    return vehicle.with_numbers({n: {"free": False} for n in names[free:]} if free is not None else {})


def _problem(seconds: float, windows: int = 1, free: int | None = None) -> tuple[object, ...]:
    """Return what a fit takes: a vehicle, its flight of doublets one after the other, and windows of equal length."""
    moved = [("elevator", 0.05), ("aileron", 0.05), ("rudder", 0.07)]
    inputs = [
        {"control": moved[i % 3][0], "shape": "doublet", "start": 1.0 + 3.0 * i, "step": 0.5,
         "amplitude": (-1) ** (i // 3) * moved[i % 3][1]}
        for i in range(int((seconds * windows - 2.0) / 3.0))
    ]  # fmt: skip
    maneuver = Maneuver.model_validate({"duration": seconds * windows, "rate": RATE, "input": inputs})
    vehicle = _airplane(free)
    flight = simulate_flight(_airplane(), maneuver, name="f")
    return vehicle, {"f": flight}, tuple(Window("f", seconds * i, seconds * (i + 1)) for i in range(windows))


def _fitted(seconds: float, windows: int = 1, free: int | None = None) -> OutputErrorEstimate:
    return fit(*_problem(seconds, windows, free))  # type: ignore[arg-type]


def _fit(seconds: float, windows: int = 1, free: int | None = None) -> Call:
    problem = _problem(seconds, windows, free)
    return lambda: fit(*problem)  # type: ignore[arg-type]


def _bars(seconds: float, windows: int = 1, free: int | None = None) -> Call:
    found = _fitted(seconds, windows, free)
    return lambda: ErrorBars.of(found)


def _costs(count: int) -> Call:
    problem, _ = estimation_problem(*_problem(SHORT), DEFAULTS)  # type: ignore[arg-type, call-arg]
    X = np.clip(
        problem.layout.start + 0.01 * np.random.default_rng(0).standard_normal((count, problem.dimension)),
        0.0,
        1.0,
    )
    return lambda: problem.costs(X, len(problem.prices) - 1)


def _gradients(windows: int) -> Call:
    found = _fitted(SHORT, windows)
    target = posterior_target(found, ErrorBars.of(found))
    straight = coordinates(target)
    xi = 0.1 * np.random.default_rng(0).standard_normal((10, target.size))
    return lambda: [straight.density(target, one) for one in xi]


def _derivatives(windows: int) -> Call:
    found = _fitted(SHORT, windows)
    return lambda: linearize(found.refit_problem, found.z, np.arange(len(found.z)))


def _replicates(count: int) -> Call:
    found = _fitted(SHORT)
    runs = bootstrap_plan(found, ErrorBars.of(found), 0, count).runs
    return lambda: [refit_chunk(one.arguments, [None]) for one in runs]


def _chains(draws: int) -> Call:
    values = np.random.default_rng(0).standard_normal((CHAINS, draws // CHAINS, 32))
    return lambda: Chains.of(values, values[:, :, 0])


GROWTHS: Final = (
    Growth("fit", "s of one window", (10, 20, 40), 3600, _fit, 1.0),
    Growth("error bars", "s of one window", (10, 20, 40), 3600, _bars, 1.0),
    Growth("fit", "windows of 10 s", (1, 2, 4, 8), 64, lambda n: _fit(SHORT, n), 1.0),
    Growth("error bars", "windows of 10 s", (1, 2, 4, 8), 64, lambda n: _bars(SHORT, n), 1.0),
    Growth("derivatives", "windows of 10 s", (1, 2, 4, 8), 64, _derivatives, 1.0),
    Growth("gradients of the posterior", "windows of 10 s", (1, 2, 4, 8), 64, _gradients, 1.0),
    Growth("fit", "free parameters", (8, 16, 32), 32, lambda n: _fit(SHORT, 1, n), 2.0),
    Growth("error bars", "free parameters", (8, 16, 32), 32, lambda n: _bars(SHORT, 1, n), 2.0),
    Growth("costs", "candidates", (64, 128, 256, 512), 8192, _costs, 1.0),
    Growth("bootstrap", "replicates", (32, 64, 128), 1024, _replicates, 1.0),
    Growth("convergence of draws", "draws", (1600, 3200, 6400), 102_400, _chains, 1.0),
)

if __name__ == "__main__":
    _measure(GROWTHS[int(sys.argv[1])].prepare(int(sys.argv[2])))
