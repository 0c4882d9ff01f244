"""The drag polar CD = CD0 + K (CL - CL0)^2 of a performance flight, with intervals that respect color.

Where only the electric power is known, the useful power follows from momentum theory (Rankine, Froude): an
actuator disc of diameter d that receives eta P gives

    eta P = 2 rho A (V + v)^2 v,  A = pi d^2 / 4,  T V = eta P V / (V + v)

with the induced speed v. eta (motor, controller, blades) and d are unknowns with priors; where power varies at
one lift coefficient the flight itself tells them, and their error is in every interval. So is that of the
airspeed, as an unknown factor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from stoop.assess.covariance import NORMAL_95, prior_information
from stoop.assess.error_bars import estimate_uncertainty
from stoop.base.arrays import FloatArray
from stoop.base.robust import huber_weights, robust_std
from stoop.problem.evidence import PieceEvidence
from stoop.reconstruct.performance import Blocks

SHAPE: Final = ("c0", "c1", "c2")  #: CD = c0 + c1 CL + c2 CL^2
MAX_ITERATIONS: Final = 30
STEP: Final = 1e-6
DISC: Final = 0.35  #: of the root of the wing area: usual diameter of all propellers' discs together ...
DISC_SPREAD: Final = float(np.log(1.6))  #: ... within this factor
MEASURED_DISC: Final = 0.02  #: relative, of a diameter that was measured
BINS: Final = 8


@dataclass(frozen=True)
class Propulsion:
    """What is assumed of the propulsion.

    Attributes
    ----------
    efficiency, efficiency_std : float
        Of motor, controller and blades together, without the induced loss: electric power to power in the disc.
    diameter : float or None
        Of the propeller's disc, m; of several discs that of one with their whole area. None when unknown.
    """

    efficiency: float = 0.70
    efficiency_std: float = 0.10
    diameter: float | None = None


@dataclass(frozen=True, eq=False)
class Bin:
    """Medians over blocks of similar lift coefficient: CL, CD, half the spread that covers 68 % of CD, count."""

    CL: float
    CD: float
    spread: float
    count: int


@dataclass(frozen=True, eq=False)
class Polar:
    """A fitted polar.

    Attributes
    ----------
    blocks : Blocks
    area, mass : float, m2, kg
    names : tuple of str
    values : (k,)
        c0, c1, c2 [1], airspeed factor [1] and, with power, efficiency [1] and logarithm of the diameter [m].
    covariance : (k, k)
        Corrected for the color of the residuals, priors in it.
    prior_std : (k,)
        NaN where there is none.
    CL, CD : (n,)
        Of the blocks, at the estimates of airspeed and propulsion.
    weights : (n,)
        Of the robust fit, 0 to 1.
    """

    blocks: Blocks
    area: float
    mass: float
    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    prior_std: FloatArray
    CL: FloatArray
    CD: FloatArray
    weights: FloatArray

    @property
    def std(self) -> FloatArray:
        """Standard errors (k,)."""
        return np.sqrt(np.diag(self.covariance))

    def drag(self, CL: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return CD and its standard error at lift coefficients (n,)."""
        rows = np.zeros((len(CL), len(self.values)))
        rows[:, :3] = np.column_stack([np.ones_like(CL), CL, CL**2])
        return rows @ self.values, np.sqrt(np.einsum("ni,ij,nj->n", rows, self.covariance, rows))

    @cached_property
    def summary(self) -> Mapping[str, tuple[float, float]]:
        """Return CD0, K, CL0, best glide and the propulsion: (value, standard error); NaN where K is not positive."""
        derived = {name: self._derived(function) for name, function in _DERIVED.items()}
        own = {
            name: (float(np.exp(v)), float(np.exp(v) * s)) if name == "diameter" else (float(v), float(s))
            for name, v, s in zip(self.names, self.values, self.std, strict=True)
            if name not in SHAPE
        }
        return {**derived, **own}

    def level_power(self, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the electric power of steady level flight and its standard error, W, at airspeeds (n,) m/s."""
        value = self._level(self.values, speed)
        rows = np.array(
            [(self._level(self._stepped(i), speed) - value) / STEP for i in range(len(self.values))]
        )
        return value, np.sqrt(np.einsum("in,ij,jn->n", rows, self.covariance, rows))

    def bins(self) -> list[Bin]:
        """Return medians in bins of as many blocks each."""
        parts = np.array_split(np.argsort(self.CL, kind="stable"), min(BINS, max(1, len(self.CL) // 4)))
        return [_bin(self.CL[part], self.CD[part]) for part in parts]

    @cached_property
    def valid(self) -> tuple[float, float]:
        """Return the lift coefficients between which 90 % of the blocks lie."""
        low, high = np.quantile(self.CL, [0.05, 0.95])
        return float(low), float(high)

    def interval(self, CL: float) -> tuple[float, float]:
        """Return the 95 % interval of CD at one lift coefficient."""
        value, std = self.drag(np.array([CL]))
        return float(value[0] - NORMAL_95 * std[0]), float(value[0] + NORMAL_95 * std[0])

    def _derived(self, function: Callable[[FloatArray], float]) -> tuple[float, float]:
        value = float(function(self.values))
        slope = np.array(
            [(float(function(self._stepped(i))) - value) / STEP for i in range(len(self.values))]
        )
        return value, float(np.sqrt(slope @ self.covariance @ slope))

    def _stepped(self, i: int) -> FloatArray:
        out = self.values.copy()
        out[i] += STEP
        return out

    def _level(self, values: FloatArray, speed: FloatArray) -> FloatArray:
        """Return the electric power at which useful power and drag balance."""
        named = dict(zip(self.names, values, strict=True))
        rho = float(np.median(self.blocks.density))
        pressure_area = 0.5 * rho * speed**2 * self.area
        CL = float(np.median(self.blocks.lift)) / pressure_area
        drag = pressure_area * (named["c0"] + named["c1"] * CL + named["c2"] * CL**2)
        disc = 0.25 * np.pi * np.exp(2.0 * named["diameter"])
        induced = 0.5 * (np.sqrt(speed**2 + 2.0 * drag / (rho * disc)) - speed)
        return np.asarray(drag * (speed + induced) / named["efficiency"])


def _parabola(values: FloatArray) -> tuple[float, float, float]:
    c0, c1, c2 = values[:3]
    return (c0 - c1**2 / (4.0 * c2), c2, -c1 / (2.0 * c2)) if c2 > 0.0 else (np.nan, np.nan, np.nan)


def _best_glide(values: FloatArray) -> float:
    """Return the greatest CL / CD, at CL = sqrt(c0 / c2)."""
    c0, c1, c2 = (float(v) for v in values[:3])
    least = c1 + 2.0 * np.sqrt(c0 * c2) if c0 > 0.0 and c2 > 0.0 else -1.0
    return 1.0 / least if least > 0.0 else np.nan


_DERIVED: Final[dict[str, Callable[[FloatArray], float]]] = {
    "CD0": lambda values: _parabola(values)[0],
    "K": lambda values: _parabola(values)[1],
    "CL0": lambda values: _parabola(values)[2],
    "best glide": _best_glide,
}


def _bin(CL: FloatArray, CD: FloatArray) -> Bin:
    middle = float(np.median(CD))
    return Bin(float(np.median(CL)), middle, robust_std(CD - middle), len(CL))


def useful_power(
    power: FloatArray, speed: FloatArray, density: FloatArray, efficiency: float, area: float
) -> FloatArray:
    """Return the thrust power T V (n,) W of an actuator disc, momentum theory.

    Parameters
    ----------
    power : (n,) W, electric
    speed : (n,) m/s
    density : (n,) kg/m3
    efficiency : float
    area : float, m2, of the disc
    """
    received = np.maximum(efficiency * power, 0.0)
    induced = np.cbrt(
        received / (2.0 * density * area)
    )  # of a disc at rest: never too small, so Newton comes down
    for _ in range(MAX_ITERATIONS):
        excess = 2.0 * density * area * (speed + induced) ** 2 * induced - received
        slope = 2.0 * density * area * (speed + induced) * (speed + 3.0 * induced)
        induced = induced - excess / slope
    return np.asarray(received * speed / (speed + induced))


@dataclass(frozen=True, eq=False)
class _Balance:
    """Residuals of the energy balance as forces, N, of a vector of unknowns."""

    blocks: Blocks
    area: float
    names: tuple[str, ...]

    def coefficients(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return CL, CD and dynamic pressure times area (n,)."""
        b, named = self.blocks, dict(zip(self.names, values, strict=True))
        speed = b.speed * named["airspeed"]
        pressure_area = 0.5 * b.density * speed**2 * self.area
        useful = np.zeros_like(speed)
        if b.powered:
            disc = 0.25 * np.pi * float(np.exp(2.0 * named["diameter"]))
            useful = useful_power(b.power, speed, b.density, float(named["efficiency"]), disc)
        drag = (useful - b.kinetic * named["airspeed"] ** 2 - b.potential) / speed
        return b.lift / pressure_area, drag / pressure_area, pressure_area

    def residual(self, values: FloatArray) -> FloatArray:
        """Return drag by the energy balance minus drag by the polar (n,), N."""
        CL, CD, pressure_area = self.coefficients(values)
        c0, c1, c2 = values[:3]
        return np.asarray((CD - (c0 + c1 * CL + c2 * CL**2)) * pressure_area)

    def jacobian(self, values: FloatArray) -> FloatArray:
        """Return the derivative (n, k) by central differences."""
        steps = STEP * np.eye(len(values))
        return np.column_stack(
            [(self.residual(values + h) - self.residual(values - h)) / (2.0 * STEP) for h in steps]
        )


def fit_polar(
    cut: Blocks, mass: float, area: float, airspeed_std: float, propulsion: Propulsion = Propulsion()
) -> Polar:
    """Fit the polar to blocks, robust against gusts.

    Parameters
    ----------
    cut : Blocks
    mass, area : float, kg, m2
    airspeed_std : float
        Relative standard error of the airspeed, common to all blocks.
    propulsion : Propulsion
    """
    names, mean, std = _priors(cut.powered, area, airspeed_std, propulsion)
    balance = _Balance(cut, area, names)
    values, weights, sigma = mean.copy(), np.ones(len(cut.time)), 1.0
    for _ in range(MAX_ITERATIONS):
        before = values
        values = _solved(balance, values, np.sqrt(weights) / sigma, mean, std)
        left = balance.residual(values)
        sigma = robust_std(left) or 1.0
        weights = huber_weights(left, sigma)
        if float(np.max(np.abs(values - before))) < 1e-8:
            break
    covariance = _covariance(balance, values, np.sqrt(weights) / sigma, std)
    CL, CD, _ = balance.coefficients(values)
    return Polar(cut, area, mass, names, values, covariance, std, CL, CD, weights)


def _solved(
    balance: _Balance, start: FloatArray, root: FloatArray, mean: FloatArray, std: FloatArray
) -> FloatArray:
    """Return the weighted least-squares estimate with priors."""
    known = np.isfinite(std)
    spread = np.where(known, std, 1.0)

    def weighted(values: FloatArray) -> FloatArray:
        return np.concatenate([root * balance.residual(values), ((values - mean) / spread)[known]])

    return np.asarray(least_squares(weighted, start, x_scale=np.where(known, std, 0.05)).x)


def _priors(
    powered: bool, area: float, airspeed_std: float, propulsion: Propulsion
) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    free = np.nan
    rows = [("c0", 0.04, free), ("c1", 0.0, free), ("c2", 0.05, free), ("airspeed", 1.0, airspeed_std)]
    if powered:
        measured = propulsion.diameter is not None
        diameter = propulsion.diameter or DISC * np.sqrt(area)
        rows.append(("efficiency", propulsion.efficiency, propulsion.efficiency_std))
        rows.append(("diameter", float(np.log(diameter)), MEASURED_DISC if measured else DISC_SPREAD))
    names, mean, std = zip(*rows, strict=True)
    return names, np.array(mean), np.array(std)


def _covariance(balance: _Balance, values: FloatArray, root: FloatArray, std: FloatArray) -> FloatArray:
    """Return the covariance, corrected for color, stretch by stretch."""
    left, slopes = balance.residual(values), -balance.jacobian(values)
    parts = [np.flatnonzero(balance.blocks.stretch == s) for s in np.unique(balance.blocks.stretch)]
    segments = [
        PieceEvidence((root * left)[part][:, None], (root[:, None] * slopes)[part][:, None, :])
        for part in parts
        if part.size > 1
    ]
    return estimate_uncertainty(segments, prior_information(std)).corrected
