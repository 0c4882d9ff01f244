"""Steady wind and pitot calibration of one flight, by robust least squares with honest standard errors.

Two independent witnesses of the wind, each a block of residuals of the same six parameters
theta = (w_n, w_e, k, c, beta_0, kappa)::

    pitot      pitot          = k |v - w| + c                              + noise
    sideslip   j . R' (v - w) = beta_0 |v - w| + kappa a_y / |v - w|       + noise

v is the smoothed velocity over ground, R' v its body components, j the body's right-hand axis. The second
is the lateral force equation a_y = (rho V^2 S / 2 m) C_Ybeta beta turned around: kappa = 2 m / (rho S
C_Ybeta) must be negative, beta_0 holds trim sideslip and heading error. Both see the wind only as the
airplane turns; weak priors hold what a flight leaves open, and the standard errors then say so.

Residuals are colored (turbulence), so each block is weighted by 1 / (sigma^2 tau), with tau the number of
samples that are worth one independent sample [1]_; robust against gusts by Huber's weights [2]_.

References
----------
.. [1] Geyer, "Practical Markov chain Monte Carlo", Statistical Science 7 (1992) 473 (integrated
   autocorrelation time).
.. [2] Huber, "Robust estimation of a location parameter", Ann. Math. Statist. 35 (1964) 73.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.units import DEGREE

WIND_N, WIND_E, SLOPE, OFFSET, TRIM, KAPPA = range(6)
HUBER: Final = 1.345  #: standard deviations; 95 % efficient on Gaussian noise
MAD: Final = 1.4826  #: median absolute deviation to standard deviation
MEMORY: Final = 30.0  #: s, longest correlation looked for
ROUNDS: Final = 3
ITERATIONS: Final = 50
TIGHT: Final = 1e-9


@dataclass(frozen=True)
class Airborne:
    """Samples of the airborne part, thinned to `step`.

    Attributes
    ----------
    time : (n,) s, on a uniform grid of `step` with holes
    step : s
    velocity : (n, 3) m/s, NED, over ground
    right : (n, 3), the body's right-hand axis in NED (second column of R)
    lateral : (n,) m/s2, specific force along it
    pitot : (n,) m/s, NaN where there is none
    """

    time: FloatArray
    step: float
    velocity: FloatArray
    right: FloatArray
    lateral: FloatArray
    pitot: FloatArray

    def where(self, keep: FloatArray) -> Airborne:
        """Keep only the samples at which the given values are finite."""
        good = np.isfinite(keep)
        parts = (self.velocity, self.right, self.lateral, self.pitot)
        velocity, right, lateral, pitot = (part[good] for part in parts)
        return Airborne(self.time[good], self.step, velocity, right, lateral, pitot)


class Witness(Protocol):
    """A block of residuals."""

    @property
    def samples(self) -> Airborne:
        """Return the samples that the residuals belong to."""
        ...

    def residual(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return measured minus model (n,), and the derivative of the model (n, 6)."""
        ...


