"""Timing on a machine that others use too: processor time of this process, things timed in turn."""

from __future__ import annotations

import gc
import os
import platform
import time
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path

import numpy as np

from stoop.base.arrays import FloatArray


def interleave(
    calls: Mapping[str, Callable[[], object]],
    rounds: int,
    clock: Callable[[], float] = time.process_time,
    least: float = 0.02,
) -> dict[str, FloatArray]:
    """Time calls in turn, A B C A B C ..., so that drift of the machine falls on all of them.

    Parameters
    ----------
    calls : mapping
        Name -> what to time; each is called once before, to warm up.
    rounds : int
    clock : callable
        Processor time by default: what other processes take does not count.
    least : float, s
        A call is repeated until one measurement takes about so long.

    Returns
    -------
    mapping
        Name -> (rounds,) array, s per call.
    """
    repeats = {name: max(1, round(least / max(_once(call, 1, clock), 1e-6))) for name, call in calls.items()}
    times: dict[str, list[float]] = {name: [] for name in calls}
    gc.disable()
    try:
        for _ in range(rounds):
            for name, call in calls.items():
                times[name].append(_once(call, repeats[name], clock) / repeats[name])
    finally:
        gc.enable()
    return {name: np.array(values) for name, values in times.items()}


def _once(call: Callable[[], object], repeats: int, clock: Callable[[], float]) -> float:
    begun = clock()
    for _ in range(repeats):
        call()
    return clock() - begun


def ratio(above: FloatArray, below: FloatArray) -> float:
    """Return the median of the ratios round by round."""
    return float(np.median(above / below))


def machine() -> dict[str, str]:
    """Return what a figure depends on beside the code."""
    packages = ("numpy", "scipy", "sympy", "numba", "llvmlite")
    return {
        "processor": f"{_processor()}, {os.cpu_count()} cores seen",
        "system": platform.platform(),
        "python": platform.python_version(),
        **{name: version(name) for name in packages},
        "load": f"{os.getloadavg()[0]:.1f} at the start" if hasattr(os, "getloadavg") else "unknown",
    }


def _processor() -> str:
    """Return the processor by LLVM's name of its design, and the vendor's own."""
    import llvmlite.binding as llvm

    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()} ({llvm.get_host_cpu_name()})"
