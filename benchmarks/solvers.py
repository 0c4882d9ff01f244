"""Compared with what: the joint fit of `benchmarks.joint` by SciPy, CasADi and JAX, as one would write it with each.

All have the same equations (printed from stoop's symbols), integration, data, weights, start and unknowns. Each tool runs on one
core in a process of its own, which begins with an empty cache of kernels. A tool whose trajectories are not those of
stoop's kernel gets no figures. ``pip install '.[solvers]'`` installs them.
"""

from __future__ import annotations

import ast
import json
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
import sympy as sp

from benchmarks.jobs import ONE_CORE
from benchmarks.solver_case import Case
from benchmarks.solver_child import TOOLS, Tool
from benchmarks.solver_stoop import options, scene
from benchmarks.table import Row
from stoop.base.arrays import FloatArray
from stoop.estimate.fit import estimation_problem
from stoop.problem.misfit import Misfit
from stoop.vehicle.symbolic import build_model
from stoop_studies.verify.scenes import Scene

PART: Final = "solvers"
TOLERANCE: Final = 1e-8  #: of trajectories, relative to the maximum of each channel
LIMIT: Final = 1200.0  #: s, of one tool
PROBE: Final = 0.02  #: standard deviation of the unknowns at which trajectories are compared, about the start


@dataclass(frozen=True)
class Ended:
    """Where a tool ended: its figures, its unknowns (D + E,), and the difference of its trajectories from the kernel's."""

    tool: Tool
    figures: Mapping[str, float]
    z: FloatArray
    difference: float


def run() -> list[Row]:
    """Measure every tool."""
    flown = scene()
    problem, _ = estimation_problem(flown.start, flown.flights, flown.windows, options(flown))
    case = case_of(flown, problem)
    ends = [_measured(tool, problem, case) for tool in TOOLS]
    if isinstance(ends[0], str):
        raise RuntimeError(ends[0])
    first = ends[0]
    J = problem.jacobian(first.z, len(problem.prices) - 1, _residuals(problem, first.z))[0]
    errors = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    least = min(_cost(problem, end.z) for end in ends if not isinstance(end, str))
    rows = []
    for tool, end in zip(TOOLS, ends, strict=True):
        if isinstance(end, str):
            rows.append(Row(PART, f"{tool.name}: fit", None, note=end))
            continue
        versions = ", ".join(f"{package} {version(package)}" for package in tool.packages)
        deviation = float(np.max(np.abs(end.z - first.z) / errors))
        rows += [
            Row(PART, f"{tool.name}: {figure}", value, unit, note=note)
            for figure, value, unit, note in (
                ("fit", end.figures["fit"], "s", versions),
                ("fit, over that of stoop", end.figures["fit"] / first.figures["fit"], "", ""),
                ("build", end.figures["build"], "s", "imports, printing, compilation"),
                ("iterations", end.figures["iterations"], "", ""),
                ("simulations", end.figures["simulations"], "", "of all maneuvers; tangents not counted"),
                ("cost above the least", _cost(problem, end.z) / least - 1.0, "", f"of {least:.6f}"),
                ("largest deviation from stoop", deviation, "standard errors", ""),
                ("memory", end.figures["memory"], "MB", "beyond NumPy and SymPy"),
                ("lines of code", lines(tool.module), "", "equations not included"),
                ("difference of trajectories", end.difference, "", "of the maximum of each channel"),
            )
        ]
    return rows


def case_of(flown: Scene, problem: Misfit) -> Case:
    """Write out the problem of a scene whose maneuvers are alike in length and in what is unknown."""
    layout, pieces, model = problem.layout, problem.pieces, build_model(flown.start)
    x, u, q = (sp.DeferredVector(name) for name in "xuq")
    own = [[n for _, n in each] for each in problem.own]
    free = {n: q[i] for i, n in enumerate([p.name for p in layout.parameters] + [n.name for n in own[0]])}
    names = {row: name for name, row in flown.start.rows.items()}
    values = [free.get(names[i], sp.Float(float(v))) for i, v in enumerate(flown.start.values)]
    known = dict(zip(model.parameters, values, strict=True))
    known |= {s: x[i] for i, s in enumerate(model.states)} | {s: u[i] for i, s in enumerate(model.inputs)}
    begin = rigid_body({name: sp.Float(value) for name, value in pieces[0].start.items()} | free)
    return Case(
        rates=tuple(sp.sympify(e).xreplace(known) for e in model.derivatives),
        readings=tuple(sp.sympify(e).xreplace(known) for e in model.outputs),
        beginning=tuple(begin[name] for name in flown.start.states),
        index=np.array([[*range(layout.dimension), *(j for j, _ in each)] for each in problem.own]),
        center=np.array([[*layout.lower, *(n.center for n in each)] for each in own]),
        scale=np.array([[*layout.width, *(n.scale for n in each)] for each in own]),
        inputs=np.stack([p.inputs for p in pieces]),
        measured=np.stack([p.measured for p in pieces]),
        sigma=np.sqrt(np.diag(problem.weights.covariance)),
        dt=pieces[0].dt,
        start=np.concatenate([layout.start, np.zeros(layout.extra)]),
        coefficients=layout.dimension,
    )


