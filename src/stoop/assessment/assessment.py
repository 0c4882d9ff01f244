"""Assessments of a finished fit: further estimates of its uncertainty, by refits of the same problem from its optimum.

An assessment is called with an estimate, its error bars and a seed, and returns a `Finding`. `pack` writes the problem as one
text, which is what a worker needs to refit it, wherever it runs.

All refits share model, weights and start, so the derivatives at the optimum serve the first steps of all, in lanes. Then each
takes Gauss-Newton steps with its own derivatives until the last is short; else the optimizer refines it.
"""

from __future__ import annotations

import base64
import io
import json
import tempfile
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Literal, Protocol, runtime_checkable

import numpy as np

from stoop.assessment.error_bars import ErrorBars
from stoop.assessment.uncertainty import method_agreement
from stoop.base.arrays import FloatArray, IntArray
from stoop.base.npz import read_arrays
from stoop.base.text import duration
from stoop.errors import IdentificationError
from stoop.estimate import methods
from stoop.estimate.estimate import Estimate
from stoop.estimate.refit_problem import Derived, RefitProblem, SummedProblem
from stoop.optimize import refine
from stoop.optimize.ledger import inner
from stoop.optimize.normal_equations import Jacobian, TallMatrix, tall
from stoop.parallel import Json, Plan, Pool, Tally, execute
from stoop.problem.archive import problem_arrays, problem_document, restored_problem
from stoop.problem.evidence import Inverse, invert
from stoop.results.result import Result
from stoop.results.uncertainty import MethodIntervals

Watch = Callable[[str], None]  #: receives the progress of an assessment
Ending = Literal["converged", "refined", "failed"]
MAX_BYTES: Final = 2**31  #: to which a packed problem may unfold
SHARED_STEPS: Final = 6  #: at most, with the derivatives at the optimum
SHARED_TOLERANCE: Final = 0.5  #: standard errors left to go when the shared derivatives have done their work
OWN_STEPS: Final = 8  #: at most, with the refit's own derivatives
STEP_TOLERANCE: Final = 0.05  #: standard errors of the last step; what is left after it is smaller still
#: assessments of the shape of a likelihood that need not be quadratic
NONLINEAR: Final = ("posterior", "profile")
MIN_REDUCTION: Final = 0.2  #: of a step by the next; a longer one asks for a curvature of its own


def free_entries(fit: Estimate, bars: ErrorBars) -> IntArray:
    """Return the entries (f,) of the search vector that no bound holds."""
    return bars.free[bars.free < len(fit.z)]


def packed(fit: Estimate, bars: ErrorBars, more: Mapping[str, Any]) -> str:
    """Return the problem that refits solve, its optimum and further arrays as text."""
    return pack(fit.refit_problem, {"z": fit.z, "free": free_entries(fit, bars), **more})


def check_method(method: str, assessments: Collection[str]) -> None:
    """Raise an IdentificationError where assessments, by name, would add nothing to a method's error bars."""
    if not methods.find(method).simulates and (idle := [n for n in NONLINEAR if n in assessments]):
        raise IdentificationError(
            f"{' and '.join(idle)}: --method {method} is a linear regression, whose likelihood has no other shape than the "
            f"corrected error bars show; leave it out, use --bootstrap, or name --method {methods.DEFAULT}"
        )


@dataclass(frozen=True)
class Finding:
    """What an assessment found: intervals, and files by name, to lie beside the result."""

    intervals: MethodIntervals
    files: Mapping[str, bytes] = field(default_factory=dict)


@runtime_checkable
class Assessment(Protocol):
    """One more estimate of the uncertainty of a fit."""

    @property
    def name(self) -> str:
        """Key in ``result.uncertainty``."""

    def __call__(self, fit: Estimate, bars: ErrorBars, seed: int, watch: Watch) -> Finding:
        """Assess; `seed` is that of everything random."""


def assess(
    result: Result, fit: Estimate, bars: ErrorBars, assessments: Sequence[Assessment], watch: Watch
) -> tuple[Result, dict[str, bytes]]:
    """Return the result with what the assessments found and which methods agree, and the files that they give.

    An IdentificationError says that a method cannot be assessed so, or that an extra is not installed.
    """
    check_method(result.method, [assessment.name for assessment in assessments])
    uncertainty, files = dict(result.uncertainty), dict[str, bytes]()
    for assessment in assessments:
        found = assessment(fit, bars, result.seed, watch)
        uncertainty[assessment.name] = found.intervals
        files |= found.files
    trust = method_agreement(result.parameters, uncertainty, result.repeatability, result.components)
    return replace(result, uncertainty=uncertainty, trust=trust), files


