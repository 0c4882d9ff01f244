"""Two gains of the filter: the steady one, and one that follows the flight.

A gain is composed of points of linearization and a Riccati equation; `likelihood` takes either.

Axes: b = candidate, g = gain, k = sample, r = point.

References
----------
E. K.-W. Chu, H.-Y. Fan, W.-W. Lin and C.-S. Wang, "Structure-preserving algorithms for periodic discrete-time
algebraic Riccati equations", *International Journal of Control* 77(8), 2004, pp. 767-788 (period one).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.estimate.filter_error.linearization import LinearModels
from stoop.kernels import filtering
from stoop.problem import Piece
from stoop.vehicle import Vehicle

SPACING: Final = 0.2  #: s between points of linearization along a flight
MAX_DOUBLINGS: Final = 60
TOLERANCE: Final = 1e-10  #: relative change of the covariance; the next one is about its square


@dataclass(frozen=True, eq=False)
class Gains:
    """Gains and innovation covariances of a piece.

    Attributes
    ----------
    gain : (G, n_e n_y, B)
    covariance : (B, G, n_y, n_y)
        What is not measured has 1 on the diagonal.
    which : (n,) of int
        Which of the G each sample has.
    """

    gain: FloatArray
    covariance: FloatArray
    which: IntArray


@dataclass(frozen=True, eq=False)
class Plan:
    """Where a piece is linearized and what was measured: independent of the candidate.

    Attributes
    ----------
    points : (n,) of int
        Point of linearization of each sample, counted from zero.
    measured : (n, n_y) bool
        Where something was measured.
    patterns : (G, n_y) bool
        Which channels were measured together.
    which : (n,) of int
        Pattern of each sample.
    """

    points: IntArray
    measured: BoolArray
    patterns: BoolArray
    which: IntArray

    @classmethod
    def of(cls, piece: Piece, points: IntArray) -> Plan:
        """Return the plan of a piece with these points."""
        measured = np.isfinite(piece.measured)
        patterns, which = np.unique(measured, axis=0, return_inverse=True)
        return cls(points, measured, patterns, which.ravel().astype(np.int64))


class Gain(Protocol):
    """How a gain is found."""

    def plan(self, piece: Piece) -> Plan:
        """Return where a piece is linearized and what was measured."""
        ...

    def gains(
        self, vehicle: Vehicle, plan: Plan, linear: LinearModels, process: FloatArray, variances: FloatArray
    ) -> Gains:
        """Return the gains of every candidate; process noise (B, r, n_e, n_e), variances (B, n_y)."""
        ...


@dataclass(frozen=True)
class Steady:
    """One point per piece, the covariance at which the filter settles there.

    Samples that lack channels have the gain of those that they have, with the same covariance before them. For that
    covariance a channel informs by its share of samples.
    """

    def plan(self, piece: Piece) -> Plan:
        """Return one point."""
        return Plan.of(piece, np.zeros(len(piece.time), dtype=np.int64))

    def gains(
        self, _vehicle: Vehicle, plan: Plan, linear: LinearModels, process: FloatArray, variances: FloatArray
    ) -> Gains:
        """Return one gain per pattern of measured channels."""
        F, H = linear.transition[:, 0], linear.readings[:, 0]
        P = steady_covariance(F, H, process[:, 0], plan.measured.mean(axis=0) / variances)
        HP = H @ P
        gain, covariance = [], []
        for pattern in plan.patterns:
            S = innovation_covariance(HP, H, variances, pattern)
            lost: BoolArray = np.logical_not(np.isfinite(S).all(axis=(1, 2)))
            whole = np.where(lost[:, None, None], np.eye(len(pattern)), S)
            K = np.asarray(np.linalg.solve(whole, np.where(pattern[:, None], HP, 0.0)), dtype=np.float64)
            K[lost] = np.nan
            gain.append(np.swapaxes(K, 1, 2).reshape(len(P), -1).T)
            covariance.append(S)
        return Gains(np.array(gain), np.stack(covariance, axis=1), plan.which)


def innovation_covariance(
    HP: FloatArray, H: FloatArray, variances: FloatArray, pattern: BoolArray
) -> FloatArray:
    """Return H P H' + R (B, n_y, n_y) for the channels of a pattern (n_y,), the unit matrix for the others."""
    S = (HP @ np.swapaxes(H, 1, 2)) * np.outer(pattern, pattern)
    diagonal = np.arange(len(pattern))
    S[:, diagonal, diagonal] += np.where(pattern, variances, 1.0)
    return _symmetric(S)


@dataclass(frozen=True)
class Varying:
    """Points along the flight, and the covariance from sample to sample: an extended Kalman filter.

    The initial state is among the unknowns, so the covariance begins at zero. What was not measured is left out
    exactly.
    """

    spacing: float = SPACING

    def plan(self, piece: Piece) -> Plan:
        """Return a point every so many samples."""
        every = max(1, round(self.spacing / piece.dt))
        return Plan.of(piece, np.arange(len(piece.time), dtype=np.int64) // every)

    def gains(
        self, vehicle: Vehicle, plan: Plan, linear: LinearModels, process: FloatArray, variances: FloatArray
    ) -> Gains:
        """Return a gain per sample."""
        kernel, which = vehicle.kernel(), plan.points
        measured = plan.measured.astype(np.float64)
        zero = np.zeros(process.shape[2:])
        known = np.where(np.isfinite(variances), variances, 1.0)
        found = [
            filtering.riccati(kernel, F, H, Q, R, measured, which, zero)[:2]
            for F, H, Q, R in zip(linear.transition, linear.readings, process, known, strict=True)
        ]
        samples = np.arange(len(which), dtype=np.int64)
        return Gains(np.stack([K for K, _ in found], axis=2), np.array([S for _, S in found]), samples)


def steady_covariance(
    transition: FloatArray, readings: FloatArray, process: FloatArray, information: FloatArray
) -> FloatArray:
    """Return P = F P F' - F P H' (H P H' + R)^-1 H P F' + Q, before a measurement is taken.

    By the structure-preserving doubling algorithm: each iteration covers twice as many samples as the one before.

    Parameters
    ----------
    transition, process : (B, n, n)
        F and Q.
    readings : (B, n_y, n)
        H.
    information : (B, n_y)
        Inverse of the diagonal of R; zero for what is never measured.

    Returns
    -------
    (B, n, n)
        NaN where there is no such covariance, or it overflows.
    """
    A = np.swapaxes(transition, 1, 2).copy()
    G = np.swapaxes(readings, 1, 2) @ (information[:, :, None] * readings)
    P, n, one = process.copy(), A.shape[1], np.eye(A.shape[1])
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for _ in range(MAX_DOUBLINGS):
            W = one + G @ P
            lost = ~np.isfinite(W).all(axis=(1, 2))  # such a candidate becomes NaN
            W[lost] = one
            solved = np.linalg.solve(W, np.concatenate([A, G], axis=2))
            solved[lost] = np.nan
            V, U, before = solved[:, :, :n], solved[:, :, n:], P
            P = _symmetric(P + np.swapaxes(A, 1, 2) @ P @ V)
            A, G = A @ V, _symmetric(G + A @ U @ np.swapaxes(A, 1, 2))
            if np.all(~(np.abs(P - before).max(axis=(1, 2)) > TOLERANCE * np.abs(P).max(axis=(1, 2)))):
                break
    return P


def _symmetric(M: FloatArray) -> FloatArray:
    return 0.5 * (M + np.swapaxes(M, 1, 2))
