"""Airspeed: the true one of an equivalent one, and the steady wind and pitot calibration of one flight.

A pitot feels the dynamic pressure. The equivalent airspeed is the one of air of 1.225 kg/m3 that has it; the true one is
larger by the root of 1.225 over the density: 5 % in 1000 m, 10 % in 2000 m.

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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.base.atmosphere import SEA_LEVEL_DENSITY, density_at_pressure, density_of_gas, standard_density
from stoop.base.notices import Notice, notice
from stoop.base.robust import huber_weights, robust_std, white_noise
from stoop.base.variables import VARIABLES

EQUIVALENT: Final = "airspeed_equivalent"
TRUE: Final = "airspeed_pitot"
PLAUSIBLE: Final = {
    "density": (0.3, 1.6),
    "pressure": (2.2e4, 1.2e5),
    "temperature": (200.0, 340.0),
    "altitude": (-500.0, 11e3),
    "pd": (-11e3, 500.0),
}  #: SI; what is beyond is a sensor's mistake
WIND_N, WIND_E, SLOPE, OFFSET, TRIM, KAPPA = range(6)


class FitLimits:
    """How the wind is fitted."""

    lag: Final = 30.0  #: s, longest correlation looked for
    rounds: Final = 3  #: of fit and correlation times in turn
    iterations: Final = 50
    tolerance: Final = 1e-9  #: of the prior standard deviations, of a last step
    sigma: Final = 1e-4  #: m/s, least noise
    speed: Final = 1e-3  #: m/s, least airspeed


_METHODS: Final[tuple[tuple[tuple[str, ...], Callable[..., FloatArray], str], ...]] = (
    (("density",), np.asarray, "as logged"),
    (("pressure", "temperature"), density_of_gas, "by pressure and temperature"),
    (("pressure",), density_at_pressure, "by the pressure, in the standard atmosphere"),
    (("altitude",), standard_density, "by the altitude, in the standard atmosphere"),
    (
        ("pd",),
        lambda down: standard_density(-down),
        "by the height above where the position begins, in the standard atmosphere",
    ),
)  #: in order of trust


def density_of(data: Mapping[str, FloatArray]) -> tuple[FloatArray, str] | None:
    """Return the density (n,) of the air by columns (n,), NaN where nothing tells it, and by what; None where nothing does."""
    for names, formula, method in _METHODS:
        if not set(names) <= data.keys():
            continue
        plausible = []
        for name in names:
            (low, high), x = PLAUSIBLE[name], data[name]
            with np.errstate(invalid="ignore"):
                plausible.append(np.where((x >= low) & (x <= high), x, np.nan))
        found = formula(*plausible)
        if np.isfinite(found).any():
            return found, method
    return None


def with_true_airspeed(
    data: Mapping[str, FloatArray], source: str
) -> tuple[dict[str, FloatArray], list[Notice]]:
    """Add the true airspeed to columns (n,) that hold the equivalent one, recorded in `source`; with a notice.

    The density has lines across holes; it is that at sea level where nothing tells.
    """
    count, found = len(data[EQUIVALENT]), density_of(data)
    density, code, values = np.full(count, SEA_LEVEL_DENSITY), "true-airspeed-of-unknown-density", {}
    if found is not None:
        known = np.flatnonzero(np.isfinite(found[0]))
        density, code = np.interp(np.arange(count), known, found[0][known]), "true-airspeed"
        values = {"method": found[1]}
    columns = {**data, TRUE: data[EQUIVALENT] * np.sqrt(SEA_LEVEL_DENSITY / density)}
    median = float(np.median(density))
    factor = float(np.sqrt(SEA_LEVEL_DENSITY / median))
    notices = [notice(code, TRUE, **values, source=source, density=median, factor=factor)]
    return {name: columns[name] for name in VARIABLES if name in columns}, notices


@dataclass(frozen=True)
class Airborne:
    """Samples of the airborne part, thinned to `step`."""

    time: FloatArray  #: (n,) s, on a uniform grid of `step` with holes
    step: float  #: s
    velocity: FloatArray  #: (n, 3) m/s, NED, over ground
    right: FloatArray  #: (n, 3), the body's right-hand axis in NED (second column of R)
    lateral: FloatArray  #: (n,) m/s2, specific force along it
    pitot: FloatArray  #: (n,) m/s, NaN where there is none

    def where(self, good: BoolArray) -> Airborne:
        """Keep the samples at which a mask (n,) holds."""
        parts = (self.velocity, self.right, self.lateral, self.pitot)
        return Airborne(self.time[good], self.step, *(part[good] for part in parts))


def air_relative(velocity: FloatArray, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Subtract the steady wind: (n, 3) m/s NED velocity through the air, (n,) m/s its length."""
    air = velocity - np.array([theta[WIND_N], theta[WIND_E], 0.0])
    return air, np.maximum(np.linalg.norm(air, axis=1), FitLimits.speed)


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
class Fit:
    """Estimate of theta: theta (6,), covariance (6, 6), and rms [m/s], one per block of residuals."""

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


