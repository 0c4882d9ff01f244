"""The noiseless BBOB functions in ten variables, as the package ``ioh`` has them.

``bbob-01`` to ``bbob-24``; the seed is the instance, which turns and shifts the function. The search box is
[-5, 5] in every variable, brought to the unit box; the value of the optimum is taken off, so that the least
cost is zero. Only the cost is known: optimizers that need residuals cannot be run here.

References
----------
Hansen, Finck, Ros and Auger (2009), Real-parameter black-box optimization benchmarking 2009: noiseless
functions definitions, INRIA RR-6829.
de Nobel, Ye, Vermetten, Wang, Doerr and Baeck (2024), IOHexperimenter, Evolutionary Computation 32, 205-210.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.extras import install
from stoop.errors import IdentificationError
from stoop.optimize.problem import ScalarProblem
from stoop_studies.problems import Posed, take_none

FUNCTIONS: Final = 24
NAMES: Final = tuple(f"bbob-{k:02d}" for k in range(1, FUNCTIONS + 1))
DIMENSION: Final = 10


class Bbob(ScalarProblem):
    """One instance (1 or more) of one function (1 to 24), on the unit box.

    Raises
    ------
    IdentificationError
        ``ioh`` is not installed.
    """

    def __init__(self, function: int, instance: int, dimension: int = DIMENSION) -> None:
        try:
            import ioh
        except ImportError:
            raise IdentificationError(f"problem bbob: needs the package ioh; {install('compare')}") from None
        self.dimension = dimension
        self.function: Any = ioh.get_problem(function, instance, dimension, ioh.ProblemClass.BBOB)
        self.least = float(self.function.optimum.y)

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return the values above the optimum, (B,), of X, (B, D) in the unit box."""
        return np.asarray(self.function(physical(X)), dtype=np.float64) - self.least

    @property
    def optimum(self) -> FloatArray:
        """The place of the least value, (D,), in [-5, 5]."""
        return np.asarray(self.function.optimum.x, dtype=np.float64)


def physical(x: FloatArray) -> FloatArray:
    """Return what points of the unit box, (..., D), mean in [-5, 5]."""
    return -5.0 + x * 10.0


def pose(name: str, seed: int, **arguments: object) -> Posed:
    """Pose the function of a name, such as ``bbob-08``; the seed is the instance.

    Raises
    ------
    IdentificationError
        Arguments, of which these problems have none; an instance below 1; ``ioh`` is not installed.
    """
    take_none(name, arguments)
    if seed < 1:
        raise IdentificationError(f"problem {name}: there is no instance {seed}; take seeds from 1 on")
    problem = Bbob(int(name.removeprefix("bbob-")), seed)
    center = np.full((1, DIMENSION), 0.5)
    return Posed(
        problem=problem,
        target=1e-8,  # above the optimum, as BBOB's own last target
        reference=float(problem.costs(center, 0)[0]),
        truth=problem.optimum,
        parameters=tuple(f"x{k + 1}" for k in range(DIMENSION)),
        values=physical,
    )
