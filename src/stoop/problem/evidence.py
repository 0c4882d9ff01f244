"""Residuals, sensitivities and prior information of a fit, for any estimator.

The residuals of output error are those of the simulation, of filter error the innovations, of multiple shooting those of
the windows, of a regression the equation errors. ``stoop.assessment`` computes error bars from them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import BoolArray, FloatArray
from stoop.problem.layout import Layout
from stoop.problem.misfit import Misfit

#: of the width of the bounds: an estimate that is nearer lies at its bound
AT_BOUND: Final = 1e-6
#: of the greatest scaled eigenvalue; below it is rounding, not information
NULL_EIGENVALUE: Final = 1e-13
#: standard errors, of second differences
STEP: Final = 0.003
LONGEST: Final = 0.01  #: of a step, in widths of a parameter's bounds
#: simulated at a time
CANDIDATES: Final = 512
#: an unknown with a larger component in a null direction is not determined
NULL_COMPONENT: Final = 1e-3


@dataclass(frozen=True)
class Unknown:
    """One number that an estimator solves for.

    A noise intensity is the logarithm of a standard deviation; it is estimated with the others and not reported.
    """

    #: of the vehicle for a parameter, of :class:`~stoop.problem.Nuisance` for a nuisance
    name: str
    kind: Literal["parameter", "nuisance", "noise"]
    #: SI
    estimate: float
    #: SI, with which a standard error is compared: larger of start and estimate, or a nuisance's prior
    size: float
    #: SI, of its bounds; infinite without bounds
    width: float = np.inf
    #: SI, standard deviation of its prior; infinite without one
    prior: float = np.inf
    #: why it has no error bar: at a bound, or not estimated by the method
    fixed: Literal["", "bound", "method"] = ""
    #: SI, root-mean-square error of the estimate by the prior alone; infinite without one
    prior_error: float = np.inf


@dataclass(frozen=True, eq=False)
class PieceEvidence:
    """Residuals of one piece at the estimate, weighted by the inverse square root W of the noise covariance.

    W' W is the inverse noise covariance. Residuals, gaps, and W are dimensionless; derivatives are per SI unit of the unknown.
    Residuals of a piece in windows are not stationary noise: they repeat from window to window.
    """

    #: (n, n_y), W (measured - model), NaN where there is no measurement
    residual: FloatArray
    #: (n, n_y, k), W d(model)/d(unknown), not used beside a missing measurement
    jacobian: FloatArray
    #: of which the piece is
    maneuver: int = 0
    #: first sample of each of w windows with initial states of their own, and the number of samples
    edges: tuple[int, ...] = ()
    #: (w - 1, e), whitened residuals of their continuity (end of one, start of the next)
    gaps: FloatArray | None = None
    #: (w - 1, e, k), derivatives of the gaps
    gap_jacobian: FloatArray | None = None

    @property
    def present(self) -> BoolArray:
        """Whether there is a measurement, (n, n_y)."""
        return np.isfinite(self.residual)

    @property
    def continuity_residuals(self) -> tuple[FloatArray, FloatArray]:
        """Gaps (w - 1, e) and their derivatives (w - 1, e, k), both empty for a piece without windows."""
        if self.gaps is None or self.gap_jacobian is None:
            return np.zeros((0, 0)), np.zeros((0, 0, self.jacobian.shape[2]))
        return self.gaps, self.gap_jacobian

    def filled(self) -> tuple[FloatArray, FloatArray]:
        """Return residual and jacobian with zeros for missing readings."""
        there = self.present
        if there.all():
            return self.residual, self.jacobian
        return np.where(there, self.residual, 0.0), np.where(there[:, :, None], self.jacobian, 0.0)

    def rows(self) -> tuple[FloatArray, FloatArray]:
        """Return all residuals (N,) and their derivatives (N, k), zeros for missing readings; gaps last."""
        (residual, jacobian), (gaps, slopes) = self.filled(), self.continuity_residuals
        count = jacobian.shape[2]
        if not gaps.size:
            return residual.ravel(), jacobian.reshape(-1, count)
        columns = np.concatenate([jacobian.reshape(-1, count), slopes.reshape(-1, count)])
        return np.concatenate([residual.ravel(), gaps.ravel()]), columns

    @property
    def gap_information(self) -> FloatArray:
        """Information (k, k) of the gaps."""
        slopes = self.continuity_residuals[1].reshape(-1, self.jacobian.shape[2])
        return np.asarray(slopes.T @ slopes)

    def of(self, unknowns: NDArray[np.intp]) -> PieceEvidence:
        """Return the same residuals with the sensitivities to some unknowns only."""
        gap = None if self.gap_jacobian is None else self.gap_jacobian[:, :, unknowns]
        return replace(self, jacobian=self.jacobian[:, :, unknowns], gap_jacobian=gap)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Residuals, sensitivities and information about k unknowns: parameters, nuisances, then noise intensities.

    The inflation is the factor by which the noise covariance in W exceeds that of the residuals, because neighboring
    residuals are correlated; the Cramer-Rao bound for white residuals divides by it.
    """

    #: those of the layout in its order, estimated or not; then noise intensities
    unknowns: tuple[Unknown, ...]
    pieces: tuple[PieceEvidence, ...]
    #: (k, k), information beside the residuals, per SI unit: priors, size of innovations, continuity
    prior: FloatArray
    inflation: float = 1.0
    #: whether residuals are uncorrelated by construction (Fourier coefficients): no color is corrected
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
        mean, std = p.prior_about(value)
        out.append(Unknown(p.name, "parameter", value, size, width, std, why, math.hypot(std, value - mean)))
    for i, n in enumerate(layout.nuisances, layout.dimension):
        value, error = n.center + n.scale * float(z[i]), n.scale * math.hypot(1.0, z[i])
        out.append(Unknown(n.name, "nuisance", value, n.scale, np.inf, n.scale, fixed[i], error))
    return tuple(out)


