"""A flight near hover held against those of the healthy vehicle: whose command rose, by more than it usually varies.

At rest, lift carries the weight and the moments balance whatever the rotors are worth. What the commands of a flight
would give beyond those of the healthy flights is therefore what the rotors fail to give, or what the vehicle weighs more:

    d = w - w_healthy = loss_k c_k           rotor k gives (1 - loss_k) of the commanded load c_k
    d = m g (1, moments at rotor k, 0)       mass m near rotor k: the same but for the yaw
    d ~ N(0, S)                              nothing of the kind

d are lift and three moments, in units of weight, weight times arm, and torque of all rotors. S is the scatter between
flights of one and the same vehicle: air density acts on the lift, the place of the battery on roll and pitch. Few healthy
flights tell little of it, so each of its four variances is that of the healthy flights and of `USUAL` together (scaled
inverse chi-square with `FIRMNESS` degrees of freedom); d is then compared by Student's t. What the correction for the
battery's voltage left wrong of the lift is a slope, told by flights of one configuration at several voltages
(`stoop.estimate.effectiveness.battery`); its error is in S.

References
----------
Gelman and others, Bayesian Data Analysis, 3rd ed., section 2.6 (normal model with unknown variance).
Crassidis and Junkins, Optimal Estimation of Dynamic Systems, 2nd ed., section 2.3 (weighted least squares).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy import stats

from stoop.base.arrays import FloatArray
from stoop.errors import FlightError, VehicleError
from stoop.estimate.effectiveness.balance import Balance
from stoop.estimate.effectiveness.battery import Battery, battery
from stoop.estimate.effectiveness.hover import Hover

USUAL: Final = (0.02, 0.01, 0.01, 0.01)  #: standard deviations between flights, in units of d
FIRMNESS: Final = 6.0  #: flights' worth of belief in them


@dataclass(frozen=True)
class Reference:
    """Flights of the healthy vehicle.

    Attributes
    ----------
    balance : Balance
    hovers : tuple of Hover
        At least one.
    others : tuple of tuples of Hover
        Healthy flights of further vehicles of the type: they tell the scatter, not the level.
    repeats : tuple of tuples of Hover
        Flights of one configuration each, whatever it is: they tell what the voltage does to the lift.
    """

    balance: Balance
    hovers: tuple[Hover, ...]
    others: tuple[tuple[Hover, ...], ...] = ()
    repeats: tuple[tuple[Hover, ...], ...] = ()

    def __post_init__(self) -> None:
        """Refuse to compare with nothing."""
        if not self.hovers:
            raise FlightError(
                "there is no healthy flight to compare with; give one or more, as --healthy LOG"
            )
        if not np.all(self.units > 0.0):
            raise VehicleError(
                f"{self.balance.vehicle.where}: the healthy flights' commands give no lift, no torque, or have no lever; "
                "check T, Q or torque_ratio, and the rotors' positions"
            )

    @cached_property
    def units(self) -> FloatArray:
        """Weight, N, weight times arm (twice), N m, and torque of all rotors, N m, as commanded in the healthy flights."""
        weight = float(np.mean([self.balance.of_thrust[0] @ h.thrust for h in self.hovers]))
        torque = float(np.mean([np.abs(self.balance.of_torque[3]) @ h.torque for h in self.hovers]))
        return np.array([weight, weight * self.balance.arm, weight * self.balance.arm, torque])

    @cached_property
    def battery(self) -> Battery:
        """What a lower voltage does to the commanded lift."""
        groups = (self.hovers, *self.others, *self.repeats)
        lifts = [np.array([self.balance.of_thrust[0] @ h.thrust for h in group]) for group in groups]
        return battery(lifts, [np.array([h.voltage for h in group]) for group in groups])

    @cached_property
    def voltage(self) -> float:
        """Mean of the healthy flights, V."""
        return float(np.mean([h.voltage for h in self.hovers]))

    @cached_property
    def level(self) -> FloatArray:
        """Mean of the healthy flights, (4,), in `units`."""
        return np.asarray(np.mean([self.sums(h) for h in self.hovers], axis=0))

    @cached_property
    def degrees(self) -> float:
        """Degrees of freedom of the variances."""
        return FIRMNESS + sum(len(group) - 1 for group in (self.hovers, *self.others))

    @cached_property
    def variances(self) -> FloatArray:
        """Between flights, (4,), in `units` squared."""
        groups = [np.array([self.sums(h) for h in group]) for group in (self.hovers, *self.others)]
        squares = sum(((g - g.mean(axis=0)) ** 2).sum(axis=0) for g in groups)
        return np.asarray((FIRMNESS * np.square(USUAL) + squares) / self.degrees)

    def columns(self, hover: Hover) -> FloatArray:
        """Return what each rotor is commanded to give, (4, n), in `units`."""
        return self.balance.loads(hover.thrust, hover.torque) / self.units[:, None]

    def sums(self, hover: Hover) -> FloatArray:
        """Return the sum over all rotors, (4,), as it would be at the healthy flights' voltage."""
        sums = self.columns(hover).sum(axis=1)
        sums[0] -= self.battery.slope * self._apart(hover)
        return np.asarray(sums)

    def covariance(self, hover: Hover) -> FloatArray:
        """Return that of the difference between one more healthy flight and the mean of these, (4, 4)."""
        return self.between(hover, len(self.hovers)) + self.within(hover)

    def between(self, hover: Hover, count: int) -> FloatArray:
        """Return what flights differ by, (4, 4), were there so many healthy ones."""
        variances = self.variances * (1.0 + 1.0 / count)
        variances[0] += (self.battery.std * self._apart(hover)) ** 2
        return np.diag(variances)

    def within(self, hover: Hover) -> FloatArray:
        """Return what the scatter within the flights adds, (4, 4)."""
        scatter = hover.covariance + sum(h.covariance for h in self.hovers) / len(self.hovers) ** 2
        return np.asarray(scatter / np.outer(self.units, self.units))

    def _apart(self, hover: Hover) -> float:
        """Return how far its voltage is from that of the healthy flights, relative; nothing where it is unknown."""
        apart = hover.voltage / self.voltage - 1.0
        return apart if np.isfinite(apart) else 0.0


