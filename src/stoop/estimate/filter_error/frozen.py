"""The least-squares problem of a filter whose gains stay as they are at an estimate: for refits near it.

With gains K and innovation covariances S held, the whitened innovations S^-1/2 v are residuals as those of a
simulation are. Adding noise to them is the bootstrap of a state-space model in innovations form (D. S. Stoffer and K. D.
Wall, *Journal of the American Statistical Association* 86(416), 1991, pp. 1024-1033). Noise intensities stay at their
estimates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.filter_error.gains import Gains
from stoop.estimate.filter_error.likelihood import Likelihood, run_filter, whitened_by
from stoop.optimize import forward_jacobian
from stoop.problem import Misfit


@dataclass(frozen=True, eq=False)
class FrozenFilter:
    """Innovations as residuals of parameters and nuisances; a :class:`stoop.optimize.Problem` with one rung.

    Attributes
    ----------
    problem : Misfit
        Layout, priors and pieces, late readings moved.
    gains : tuple of Gains
        Of each piece, for one candidate.
    """

    problem: Misfit
    gains: tuple[Gains, ...]
    kind: str = "filter"
    prices: tuple[float, ...] = (1.0,)

    @classmethod
    def of(cls, likelihood: Likelihood, z: FloatArray) -> FrozenFilter:
        """Return the problem with the gains at the unknowns z (k,), noise intensities included."""
        return cls(likelihood.problem, tuple(likelihood.gains_at(z)))

    @classmethod
    def restored(cls, problem: Misfit, arrays: Mapping[str, Any]) -> FrozenFilter:
        """Return the problem from its `arrays`."""
        each = range(len(problem.pieces))
        return cls(
            problem,
            tuple(Gains(*(arrays[f"gains.{n}.{i}"] for n in ("gain", "covariance", "which"))) for i in each),
        )

    @property
    def arrays(self) -> dict[str, Any]:
        """What :meth:`restored` needs beside `problem`."""
        names = ("gain", "covariance", "which")
        return {f"gains.{n}.{i}": getattr(g, n) for i, g in enumerate(self.gains) for n in names}

    @property
    def dimension(self) -> int:
        """Number of parameters."""
        return self.problem.dimension

    @property
    def extra(self) -> int:
        """Number of nuisances."""
        return self.problem.extra

    @cached_property
    def roots(self) -> tuple[FloatArray, ...]:
        """S^-1/2 of each piece's gains, (G, n_y, n_y)."""
        return tuple(np.linalg.inv(np.linalg.cholesky(g.covariance[0])) for g in self.gains)

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return whitened predicted minus measured readings, then the residuals of the priors, (B, n_r)."""
        parts = [-self._white(Z, i).reshape(len(Z), -1) for i in range(len(self.gains))]
        return np.concatenate([*parts, self.problem.layout.prior_residuals(Z)], axis=1)

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return costs (B,) with the nuisances at zero."""
        Z = np.concatenate([X, np.zeros((len(X), self.extra))], axis=1)
        return np.asarray(np.sum(self.residuals(Z, rung) ** 2, axis=1))

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[FloatArray, float]:
        """Return the derivative of the residuals by forward differences, and the trajectories it took."""
        return forward_jacobian(self, z, rung, r)

    def reference(self, rung: int) -> float:
        """Return infinity: there is no trivial model to compare with."""
        return float(np.inf)

    def in_units(self, white: list[FloatArray]) -> list[FloatArray]:
        """Return whitened values (n, n_y) of each piece in the channels' units."""
        return [
            whitened_by(np.asarray(np.linalg.inv(root), dtype=np.float64), w[None], g.which)[0]
            for root, w, g in zip(self.roots, white, self.gains, strict=True)
        ]

    def _white(self, Z: FloatArray, index: int) -> FloatArray:
        rows, start = self.problem.candidates(Z, index)
        own = self.gains[index]
        gains = Gains(np.repeat(own.gain, len(Z), axis=2), own.covariance, own.which)
        v, _ = run_filter(self.problem, index, rows, start, gains)
        return whitened_by(self.roots[index], v, own.which)