def prior_information(unknowns: Sequence[Unknown]) -> FloatArray:
    """Return the information (k, k) of independent priors."""
    return np.diag(np.array([u.prior for u in unknowns]) ** -2.0)


def simulation_evidence(problem: Misfit, z: FloatArray, inflation: float) -> Evidence:
    """Return the evidence of output error: residuals and sensitivities of the simulation from each piece's start."""
    rung = len(problem.prices) - 1
    r = problem.residuals(z[None, :], rung)[0]
    jacobian = problem.jacobian(z, rung, r)[0].dense() / problem.layout.scales
    pieces, first = [], 0
    for piece in problem.pieces:
        rows, shape = slice(first, first + piece.measured.size), piece.measured.shape
        residual = np.where(np.isfinite(piece.measured), -r[rows].reshape(shape), np.nan)
        pieces.append(PieceEvidence(residual, jacobian[rows].reshape(*shape, -1), piece.maneuver))
        first = rows.stop
    unknowns = unknowns_of(problem.layout, z)
    return Evidence(unknowns, tuple(pieces), prior_information(unknowns), inflation)


def observed_information(
    problem: Misfit, z: FloatArray, evidence: Evidence, factor: FloatArray
) -> FloatArray:
    """Return the Hessian (r, r) of half the cost along the columns of `factor` (f, r), where that of Gauss and Newton is 1.

    That, which determines steps, omits the products of residuals and second derivatives; these are large for a wrong model. Not
    finite where a simulation nearby diverges. Each difference is along a direction in which the cost grows by one for a unit:
    along single unknowns, what only all of them together hardly change were a difference of large numbers.
    """
    free = evidence.free
    total = factor.T @ evidence.prior[np.ix_(free, free)] @ factor
    for i, piece in enumerate(evidence.pieces):
        own = np.flatnonzero(np.any(piece.jacobian != 0.0, axis=(0, 1))[free])
        along, triangle = np.linalg.qr(factor[own].T)  # a row of it moves an unknown and those behind it
        unit = np.zeros((len(triangle), len(z)))
        unit[:, free[own]] = triangle / problem.layout.scales[free[own]]
        longest = np.maximum(np.max(np.abs(unit), axis=1), np.finfo(np.float64).tiny)
        sizes = np.minimum(STEP, LONGEST / longest)
        change = partial(problem.piece_costs, index=i, count=len(problem.pieces[i].time))
        half = 0.5  # of the cost, which the kernel sums along trajectories; by color it would take the readings of all
        if not problem.weights.separable:
            residual, slopes = piece.filled()
            change, half = partial(problem.piece_products, index=i, left=-residual.ravel()), 1.0
            slopes = slopes.reshape(residual.size, -1)[:, free] @ factor
            total += slopes.T @ slopes
        curvature = second_differences(change, z, unit * sizes[:, None]) / np.outer(sizes, sizes)
        total += half * along @ curvature @ along.T
    return np.asarray(total)


