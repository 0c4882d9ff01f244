"""How fast costs are computed: against the prototype, against the core's peak, against SciPy."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from benchmarks import flops, peak, plain, prototype
from benchmarks.case import MANEUVER, Case, full
from benchmarks.clock import FloatArray, interleave, ratio
from benchmarks.table import Row
from stoop.kernels import compiler, load_kernel
from stoop.kernels.kernel import ENTRIES
from stoop.simulation.fly import fly
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle.symbolic import build_model

PART = "engine"
COUNTS = (64, 512)
SMALL = 48  #: candidates of the longitudinal model, as many as a population of the paper's searches
ROUNDS = 15


def run() -> list[Row]:
    """Measure all of it."""
    case = full()
    return [
        _compilation(case),
        *_against_prototype_and_peak(case),
        _on_avx2(case),
        *_longitudinal(case),
        *_against_scipy(case),
        *_threads(case),
    ]


def _compilation(case: Case) -> Row:
    """Time what a structure that is not in the cache takes: its functions and all that is compiled from them."""
    kept = os.environ.get("STOOP_CACHE_DIR")
    with tempfile.TemporaryDirectory(prefix="stoop-benchmark-") as folder:
        os.environ["STOOP_CACHE_DIR"] = folder
        begun = time.process_time()
        kernel = load_kernel(f"benchmark {folder}", lambda: build_model(case.vehicle))
        for name in ENTRIES:
            for count in (1, kernel.lanes):
                kernel.entry(name, count)
        spent = time.process_time() - begun
    os.environ.pop("STOOP_CACHE_DIR")
    if kept is not None:
        os.environ["STOOP_CACHE_DIR"] = kept
    note = f"six degrees of freedom, all {len(ENTRIES)} functions, each for many candidates and for few; processor time"
    return Row(PART, "cold structure", spent, "s", at_most=1.5, note=note)


def _on_avx2(case: Case) -> Row:
    """Time code that is made for a processor with half the register, beside that processor's own peak."""
    target, figure = compiler.Target("haswell", ""), "share of the core's FMA peak, code for AVX2"
    ceiling = peak.compiled(target) if compiler.native().doubles() >= target.doubles() > 2 else None
    if ceiling is None:
        return Row(PART, figure, None, "%", at_least=52.0, note="no AVX2 here")
    entry, lanes = ENTRIES["cost"], 2 * target.doubles()
    made = compiler.load(target.object_file(entry.text(case.kernel.model, lanes)), entry.arguments)
    kernel = replace(case.kernel, lanes=lanes, entries=lambda *_: made)
    count, steps = max(COUNTS), len(case.flown.time)
    times = interleave({"ours": case.cost(count, kernel=kernel), "peak": ceiling[0]}, ROUNDS)
    ours = _nanoseconds(times["ours"], count, steps)
    share = _share(case, ours, times["peak"], ceiling[1])
    note = f"{np.median(ours):.1f} ns a step; {share.note}"
    return replace(share, figure=figure, at_least=52.0, note=note)


def _nanoseconds(times: FloatArray, count: int, steps: int) -> FloatArray:
    return times / count / steps * 1e9


def _against_prototype_and_peak(case: Case) -> Iterator[Row]:
    """Time stoop, the prototype and the multiply-add loop in turn."""
    ceiling = peak.compiled()
    calls = _calls(case)
    if ceiling is not None:
        calls["peak"] = ceiling[0]
    times, steps = interleave(calls, ROUNDS), len(case.flown.time)
    ours = {count: _nanoseconds(times[f"stoop {count}"], count, steps) for count in COUNTS}
    for count in COUNTS:
        yield Row(PART, f"step, {count} candidates", float(np.median(ours[count])), "ns", note=_SETTING)
    for name, words in _KEPT.items():
        spent = float(np.median(_nanoseconds(times[name], 64, steps)))
        yield Row(PART, f"step, 64 candidates, {words}", spent, "ns")
    for count in COUNTS:
        yield _beside(times, ours[count], count)
    yield _share(case, ours[max(COUNTS)], times.get("peak"), ceiling[1] if ceiling else 0.0)


def _calls(case: Case) -> dict[str, Callable[[], object]]:
    """Return what is timed of stoop and of the prototype, by name, partners next to each other."""
    theirs = prototype.calls(COUNTS)
    calls: dict[str, Callable[[], object]] = {}
    for count in COUNTS:
        calls[f"stoop {count}"] = case.cost(count)
        if count in theirs:
            calls[f"prototype {count}"] = theirs[count]
    return calls | {"outputs": case.outputs(64), "delays": case.outputs(64, delays=True)}