def gust_share(apart: FloatArray, error: float) -> float:
    """Return the share of gusts in the mean square of differences (n,) of calibrated pitot and inertial speed, m/s.

    Gusts are slow. The noise of the pitot is white: its variance is a sixth of that of second differences. Other errors of the
    pitot have a root mean square `error`. The share is the weight of the pitot that makes the mean square error of a
    weighted mean least (Wiener).
    """
    known = apart[np.isfinite(apart)]
    if not known.size:
        return 0.0
    return max(0.0, 1.0 - (white_noise(apart) + error**2) / max(float(np.mean(known**2)), FitLimits.sigma**2))


def fit(evidence: Sequence[Evidence], mean: FloatArray, std: FloatArray) -> Fit:
    """Fit theta to all evidence together: Gauss-Newton steps and correlation times in turn.

    The scale of the residuals is estimated anew at each step, which is why no general least-squares routine serves.

    Parameters
    ----------
    evidence : equations and their samples; none returns the prior
    mean, std : (6,), Gaussian prior of theta, and the start
    """

    def normal_equations(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        information, gradient = np.diag(std**-2.0), (mean - theta) / std**2
        for (equation, samples), time in zip(evidence, times, strict=True):
            residual, slopes = equation(samples, theta)
            sigma = max(robust_std(residual), FitLimits.sigma)
            weight = huber_weights(residual, sigma) / sigma**2 / time
            information += slopes.T @ (weight[:, None] * slopes)
            gradient += slopes.T @ (weight * residual)
        return information, gradient

    theta, times = mean.copy(), [1.0 for _ in evidence]
    for round_ in range(FitLimits.rounds + 1):
        for _ in range(FitLimits.iterations):
            step = np.linalg.solve(*normal_equations(theta))
            theta = theta + step
            if float(np.max(np.abs(step) / std)) < FitLimits.tolerance:
                break
        residuals = [equation(samples, theta)[0] for equation, samples in evidence]
        if round_ < FitLimits.rounds:
            times = [_correlation_time(s, r) for (_, s), r in zip(evidence, residuals, strict=True)]
    information, _ = normal_equations(theta)
    rms = tuple(float(np.sqrt(np.mean(r**2))) for r in residuals)
    return Fit(theta, np.asarray(np.linalg.inv(information), dtype=np.float64), rms)


def _correlation_time(samples: Airborne, residual: FloatArray) -> float:
    """Return the integrated autocorrelation time in samples, across the holes; at least one."""
    place = np.rint((samples.time - samples.time[0]) / samples.step).astype(np.int64)
    spread = robust_std(residual) or 1.0
    series, known = np.zeros(place[-1] + 1), np.zeros(place[-1] + 1)
    series[place], known[place] = np.clip(residual / spread, -5.0, 5.0), 1.0
    power = float(series @ series) / place.size
    total = 1.0
    for lag in range(1, min(int(FitLimits.lag / samples.step), series.size - 1) + 1):
        pairs = float(known[lag:] @ known[:-lag])
        if pairs < 0.1 * place.size or power <= 0.0:
            break
        correlation = float(series[lag:] @ series[:-lag]) / pairs / power
        if correlation <= 0.0:
            break
        total += 2.0 * correlation
    return float(min(total, 0.25 * place.size))
