"""Propagated quantities: a number, or a curve over the airspeed, with its distribution over the draws."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.extend.arrays import BoolArray, ComplexArray, FloatArray
from stoop.extend.motion import oscillates, tracked_modes

PERCENTILES: Final = (2.5, 25.0, 50.0, 75.0, 97.5)
MIN_SHARE: Final = 0.1  #: of the variance; what a parameter adds less is not named
MOST_NAMED: Final = 3  #: parameters that most of the variance comes from
ON_PRIOR: Final = 0.5  #: share of the variance, from which a figure rests on priors
ROUNDING: Final = 1e-9  #: relative; a smaller spread is none
MIN_DRAWS: Final = 20  #: from which quantiles are taken


@dataclass(frozen=True, eq=False)
class Samples:
    """One quantity: at the estimate, and of every draw; NaN where it does not exist."""

    name: str
    unit: str
    estimate: float
    draws: FloatArray  #: (D,)

    @classmethod
    def of(cls, name: str, unit: str, values: FloatArray) -> Samples:
        """Return a quantity from its values (1 + D,), that of the estimate first."""
        return cls(name, unit, float(values[0]), np.asarray(values[1:]))


@dataclass(frozen=True)
class Figure:
    """One quantity with its uncertainty, in its unit."""

    group: str
    name: str
    unit: str
    estimate: float
    std_error: float
    ci95_lower: float
    ci95_upper: float
    median: float
    failed: float  #: share of the draws for which the quantity does not exist
    #: parameters and the share of the variance that would vanish if each were known, to first order, the largest first
    sources: tuple[tuple[str, float], ...] = ()
    #: of the variance that vanishes when all parameters that rest on priors or bounds are held at their estimates
    prior_share: float = 0.0

    @property
    def rests_on_prior(self) -> bool:
        """Whether most of the uncertainty is that of priors and bounds."""
        return self.prior_share >= ON_PRIOR


@dataclass(frozen=True, eq=False)
class Curve:
    """One quantity over the airspeed (n,)."""

    name: str
    unit: str
    airspeed: FloatArray  #: (n,), m/s
    estimate: FloatArray  #: (n,)
    bands: FloatArray  #: (5, n), :data:`PERCENTILES` of the draws
    failed: FloatArray  #: (n,), share of the draws for which it does not exist


def figure(
    group: str, one: Samples, names: Sequence[str], draws: FloatArray, prior_share: float = 0.0
) -> Figure:
    """Return a quantity with its uncertainty; `draws` (D, k) are those of the parameters named."""
    good = np.isfinite(one.draws)
    failed = 1.0 - float(np.mean(good))
    if good.sum() < MIN_DRAWS:
        nothing = (math.nan,) * 4
        return Figure(group, one.name, one.unit, one.estimate, *nothing, failed)
    values = one.draws[good]
    low, middle, high = np.percentile(values, [PERCENTILES[0], 50.0, PERCENTILES[-1]]).tolist()
    if np.ptp(values) <= ROUNDING * abs(middle):  # of numbers that were not estimated
        return Figure(group, one.name, one.unit, one.estimate, 0.0, low, high, middle, failed)
    shares = variance_shares(draws[good], values)
    strongest = sorted(zip(names, shares, strict=True), key=lambda pair: -pair[1])[:MOST_NAMED]
    sources = tuple((n, float(s)) for n, s in strongest if s >= MIN_SHARE)
    return Figure(
        group, one.name, one.unit, one.estimate, float(np.std(values, ddof=1)), low, high, middle, failed, sources,
        prior_share,
    )  # fmt: skip


def variance_shares(draws: FloatArray, values: FloatArray) -> FloatArray:
    """Return the share (k,) of the variance of values (D,) that would vanish if one parameter of draws (D, k) were known.

    To first order: the squared correlation. Shares of correlated parameters do not add up to one.
    """
    centered, y = draws - draws.mean(axis=0), values - values.mean()
    scale, size = centered.std(axis=0), float(y.std())
    if not size > 0.0:
        return np.zeros(draws.shape[1])
    correlation = centered.T @ y / (len(y) * size * np.where(scale > 0.0, scale, 1.0))
    return np.asarray(correlation**2)


def conditional_draws(draws: FloatArray, known: BoolArray, at: FloatArray) -> FloatArray:
    """Return draws (D, k) of the parameters given the values `at` (k,) of those that are `known` (k,).

    The others move by their linear regression on the known ones, which is exact for a normal distribution.
    """
    off = draws[:, known] - at[known]
    centered = off - off.mean(axis=0)
    scale = centered.std(axis=0)
    safe = np.where(scale > 0.0, scale, 1.0)
    others = draws[:, ~known]
    slope = np.linalg.lstsq(centered / safe, others - others.mean(axis=0), rcond=None)[0]
    out = np.repeat(at[None, :], len(draws), axis=0)
    out[:, ~known] = others - (off / safe) @ slope
    return out


def variance_removed(values: FloatArray, given: FloatArray, known: int) -> float:
    """Return the share of the variance of values (D,) that vanishes when `known` parameters are known.

    `given` (D,) are the values of :func:`conditional_draws`, whose regression takes a degree of freedom for each known parameter.
    The share is one where the quantity does not exist without the spread of these parameters.
    """
    both = np.isfinite(values) & np.isfinite(given)
    count = int(both.sum())
    if count < MIN_DRAWS:
        return 1.0
    total = float(np.var(values[both]))
    left = float(np.var(given[both])) * count / max(count - known, 1)
    return min(max(1.0 - left / total, 0.0), 1.0) if total > 0.0 else 0.0


def curve(name: str, unit: str, airspeed: FloatArray, values: FloatArray) -> Curve:
    """Return a curve over airspeeds (n,) with its bands from values (n, 1 + D), those of the estimate first."""
    estimate, draws = values[:, 0], values[:, 1:].T
    good = np.isfinite(draws)
    bands = np.full((len(PERCENTILES), draws.shape[1]), np.nan)
    for i in np.flatnonzero(good.sum(axis=0) >= MIN_DRAWS):
        bands[:, i] = np.percentile(draws[good[:, i], i], PERCENTILES)
    return Curve(name, unit, airspeed, estimate, bands, 1.0 - good.mean(axis=0))


def mode_samples(A: FloatArray, names: tuple[str, ...]) -> tuple[list[Samples], dict[str, float]]:
    """Return frequency and damping of oscillations, and time constants of the others, and shares of another character.

    `A` (1 + D, n, n) are those of the estimate and of the draws. A draw whose pair has become two real modes has the frequency
    and damping of their product; one whose real mode has joined another is counted.
    """
    out, other = list[Samples](), dict[str, float]()
    for mode, drawn in tracked_modes(A, names):
        pair = drawn.shape[1] == 2
        changed = oscillates(drawn[:, 0]) != pair
        share = float(np.mean(changed[np.isfinite(drawn).all(axis=1)]))
        if share > 0.0:
            other[mode.name] = share
        out += _samples(mode.name, drawn, pair)
    return out, other


def _samples(name: str, drawn: ComplexArray, pair: bool) -> list[Samples]:
    middle = drawn.mean(axis=1).real
    with np.errstate(divide="ignore", invalid="ignore"):
        if pair:
            frequency = np.sqrt(np.maximum(np.prod(drawn, axis=1).real, 0.0))
            damping = -middle / frequency
            found = {f"{name}, frequency": (frequency, "rad/s"), f"{name}, damping": (damping, "1")}
        else:  # its inverse passes through infinity where the mode becomes unstable
            found = {f"{name}, eigenvalue": (middle, "1/s")}
            if (middle[np.isfinite(middle)] < 0.0).all():
                found[f"{name}, time constant"] = (-1.0 / middle, "s")
    return [Samples.of(n, unit, v) for n, (v, unit) in found.items()]