_KEPT = {"outputs": "outputs kept", "delays": "outputs kept, inputs of its own (free delay)"}
_SETTING = "6 DoF, 32 parameters, 12 channels, one thread; per RK4 step and candidate"


def _beside(times: dict[str, FloatArray], ours: FloatArray, count: int) -> Row:
    figure = f"over k10_sympy_lanes.py, {count} candidates"
    if f"prototype {count}" not in times:
        return Row(PART, figure, None, at_most=0.85, note="shared folder not found: set STOOP_SHARED")
    theirs = _nanoseconds(times[f"prototype {count}"], count, prototype.STEPS)
    return Row(PART, figure, ratio(ours, theirs), at_most=0.85, note=f"it takes {np.median(theirs):.1f} ns")


def _longitudinal(case: Case) -> Iterator[Row]:
    """Time the longitudinal model, the multiply-add loop and all six degrees of freedom in turn."""
    small, ceiling = _elevator_only(case), peak.compiled()
    calls = {"small": small.cost(SMALL), "full": case.cost(COUNTS[0])}
    if ceiling is not None:
        calls["peak"] = ceiling[0]
    times, steps = interleave(calls, ROUNDS), len(case.flown.time)
    ours = _nanoseconds(times["small"], SMALL, steps)
    name, note = "longitudinal model:", "6 states, 1 input, 6 channels, one thread"
    yield Row(PART, f"{name} step, {SMALL} candidates", float(np.median(ours)), "ns", at_most=8.0, note=note)
    share = _share(small, ours, times.get("peak"), ceiling[1] if ceiling else 0.0)
    yield replace(share, figure=f"{name} {share.figure}", at_least=None)
    beside = ratio(ours, _nanoseconds(times["full"], COUNTS[0], steps))
    yield Row(PART, f"{name} over six degrees of freedom", beside, note="step beside step")


def _elevator_only(case: Case) -> Case:
    """Return the longitudinal model, flown with the elevator's part of the maneuver."""
    vehicle = case.vehicle.reduced("longitudinal")
    steps = [s for s in MANEUVER.model_dump()["input"] if s["control"] in vehicle.controls]
    return Case(vehicle, fly(vehicle, Maneuver.model_validate({**MANEUVER.model_dump(), "input": steps})))


def _operations(case: Case) -> int:
    """Return the operations of a step of one candidate."""
    return flops.operations(ENTRIES["cost"].text(case.kernel.model, case.kernel.lanes))


def _share(case: Case, ours: FloatArray, loop: FloatArray | None, in_loop: float) -> Row:
    """Return which share of the core's multiply-add peak the kernel reaches."""
    figure = "share of the core's FMA peak"
    if loop is None:
        return Row(PART, figure, None, "%", at_least=45.0, note="no fused multiply-add here")
    count = _operations(case)
    share = 100.0 * ratio(count / ours, in_loop / loop * 1e-9)
    note = f"{count} operations a step; peak {np.median(in_loop / loop) * 1e-9:.0f} Gflop/s"
    return Row(PART, figure, share, "%", at_least=62.0, note=note)


def _against_scipy(case: Case) -> Iterator[Row]:
    """Time one trajectory by odeint against one candidate of 64."""
    p = plain.plain(case)
    python, compiled = plain.python_odeint(p), plain.numba_odeint(p)
    times = interleave({"ours": case.cost(64), "python": python, "numba": compiled}, 7)
    ours = times["ours"] / 64
    for name, side, least in (("python", "lean Python", 120.0), ("numba", "Numba", 40.0)):
        error = _difference(plain.readings(p, {"python": python, "numba": compiled}[name]()), case)
        note = f"{np.median(times[name]) * 1e3:.1f} ms against {np.median(ours) * 1e6:.0f} us; differ by {error:.0e}"
        figure = f"times faster than odeint, {side} right-hand side"
        yield Row(PART, figure, ratio(times[name], ours), at_least=least, note=note)


def _difference(readings: FloatArray, case: Case) -> float:
    """Return the largest difference to our readings, in channel maxima."""
    y = case.flown.outputs
    return float((np.abs(readings - y).max(axis=0) / np.abs(y).max(axis=0)).max())


def _threads(case: Case) -> Iterator[Row]:
    """Compare wall times of one and two threads; the least of several, as others may use the machine."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if cores < 2:
        yield Row(PART, "two threads over one", None, note="only one core")
        return
    calls = {"one": case.cost(64), "two": case.cost(64, threads=2)}
    times = interleave(calls, 400, time.perf_counter, least=0.0)
    note = "64 candidates, least wall times of 400; near 1 where others hold the second core"
    yield Row(PART, "two threads over one, speed", float(times["one"].min() / times["two"].min()), note=note)
