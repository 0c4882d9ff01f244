"""A certified regression as a problem for our optimizers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stoop.base.arrays import FloatArray
from stoop_studies.verify.nist.files import Certified
from stoop_studies.verify.nist.models import compiled


@dataclass(frozen=True, eq=False)
class Regression:
    """A file of NIST StRD as an `optimize.Problem` without a box: all of its parameters are free.

    Attributes
    ----------
    certified : Certified
        Of which the certified values are not looked at here.
    scale : (p,)
        Sizes of the parameters at the start: z = b / scale.
    """

    certified: Certified
    scale: FloatArray

    dimension = 0
    prices = (1.0,)

    @property
    def extra(self) -> int:
        """Number of parameters."""
        return len(self.scale)

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return model less response (B, n)."""
        n = len(self.certified.y)
        with np.errstate(all="ignore"):
            rows = [_wide(compiled(self.certified.name).residual(*self._told(z)), n) for z in Z]
        return np.array(rows)

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[FloatArray, float]:
        """Return exact derivatives (n, p)."""
        n = len(self.certified.y)
        with np.errstate(all="ignore"):
            rows = [_wide(d(*self._told(z)), n) for d in compiled(self.certified.name).derivatives]
        return (np.array(rows) * self.scale[:, None]).T, float(self.extra)

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return the sums of squares at the origin: there is no box."""
        residuals = self.residuals(np.zeros((len(X), self.extra)), rung)
        return np.asarray((residuals**2).sum(axis=1))

    def reference(self, rung: int) -> float:
        """Return the cost of a constant."""
        return float(((self.certified.y - self.certified.y[0]) ** 2).sum())

    def _told(self, z: FloatArray) -> tuple[Any, ...]:
        return (z * self.scale, self.certified.y, *self.certified.x)


def _wide(values: Any, n: int) -> FloatArray:
    """Return (n,) of what may be a constant."""
    return np.broadcast_to(np.asarray(values, dtype=np.float64), (n,))
