"""The least-squares problem near an estimate, which assessments solve again with other measurements or held parameters."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, Self

import numpy as np

from stoop import optimize
from stoop.base.arrays import BoolArray, FloatArray
from stoop.estimate.response import Responses, simulation_responses
from stoop.optimize.normal_equations import Jacobian, project, tall
from stoop.problem import Misfit


class SummedProblem(optimize.Problem, Protocol):
    """A problem that also sums products of its residuals without keeping them."""

    def products(self, Z: FloatArray, rung: int, left: FloatArray) -> FloatArray:
        """Return the weighted residuals (B, n_r) of Z, (B, D + E), times `left`, (n_r,)."""
        ...

    def gradient(self, z: FloatArray, rung: int, r: FloatArray, left: FloatArray) -> FloatArray:
        """Return the derivative (n_r, D + E) at z with residuals r, (n_r,), times `left`, (n_r,): (D + E,)."""
        ...


@dataclass(frozen=True, eq=False)
class Derived(ABC):
    """A :class:`stoop.optimize.Problem` made from another; a child changes what differs."""

    problem: optimize.Problem

    @property
    def dimension(self) -> int:
        """Number of variables in the unit box."""
        return self.problem.dimension

    @property
    def extra(self) -> int:
        """Number of nuisances."""
        return self.problem.extra

    @property
    def prices(self) -> tuple[float, ...]:
        """Price of one trajectory on each rung."""
        return self.problem.prices

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return weighted residuals (B, n_r)."""
        return self.problem.residuals(Z, rung)

    def products(self, Z: FloatArray, rung: int, left: FloatArray) -> FloatArray:
        """Return the weighted residuals (B, n_r) times `left` (n_r,)."""
        return project(self.residuals(Z, rung), left)

    def gradient(self, z: FloatArray, rung: int, r: FloatArray, left: FloatArray) -> FloatArray:
        """Return the derivative at z with residuals r times `left` (n_r,), (D + E,)."""
        return tall(self.jacobian(z, rung, r)[0]).project(left)

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return costs (B,) with the nuisances at zero."""
        Z = np.concatenate([X, np.zeros((len(X), self.extra))], axis=1)
        return np.asarray(np.sum(self.residuals(Z, rung) ** 2, axis=1))

    @abstractmethod
    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[Jacobian, float]:
        """Return the derivative (n_r, D + E) at z with residuals r, and the trajectories it took."""

    def reference(self, rung: int) -> float:
        """Return the trivial model's cost."""
        return self.problem.reference(rung)


@dataclass(frozen=True, eq=False)
class RefitProblem(Derived):
    """Weighted residuals near an estimate as a function of parameters and nuisances, on one rung.

    Residuals (B, n_r) are those of the stretches in their order, then gaps between windows, then priors. What depends on
    the estimate beside the search vector (gains of a filter, states at the start of windows, regressors) stays as it is there.
    """

    problem: Misfit
    #: name in a packed problem
    kind: ClassVar[str]
    #: whether the sum of squares is the whole cost of the estimator, so that the estimate is its minimum
    complete: ClassVar[bool] = False

    @property
    def prices(self) -> tuple[float, ...]:
        """Price of one trajectory."""
        return (1.0,)

    @abstractmethod
    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return whitened modeled minus measured values, then the residuals of the priors, (B, n_r)."""

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[Jacobian, float]:
        """Return the derivative (n_r, D + E) of residuals r at z, and the trajectories it took; by forward differences."""
        return optimize.forward_jacobian(self, z, rung, r)

    @abstractmethod
    def in_units(self, white: Sequence[FloatArray]) -> list[FloatArray]:
        """Return whitened values (n, q) of each stretch, finite, in the units of the columns."""

    def responses(self, z: FloatArray) -> Responses:
        """Return the first-order responses of the residuals to extensions of the vehicle at z (D + E,); none if unknown."""
        return Responses()

    def reference(self, rung: int) -> float:
        """Return infinity: there is no trivial model to compare with."""
        return float(np.inf)

    @property
    def box(self) -> tuple[float, float]:
        """Bounds of the parameters in units of the search vector."""
        return 0.0, 1.0

    @property
    def equations(self) -> tuple[str, ...]:
        """Equations of which the columns are errors; empty where the columns are readings."""
        return ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Name of each column of the residuals: an output of the vehicle, or an equation."""
        return self.equations or self.problem.layout.vehicle.outputs

    @property
    def spacing(self) -> float:
        """Time from row to row, s; infinite for rows that are no samples of time."""
        return self.problem.pieces[0].dt

    @property
    def present(self) -> tuple[BoolArray, ...]:
        """Which residuals (n, q) of each stretch there are."""
        return tuple(np.isfinite(piece.measured) for piece in self.problem.pieces)

    @property
    def windows(self) -> tuple[tuple[int, ...], ...]:
        """First sample of each window of each piece, then the number of samples; empty where pieces are flown whole."""
        return ()

    @property
    def gaps(self) -> int:
        """Number of residuals of the gap between two windows."""
        return 0

    @property
    def arrays(self) -> dict[str, Any]:
        """Arrays from which :meth:`restored` builds the same problem on the same `problem`."""
        return {}

    @classmethod
    @abstractmethod
    def restored(cls, problem: Misfit, arrays: Mapping[str, Any]) -> Self:
        """Return the problem from its `arrays`."""


@dataclass(frozen=True, eq=False)
class SimulationProblem(RefitProblem):
    """Whitened residuals of the simulation of each piece from its start: output error."""

    kind: ClassVar = ""
    complete: ClassVar = True

    @classmethod
    def restored(cls, problem: Misfit, arrays: Mapping[str, Any]) -> SimulationProblem:
        """Return the problem of a simulation."""
        return cls(problem)

    @property
    def _rung(self) -> int:
        return len(self.problem.prices) - 1

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return whitened simulated minus measured readings, then the residuals of the priors, (B, n_r)."""
        return self.problem.residuals(Z, self._rung)

    def products(self, Z: FloatArray, rung: int, left: FloatArray) -> FloatArray:
        """Return the residuals (B, n_r) times `left` (n_r,), which the kernel sums along each trajectory."""
        return self.problem.products(Z, self._rung, left)

    def gradient(self, z: FloatArray, rung: int, r: FloatArray, left: FloatArray) -> FloatArray:
        """Return the derivative of the residuals times `left` (n_r,), which the kernel sums along each trajectory."""
        return self.problem.gradient(z, self._rung, r, left)

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[Jacobian, float]:
        """Return the derivative of the residuals, and the trajectories it took."""
        return self.problem.jacobian(z, self._rung, r)

    def responses(self, z: FloatArray) -> Responses:
        """Return the first-order responses of the readings to extensions of the vehicle at z (D + E,)."""
        return simulation_responses(self.problem, z)

    def in_units(self, white: Sequence[FloatArray]) -> list[FloatArray]:
        """Return whitened values (n, n_y) of each piece in the channels' units."""
        each = zip(self.problem.piece_weights, white, self.present, strict=True)
        return [weights.colored(w, present) for weights, w, present in each]
