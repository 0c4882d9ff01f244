"""Steady wind and pitot calibration of one flight, by robust least squares with honest standard errors.

Two independent kinds of evidence on the wind, each a block of residuals of the same six parameters
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

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.robust import huber_weights, robust_std
from stoop.flight.instrument_errors import prior_std

WIND_N, WIND_E, SLOPE, OFFSET, TRIM, KAPPA = range(6)
MAX_LAG: Final = 30.0  #: s, longest correlation looked for
WHITENING_ROUNDS: Final = 3
MAX_ITERATIONS: Final = 50
STEP_TOLERANCE: Final = 1e-9  #: of the prior standard deviations
MIN_SIGMA: Final = 1e-4  #: m/s
MIN_SPEED: Final = 1e-3  #: m/s
KAPPA_PRIOR: Final = 2000.0  #: m; 2 m / (rho S) is 40 m for a small drone, 2000 m for an airliner


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

    def with_pitot(self) -> Airborne:
        """Keep only the samples that hold a reading of the pitot."""
        good = np.isfinite(self.pitot)
        parts = (self.velocity, self.right, self.lateral, self.pitot)
        velocity, right, lateral, pitot = (part[good] for part in parts)
        return Airborne(self.time[good], self.step, velocity, right, lateral, pitot)


def air_relative(velocity: FloatArray, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Subtract the steady wind: (n, 3) m/s NED velocity through the air, (n,) m/s its length."""
    air = velocity - np.array([theta[WIND_N], theta[WIND_E], 0.0])
    return air, np.maximum(np.linalg.norm(air, axis=1), MIN_SPEED)


Equation = Callable[[Airborne, FloatArray], tuple[FloatArray, FloatArray]]
"""Samples and theta (6,) -> measured minus model (n,) [m/s], and the derivative of the model (n, 6)."""

Evidence = tuple[Equation, Airborne]


def pitot_equation(samples: Airborne, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return pitot - (k |v - w| + c): the pitot reads an affine function of the true airspeed."""
    air, speed = air_relative(samples.velocity, theta)
    slopes = np.zeros((speed.size, 6))
    slopes[:, :2] = -theta[SLOPE] * air[:, :2] / speed[:, None]
    slopes[:, SLOPE], slopes[:, OFFSET] = speed, 1.0
    return samples.pitot - (theta[SLOPE] * speed + theta[OFFSET]), slopes


def sideslip_equation(samples: Airborne, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return lateral airspeed - (beta_0 V + kappa a_y / V); V is held in the derivative."""
    air, speed = air_relative(samples.velocity, theta)
    slopes = np.zeros((speed.size, 6))
    slopes[:, :2] = samples.right[:, :2]
    slopes[:, TRIM], slopes[:, KAPPA] = speed, samples.lateral / speed
    lateral = np.sum(samples.right * air, axis=1)
    return lateral - slopes[:, TRIM:] @ theta[TRIM:], slopes


@dataclass(frozen=True)
class Prior:
    """Gaussian prior of theta: mean (6,) and std (6,)."""

    mean: FloatArray
    std: FloatArray

    def with_wind(self, wind: FloatArray, std: FloatArray) -> Prior:
        """Return the prior with another wind (2,) m/s."""
        return Prior(np.concatenate([wind, self.mean[2:]]), np.concatenate([std, self.std[2:]]))


def default_prior(rest_offset: float) -> Prior:
    """Return the priors of the instrument errors, the offset of the pitot about what it reads at rest."""
    offset = rest_offset if np.isfinite(rest_offset) else 0.0
    names = ("wind.n", "wind.e", "airspeed_pitot.scale", "airspeed_pitot.bias", "beta.bias")
    return Prior(np.array([0.0, 0.0, 1.0, offset, 0.0, 0.0]), np.array([*map(prior_std, names), KAPPA_PRIOR]))


@dataclass(frozen=True)
class Fit:
    """Estimate of theta.

    Attributes
    ----------
    theta : (6,)
    covariance : (6, 6)
    rms : m/s, one per block of residuals
    """

    theta: FloatArray
    covariance: FloatArray
    rms: tuple[float, ...]

    @property
    def std(self) -> FloatArray:
        """Standard errors, (6,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def wind_std(self) -> float:
        """Standard error of the wind along its worst direction [m/s]."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))


def fit(evidence: Sequence[Evidence], prior: Prior) -> Fit:
    """Fit theta to all evidence together, from the prior's mean: Gauss-Newton and correlation times in turn.

    Without evidence, the prior itself.
    """
    theta, times = prior.mean.copy(), [1.0 for _ in evidence]
    for round_ in range(WHITENING_ROUNDS + 1):
        for _ in range(MAX_ITERATIONS):
            information, gradient = _normal_equations(evidence, times, prior, theta)
            step = np.linalg.solve(information, gradient)
            theta = theta + step
            if float(np.max(np.abs(step) / prior.std)) < STEP_TOLERANCE:
                break
        residuals = [equation(samples, theta)[0] for equation, samples in evidence]
        if round_ < WHITENING_ROUNDS:
            times = [correlation_time(s, r) for (_, s), r in zip(evidence, residuals, strict=True)]
    information, _ = _normal_equations(evidence, times, prior, theta)
    rms = tuple(float(np.sqrt(np.mean(r**2))) for r in residuals)
    return Fit(theta, np.asarray(np.linalg.inv(information), dtype=np.float64), rms)


def _normal_equations(
    evidence: Sequence[Evidence], times: Sequence[float], prior: Prior, theta: FloatArray
) -> tuple[FloatArray, FloatArray]:
    information = np.diag(prior.std**-2.0)
    gradient = (prior.mean - theta) / prior.std**2
    for (equation, samples), time in zip(evidence, times, strict=True):
        residual, slopes = equation(samples, theta)
        sigma = max(robust_std(residual), MIN_SIGMA)
        weight = huber_weights(residual, sigma) / sigma**2 / time
        information += slopes.T @ (weight[:, None] * slopes)
        gradient += slopes.T @ (weight * residual)
    return information, gradient


def correlation_time(samples: Airborne, residual: FloatArray) -> float:
    """Return the integrated autocorrelation time in samples, across the holes; at least one."""
    place = np.rint((samples.time - samples.time[0]) / samples.step).astype(np.int64)
    spread = robust_std(residual) or 1.0
    series, known = np.zeros(place[-1] + 1), np.zeros(place[-1] + 1)
    series[place], known[place] = np.clip(residual / spread, -5.0, 5.0), 1.0
    power = float(series @ series) / place.size
    total = 1.0
    for lag in range(1, min(int(MAX_LAG / samples.step), series.size - 1) + 1):
        pairs = float(known[lag:] @ known[:-lag])
        if pairs < 0.1 * place.size or power <= 0.0:
            break
        correlation = float(series[lag:] @ series[:-lag]) / pairs / power
        if correlation <= 0.0:
            break
        total += 2.0 * correlation
    return float(min(total, 0.25 * place.size))
