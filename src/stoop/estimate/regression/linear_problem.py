"""The least-squares problem of a regression near its estimates: what the bootstrap refits and PRESS leaves parts out of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.estimate.refit_problem import RefitProblem
from stoop.problem import Misfit
from stoop.problem.evidence import Evidence, PieceEvidence


@dataclass(frozen=True, eq=False)
class LinearProblem(RefitProblem):
    """The weighted equations as residuals, linear about the estimates.

    Equations of rotors are linearized there, those left out stay out, and the weights of the equations stay.
    """

    kind: ClassVar = "regression"
    #: its layout has the priors that the regression used
    problem: Misfit
    #: (D + E,), the estimates
    center: FloatArray
    #: equation errors (n, q) and regressors (n, q, D + E) of each stretch
    stretches: tuple[PieceEvidence, ...]
    #: equation -> standard deviation of its errors, SI; q entries
    deviations: Mapping[str, float]
    #: s from row to row; infinite for rows that are no samples of time
    dt: float
    #: whether the bounds of the parameters hold
    bounded: bool

    @classmethod
    def of(
        cls,
        problem: Misfit,
        z: FloatArray,
        evidence: Evidence,
        deviations: Mapping[str, float],
        dt: float,
        bounded: bool,
    ) -> LinearProblem:
        """Return the problem about estimates z (D + E,); a parameter without prior information has no prior."""
        layout, known = problem.layout, np.diag(evidence.prior) > 0.0
        pairs = zip(layout.parameters, known, strict=False)  # nuisances come last
        parameters = tuple(p if k else replace(p, prior=None) for p, k in pairs)
        problem = replace(problem, layout=replace(layout, parameters=parameters))
        return cls(problem, z, evidence.pieces, deviations, dt, bounded)

    @classmethod
    def restored(cls, problem: Misfit, arrays: Mapping[str, Any]) -> LinearProblem:
        """Return the problem from its `arrays`."""
        each = range(sum(name.startswith("regressors.") for name in arrays))
        stretches = tuple(PieceEvidence(arrays[f"errors.{i}"], arrays[f"regressors.{i}"]) for i in each)
        deviations = dict(zip(arrays["equations"].tolist(), arrays["deviations"].tolist(), strict=True))
        dt, bounded = float(arrays["dt"]), bool(arrays["bounded"])
        return cls(problem, arrays["center"], stretches, deviations, dt, bounded)

    @property
    def arrays(self) -> dict[str, Any]:
        """Arrays that :meth:`restored` takes beside `problem`."""
        out: dict[str, Any] = {n: np.array(getattr(self, n)) for n in ("center", "dt", "bounded")}
        out |= {
            "equations": np.array(list(self.deviations)),
            "deviations": np.array(list(self.deviations.values())),
        }
        for i, stretch in enumerate(self.stretches):
            out |= {f"errors.{i}": stretch.residual, f"regressors.{i}": stretch.jacobian}
        return out

    @property
    def box(self) -> tuple[float, float]:
        """Bounds of the parameters, infinite for a regression without bounds."""
        return (0.0, 1.0) if self.bounded else (-np.inf, np.inf)

    @property
    def equations(self) -> tuple[str, ...]:
        """Names of the equations."""
        return tuple(self.deviations)

    @property
    def spacing(self) -> float:
        """Time from row to row, s; infinite for rows that are no samples of time."""
        return self.dt

    @property
    def present(self) -> tuple[BoolArray, ...]:
        """Which equation errors (n, q) of each stretch there are."""
        return tuple(stretch.present for stretch in self.stretches)

    @cached_property
    def _linear(self) -> tuple[FloatArray, FloatArray]:
        """Modeled minus measured (n,) at the estimates, weighted, and the derivative (n, D + E)."""
        residual = [-s.residual.ravel() for s in self.stretches]
        scales = self.problem.layout.scales
        slopes = [s.jacobian.reshape(s.residual.size, -1) * scales for s in self.stretches]
        return np.concatenate(residual), np.concatenate(slopes)

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return weighted modeled minus measured responses, then the residuals of the priors, (B, n_r)."""
        residual, slopes = self._linear
        equations = residual + (Z - self.center) @ slopes.T
        return np.concatenate([equations, self.problem.layout.prior_residuals(Z)], axis=1)

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[FloatArray, float]:
        """Return the derivative of the residuals, which costs nothing."""
        return np.concatenate([self._linear[1], self.problem.layout.prior_jacobian(z)]), 0.0

    def in_units(self, white: Sequence[FloatArray]) -> list[FloatArray]:
        """Return weighted values (n, q) of each stretch in SI."""
        return [w * np.array(list(self.deviations.values())) for w in white]
