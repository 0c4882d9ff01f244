"""Certified regressions of NIST's Statistical Reference Datasets: our Levenberg-Marquardt and our covariance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import sympy as sp

from stoop import optimize
from stoop.assessment.covariance import standard_errors
from stoop.base.arrays import FloatArray
from stoop.problem.evidence import invert_rows
from stoop_studies.findings import Findings, Setting, holds
from stoop_studies.verify.strd import Certified, Model, read_certified
from stoop_studies.verify.study import Samples, Verification, published_files

CERTIFIED_DIGITS: Final = 11.0
PARAMETER_DIGITS: Final = 9.0
DEVIATION_DIGITS: Final = 9.0
PATIENT: Final = optimize.Settings(iterations=2000, gain=1e-14, predicted=0.0, stall=2000, stall_damping=0.0)


@cache
def compiled(model: Model) -> tuple[Callable[..., Any], ...]:
    """Return the residual of a model and its exact derivatives as functions of (parameters, y, predictors)."""
    residual = model.mean - model.response
    expressions = (residual, *(sp.diff(residual, b) for b in model.parameters))
    arguments = (model.parameters, sp.Symbol("y", real=True), *model.predictors)
    return tuple(sp.lambdify(arguments, e, "numpy") for e in expressions)


def problem_files(folder: Path | None) -> list[Path]:
    """Return the files ``*.dat`` of a folder, or of its folder ``nist-strd``, whichever has more."""
    return published_files(
        "nist",
        folder,
        "nist-strd",
        r".+\.dat",
        "holds none of its files",
        "give --data DIR with the files of "
        "https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml (Misra1a.dat and others)",
    )


@dataclass(frozen=True, eq=False)
class Regression:
    """A file of NIST StRD as an `optimize.Problem` without a box: z = b / scale, with the sizes of its start."""

    certified: Certified
    scale: FloatArray

    dimension = 0
    prices = (1.0,)

    @property
    def extra(self) -> int:
        """Number of parameters."""
        return len(self.scale)

    def _evaluate(self, part: slice, z: FloatArray) -> FloatArray:
        """Return some of the functions (k, n) of `compiled` at a point."""
        c, functions = self.certified, compiled(self.certified.model)[part]
        with np.errstate(all="ignore"):
            values = [np.asarray(f(z * self.scale, c.y, *c.x), dtype=np.float64) for f in functions]
        return np.array([np.broadcast_to(v, len(c.y)) for v in values])  # some derivatives are constant

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return model less response (B, n)."""
        return np.array([self._evaluate(slice(1), z)[0] for z in Z])

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[FloatArray, float]:
        """Return exact derivatives (n, p)."""
        return (self._evaluate(slice(1, None), z) * self.scale[:, None]).T, float(self.extra)

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return the sums of squares at the origin: there is no box."""
        residuals = self.residuals(np.zeros((len(X), self.extra)), rung)
        return np.asarray((residuals**2).sum(axis=1))

    def reference(self, rung: int) -> float:
        """Return the cost of a constant."""
        return float(((self.certified.y - self.certified.y[0]) ** 2).sum())


def digits(value: FloatArray | float, certified: FloatArray | float) -> float:
    """Return how many digits of the worst value are right."""
    error = np.max(np.abs(np.subtract(value, certified)) / np.abs(certified))
    if not np.isfinite(error):
        return 0.0
    return float(np.clip(-np.log10(max(error, 1e-300)), 0.0, CERTIFIED_DIGITS))


def fit_certified(certified: Certified, start: int) -> dict[str, Any]:
    """Return the record of a problem from its start 1 or 2: how many digits each algorithm gets right."""
    b = certified.starts[start - 1]
    problem = Regression(certified, np.where(b != 0.0, np.abs(b), 1.0))
    z = b / problem.scale
    found, alone = optimize.descend(problem, z, 0), optimize.refine(problem, z, 0, PATIENT)
    J, _ = problem.jacobian(found.z, 0, found.z)
    variance = found.cost / (J.shape[0] - J.shape[1])
    deviations = np.sqrt(variance) * standard_errors(invert_rows(J).matrix) * problem.scale
    return {
        "problem": certified.name, "level": certified.level, "parameters": len(certified.values),
        "observations": len(certified.y), "start": start, "ending": found.ending, "iterations": found.iterations,
        "digits_parameters": digits(found.z * problem.scale, certified.values),
        "digits_deviations": digits(deviations, certified.deviations),
        "digits_rss": digits(found.cost, certified.least), "local_search_ending": alone.ending,
        "local_search_iterations": alone.iterations,
        "local_search_digits_parameters": digits(alone.z * problem.scale, certified.values),
    }  # fmt: skip


def show(setting: Setting, samples: Samples) -> Findings:
    """Return how many digits are right."""
    files = problem_files(setting.data)
    fits = [fit_certified(read_certified(path), start) for path in files for start in (1, 2)]
    claims = []
    for what, key, needed in (
        ("parameter", "digits_parameters", PARAMETER_DIGITS),
        ("standard deviation", "digits_deviations", DEVIATION_DIGITS),
    ):
        right, worst = [f[key] for f in fits], min(fits, key=lambda f: float(f[key]))
        claims.append(
            holds(
                f"At least {needed:.0f} digits of every {what} are right, from both starts",
                min(right) >= needed,
                f"{sum(d >= needed for d in right)} of {len(right)} fits; the least is {min(right):.1f}, "
                f"{worst['problem']} from start {worst['start']}",
            )
        )
    rows = [{k: round(v, 1) if isinstance(v, float) else v for k, v in f.items()} for f in fits]
    return Findings.of(f"{len(files)} certified regressions of NIST StRD", claims, rows)


EXPERIMENT: Final = Verification("nist", show)
