"""The local refinement against NIST's certified nonlinear regressions, and against SciPy on the same problems."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from unit.optimize.conftest import Residuals

from stoop import optimize

Model = Callable[..., np.ndarray]

PI = np.pi
MODELS: dict[str, Model] = {
    "Misra1a": lambda x, b1, b2: b1 * (1 - np.exp(-b2 * x)),
    "Misra1d": lambda x, b1, b2: b1 * b2 * x / (1 + b2 * x),
    "DanWood": lambda x, b1, b2: b1 * x**b2,
    "Chwirut2": lambda x, b1, b2, b3: np.exp(-b1 * x) / (b2 + b3 * x),
    "Rat42": lambda x, b1, b2, b3: b1 / (1 + np.exp(b2 - b3 * x)),
    "MGH17": lambda x, b1, b2, b3, b4, b5: b1 + b2 * np.exp(-x * b4) + b3 * np.exp(-x * b5),
    "Lanczos3": lambda x, a, b, c, d, e, f: a * np.exp(-b * x) + c * np.exp(-d * x) + e * np.exp(-f * x),
    "Roszman1": lambda x, b1, b2, b3, b4: b1 - b2 * x - np.arctan(b3 / (x - b4)) / PI,
    "Kirby2": lambda x, b1, b2, b3, b4, b5: (b1 + b2 * x + b3 * x**2) / (1 + b4 * x + b5 * x**2),
    "ENSO": lambda x, b1, b2, b3, b4, b5, b6, b7, b8, b9: (
        b1
        + b2 * np.cos(2 * PI * x / 12)
        + b3 * np.sin(2 * PI * x / 12)
        + b5 * np.cos(2 * PI * x / b4)
        + b6 * np.sin(2 * PI * x / b4)
        + b8 * np.cos(2 * PI * x / b7)
        + b9 * np.sin(2 * PI * x / b7)
    ),
    "Gauss1": lambda x, b1, b2, b3, b4, b5, b6, b7, b8: (
        b1 * np.exp(-b2 * x) + b3 * np.exp(-(((x - b4) / b5) ** 2)) + b6 * np.exp(-(((x - b7) / b8) ** 2))
    ),
}  #: as each file states it


@dataclass
class Regression(Residuals):
    """A NIST data set as a problem: the box spans starts and certified values with a margin."""

    x: np.ndarray
    y: np.ndarray
    model: Model
    starts: np.ndarray  # (2, D)
    certified: np.ndarray  # (D,)
    least: float

    def __post_init__(self) -> None:
        known = np.vstack([self.starts, self.certified])
        margin = 0.2 * np.ptp(known, axis=0) + 0.05 * np.abs(self.certified)
        self.low = known.min(axis=0) - margin
        self.span = known.max(axis=0) + margin - self.low
        self.dimension = len(self.low)

    def unit(self, b: np.ndarray) -> np.ndarray:
        return (b - self.low) / self.span

    def residuals(self, Z: np.ndarray, rung: int) -> np.ndarray:
        with np.errstate(all="ignore"):
            return np.array([self.model(self.x, *(self.low + z * self.span)) - self.y for z in Z])

    def reference(self, rung: int) -> float:
        return float(((self.y - self.y[0]) ** 2).sum())


@pytest.fixture(scope="module")
def regression(shared_data: Path) -> Callable[[str], Regression]:
    def read(name: str) -> Regression:
        text = (shared_data / "nist-strd" / f"{name}.dat").read_text()
        rows = re.findall(r"^\s*b\d+ =\s+(\S+)\s+(\S+)\s+(\S+)\s+\S+\s*$", text, re.MULTILINE)
        b = np.array(rows, dtype=float)
        least = float(re.search(r"Residual Sum of Squares:\s+(\S+)", text)[1])
        table = np.loadtxt(text[text.rindex("Data:") :].splitlines()[1:])
        return Regression(table[:, 1], table[:, 0], MODELS[name], b[:, :2].T, b[:, 2], least)

    return read


PATIENT = optimize.Settings(iterations=1000, gain=1e-14, predicted=0.0, stall=1000, stall_damping=0.0)
FAR = ["Misra1a", "Misra1d", "DanWood", "Chwirut2", "Rat42", "Gauss1", "Roszman1"]
CASES = [(name, 1) for name in sorted(MODELS)] + [(name, 0) for name in FAR]


def test_local_refinements_end_at_the_certified_values(regression: Callable[[str], Regression]) -> None:
    for name, start in CASES:
        problem = regression(name)
        end = optimize.refine(problem, problem.unit(problem.starts[start]), 0, PATIENT)
        assert end.converged, name
        assert end.cost == pytest.approx(problem.least, rel=1e-6), name
        # the sums of three exponentials are known to be nearly degenerate
        rel = 1e-3 if name.startswith("Lanczos") else 1e-5
        assert problem.low + end.z * problem.span == pytest.approx(problem.certified, rel=rel), name


def test_local_refinements_end_where_scipy_does_inside_bounds(regression):
    """The box ends between start and certified values, so that the answer lies on a bound."""
    for name in ("Misra1a", "Chwirut2", "Lanczos3", "Kirby2"):
        problem = regression(name)
        cut = 0.5 * (problem.starts[1] + problem.certified)[0]
        side = problem.starts[1][0] > problem.certified[0]
        high = problem.low + problem.span
        problem.low[0], high[0] = (cut, high[0]) if side else (problem.low[0], cut)
        problem.span = high - problem.low
        z = np.clip(problem.unit(problem.starts[1]), 0.0, 1.0)
        ours = optimize.refine(problem, z, 0, PATIENT)
        theirs = least_squares(
            lambda v, problem=problem: problem.residuals(v[None, :], 0)[0], np.clip(z, 1e-9, 1 - 1e-9),
            bounds=(0.0, 1.0), x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=3000,
        )  # fmt: skip
        assert ((ours.z >= 0.0) & (ours.z <= 1.0)).all(), name
        assert ours.cost <= 2.0 * theirs.cost * (1.0 + 1e-5), name


def test_default_search_needs_no_start(regression: Callable[[str], Regression]) -> None:
    for name in ("Misra1a", "Chwirut2", "DanWood", "Gauss1", "ENSO"):
        problem = regression(name)
        outcome = optimize.minimize(optimize.create(), problem, seed=1, stop=optimize.Stop(budget=5000))
        assert outcome.status == "converged"
        assert outcome.cost == pytest.approx(problem.least, rel=1e-5)
