"""Alternate noise estimation and Levenberg-Marquardt until both converge; error bars that count the color of residuals."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from threadpoolctl import threadpool_limits

from stoop import optimize
from stoop.assessment.covariance import standard_errors
from stoop.assessment.error_bars import (
    ComparisonScale,
    Identifiability,
    Uncertainty,
    estimate_uncertainty,
    identifiability,
)
from stoop.base.arrays import FloatArray
from stoop.base.variables import POSITION, VELOCITY
from stoop.errors import IdentificationError
from stoop.estimate.noise import correlation_times
from stoop.flight import Flight
from stoop.flight.instrument_errors import instrument_errors
from stoop.problem import on_circle
from stoop.problem.evidence import PieceEvidence
from stoop.reconstruction.kinematics import OUTPUTS
from stoop.reconstruction.pieces import MARGIN, Pieces
from stoop.reconstruction.problem import START, Problem

MAX_ROUNDS: Final = 12  #: of alternate noise estimation and Levenberg-Marquardt
MAX_CHANGE: Final = 0.2  #: standard errors by which new weights may still change an estimate
_AIRSPEEDS, _VELOCITIES, _POSITIONS = ("V", "airspeed_pitot"), VELOCITY, POSITION
NOISE_FLOORS: Final = {
    **dict.fromkeys(OUTPUTS, 1e-4),
    **dict.fromkeys(_AIRSPEEDS, 0.05),
    **dict.fromkeys(_VELOCITIES, 0.01),
    **dict.fromkeys(_POSITIONS, 0.02),
}  #: rad, m/s, m; no channel is trusted further
FIRST_NOISE: Final = {
    **dict.fromkeys(OUTPUTS, 0.03),
    **dict.fromkeys(_AIRSPEEDS, 1.0),
    **dict.fromkeys(_VELOCITIES, 0.5),
    **dict.fromkeys(_POSITIONS, 2.0),
}  #: rad, m/s, m; before anything is known
TOO_LATE: Final = (
    f"more than the {MARGIN:g} s that pieces have to spare at their ends: look at the clocks instead"
)
_SETTINGS: Final = optimize.Settings(iterations=60, gain=1e-8, predicted=1e-6, stall=0, stall_damping=np.inf)


@dataclass(frozen=True, eq=False)
class Estimate:
    """A finished compatibility fit.

    Attributes
    ----------
    pieces : Pieces
    problem : Problem
        With the final weights.
    z : (E,), the optimum
    uncertainty : Uncertainty
        Of the whole vector, in prior standard deviations.
    identifiability : tuple of Identifiability, of the instrument errors
    converged : bool
        Whether noise and estimates converged.
    """

    pieces: Pieces
    problem: Problem
    z: FloatArray
    uncertainty: Uncertainty
    identifiability: tuple[Identifiability, ...]
    converged: bool

    @property
    def values(self) -> dict[str, float]:
        """Estimates of the unknowns, SI."""
        found = self.problem.values(self.z[None, :])[0]
        return {u.name: float(value) for u, value in zip(self.problem.unknowns, found, strict=True)}

    @property
    def errors(self) -> dict[str, float]:
        """Standard errors of the unknowns, corrected for color, SI."""
        sigma = standard_errors(self.uncertainty.corrected)[: self.problem.shared] * self.problem.scales
        return {u.name: float(value) for u, value in zip(self.problem.unknowns, sigma, strict=True)}


def estimate(pieces: Pieces) -> Estimate:
    """Estimate everything that the logged channels can tell of each other.

    Raises
    ------
    IdentificationError
        The kinematics cannot be integrated from the recorded inputs.
    """
    with threadpool_limits(limits=1, user_api="blas"):  # more threads would round differently
        return _estimate(
            pieces,
            Problem(
                instrument_errors(pieces.logged),
                pieces.pieces,
                np.array([FIRST_NOISE[name] for name in OUTPUTS]),
            ),
        )


def _estimate(pieces: Pieces, problem: Problem) -> Estimate:
    z, converged = first_guess(problem, pieces.flight), False
    for _ in range(MAX_ROUNDS):
        end = optimize.refine(problem, z, 0, _SETTINGS)
        if not np.isfinite(end.cost):
            raise IdentificationError(
                f"{pieces.flight.name}: the recorded rates and accelerations cannot be integrated; "
                "look for wild samples with stoop info"
            )
        converged, z = _change(problem, z, end.z) < MAX_CHANGE, end.z
        if converged:
            break
        # half of the way, or channels take turns in being believed
        problem = problem.weighted(np.sqrt(problem.sigma * _sigma(problem, z)))
    found = estimate_uncertainty(sensitivities(problem, z), np.eye(problem.extra))
    return Estimate(pieces, problem, z, found, _judged(problem, z, found), converged)


def _change(problem: Problem, before: FloatArray, now: FloatArray) -> float:
    """Return the largest change of an instrument error, in its standard errors."""
    J, _ = problem.jacobian(now, 0, problem.residuals(now[None, :], 0)[0])
    error = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    return float(np.max(np.abs(now - before)[: problem.shared] / error[: problem.shared], initial=0.0))


def first_guess(problem: Problem, flight: Flight) -> FloatArray:
    """Return the vector with everything at its prior, the wind as the air data reconstruction has it."""
    z = np.zeros(problem.extra)
    if flight.air is not None and np.isfinite(flight.air.wind_n):
        known = {"wind.n": flight.air.wind_n, "wind.e": flight.air.wind_e}
        for i, unknown in enumerate(problem.unknowns):
            z[i] = (known.get(unknown.name, unknown.mean) - unknown.mean) / unknown.std
    return z


def residuals(problem: Problem, z: FloatArray) -> list[FloatArray]:
    """Return measured minus reconstructed (n, 13) of every piece, NaN where nothing was measured."""
    return [
        on_circle(piece.measured - problem.outputs(z, i), OUTPUTS) for i, piece in enumerate(problem.pieces)
    ]


def _sigma(problem: Problem, z: FloatArray) -> FloatArray:
    """Return by what each channel is to be weighted: noise times the root of its own correlation time.

    Channels were recorded at different rates and interpolated; one that is sampled ten times between two of
    its own readings must not count ten times.
    """
    errors = residuals(problem, z)
    together = np.concatenate(errors)
    repeats = correlation_times(errors, problem.pieces[0].dt * problem.pieces[0].every)
    out = np.ones(len(OUTPUTS))
    for i, name in enumerate(OUTPUTS):
        seen = together[np.isfinite(together[:, i]), i]
        if seen.size:
            power = max(float(np.mean(seen**2)), NOISE_FLOORS[name] ** 2)
            out[i] = np.sqrt(power * repeats[i])
    return out


def sensitivities(problem: Problem, z: FloatArray) -> list[PieceEvidence]:
    """Return whitened residuals and sensitivities of each piece, channels that were measured only."""
    r = problem.residuals(z[None, :], 0)[0]
    J, _ = problem.jacobian(z, 0, r)
    used = np.flatnonzero(np.any([np.isfinite(p.measured).any(axis=0) for p in problem.pieces], axis=0))
    out, first = [], 0
    for piece in problem.pieces:
        block = slice(first, first + piece.measured.size)
        shape = (len(piece.measured), len(OUTPUTS))
        seen = np.isfinite(piece.measured[:, used])
        residual = np.where(seen, -r[block].reshape(shape)[:, used], np.nan)
        out.append(PieceEvidence(residual, J[block].reshape(*shape, -1)[:, used]))
        first = block.stop
    return out


def _judged(problem: Problem, z: FloatArray, found: Uncertainty) -> tuple[Identifiability, ...]:
    count = problem.extra
    names = [u.name for u in problem.unknowns] + [
        f"start {i}" for i in range(len(START) * len(problem.pieces))
    ]
    yardstick = ComparisonScale(np.ones(count), np.full(count, np.inf), np.ones(count))
    judged = identifiability(names, found.information, found.corrected, yardstick)
    values = problem.values(z[None, :])[0]
    return tuple(
        _within_reach(one, float(value)) for one, value in zip(judged[: problem.shared], values, strict=True)
    )


def _within_reach(one: Identifiability, value: float) -> Identifiability:
    """Take a delay as not identifiable that is so long that pieces hold nothing to compare with."""
    far = one.name.endswith(".delay") and abs(value) > MARGIN
    return replace(one, identifiable=False, reason=TOO_LATE) if far else one
