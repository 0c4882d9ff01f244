"""What an optimizer knows of its problem: costs, residuals, and the price of each."""

from __future__ import annotations

from typing import NoReturn, Protocol

import numpy as np

from stoop.base.arrays import FloatArray, IntArray
from stoop.errors import IdentificationError
from stoop.optimize.normal_equations import Jacobian


class Residuals(Protocol):
    """The part of a problem that `forward_jacobian` needs."""

    @property
    def dimension(self) -> int:
        """Number D of variables in the unit box."""

    @property
    def prices(self) -> tuple[float, ...]:
        """Price of one trajectory on each rung, in trajectories of the full record; the last is 1."""

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return weighted residuals, (B, n_r), of Z, (B, D + E), priors included; cost = sum of squares."""
        ...


class Problem(Residuals, Protocol):
    """A least-squares problem on the unit box, with nuisances and a ladder of shorter records.

    The first `dimension` variables are searched by the population, in [0, 1]. The next `extra` are nuisances
    (initial states, sensor biases): unbounded, scaled so that 1 is about one prior sigma, zero where the
    measurements put them. Populations keep them at zero; only local refinement moves them.

    A rung is a shortened record: 0 the shortest, the last one the full record. Costs are always quoted and compared
    on the full record. A candidate that diverges is a value, not an error: its cost is inf, its residuals hold inf or nan.
    """

    @property
    def extra(self) -> int:
        """Number E of nuisances."""

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return the costs, (B,), of X, (B, D), with the nuisances at zero; counts B prices."""
        ...

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[Jacobian, float]:
        """Return d r / d z, (n_r, D + E), at z with residuals r, and the trajectories it took.

        `forward_jacobian` is the ready-made implementation; override it where structure saves simulations.
        """
        ...

    def reference(self, rung: int) -> float:
        """Return the trivial model's cost (a constant at the first measurement): the scale of the gates."""
        ...


class ScalarProblem:
    """Base of problems of which only the cost is known, on one record; a child has `dimension` and `costs`."""

    extra: int = 0
    prices: tuple[float, ...] = (1.0,)

    def residuals(self, Z: FloatArray, rung: int) -> NoReturn:
        """Refuse with an `IdentificationError`: there are none."""
        raise IdentificationError(
            "problem: only its cost is known, there are no residuals; take an optimizer that needs none"
        )

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> NoReturn:
        """Refuse, as `residuals`."""
        self.residuals(z[None, :], rung)

    def reference(self, rung: int) -> float:
        """Return inf: there is no trivial model to compare with."""
        return float(np.inf)


def forward_jacobian(
    problem: Residuals, z: FloatArray, rung: int, r: FloatArray, step: float = 1e-7
) -> tuple[FloatArray, float]:
    """Differentiate the residuals by forward differences, backward at an upper bound.

    A column whose forward point diverges is taken backward; if that diverges too it is zero, which holds the
    variable for this iteration.

    Parameters
    ----------
    problem, rung
    z : (D + E,), first D in [0, 1]
    r : (n_r,), residuals at z
    step : balances truncation against rounding for residuals of order one

    Returns
    -------
    jacobian : (n_r, D + E), column-major
    spent : trajectories of the full record
    """

    def differences(steps: FloatArray, which: IntArray) -> FloatArray:
        """Return one row of difference quotients per variable in `which`."""
        Z = np.repeat(z[None, :], len(which), axis=0)
        Z[np.arange(len(which)), which] += steps
        # z + h is rounded: divide by the step that was taken
        taken = Z[np.arange(len(which)), which] - z[which]
        with np.errstate(invalid="ignore", over="ignore"):
            quotients: FloatArray = (problem.residuals(Z, rung) - r) / taken[:, None]
        return quotients

    signs = np.ones(len(z))
    signs[: problem.dimension][z[: problem.dimension] + step > 1.0] = -1.0
    rows = differences(signs * step, np.arange(len(z)))
    lost = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    if lost.size:
        again = differences(-signs[lost] * step, lost)
        again[~np.isfinite(again).all(axis=1)] = 0.0
        rows[lost] = again
    return rows.T, (len(z) + lost.size) * problem.prices[rung]