def second_differences(
    change: Callable[[FloatArray], FloatArray], z: FloatArray, steps: FloatArray
) -> FloatArray:
    """Return the second differences (r, r) about z of a function of vectors (B, D + E) along `steps` (r, D + E)."""
    a, b = np.triu_indices(len(steps), 1)
    moves = np.concatenate([steps, -steps, steps[a] + steps[b], -steps[a] - steps[b], np.zeros((1, len(z)))])
    parts = np.array_split(z + moves, 1 + len(moves) // CANDIDATES)
    costs = np.concatenate([change(part) for part in parts])
    sizes = np.cumsum([len(steps), len(steps), len(a), len(a)])
    ahead, behind, ahead_both, behind_both, here = np.split(costs, sizes)
    with np.errstate(invalid="ignore"):
        both = ahead + behind
        block = np.diag(both - 2.0 * here)
        block[a, b] = block[b, a] = 0.5 * (ahead_both + behind_both - both[a] - both[b]) + here
    return block


@dataclass(frozen=True, eq=False)
class Inverse:
    """Inverse of an information matrix on the directions that it determines."""

    #: (k, r); factor @ factor.T is the pseudo-inverse; r directions are determined
    factor: FloatArray
    #: (k,) bool; which unknowns have no part in a direction without information
    determined: BoolArray
    #: (k,), of the information scaled to a unit diagonal, ascending
    eigenvalues: FloatArray

    @property
    def matrix(self) -> FloatArray:
        """Pseudo-inverse (k, k)."""
        return np.asarray(self.factor @ self.factor.T)


def invert(information: FloatArray) -> Inverse:
    """Invert an information matrix (k, k), scaled to a unit diagonal so that units do not matter.

    Directions without information are left out (pseudo-inverse); `determined` excludes the unknowns with a part in them.
    """
    diagonal = np.sqrt(np.maximum(np.diag(information), 0.0))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    return _inverse(diagonal, *np.linalg.eigh(information / np.outer(scale, scale)))


def invert_rows(rows: FloatArray) -> Inverse:
    """Invert the information ``rows.T @ rows`` of sensitivities (n, k), by QR and singular values of the scaled rows.

    The product is not formed: it squares the condition number, which doubles the loss of digits in the standard errors of
    unknowns that the rows hardly determine (Golub and Van Loan, Matrix Computations, section 5.3).
    """
    diagonal = np.sqrt(np.einsum("nk,nk->k", rows, rows))
    triangle = np.linalg.qr(rows / np.where(diagonal > 0.0, diagonal, 1.0), mode="r")
    _, singular, directions = np.linalg.svd(triangle)
    values = np.zeros(len(diagonal))
    values[: len(singular)] = singular**2
    return _inverse(diagonal, values[::-1], directions[::-1].T)


def _inverse(diagonal: FloatArray, values: FloatArray, vectors: FloatArray) -> Inverse:
    """Return the inverse from roots (k,) of the information's diagonal, and ascending eigenvalues of the scaled one."""
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    kept = values > NULL_EIGENVALUE * max(float(values[-1]), 0.0) if values.size else values > 0.0
    factor = vectors[:, kept] / np.sqrt(values[kept]) / scale[:, None]
    determined = np.sqrt(np.sum(vectors[:, ~kept] ** 2, axis=1)) <= NULL_COMPONENT
    return Inverse(factor, determined & (diagonal > 0.0), values)
