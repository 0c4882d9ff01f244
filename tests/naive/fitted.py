"""Least-squares problems whose uncertainty is known without stoop."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stoop.optimize import forward_jacobian

FloatArray = np.ndarray


@dataclass(frozen=True, eq=False)
class Fitted:
    """A problem in the unit box from a function of parameters (B, D + E) to residuals (B, n)."""

    function: Callable[[FloatArray], FloatArray]
    dimension: int
    extra: int = 0
    prices: tuple[float, ...] = (1.0,)

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        return self.function(Z)

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        Z = np.concatenate([X, np.zeros((len(X), self.extra))], axis=1)
        return np.asarray(np.sum(self.residuals(Z, rung) ** 2, axis=1))

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[FloatArray, float]:
        return forward_jacobian(self, z, rung, r)

    def products(self, Z: FloatArray, rung: int, left: FloatArray) -> FloatArray:
        return np.asarray(self.residuals(Z, rung) @ left)

    def gradient(self, z: FloatArray, rung: int, r: FloatArray, left: FloatArray) -> FloatArray:
        return np.asarray(left @ self.jacobian(z, rung, r)[0])

    def reference(self, rung: int) -> float:
        return 1e6


def line(design: FloatArray, measured: FloatArray, sigma: float, extra: int = 0) -> Fitted:
    """Return a linear model; the last `extra` unknowns are nuisances with a prior N(0, 1)."""

    def residuals(Z: FloatArray) -> FloatArray:
        r = (Z @ design.T - measured) / sigma
        return np.concatenate([r, Z[:, Z.shape[1] - extra :]], axis=1)

    return Fitted(residuals, design.shape[1] - extra, extra)