@dataclass(frozen=True)
class Pitot:
    """The pitot reads an affine function of the true airspeed."""

    samples: Airborne

    def residual(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pitot - (k |v - w| + c) [m/s] and the derivative."""
        air, speed = air_relative(self.samples.velocity, theta)
        slopes = np.zeros((speed.size, 6))
        slopes[:, :2] = -theta[SLOPE] * air[:, :2] / speed[:, None]
        slopes[:, SLOPE], slopes[:, OFFSET] = speed, 1.0
        return self.samples.pitot - (theta[SLOPE] * speed + theta[OFFSET]), slopes


@dataclass(frozen=True)
class Sideslip:
    """Sideslip is what the lateral force says it is, and else a constant."""

    samples: Airborne

    def residual(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return lateral airspeed - (beta_0 V + kappa a_y / V) [m/s]; V is held in the derivative."""
        air, speed = air_relative(self.samples.velocity, theta)
        slopes = np.zeros((speed.size, 6))
        slopes[:, :2] = self.samples.right[:, :2]
        slopes[:, TRIM], slopes[:, KAPPA] = speed, self.samples.lateral / speed
        lateral = np.sum(self.samples.right * air, axis=1)
        return lateral - slopes[:, TRIM:] @ theta[TRIM:], slopes


def air_relative(velocity: FloatArray, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Subtract the steady wind: (n, 3) m/s NED velocity through the air, (n,) m/s its length."""
    air = velocity - np.array([theta[WIND_N], theta[WIND_E], 0.0])
    return air, np.maximum(np.linalg.norm(air, axis=1), 1e-3)


@dataclass(frozen=True)
class Prior:
    """What is believed before the flight: Gaussian, mean (6,) and std (6,)."""

    mean: FloatArray
    std: FloatArray

    def with_wind(self, wind: FloatArray, std: FloatArray) -> Prior:
        """Believe in a wind (2,) m/s."""
        return Prior(np.concatenate([wind, self.mean[2:]]), np.concatenate([std, self.std[2:]]))


def default_prior(rest_offset: float) -> Prior:
    """Weak belief: 10 m/s of wind, a pitot within 15 % and 3 m/s of what it reads at rest, 3 degrees of trim.

    kappa is of the order of 2 m / (rho S): 40 m for a small drone, 2000 m for an airliner.
    """
    offset = rest_offset if np.isfinite(rest_offset) else 0.0
    return Prior(
        np.array([0.0, 0.0, 1.0, offset, 0.0, 0.0]),
        np.array([10.0, 10.0, 0.15, 3.0, 3.0 * DEGREE, 2000.0]),
    )


@dataclass(frozen=True)
class Fit:
    """Estimate of theta.

    Attributes
    ----------
    theta : (6,)
    covariance : (6, 6)
    rms : m/s, one per witness
    independent : number of samples that are worth an independent one, per witness
    """

    theta: FloatArray
    covariance: FloatArray
    rms: tuple[float, ...]
    independent: tuple[float, ...]

    @property
    def std(self) -> FloatArray:
        """Standard errors, (6,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def wind_std(self) -> float:
        """Standard error of the wind along its worst direction [m/s]."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))


def fit(witnesses: Sequence[Witness], prior: Prior) -> Fit:
    """Fit theta to all witnesses together, from the prior's mean; color and estimate in turn.

    Without a witness, the prior itself.
    """
    theta = prior.mean.copy()
    color = [1.0 for _ in witnesses]
    for _ in range(ROUNDS):
        theta = _minimize(witnesses, color, prior, theta)
        left = [w.residual(theta)[0] for w in witnesses]
        color = [samples_per_independent(w.samples, r) for w, r in zip(witnesses, left, strict=True)]
    theta = _minimize(witnesses, color, prior, theta)
    information, _ = _normal_equations(witnesses, color, prior, theta)
    left = [w.residual(theta)[0] for w in witnesses]
    rms = tuple(float(np.sqrt(np.mean(r**2))) for r in left)
    independent = tuple(r.size / c for r, c in zip(left, color, strict=True))
    return Fit(theta, np.asarray(np.linalg.inv(information), dtype=np.float64), rms, independent)


def _minimize(
    witnesses: Sequence[Witness], color: Sequence[float], prior: Prior, theta: FloatArray
) -> FloatArray:
    """Gauss-Newton with Huber weights."""
    for _ in range(ITERATIONS):
        information, pull = _normal_equations(witnesses, color, prior, theta)
        move = np.linalg.solve(information, pull)
        theta = theta + move
        if float(np.max(np.abs(move) / prior.std)) < TIGHT:
            break
    return theta


def _normal_equations(
    witnesses: Sequence[Witness], color: Sequence[float], prior: Prior, theta: FloatArray
) -> tuple[FloatArray, FloatArray]:
    information = np.diag(prior.std**-2.0)
    pull = (prior.mean - theta) / prior.std**2
    for witness, worth in zip(witnesses, color, strict=True):
        residual, slopes = witness.residual(theta)
        weight = _weights(residual) / worth
        information += slopes.T @ (weight[:, None] * slopes)
        pull += slopes.T @ (weight * residual)
    return information, pull


def _weights(residual: FloatArray) -> FloatArray:
    sigma = max(MAD * float(np.median(np.abs(residual))), 1e-4)
    return np.minimum(1.0, HUBER * sigma / np.maximum(np.abs(residual), 1e-12)) / sigma**2


def samples_per_independent(samples: Airborne, residual: FloatArray) -> float:
    """Return the integrated autocorrelation time in samples, across the holes; at least one."""
    place = np.rint((samples.time - samples.time[0]) / samples.step).astype(np.int64)
    spread = MAD * float(np.median(np.abs(residual))) or 1.0
    series, known = np.zeros(place[-1] + 1), np.zeros(place[-1] + 1)
    series[place], known[place] = np.clip(residual / spread, -5.0, 5.0), 1.0
    power = float(series @ series) / place.size
    total = 1.0
    for lag in range(1, min(int(MEMORY / samples.step), series.size - 1) + 1):
        pairs = float(known[lag:] @ known[:-lag])
        if pairs < 0.1 * place.size or power <= 0.0:
            break
        correlation = float(series[lag:] @ series[:-lag]) / pairs / power
        if correlation <= 0.0:
            break
        total += 2.0 * correlation
    return float(min(total, 0.25 * place.size))
