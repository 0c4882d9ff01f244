"""Certified regressions of NIST's Statistical Reference Datasets: our Levenberg-Marquardt and our covariance."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import sympy as sp

from stoop import optimize
from stoop.assessment.covariance import standard_errors
from stoop.base.arrays import FloatArray
from stoop.errors import StoopError
from stoop.problem.evidence import invert
from stoop.report.sheet import Prose, Section
from stoop_studies.findings import Findings, Setting, holds
from stoop_studies.verify.study import Columns, Samples, Verification, page_table, published_files

CERTIFIED_DIGITS: Final = 11.0
PARAMETER_DIGITS: Final = 9.0
DEVIATION_DIGITS: Final = 6.0
PATIENT: Final = optimize.Settings(iterations=2000, gain=1e-14, predicted=0.0, stall=2000, stall_damping=0.0)
PARAMETER_ROW: Final = re.compile(r"^\s*b\d+ =\s+(\S+)\s+(\S+)\s+(\S+)\s+(\S+)\s*$", re.MULTILINE)
SUM_OF_SQUARES: Final = re.compile(r"^Residual Sum of Squares:\s+(\S+)\s*$", re.MULTILINE)
LEVEL: Final = re.compile(r"^\s*(Lower|Average|Higher) Level of Difficulty", re.MULTILINE)
LEAD: Final = """\
Each problem states a model, data, two starts, and parameters and standard deviations that NIST computed with 128-bit \
reals and certifies to 11 digits. All are run from both starts by one algorithm with one setting; no bounds are \
given, and parameters are measured in units of their starts."""
WORDS: Final = """\
Digits are -log10 of the relative error, at most the 11 that are certified; the worst parameter counts. Derivatives \
are exact (SymPy). `descend` is Levenberg-Marquardt with a Jacobian in each iteration, QR, geodesic acceleration and \
undamped steps at the end. Standard deviations are the square roots of the diagonal of s2 (J'J)^-1, by the code that \
makes the error bars of a flight.

The local search of the default optimizer keeps a Jacobian as long as Broyden's update carries it; \
here it is left to itself, without the population that would start it elsewhere."""
SHOWN: Final[Columns] = {
    "problem": ("problem", str),
    "level": ("level", str),
    "start": ("start", "d"),
    "iterations": ("iterations", "d"),
    "digits_parameters": ("parameters", ".1f"),
    "digits_deviations": ("deviations", ".1f"),
    "digits_rss": ("RSS", ".1f"),
    "local_search_digits_parameters": ("local search alone", ".1f"),
    "local_search_iterations": ("its iterations", "d"),
}

b1, b2, b3, b4, b5, b6, b7, b8, b9 = B = sp.symbols("b1:10", real=True)
x, x1, x2, y = sp.symbols("x x1 x2 y", real=True)

_EXPONENTIALS: Final = b1 * sp.exp(-b2 * x) + b3 * sp.exp(-b4 * x) + b5 * sp.exp(-b6 * x)
_GAUSSIANS: Final = (
    b1 * sp.exp(-b2 * x) + b3 * sp.exp(-((x - b4) ** 2) / b5**2) + b6 * sp.exp(-((x - b7) ** 2) / b8**2)
)
_CHWIRUT: Final = sp.exp(-b1 * x) / (b2 + b3 * x)


def _wave(period: sp.Expr, cosine: sp.Expr, sine: sp.Expr) -> sp.Expr:
    phase = 2 * sp.pi * x / period
    return cosine * sp.cos(phase) + sine * sp.sin(phase)


class Model(NamedTuple):
    """A regression ``response = mean + e``, of `b1` to `b9`, the measured `y`, and predictors in the order of the columns."""

    mean: sp.Expr
    response: sp.Expr = y
    predictors: tuple[sp.Symbol, ...] = (x,)


MODELS: Final[Mapping[str, Model]] = {
    "Chwirut1": Model(_CHWIRUT),
    "Chwirut2": Model(_CHWIRUT),
    "DanWood": Model(b1 * x**b2),
    "ENSO": Model(b1 + _wave(sp.Integer(12), b2, b3) + _wave(b4, b5, b6) + _wave(b7, b8, b9)),
    "Gauss1": Model(_GAUSSIANS),
    "Gauss2": Model(_GAUSSIANS),
    "Gauss3": Model(_GAUSSIANS),
    "Kirby2": Model((b1 + b2 * x + b3 * x**2) / (1 + b4 * x + b5 * x**2)),
    "Lanczos2": Model(_EXPONENTIALS),
    "Lanczos3": Model(_EXPONENTIALS),
    "MGH10": Model(b1 * sp.exp(b2 / (x + b3))),
    "MGH17": Model(b1 + b2 * sp.exp(-x * b4) + b3 * sp.exp(-x * b5)),
    "Misra1a": Model(b1 * (1 - sp.exp(-b2 * x))),
    "Misra1b": Model(b1 * (1 - (1 + b2 * x / 2) ** -2)),
    "Misra1c": Model(b1 * (1 - 1 / sp.sqrt(1 + 2 * b2 * x))),
    "Misra1d": Model(b1 * b2 * x / (1 + b2 * x)),
    "Nelson": Model(b1 - b2 * x1 * sp.exp(-b3 * x2), sp.log(y), (x1, x2)),
    "Rat42": Model(b1 / (1 + sp.exp(b2 - b3 * x))),
    "Roszman1": Model(b1 - b2 * x - sp.atan(b3 / (x - b4)) / sp.pi),
}  #: by the name of the file


@cache
def compiled(name: str) -> tuple[Callable[..., Any], ...]:
    """Return the residual of a model and its exact derivatives as functions of (parameters, y, predictors)."""
    model = MODELS[name]
    parameters = tuple(b for b in B if b in model.mean.free_symbols)
    residual = model.mean - model.response
    expressions = (residual, *(sp.diff(residual, b) for b in parameters))
    arguments = (parameters, y, *model.predictors)
    return tuple(sp.lambdify(arguments, e, "numpy") for e in expressions)


@dataclass(frozen=True, eq=False)
class Certified:
    """A problem as its file states it: two starts (2, p), certified values and standard deviations (p,), data.

    ``least`` is the certified residual sum of squares, ``y`` (n,) the response, ``x`` (m, n) the predictors.
    """

    name: str
    level: str
    starts: FloatArray
    values: FloatArray
    deviations: FloatArray
    least: float
    y: FloatArray
    x: FloatArray


def read_certified(path: Path) -> Certified:
    """Read a file; one that is not of this format is a StoopError."""
    try:
        text = path.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise StoopError(f"{path}: cannot be read ({error}); fetch it again from NIST") from None
    try:
        rows = np.array(PARAMETER_ROW.findall(text), dtype=np.float64)
        (least,), (level,) = SUM_OF_SQUARES.findall(text)[:1], LEVEL.findall(text)[:1]
        lines = text[text.rindex("\nData:") :].splitlines()[2:]
        table = np.array([line.split() for line in lines if line.strip()], dtype=np.float64)
        starts, values, deviations = rows[:, :2].T, rows[:, 2], rows[:, 3]
        y, x = table[:, 0], table[:, 1:].T
        return Certified(path.stem, level.lower(), starts, values, deviations, float(least), y, x)
    except (ValueError, TypeError, IndexError):
        raise StoopError(f"{path}: is no file of NIST StRD; fetch it again from NIST") from None


def problem_files(folder: Path | None) -> list[Path]:
    """Return the files of the problems that lie in a folder, or in its folder ``nist-strd``."""
    return published_files(
        "nist",
        folder,
        "nist-strd",
        rf"({'|'.join(MODELS)})\.dat",
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
        c, functions = self.certified, compiled(self.certified.name)[part]
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
    deviations = np.sqrt(variance) * standard_errors(invert(J.T @ J).matrix) * problem.scale
    return {
        "problem": certified.name,
        "level": certified.level,
        "parameters": len(certified.values),
        "observations": len(certified.y),
        "start": start,
        "ending": found.ending,
        "iterations": found.iterations,
        "digits_parameters": digits(found.z * problem.scale, certified.values),
        "digits_deviations": digits(deviations, certified.deviations),
        "digits_rss": digits(found.cost, certified.least),
        "local_search_ending": alone.ending,
        "local_search_iterations": alone.iterations,
        "local_search_digits_parameters": digits(alone.z * problem.scale, certified.values),
    }


def show(setting: Setting, samples: Samples) -> Findings:
    """Return how many digits are right."""
    files = problem_files(setting.data)
    fits = [fit_certified(read_certified(path), start) for path in files for start in (1, 2)]
    caption = "Digits of the worst parameter, of the worst standard deviation and of the sum of squares"
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
    return Findings.tabulated(
        f"{len(files)} certified regressions of NIST StRD",
        LEAD,
        claims,
        (Section("Digits that are right", (page_table(caption, SHOWN, fits), Prose(WORDS))),),
        [{k: round(v, 1) if isinstance(v, float) else v for k, v in f.items()} for f in fits],
    )


EXPERIMENT: Final = Verification("nist", show)
