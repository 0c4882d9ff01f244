"""Problems of which only the cost is known: no residuals, no record to shorten, no nuisances."""

from __future__ import annotations

from typing import NoReturn

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import IdentificationError
from stoop.optimize.ledger import Ledger
from stoop.optimize.problem import Problem


class Scalar:
    """Base of such problems; a child has `dimension` and `costs`.

    Attributes
    ----------
    extra : no nuisances
    prices : one rung, the whole
    """

    extra: int = 0
    prices: tuple[float, ...] = (1.0,)

    def residuals(self, Z: FloatArray, rung: int) -> NoReturn:
        """Refuse: there are none.

        Raises
        ------
        IdentificationError
            Always.
        """
        raise _none()

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> NoReturn:
        """Refuse: there is none.

        Raises
        ------
        IdentificationError
            Always.
        """
        raise _none()

    def reference(self, rung: int) -> float:
        """Return inf: there is no trivial model to compare with."""
        return float(np.inf)


def has_residuals(problem: Problem) -> bool:
    """Whether a problem, behind a ledger or not, can be asked for residuals."""
    inner = problem.problem if isinstance(problem, Ledger) else problem
    return not isinstance(inner, Scalar)


def _none() -> IdentificationError:
    return IdentificationError(
        "problem: only its cost is known, there are no residuals; take an optimizer that needs none"
    )
