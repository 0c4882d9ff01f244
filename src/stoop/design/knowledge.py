"""What is known of the parameters before the next flight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stoop.assess.covariance import invert, marked, standard_errors
from stoop.base.arrays import FloatArray
from stoop.results.result import Result


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Information about some parameters, by name.

    Attributes
    ----------
    names : tuple of str
    information : (k, k)
        In the inverse products of the parameters' units; zeros where nothing is known.
    """

    names: tuple[str, ...]
    information: FloatArray

    @classmethod
    def none(cls) -> Knowledge:
        """Return what is known without a flight."""
        return cls((), np.zeros((0, 0)))

    @classmethod
    def of_result(cls, result: Result) -> Knowledge:
        """Return what an identification has found; a parameter that it could not tell is not known."""
        told = [i for i, n in enumerate(result.covariance.names) if _told(result, n, i)]
        names = tuple(result.covariance.names[i] for i in told)
        return cls(names, invert(result.covariance.matrix[np.ix_(told, told)]).matrix)

    def among(self, names: tuple[str, ...]) -> FloatArray:
        """Return the information (n, n) about the parameters of a list, zeros for those it says nothing of."""
        out = np.zeros((len(names), len(names)))
        shared = [i for i, n in enumerate(self.names) if n in names]
        place = [names.index(self.names[i]) for i in shared]
        out[np.ix_(place, place)] = self._about(shared)
        return out

    def std(self, names: tuple[str, ...]) -> FloatArray:
        """Return the standard errors (n,) of parameters; infinite where nothing is known."""
        inverse = invert(self.among(names))
        return standard_errors(marked(inverse.matrix, inverse.determined))

    def _about(self, index: list[int]) -> FloatArray:
        """Return the information about some of the parameters when the others are unknown."""
        others = [i for i in range(len(self.names)) if i not in index]
        own = self.information[np.ix_(index, index)]
        if not others:
            return own
        cross = self.information[np.ix_(index, others)]
        lost: FloatArray = cross @ invert(self.information[np.ix_(others, others)]).matrix @ cross.T
        return own - lost


def _told(result: Result, name: str, i: int) -> bool:
    variance = float(result.covariance.matrix[i, i])
    return result.parameters[name].identifiable and np.isfinite(variance) and variance > 0.0