def refits(
    plan: Plan, store: Path | None, pool: Pool, progress: str, unit: int, watch: Watch
) -> Mapping[str, Json]:
    """Execute a campaign of refits, in a temporary store without a given one; each run counts as `unit` in the progress."""

    def report(done: Tally) -> None:
        left = "" if done.seconds_left is None else f", {duration(done.seconds_left)} left"
        watch(f"{progress.format(done.done * unit, done.total * unit)}{done.note and ' '}{done.note or left}")

    with tempfile.TemporaryDirectory(prefix="stoop-") as folder:
        return execute(plan, store or Path(folder) / "refits.sqlite", pool, report)


def pack(problem: RefitProblem, more: Mapping[str, Any]) -> str:
    """Return a problem, and arrays that belong to it, as text; the same problem gives the same text."""
    head = problem_document(problem.problem) | {"kind": problem.kind}
    arrays = {**problem_arrays(problem.problem), **more, **problem.arrays}
    arrays["head"] = np.frombuffer(json.dumps(head).encode(), dtype=np.uint8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return base64.b64encode(buffer.getvalue()).decode()


def unpack(text: str) -> tuple[RefitProblem, dict[str, Any]]:
    """Return the problem that was packed, and all arrays."""
    arrays = read_arrays(io.BytesIO(base64.b64decode(text)), MAX_BYTES)
    head = json.loads(arrays.pop("head").tobytes())
    misfit = restored_problem(head, arrays)
    return methods.refit_problem(head["kind"]).restored(misfit, arrays), arrays


@dataclass(frozen=True, eq=False)
class Optimum:
    """The end of a search, linearized."""

    problem: SummedProblem  #: weights as in the last fit, priors included; nuisances behind the parameters
    z: FloatArray  #: (D + E,); the optimum in the problem's own units
    free: IntArray  #: (f,) int; entries that no bound holds; the others stay where they are
    residual: FloatArray  #: (n_r,); weighted residuals there, those of the priors last
    jacobian: TallMatrix  #: (n_r, f)
    box: tuple[float, float] = (0.0, 1.0)  #: in which the parameters stay, in units of the vector

    @property
    def rung(self) -> int:
        """The full record."""
        return len(self.problem.prices) - 1

    @property
    def shared(self) -> int:
        """How many of the free entries are parameters; they come first."""
        return int(np.sum(self.free < self.problem.dimension))

    @cached_property
    def information(self) -> FloatArray:
        """Of the weighted residuals, priors included, (f, f)."""
        return self.jacobian.gram()

    @cached_property
    def inverse(self) -> Inverse:
        """Of the information."""
        return invert(self.information)

    @classmethod
    def of_likelihood(cls, fit: Estimate) -> Optimum:
        """Return the greatest likelihood of a fit, no entry held."""
        problem = fit.refit_problem
        return likelihood_optimum(problem, linearize(problem, fit.z, np.arange(len(fit.z))))

    @property
    def nuisances(self) -> TallMatrix:
        """Derivatives (n_r, E) of the residuals by the nuisances, where no entry is held."""
        return self.jacobian.of_variables(np.arange(self.shared, len(self.z)))

    def at(self, steps: FloatArray) -> FloatArray:
        """Return vectors (B, D + E) for steps (B, f) from the optimum; parameters stay in their box."""
        Z = np.repeat(self.z[None, :], len(steps), axis=0)
        Z[:, self.free] += steps
        d = self.problem.dimension
        Z[:, :d] = np.clip(Z[:, :d], *self.box)
        return Z


def linearize(problem: SummedProblem, z: FloatArray, free: IntArray) -> Optimum:
    """Return the optimum with its residuals and their derivatives."""
    rung = len(problem.prices) - 1
    residual = problem.residuals(z[None, :], rung)[0]
    jacobian, _ = problem.jacobian(z, rung, residual)
    return Optimum(problem, z, free, residual, tall(jacobian).of_variables(free))


def unpacked_optimum(text: str) -> tuple[RefitProblem, Optimum, dict[str, Any]]:
    """Return a packed problem, its optimum, and all arrays."""
    problem, arrays = unpack(text)
    optimum = linearize(problem, arrays["z"], arrays["free"].astype(np.intp))
    return problem, replace(optimum, box=problem.box), arrays


@dataclass(frozen=True, eq=False)
class Shifted(Derived):
    """A problem with other measurements: the residuals are shifted by (n_r,), nothing else changes."""

    problem: SummedProblem
    shift: FloatArray

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return shifted residuals (B, n_r) on the full record."""
        return self.problem.residuals(Z, rung) + self.shift

    def products(self, Z: FloatArray, rung: int, left: FloatArray) -> FloatArray:
        """Return the shifted residuals (B, n_r) times `left` (n_r,)."""
        return self.problem.products(Z, rung, left) + inner(self.shift, left)

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[Jacobian, float]:
        """Return the derivative, which the shift does not change, and the trajectories it took."""
        return self.problem.jacobian(z, rung, r - self.shift)

    def gradient(self, z: FloatArray, rung: int, r: FloatArray, left: FloatArray) -> FloatArray:
        """Return the derivative times `left`, (D + E,)."""
        return self.problem.gradient(z, rung, r - self.shift, left)


def likelihood_optimum(problem: RefitProblem, optimum: Optimum) -> Optimum:
    """Return the optimum of a sum of squares that is least there, as the likelihood is greatest.

    A likelihood with further terms (the size of innovations) has its maximum beside that of the sum of squares: then the part of
    the residuals that the unknowns still explain is taken off.
    """
    if problem.complete:
        return optimum
    factor, J = optimum.inverse.factor, optimum.jacobian
    explained = J.apply(factor @ (factor.T @ J.project(optimum.residual)))
    shifted = Shifted(optimum.problem, -explained)
    return replace(optimum, problem=shifted, residual=optimum.residual - explained)


@dataclass(frozen=True, eq=False)
class Refits:
    """Where refits ended, (B, D + E), NaN for those that failed, and how each ended."""

    z: FloatArray
    endings: tuple[Ending, ...]


def refit(optimum: Optimum, shifts: FloatArray) -> Refits:
    """Refit problems whose residuals are those of `optimum.problem` plus `shifts` (B, n_r)."""
    factor, free = optimum.inverse.factor, optimum.free
    Z = optimum.at(np.zeros((len(shifts), len(free))))
    residuals = np.repeat(optimum.residual[None, :], len(shifts), axis=0)
    for _ in range(SHARED_STEPS):
        with np.errstate(invalid="ignore", over="ignore"):
            gradients = np.array([optimum.jacobian.project(r) for r in residuals + shifts])
            steps = -gradients @ factor  # (B, r), standard errors
        length = np.sqrt(np.sum(steps**2, axis=1))
        moving = np.isfinite(length) & (length > SHARED_TOLERANCE)
        if not moving.any():
            break
        Z[moving] = optimum.at(Z[moving][:, free] - optimum.z[free] + steps[moving] @ factor.T)
        residuals[moving] = optimum.problem.residuals(Z[moving], optimum.rung)
    endings = list[Ending]()
    for z, shift in zip(Z, shifts, strict=True):
        found = _gauss_newton(optimum, z, shift)
        endings.append("converged")
        if found is None:
            end = refine(Shifted(optimum.problem, shift), optimum.z, optimum.rung)
            found, endings[-1] = (end.z, "refined") if end.converged else (np.full(len(z), np.nan), "failed")
        z[:] = found
    return Refits(Z, tuple(endings))


def _gauss_newton(optimum: Optimum, z: FloatArray, shift: FloatArray) -> FloatArray | None:
    """Take Gauss-Newton steps with the refit's own gradients; None where they do not converge.

    The information is that of the first point until steps no longer shrink fast.
    """
    problem, rung, free = optimum.problem, optimum.rung, optimum.free
    boxed, before = free < problem.dimension, np.inf
    low, high = optimum.box
    inverse = None
    for _ in range(OWN_STEPS):
        r = problem.residuals(z[None, :], rung)[0]
        if not np.isfinite(r).all():
            return None
        if inverse is None:
            jacobian = tall(problem.jacobian(z, rung, r)[0])
            inverse, gradient = _Inverse(jacobian, free), jacobian.project(r + shift)[free]
        else:
            gradient = problem.gradient(z, rung, r, r + shift)[free]
        if not np.isfinite(gradient).all():
            return None
        at = z[free]
        # bounds that the step would cross hold
        held = boxed & (((at <= low) & (gradient > 0.0)) | ((at >= high) & (gradient < 0.0)))
        unheld = np.flatnonzero(~held)
        step, length = inverse.step(gradient, unheld)
        if length > MIN_REDUCTION * before:
            inverse = _Inverse(tall(problem.jacobian(z, rung, r)[0]), free)
            step, length = inverse.step(gradient, unheld)
        before = length
        z = optimum.at((at - optimum.z[free] + step)[None, :])[0]
        if length < STEP_TOLERANCE:
            return z
    return None


class _Inverse:
    """Inverse of the information of f free entries of a Jacobian, found once for the entries that no bound holds."""

    def __init__(self, jacobian: TallMatrix, free: IntArray) -> None:
        self.information = jacobian.gram()[np.ix_(free, free)]
        self.unheld, self.factor = np.empty(0, dtype=np.intp), np.empty((0, 0))

    def step(self, gradient: FloatArray, unheld: IntArray) -> tuple[FloatArray, float]:
        """Return the Gauss-Newton step (f,) of the entries `unheld`, and its length in standard errors."""
        if not np.array_equal(unheld, self.unheld):
            self.unheld, self.factor = unheld, invert(self.information[np.ix_(unheld, unheld)]).factor
        reduced, step = -gradient[unheld] @ self.factor, np.zeros(len(gradient))
        step[unheld] = self.factor @ reduced
        return step, float(np.sqrt(reduced @ reduced))
