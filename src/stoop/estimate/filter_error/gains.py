"""Two gains of the filter: the one at which it settles, and one that follows the flight.

A gain is composed of points of linearization and a Riccati equation; `likelihood` takes either.

Axes: b = candidate, g = gain, k = sample, r = point.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.estimate.filter_error import steady
from stoop.estimate.filter_error.points import Linear
from stoop.kernels import filtering
from stoop.problem import Piece
from stoop.vehicle import Vehicle

IntArray = NDArray[np.int64]
SPACING: Final = 0.2  #: s between points of linearization along a flight


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
    """What does not depend on a candidate.

    Attributes
    ----------
    points : (n,) of int
        Point of linearization of each sample, counted from zero.
    seen : (n, n_y) bool
        Where something was measured.
    patterns : (G, n_y) bool
        Which channels were measured together.
    which : (n,) of int
        Pattern of each sample.
    """

    points: IntArray
    seen: NDArray[np.bool_]
    patterns: NDArray[np.bool_]
    which: IntArray


def _plan(piece: Piece, points: IntArray) -> Plan:
    seen = np.isfinite(piece.measured)
    patterns, which = np.unique(seen, axis=0, return_inverse=True)
    return Plan(points, seen, patterns, which.ravel().astype(np.int64))


class Gain(Protocol):
    """How a gain is found."""

    def plan(self, piece: Piece) -> Plan:
        """Return where a piece is linearized and what was measured."""
        ...

    def gains(
        self, vehicle: Vehicle, plan: Plan, linear: Linear, process: FloatArray, variances: FloatArray
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
        return _plan(piece, np.zeros(len(piece.time), dtype=np.int64))

    def gains(
        self, _vehicle: Vehicle, plan: Plan, linear: Linear, process: FloatArray, variances: FloatArray
    ) -> Gains:
        """Return one gain per pattern of measured channels."""
        F, H = linear.transition[:, 0], linear.readings[:, 0]
        P = steady.covariance(F, H, process[:, 0], plan.seen.mean(axis=0) / variances)
        HP = H @ P
        gain, covariance = [], []
        for pattern in plan.patterns:
            S = innovation_covariance(HP, H, variances, pattern)
            shown = np.where(pattern[:, None], HP, 0.0)
            gain.append(np.swapaxes(_solved(S, shown), 1, 2).reshape(len(P), -1).T)
            covariance.append(S)
        return Gains(np.array(gain), np.stack(covariance, axis=1), plan.which)


def innovation_covariance(
    HP: FloatArray, H: FloatArray, variances: FloatArray, pattern: NDArray[np.bool_]
) -> FloatArray:
    """Return H P H' + R (B, n_y, n_y) for the channels of a pattern (n_y,), the unit matrix for the others."""
    S = (HP @ np.swapaxes(H, 1, 2)) * np.outer(pattern, pattern)
    diagonal = np.arange(len(pattern))
    S[:, diagonal, diagonal] += np.where(pattern, variances, 1.0)
    return 0.5 * (S + np.swapaxes(S, 1, 2))


def _solved(S: FloatArray, right: FloatArray) -> FloatArray:
    """Return S^-1 right, NaN for candidates that are lost."""
    lost: NDArray[np.bool_] = np.logical_not(np.isfinite(S).all(axis=(1, 2)))
    out = np.asarray(
        np.linalg.solve(np.where(lost[:, None, None], np.eye(S.shape[1]), S), right), dtype=np.float64
    )
    out[lost] = np.nan
    return out


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
        return _plan(piece, np.arange(len(piece.time), dtype=np.int64) // every)

    def gains(
        self, vehicle: Vehicle, plan: Plan, linear: Linear, process: FloatArray, variances: FloatArray
    ) -> Gains:
        """Return a gain per sample."""
        kernel, which = vehicle.kernel(), plan.points
        seen = plan.seen.astype(np.float64)
        zero = np.zeros(process.shape[2:])
        known = np.where(np.isfinite(variances), variances, 1.0)
        found = [
            filtering.riccati(kernel, F, H, Q, R, seen, which, zero)[:2]
            for F, H, Q, R in zip(linear.transition, linear.readings, process, known, strict=True)
        ]
        samples = np.arange(len(which), dtype=np.int64)
        return Gains(np.stack([K for K, _ in found], axis=2), np.array([S for _, S in found]), samples)
