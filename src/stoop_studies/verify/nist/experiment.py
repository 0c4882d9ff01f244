"""Certified regressions: our Levenberg-Marquardt and our covariance against NIST's digits, from both starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop import optimize
from stoop.assess.covariance import invert, standard_errors
from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.report.sheet import Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Results, Setting, holds
from stoop_studies.verify.nist.files import Certified, problem_files, read_certified
from stoop_studies.verify.nist.models import MODELS
from stoop_studies.verify.nist.problem import Regression

CERTIFIED_DIGITS: Final = 11.0
PARAMETER_DIGITS: Final = 9.0
DEVIATION_DIGITS: Final = 6.0
PATIENT: Final = optimize.Settings(iterations=2000, gain=1e-14, predicted=0.0, stall=2000, stall_damping=0.0)
LEAD: Final = """\
Each problem states a model, data, two starts, and parameters and standard deviations that NIST computed with 128-bit \
reals and certifies to 11 digits. All are run from both starts by one algorithm with one setting; no bounds are \
given, and parameters are measured in units of their starts."""
WORDS: Final = """\
Digits are -log10 of the relative error, at most the 11 that are certified; the worst parameter counts. Derivatives \
are exact (SymPy). `descend` is Levenberg-Marquardt with a Jacobian in each iteration, QR, geodesic acceleration and \
undamped steps at the end. Standard deviations are the square roots of the diagonal of s2 (J'J)^-1, by the code that \
makes the error bars of a flight.

`dive` is the local search of the default optimizer, which keeps a Jacobian as long as Broyden's update carries it; \
here it is left to itself, without the population that would start it elsewhere."""
HEAD: Final = (
    "problem", "level", "parameters", "observations", "start", "ending", "iterations", "digits_parameters",
    "digits_deviations", "digits_rss", "dive_ending", "dive_iterations", "dive_digits_parameters",
)  # fmt: skip


@dataclass(frozen=True)
class Fitted:
    """One problem from one start: how many digits are right."""

    certified: Certified
    start: int
    descent: optimize.Refinement
    parameters: float
    deviations: float
    least: float
    dive: optimize.Refinement
    dive_parameters: float

    @property
    def row(self) -> tuple[Cell, ...]:
        """The numbers under `HEAD`."""
        c = self.certified
        told = (c.name, c.level, len(c.values), len(c.y), self.start)
        found = (round(v, 1) for v in (self.parameters, self.deviations, self.least))
        dived = (self.dive.ending, self.dive.iterations, round(self.dive_parameters, 1))
        return (*told, self.descent.ending, self.descent.iterations, *found, *dived)


def digits(value: FloatArray | float, certified: FloatArray | float) -> float:
    """Return how many digits of the worst value are right."""
    error = np.max(np.abs(np.subtract(value, certified)) / np.abs(certified))
    if not np.isfinite(error):
        return 0.0
    return float(np.clip(-np.log10(max(error, 1e-300)), 0.0, CERTIFIED_DIGITS))


def fit_certified(certified: Certified, start: int) -> Fitted:
    """Return the fit of a problem from its start 1 or 2."""
    b = certified.starts[start - 1]
    problem = Regression(certified, np.where(b != 0.0, np.abs(b), 1.0))
    z = b / problem.scale
    found, dived = optimize.descend(problem, z, 0), optimize.refine(problem, z, 0, PATIENT)
    return Fitted(
        certified,
        start,
        found,
        digits(found.z * problem.scale, certified.values),
        digits(deviations(problem, found), certified.deviations),
        digits(found.cost, certified.least),
        dived,
        digits(dived.z * problem.scale, certified.values),
    )


def deviations(problem: Regression, found: optimize.Refinement) -> FloatArray:
    """Return the standard deviations (p,) at an optimum, in the parameters' units."""
    J, _ = problem.jacobian(found.z, 0, found.z)
    variance = found.cost / (J.shape[0] - J.shape[1])
    return np.asarray(np.sqrt(variance) * standard_errors(invert(J.T @ J).matrix) * problem.scale)


@dataclass(frozen=True)
class Nist:
    """The nonlinear problems of NIST StRD."""

    name: str = "nist"
    runs: int = 1
    parts: tuple[str, ...] = ()

    def plan(self, setting: Setting) -> None:
        """Return nothing: all of it takes seconds."""
        return

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return how many digits are right."""
        files = problem_files(setting.data, tuple(MODELS))
        fits = [fit_certified(read_certified(path), start) for path in files for start in (1, 2)]
        return Findings(
            f"{len(files)} certified regressions of NIST StRD",
            LEAD,
            claims(fits),
            (Section("Digits that are right", (_table(fits), Prose(WORDS))),),
            HEAD,
            tuple(f.row for f in fits),
        )


def claims(fits: Sequence[Fitted]) -> tuple[Claim, ...]:
    """Return what is claimed of the fits."""
    return (
        _claim("parameter", [f.parameters for f in fits], PARAMETER_DIGITS, fits),
        _claim("standard deviation", [f.deviations for f in fits], DEVIATION_DIGITS, fits),
    )


def _claim(what: str, right: Sequence[float], needed: float, fits: Sequence[Fitted]) -> Claim:
    worst = int(np.argmin(right))
    place = f"{fits[worst].certified.name} from start {fits[worst].start}"
    return holds(
        f"At least {needed:.0f} digits of every {what} are right, from both starts",
        min(right) >= needed,
        f"{sum(d >= needed for d in right)} of {len(right)} fits; the least is {min(right):.1f}, {place}",
    )


def _table(fits: Sequence[Fitted]) -> Table:
    head = (
        "problem",
        "level",
        "start",
        "iterations",
        "parameters",
        "deviations",
        "RSS",
        "dive alone",
        "its iterations",
    )
    rows = tuple(
        (
            f.certified.name,
            f.certified.level,
            str(f.start),
            str(f.descent.iterations),
            *(f"{d:.1f}" for d in (f.parameters, f.deviations, f.least, f.dive_parameters)),
            str(f.dive.iterations),
        )
        for f in fits
    )
    return Table(
        "Digits of the worst parameter, of the worst standard deviation and of the sum of squares", head, rows
    )
