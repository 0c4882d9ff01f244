"""Noise and gains of a filter: the steady gain, and one that follows the flight.

Gusts of the vehicle file disturb where there are any; their intensities are numbers of the vehicle, free or not. Without
a table of turbulence white accelerations disturb velocity and rates, one unknown intensity each. The noise of each
measured channel is unknown, unless it is given. Unknown intensities are logarithms: the tail of the search vector.

Axes: b = candidate, g = gain, k = sample, r = point of linearization.

References
----------
E. K.-W. Chu, H.-Y. Fan, W.-W. Lin and C.-S. Wang, "Structure-preserving algorithms for periodic discrete-time
algebraic Riccati equations", *International Journal of Control* 77(8), 2004, pp. 767-788 (period one).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Final, Literal

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.estimate.linearization import LinearModels
from stoop.kernels import filtering
from stoop.problem import Piece
from stoop.vehicle import Vehicle
from stoop.vehicle.channels import RIGID_STATES

#: per root second
FIRST_INTENSITY: Final = {"u": 0.3, "v": 0.3, "w": 0.3, "p": 0.1, "q": 0.1, "r": 0.1}
#: share of these that a stated process noise has: a filter that follows the record of an unstable vehicle and takes hardly any
#: more noise from it than one that knows of no disturbance. With a tenth, errors of the unstable derivatives grow by a quarter
STATED: Final = 0.01
#: of the first guess: bounds of an intensity
RANGE: Final = (1e-3, 1e3)
MAX_DOUBLINGS: Final = 60
#: relative change of the covariance; the next one is about its square
TOLERANCE: Final = 1e-10


@dataclass(frozen=True, eq=False)
class Noise:
    """Intensities of process and measurement noise."""

    vehicle: Vehicle
    #: (n_y,), first guess of the standard deviation of each channel, its unit; NaN where not measured
    first: FloatArray
    #: (n_y,), variances that are not estimated
    given: FloatArray | None = None
    #: share of `FIRST_INTENSITY` that intensities are, where they are not estimated
    stated: float | None = None

    @cached_property
    def disturbed(self) -> tuple[str, ...]:
        """States with a white acceleration of unknown intensity: none where gusts disturb."""
        known = self.vehicle.gusts or self.stated is not None
        return () if known else tuple(s for s in self.vehicle.moves if s in RIGID_STATES)

    @cached_property
    def channels(self) -> list[int]:
        """Channels whose noise is estimated."""
        return [] if self.given is not None else np.flatnonzero(np.isfinite(self.first)).tolist()

    @property
    def size(self) -> int:
        """Length of the tail."""
        return len(self.start)

    @cached_property
    def start(self) -> FloatArray:
        """The tail to begin with."""
        return np.log([*(FIRST_INTENSITY[s] for s in self.disturbed), *self.first[self.channels]])

    def process(self, tail: FloatArray, drive: FloatArray, dt: float) -> FloatArray:
        """Return the covariance (B, r, n_e, n_e) that a sample of `dt` s adds, for tails (B, t).

        `drive` (B, r, n_e, n_w) is the perturbation by one unit of noise held over the sample; noise of unit intensity has
        the variance 1/dt there.
        """
        out: FloatArray = drive @ np.swapaxes(drive, 2, 3) / dt
        for i, name in enumerate(self.disturbed):
            e = self.vehicle.moves.index(name)
            out[:, :, e, e] += np.exp(2.0 * tail[:, i, None]) * dt
        share = self.stated or 0.0
        for name in FIRST_INTENSITY.keys() & set(self.vehicle.moves) if share else ():
            e = self.vehicle.moves.index(name)
            out[:, :, e, e] += (share * FIRST_INTENSITY[name]) ** 2 * dt
        return out

    def variances(self, tail: FloatArray) -> FloatArray:
        """Return the measurement variances (B, n_y), infinite for channels that were never measured."""
        out = np.full((len(tail), len(self.first)), np.inf)
        if self.given is not None:
            out[:] = np.where(np.isfinite(self.first), self.given, np.inf)
        out[:, self.channels] = np.exp(2.0 * tail[:, len(self.disturbed) :])
        return out


def first_guess(vehicle: Vehicle, pieces: Sequence[Piece]) -> FloatArray:
    """Return the noise (n_y,) that second differences show, NaN for channels that were never measured.

    White noise of variance s^2 has second differences of variance 6 s^2, in which a smooth signal hardly shows.
    """
    out = np.full(len(vehicle.outputs), np.nan)
    for i, channel in enumerate(vehicle.outputs):
        found = np.concatenate([np.diff(p.measured[:, i], 2) for p in pieces])
        found, sigma = found[np.isfinite(found)], getattr(vehicle.file.sensors, channel).sigma
        if found.size:
            out[i] = max(float(np.median(np.abs(found))) / 0.6745 / np.sqrt(6.0), 1e-2 * sigma)
        elif any(np.isfinite(p.measured[:, i]).any() for p in pieces):
            out[i] = sigma
    return out


@dataclass(frozen=True, eq=False)
class Gains:
    """Gains and innovation covariances of a piece."""

    #: (G, n_e n_y, B)
    gain: FloatArray
    #: (B, G, n_y, n_y), what is not measured has 1 on the diagonal
    covariance: FloatArray
    #: (n,), which of the G each sample has
    which: IntArray

    def repeated(self, count: int) -> Gains:
        """Return the gains of one candidate for so many."""
        return Gains(np.repeat(self.gain, count, axis=2), self.covariance, self.which)


@dataclass(frozen=True, eq=False)
class Plan:
    """Where a piece is linearized and what was measured: independent of the candidate."""

    #: (n,), point of linearization of each sample, counted from zero
    points: IntArray
    #: (n, n_y), where something was measured
    measured: BoolArray
    #: (G, n_y), which channels were measured together
    patterns: BoolArray
    #: (n,), pattern of each sample
    which: IntArray


@dataclass(frozen=True)
class Gain(ABC):
    """How a gain is found; points of linearization are `spacing` s apart."""

    name: ClassVar[Literal["steady", "varying"]]
    spacing: float

    def plan(self, piece: Piece) -> Plan:
        """Return where a piece is linearized and what was measured."""
        measured = np.isfinite(piece.measured)
        patterns, which = np.unique(measured, axis=0, return_inverse=True)
        samples, n = min(self.spacing / piece.dt, len(piece.time)), len(piece.time)
        points = np.arange(n, dtype=np.int64) // max(1, round(samples))
        return Plan(points, measured, patterns, which.ravel().astype(np.int64))

    @abstractmethod
    def gains(
        self, vehicle: Vehicle, plan: Plan, linear: LinearModels, process: FloatArray, variances: FloatArray
    ) -> Gains:
        """Return the gains of every candidate; process noise (B, r, n_e, n_e), variances (B, n_y)."""


@dataclass(frozen=True)
class Steady(Gain):
    """One point per piece, the covariance at which the filter settles there.

    Samples that lack channels have the gain of those that they have, with the same covariance before them. For that
    covariance a channel informs by its share of samples.
    """

    name: ClassVar = "steady"
    spacing: float = np.inf

    def gains(
        self, _vehicle: Vehicle, plan: Plan, linear: LinearModels, process: FloatArray, variances: FloatArray
    ) -> Gains:
        """Return one gain per pattern of measured channels."""
        F, H = linear.transition[:, 0], linear.readings[:, 0]
        P = steady_covariance(F, H, process[:, 0], plan.measured.mean(axis=0) / variances)
        HP, gain, covariance = H @ P, [], []
        for pattern in plan.patterns:
            S = (HP @ np.swapaxes(H, 1, 2)) * np.outer(pattern, pattern)
            S[:, np.arange(len(pattern)), np.arange(len(pattern))] += np.where(pattern, variances, 1.0)
            S = _symmetric(S)
            lost: BoolArray = np.logical_not(np.isfinite(S).all(axis=(1, 2)))
            invertible = np.where(lost[:, None, None], np.eye(len(pattern)), S)
            K = np.asarray(np.linalg.solve(invertible, np.where(pattern[:, None], HP, 0.0)), dtype=np.float64)
            K[lost] = np.nan
            gain.append(np.swapaxes(K, 1, 2).reshape(len(P), -1).T)
            covariance.append(S)
        return Gains(np.array(gain), np.stack(covariance, axis=1), plan.which)


@dataclass(frozen=True)
class Varying(Gain):
    """Points along the flight, and the covariance from sample to sample: an extended Kalman filter.

    The initial state is among the unknowns, so the covariance begins at zero. What was not measured is left out
    exactly.
    """

    name: ClassVar = "varying"
    spacing: float = 0.2

    def gains(
        self, vehicle: Vehicle, plan: Plan, linear: LinearModels, process: FloatArray, variances: FloatArray
    ) -> Gains:
        """Return a gain per sample."""
        measured, zero = plan.measured.astype(np.float64), np.zeros(process.shape[2:])
        known = np.where(np.isfinite(variances), variances, 1.0)
        rows, kernel = zip(linear.transition, linear.readings, process, known, strict=True), vehicle.kernel()
        found = [filtering.riccati(kernel, *row, measured, plan.points, zero)[:2] for row in rows]
        samples = np.arange(len(measured), dtype=np.int64)
        return Gains(np.stack([K for K, _ in found], axis=2), np.array([S for _, S in found]), samples)


#: by name in a result
GAINS: Final[dict[str, Gain]] = {gain.name: gain for gain in (Steady(), Varying())}


def steady_covariance(
    transition: FloatArray, readings: FloatArray, process: FloatArray, information: FloatArray
) -> FloatArray:
    """Return P = F P F' - F P H' (H P H' + R)^-1 H P F' + Q, before a measurement is taken.

    By the structure-preserving doubling algorithm: each iteration covers twice as many samples as the one before. P is
    (B, n, n), NaN where there is no such covariance, or it overflows.

    F and Q are (B, n, n), H is (B, n_y, n); the information (B, n_y) is the inverse of the diagonal of R, zero for what is
    never measured.
    """
    A = np.swapaxes(transition, 1, 2).copy()
    G = np.swapaxes(readings, 1, 2) @ (information[:, :, None] * readings)
    P, n, one = process.copy(), A.shape[1], np.eye(A.shape[1])
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for _ in range(MAX_DOUBLINGS):
            W = one + G @ P
            lost = ~np.isfinite(W).all(axis=(1, 2))  # such a candidate becomes NaN
            W[lost] = one
            solved = _solved(W, np.concatenate([A, G], axis=2))
            solved[lost] = np.nan
            V, U, before = solved[:, :, :n], solved[:, :, n:], P
            P = _symmetric(P + np.swapaxes(A, 1, 2) @ P @ V)
            A, G = A @ V, _symmetric(G + A @ U @ np.swapaxes(A, 1, 2))
            if np.all(~(np.abs(P - before).max(axis=(1, 2)) > TOLERANCE * np.abs(P).max(axis=(1, 2)))):
                break
    return P


def _solved(matrices: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solutions (B, n, m) of linear systems, NaN where the matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(matrices, right))
    except np.linalg.LinAlgError:
        singular = np.linalg.slogdet(matrices)[0] == 0.0
        return np.asarray(np.linalg.solve(np.where(singular[:, None, None], np.nan, matrices), right))


def _symmetric(M: FloatArray) -> FloatArray:
    return 0.5 * (M + np.swapaxes(M, 1, 2))
