"""Gauss-Newton steps through windows that bend with the residuals.

Where numbers are known together only (inertia and torque, drag and the height of the rotors), the cost is a narrow curved
valley, which a straight step leaves at once, so that hundreds of short ones follow it. The second derivative of the residuals
along a step, from their values a tenth of it away, is fitted as residuals are; half of that solution bends the step.

References
----------
M. K. Transtrum, B. B. Machta and J. P. Sethna, "Geometry of nonlinear least squares with applications to sloppy models and
optimization", *Physical Review E* 83, 2011, 036701.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray, IntArray
from stoop.estimate.shooting_problem import Iterate, Reduced, ShootingProblem, Weighted, reduced
from stoop.estimate.shooting_windows import Shot, lanes_first
from stoop.optimize.normal_equations import project, solve_damped

PROBE: Final = 0.1  #: of a step, after which its curvature is seen


@dataclass(frozen=True, eq=False)
class Step:
    """A damped Gauss-Newton step from an iterate."""

    z: FloatArray  #: (D + E,)
    windows: list[Reduced]  #: of each piece, their states eliminated
    normal: FloatArray  #: (D + E, D + E)
    free: IntArray  #: entries of z that no bound holds
    damping: float
    gain: float  #: predicted reduction of the cost

    def moves(self, problem: ShootingProblem) -> list[FloatArray]:
        """Return the steps (w, e) of the windows' states."""
        rows = zip(problem.shots, self.windows, strict=True)
        return [one.moves(self.z[shots.entries]) for shots, one in rows]


def bent(
    problem: ShootingProblem,
    at: Iterate,
    linear: Sequence[Sequence[Shot]],
    weighted: Sequence[Sequence[Weighted]],
    step: Step,
) -> Iterate:
    """Return the iterate after a step and half of its geodesic acceleration.

    `linear` and `weighted` are the windows of each piece, whitened, at the iterate; it stays there where the step diverges.
    """
    moves, dimension = step.moves(problem), problem.problem.dimension

    def after(z: FloatArray, steps: Sequence[FloatArray]) -> tuple[FloatArray, list[FloatArray]]:
        rows = zip(problem.shots, at.nodes, steps, strict=True)
        return at.z + z, [s.perturbed(own, m.T) if len(m) > 1 else own for s, own, m in rows]

    near = problem.whitened(*after(PROBE * step.z, [PROBE * m for m in moves]))
    curved, slope = list[Reduced](), np.zeros_like(step.z)
    for shots, own, windows, values, m in zip(problem.shots, linear, weighted, near, moves, strict=True):
        second = _second_derivatives(own, windows, values, step.z[shots.entries], m)
        curved.append(reduced(second, step.damping))
        slope[shots.entries] += curved[-1].gradient
    bend, free = np.zeros_like(step.z), step.free
    bend[free] = solve_damped(step.normal[np.ix_(free, free)], -slope[free], step.damping)
    if not np.isfinite(bend).all():
        return at
    more = replace(step, z=bend, windows=curved).moves(problem)
    z, nodes = after(step.z + 0.5 * bend, [m + 0.5 * b for m, b in zip(moves, more, strict=True)])
    z[:dimension] = np.clip(z[:dimension], 0.0, 1.0)
    return problem.iterate(z, nodes)


def _second_derivatives(
    linear: Sequence[Shot],
    weighted: Sequence[Weighted],
    near: tuple[FloatArray, FloatArray],
    step: FloatArray,
    moves: FloatArray,
) -> list[Weighted]:
    """Return the windows of a piece with the second derivative along a step (j,), (w, e) in place of residuals and gaps."""
    ends = np.cumsum([len(shot.residual) for shot in linear])[:-1]
    gaps, out = [*near[1], np.empty(0)], list[Weighted]()
    following = [*(b for _, b in pairwise(moves)), np.zeros_like(moves[0])]
    for k, (shot, one, values) in enumerate(zip(linear, weighted, np.split(near[0], ends), strict=True)):
        along = shot.by_unknown @ step + shot.by_state @ moves[k]
        left = (2.0 / PROBE * ((values - shot.residual) / PROBE - along)).ravel()
        by_unknown = lanes_first(shot.by_unknown).reshape(-1, left.size)
        by_state = lanes_first(shot.by_state).reshape(-1, left.size)
        gap = one.gap
        if gap.size:
            along = one.gap_by_unknown @ step + one.gap_by_state @ moves[k] - one.closing * following[k]
            gap = 2.0 / PROBE * ((gaps[k] - gap) / PROBE - along)
        slopes = {"unknown_slope": project(by_unknown, left), "state_slope": project(by_state, left)}
        out.append(replace(one, products=replace(one.products, **slopes), gap=gap))
    return out