def rigid_body(start: Mapping[str, Any]) -> dict[str, Any]:
    """Return the states of a rigid body by V, alpha, beta, rates and Euler angles, in symbols."""
    c, s = ([f(start[angle] / 2) for angle in ("phi", "theta", "psi")] for f in (sp.cos, sp.sin))
    plane = start["V"] * sp.cos(start["beta"])
    return {name: start[name] for name in "pqrh"} | {
        "u": plane * sp.cos(start["alpha"]),
        "v": start["V"] * sp.sin(start["beta"]),
        "w": plane * sp.sin(start["alpha"]),
        "e0": c[0] * c[1] * c[2] + s[0] * s[1] * s[2],
        "e1": s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
        "e2": c[0] * s[1] * c[2] + s[0] * c[1] * s[2],
        "e3": c[0] * c[1] * s[2] - s[0] * s[1] * c[2],
    }


def probe(case: Case) -> FloatArray:
    """Return unknowns (D + E,) near the start at which trajectories are compared."""
    return case.start + PROBE * np.random.default_rng(0).standard_normal(len(case.start))


def difference(problem: Misfit, z: FloatArray, readings: FloatArray) -> float:
    """Return how far readings (w, n, n_y) are from those of stoop's kernel for unknowns (D + E,), of each channel's maximum."""
    exact = np.stack([problem.outputs(z, i) for i in range(len(problem.pieces))])
    return float(np.max(np.abs(readings - exact).max((0, 1)) / np.abs(exact).max((0, 1))))


def lines(module: str) -> int:
    """Return the lines of a module of this folder that hold code: neither docstrings, comments, nor imports."""
    tree = ast.parse(Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8"))
    texts = [
        node for node in ast.walk(tree) if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    ]
    left_out = [*texts, *(node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom))]
    hidden = {k for node in left_out for k in range(node.lineno, (node.end_lineno or 0) + 1)}
    held = {k for node in ast.walk(tree) if isinstance(node, ast.expr | ast.stmt | ast.arg)
            for k in (node.lineno, node.end_lineno or 0)}  # fmt: skip
    return len(held - hidden)


def _measured(tool: Tool, problem: Misfit, case: Case) -> Ended | str:
    """Run a tool apart; return why it has no figures where it fails, or simulates something else."""
    point, core = probe(case), sorted(os.sched_getaffinity(0))[:1]
    with tempfile.TemporaryDirectory(prefix="stoop-solvers-") as name:
        folder = Path(name)
        (folder / "case.pickle").write_bytes(pickle.dumps((case, point)))
        words = [sys.executable, "-m", "benchmarks.solver_child", str(TOOLS.index(tool)), name]
        try:
            done = subprocess.run(
                words,
                env=os.environ | ONE_CORE | {"STOOP_CACHE_DIR": str(folder / "cache")},
                capture_output=True,
                text=True,
                timeout=LIMIT,
                check=False,
                preexec_fn=lambda: os.sched_setaffinity(0, core),
            )
        except subprocess.TimeoutExpired:
            return f"no result in {LIMIT:.0f} s"
        if done.returncode:
            return (done.stderr.strip().splitlines() or ["no message"])[-1]
        with np.load(folder / "found.npz") as found:
            z, readings = found["z"], found["readings"]
    off = difference(problem, point, readings)
    if not off <= TOLERANCE:
        return f"trajectories differ by {off:.1g} of their maximum"
    return Ended(tool, json.loads(done.stdout.splitlines()[-1]), z, off)


def _residuals(problem: Misfit, z: FloatArray) -> FloatArray:
    return np.asarray(problem.residuals(z[None, :], len(problem.prices) - 1)[0])


def _cost(problem: Misfit, z: FloatArray) -> float:
    return float(np.sum(_residuals(problem, z) ** 2))
