"""One tool of `benchmarks.solvers` in a process of its own: ``python -m benchmarks.solver_child NUMBER FOLDER``."""

from __future__ import annotations

import importlib
import json
import pickle
import re
import resource
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

ROUNDS: Final = 3  #: fits after the first


@dataclass(frozen=True)
class Tool:
    """A tool as it is used: its name, the module that holds its code, the packages it needs, and options of `prepare`."""

    name: str
    module: str
    packages: tuple[str, ...]
    options: tuple[tuple[str, Any], ...] = ()


IPOPT: Final = ("casadi",)
TOOLS: Final = (
    Tool("stoop", "solver_stoop", ("llvmlite",)),
    Tool("stoop, local search alone", "solver_stoop", ("llvmlite",), (("local", True),)),
    Tool("SciPy and Numba", "solver_scipy", ("scipy", "numba")),
    Tool("CasADi and IPOPT", "solver_casadi", IPOPT, (("stride", 10),)),
    Tool("CasADi and IPOPT, compiled by GCC", "solver_casadi", IPOPT, (("stride", 10), ("compiled", True))),
    Tool("JAX and Diffrax", "solver_jax", ("jax", "diffrax", "optimistix")),
)  #: the first is the reference


def measure(tool: Tool, folder: Path) -> dict[str, float]:
    """Build, simulate the probe of a case, fit; write unknowns and readings, return time (s) and memory (MB)."""
    case, probe = pickle.loads((folder / "case.pickle").read_bytes())  # noqa: S301 - written by the parent
    before, begun = _peak(), _spent()
    solver = importlib.import_module(f"benchmarks.{tool.module}").prepare(case, **dict(tool.options))
    readings, found = solver.simulate(probe), solver.fit()
    first, times = _spent() - begun, []
    for _ in range(ROUNDS):
        begun = _spent()
        found = solver.fit()
        times.append(_spent() - begun)
    np.savez(folder / "found.npz", z=found.z, readings=readings)
    return {
        "fit": min(times),
        "build": first - min(times),
        "memory": _peak() - before,
        "iterations": found.iterations,
        "simulations": found.simulations,
    }


def _spent() -> float:
    """Return the processor time of this process and of the compilers that it started, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def _peak() -> float:
    """Return the greatest memory of this process, MB; that of `getrusage` would include its parent's."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return float(re.search(r"VmHWM:\s+(\d+) kB", status)[1]) * 1024e-6  # type: ignore[index]


if __name__ == "__main__":
    print(json.dumps(measure(TOOLS[int(sys.argv[1])], Path(sys.argv[2]))))
