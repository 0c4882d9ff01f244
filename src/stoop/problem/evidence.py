"""What an estimate rests on, in one form for every estimator: residuals, sensitivities and prior information.

Output error gives the residuals and sensitivities of its simulation, filter error those of the innovations, multiple
shooting those of its windows, a regression its equation errors and regressors. One path leads from here to error bars
(``stoop.assessment``).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import BoolArray, FloatArray
from stoop.problem.layout import Layout
from stoop.problem.misfit import Misfit

AT_BOUND = 1e-6  #: of the width of the bounds: an estimate that is nearer lies at its bound


@dataclass(frozen=True)
class Unknown:
    """One number that an estimator solves for.

    Attributes
    ----------
    name : str
        Of the vehicle for a parameter, of :class:`~stoop.problem.Nuisance` for a nuisance.
    kind : {"parameter", "nuisance", "noise"}
        A noise intensity is the logarithm of a standard deviation; it takes part and is not reported.
    estimate : float, SI
    size : float, SI
        With which a standard error is compared: the larger of start and estimate, or the prior of a nuisance.
    width : float, SI
        Of its bounds; infinite without bounds.
    prior : float, SI
        Standard deviation of its prior; infinite without one.
    fixed : {"", "bound", "method"}
        Why it has no error bar: its estimate lies at a bound, or the method does not estimate it.
    """

    name: str
    kind: Literal["parameter", "nuisance", "noise"]
    estimate: float
    size: float
    width: float = np.inf
    prior: float = np.inf
    fixed: Literal["", "bound", "method"] = ""


@dataclass(frozen=True, eq=False)
class PieceEvidence:
    """Residuals of one piece at the estimate, weighted by the inverse square root W of the noise covariance.

    Attributes
    ----------
    residual : (n, n_y), 1
        W (measured - model), with W' W the inverse noise covariance; NaN where there is no measurement.
    jacobian : (n, n_y, k), 1 per SI unit of the unknown
        W d(model)/d(unknown); zero for unknowns that do not touch the piece, and not used beside a missing measurement.
    edges : tuple of int
        First sample of each window and the number of samples, where windows of the piece begin anew: residuals are then
        no stationary noise, but alike from window to window. Else empty.
    gaps : (w - 1, e), 1
        Whitened residuals of the continuity of the w windows (end of one, start of the next), where there are `edges`.
    gap_jacobian : (w - 1, e, k), 1 per SI unit of the unknown
        Their derivatives.
    """

    residual: FloatArray
    jacobian: FloatArray
    edges: tuple[int, ...] = ()
    gaps: FloatArray | None = None
    gap_jacobian: FloatArray | None = None

    @property
    def present(self) -> BoolArray:
        """Where there is a measurement, (n, n_y)."""
        return np.isfinite(self.residual)

    def filled(self) -> tuple[FloatArray, FloatArray]:
        """Return residual and jacobian with zeros for what is missing."""
        there = self.present
        if there.all():
            return self.residual, self.jacobian
        return np.where(there, self.residual, 0.0), np.where(there[:, :, None], self.jacobian, 0.0)

    def of(self, unknowns: NDArray[np.intp]) -> PieceEvidence:
        """Return the same residuals with the sensitivities to some unknowns only."""
        gap = None if self.gap_jacobian is None else self.gap_jacobian[:, :, unknowns]
        return replace(self, jacobian=self.jacobian[:, :, unknowns], gap_jacobian=gap)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the estimates of any method rest on; k unknowns: parameters, nuisances, then noise intensities.

    Attributes
    ----------
    unknowns : tuple of Unknown, (k,)
        Parameters and nuisances of the layout in its order, estimated or not; then whatever else the method estimates.
    pieces : tuple of PieceEvidence
    prior : (k, k)
        Information beside the residuals, per SI unit: priors, the size of innovations, the continuity of windows.
    inflation : float
        Factor by which the noise covariance in W exceeds that of the residuals, because neighboring residuals are
        correlated; the Cramer-Rao bound for white residuals takes it off again.
    white : bool
        Whether the residuals are uncorrelated by construction (Fourier coefficients), so that no color is corrected.
    """

    unknowns: tuple[Unknown, ...]
    pieces: tuple[PieceEvidence, ...]
    prior: FloatArray
    inflation: float = 1.0
    white: bool = False

    @property
    def free(self) -> NDArray[np.intp]:
        """The unknowns that are estimated and at no bound."""
        return np.flatnonzero([not u.fixed for u in self.unknowns])


def unknowns_of(
    layout: Layout, z: FloatArray, estimated: Collection[int] | None = None
) -> tuple[Unknown, ...]:
    """Return the parameters and nuisances of a layout at an estimate z (D + E,).

    `estimated` are the entries of `z` that the method estimates, whether at a bound or not; all of them when absent.
    """
    out: list[Unknown] = []
    fixed: list[Literal["", "bound", "method"]] = [
        "" if estimated is None or i in estimated else "method" for i in range(len(z))
    ]
    values = layout.physical(z[None, :])[0].tolist()
    for i, (p, value) in enumerate(zip(layout.parameters, values, strict=True)):
        at_bound = estimated is None and not AT_BOUND <= z[i] <= 1.0 - AT_BOUND
        size, width = max(abs(p.value), abs(value)), p.upper - p.lower
        why = "bound" if at_bound else fixed[i]
        out.append(Unknown(p.name, "parameter", value, size, width, p.prior or np.inf, why))
    for i, n in enumerate(layout.nuisances, layout.dimension):
        value = n.center + n.scale * float(z[i])
        out.append(Unknown(n.name, "nuisance", value, n.scale, prior=n.scale, fixed=fixed[i]))
    return tuple(out)


def prior_information(unknowns: Sequence[Unknown]) -> FloatArray:
    """Return the information (k, k) of independent priors."""
    return np.diag(np.array([u.prior for u in unknowns]) ** -2.0)


def simulation_evidence(problem: Misfit, z: FloatArray, inflation: float) -> Evidence:
    """Return the evidence of output error: residuals and sensitivities of the simulation from each piece's start."""
    rung = len(problem.prices) - 1
    r = problem.residuals(z[None, :], rung)[0]
    jacobian, _ = problem.jacobian(z, rung, r)
    jacobian = jacobian / problem.layout.scales
    pieces, first = [], 0
    for piece in problem.pieces:
        rows, shape = slice(first, first + piece.measured.size), piece.measured.shape
        residual = np.where(np.isfinite(piece.measured), -r[rows].reshape(shape), np.nan)
        pieces.append(PieceEvidence(residual, jacobian[rows].reshape(*shape, -1)))
        first = rows.stop
    unknowns = unknowns_of(problem.layout, z)
    return Evidence(unknowns, tuple(pieces), prior_information(unknowns), inflation)
