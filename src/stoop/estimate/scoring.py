"""Fisher's scoring of a likelihood within bounds.

The information M is the curvature of -ln L where the model is right. Of a real flight it is not: the search adds what the
changes of the gradient between its points show to be missing, by the secant update of Dennis, Gay and Welsch.

References
----------
M. R. Osborne, "Fisher's method of scoring", *International Statistical Review* 60(1), 1992, pp. 99-117.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate import iterates
from stoop.estimate.filter_likelihood import Likelihood
from stoop.optimize.levenberg_marquardt import Damping, Ending, StagedModel, Stages, TenfoldDamping, Trial
from stoop.optimize.minimize import Status
from stoop.optimize.secant import Secant

#: tolerances, that may seem left to gain where no step gains anything: as exact are differences of a filter's gradient
UNREACHED: Final = 10.0


class ScoringModel(StagedModel):
    """Fisher's scoring of a likelihood within bounds; it ends when the predicted gain of -ln L is below `tolerance`.

    The cost is twice the negative logarithm of the posterior; the history (i, 2) holds iterations and cost.
    """

    status: Status
    history: FloatArray

    def __init__(self, likelihood: Likelihood, z: FloatArray, tolerance: float) -> None:
        self.likelihood, self.tolerance, self.secant = likelihood, tolerance, Secant.none(likelihood.size)
        self.lower, self.upper = likelihood.bounds
        self.go_to(np.clip(z, self.lower, self.upper))

    @property
    def point(self) -> FloatArray:
        """The unknowns, (k,)."""
        return self.z

    @property
    def memory(self) -> FloatArray:
        """The secant of the last linearization."""
        return self.secant.packed

    def recall(self, memory: FloatArray) -> None:
        """Take over the secant of a saved search."""
        if memory.size:  # none in states of release 0.1
            self.secant = Secant.unpacked(memory, len(self.z))

    def go_to(self, point: FloatArray) -> None:
        """Go to a point."""
        self.z, self.cost, self.current = point, self.likelihood.cost(point), False

    def stopped(self, damping: Damping) -> Ending | None:
        """Show the simulation at this point; see :class:`StagedModel`."""
        iterates.show(self.likelihood.problem, self.z, self.cost)
        return super().stopped(damping)

    @property
    def usable(self) -> bool:
        """Whether cost and gradient are finite."""
        return self.status != "interrupted" and bool(np.isfinite(self.cost))

    def linearize(self) -> None:
        """Compute gradient, information and curvature of the unknowns that no bound holds."""
        with np.errstate(over="ignore", invalid="ignore"):  # a perturbation that diverges leads to no step
            at = self.likelihood.score(self.z)
            g, noise = at.gradient, np.arange(self.likelihood.known, len(self.z))
            curvature = at.information.copy()
            # By a logarithm x of s the curvature is s^2 d2/ds2 + s d/ds. The expectation of the second term is zero, but of an
            # intensity that vanishes it is all that is left.
            curvature[noise, noise] += np.abs(g[noise])
            self.secant = self.secant.at(self.z, g, curvature)
        held = ((self.z <= self.lower) & (g > 0.0)) | ((self.z >= self.upper) & (g < 0.0))
        self.free = np.flatnonzero(~held)
        rows = np.ix_(self.free, self.free)
        self.gradient, self.information = g[self.free], at.information[rows]
        self.curvature = self.secant.corrected(curvature, self.free)
        self.current = self.exact = True

    @property
    def optimal(self) -> bool:
        """Whether the predicted gain is below the tolerance."""
        if not self.current:
            self.linearize()
        return self._left() < self.tolerance

    def settled(self) -> Ending:
        """Return an optimum only if little seems left to gain."""
        return "converged" if self._left() < UNREACHED * self.tolerance else "stalled"

    def _left(self) -> float:
        """Return the predicted gain of -ln L."""
        return 0.5 * float(self.gradient @ self._solve(self.gradient, 0.0))

    def step(self, damping: float) -> FloatArray:
        """Return the damped step."""
        step = np.zeros_like(self.z)
        step[self.free] = self._solve(-self.gradient, damping)
        return step

    def _solve(self, right: FloatArray, damping: float) -> FloatArray:
        """Solve with the diagonal scaled to one, so that units do not matter."""
        with np.errstate(over="ignore", invalid="ignore"):
            scale = 1.0 / np.sqrt(np.maximum(np.diag(self.curvature), 1e-300))
            matrix = self.curvature * np.outer(scale, scale)
            matrix[np.diag_indices_from(matrix)] += max(damping, 1e-12)
            return np.asarray(scale * np.linalg.solve(matrix, scale * right))

    def evaluate(self, step: FloatArray) -> Trial:
        """Return the cost after the step."""
        there = np.clip(self.z + step, self.lower, self.upper)
        return Trial(there, self.likelihood.cost(there), 0.0)

    def accept(self, trial: Trial, ratio: float) -> None:
        """Move to the point of the step."""
        self.z, self.cost, self.current = trial.point, trial.cost, False


def maximize(
    stages: Stages, likelihood: Likelihood, z: FloatArray, tolerance: float, steps: float = np.inf
) -> ScoringModel:
    """Maximize the log-likelihood from z (k,).

    Stop when the predicted gain of the next step is below `tolerance`, or after `steps`; Ctrl-C keeps the best so far.
    """
    model = ScoringModel(likelihood, z, tolerance)
    try:
        model.status = stages.search(model, TenfoldDamping(1e-3, growth=4.0, smallest=1e-9), steps)
    except KeyboardInterrupt:
        model.status = "interrupted"
    costs = stages.stages[-1].costs
    model.history = np.column_stack([np.arange(len(costs)), costs])
    return model