@dataclass(frozen=True)
class Suspect:
    """One explanation: a single size that is fitted to lift and moments.

    Attributes
    ----------
    rotor : str
    size, std : float
        Share of thrust and torque that the rotor loses; or mass near it, as a share of the vehicle's.
    left : float
        What it leaves unexplained: squares of three independent standard deviations.
    """

    rotor: str
    size: float
    std: float
    left: float

    @property
    def sigmas(self) -> float:
        """Size in standard errors."""
        return self.size / self.std


@dataclass(frozen=True)
class Assessment:
    """What a flight says of the rotors.

    Attributes
    ----------
    name : str
    weak, mass : tuple of Suspect
        For each rotor in turn.
    distance : float
        From the healthy flights: squares of four independent standard deviations.
    degrees : float
        Of freedom, of the variances.
    voltage : float
        V
    """

    name: str
    weak: tuple[Suspect, ...]
    mass: tuple[Suspect, ...]
    distance: float
    degrees: float
    voltage: float

    @property
    def suspected(self) -> Suspect:
        """The rotor whose loss explains most; losses only, no rotor gains."""
        return max(self.weak, key=lambda s: s.sigmas)

    @property
    def chance(self) -> float:
        """How often a healthy flight makes any rotor this suspect: one-sided Student's t, times the number of rotors."""
        one = float(stats.t.sf(self.suspected.sigmas, self.degrees))
        return min(1.0, len(self.weak) * one)

    def mass_near(self, rotor: str) -> Suspect:
        """Return the explanation by a mass."""
        return next(s for s in self.mass if s.rotor == rotor)


def assess(hover: Hover, reference: Reference) -> Assessment:
    """Hold a flight against the healthy ones."""
    scale = reference.units
    d = reference.sums(hover) - reference.level
    whiten = np.linalg.inv(np.linalg.cholesky(reference.covariance(hover)))
    pull = reference.balance.of_thrust * np.array([1.0, 1.0, 1.0, 0.0])[:, None]
    columns, masses = reference.columns(hover), pull * scale[0] / scale[:, None]
    rotors = reference.balance.rotors
    return Assessment(
        hover.name,
        tuple(_explain(name, whiten @ c, whiten @ d) for name, c in zip(rotors, columns.T, strict=True)),
        tuple(_explain(name, whiten @ c, whiten @ d) for name, c in zip(rotors, masses.T, strict=True)),
        float(np.sum((whiten @ d) ** 2)),
        reference.degrees,
        hover.voltage,
    )


def leave_one_out(reference: Reference) -> tuple[Assessment, ...]:
    """Hold each healthy flight against the others; nothing where it is the only one."""
    hovers = reference.hovers
    if len(hovers) < 2:
        return ()
    return tuple(assess(h, replace(reference, hovers=tuple(o for o in hovers if o is not h))) for h in hovers)


def _explain(rotor: str, column: FloatArray, d: FloatArray) -> Suspect:
    """Return the least-squares size of one column in d, both whitened."""
    squares = float(column @ column)
    if squares <= 0.0:  # a rotor that was never commanded can lose nothing
        return Suspect(rotor, 0.0, float("inf"), float(d @ d))
    size = float(column @ d) / squares
    return Suspect(rotor, size, squares**-0.5, float(np.sum((d - size * column) ** 2)))
