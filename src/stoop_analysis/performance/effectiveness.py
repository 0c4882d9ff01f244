"""Loss of effectiveness of rotors, from the commands of a flight near hover and of flights of the healthy vehicle.

At rest the equations of `stoop.vehicle.symbolic.forces` reduce to thrust T(x) along the axis and torque Q(x) about it; lift
equals the weight and the moments balance, whatever the state of the rotors. The excess of the commanded loads over those of the
healthy flights is therefore the loss of the rotors, or added weight:

    d = w - w_healthy = loss_k c_k           rotor k gives (1 - loss_k) of the commanded load c_k
    d = m g (1, moments at rotor k, 0)       mass m near rotor k: the same but for the yaw
    d ~ N(0, S)                              no change

d are lift and three moments, in units of weight, weight times arm, and torque of all rotors. S is the scatter between
flights of one and the same vehicle: air density acts on the lift, the position of the battery on roll and pitch. A few healthy
flights determine it poorly, so `USUAL` is the prior of its four variances (scaled inverse chi-square with `LIMITS.prior_flights`
degrees of freedom), and the test of d is Student's t. The lift still depends on the battery's voltage after the correction of
the commands; the slope follows from flights of one configuration at several voltages (`battery`), and S contains its error.

References
----------
Gelman and others, Bayesian Data Analysis, 3rd ed., section 2.6 (normal model with unknown variance).
Crassidis and Junkins, Optimal Estimation of Dynamic Systems, 2nd ed., section 2.3 (weighted least squares).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy import stats

from stoop import Flight, Notice, Vehicle
from stoop.extend.arrays import BoolArray, FloatArray, run_slices
from stoop.extend.errors import FlightError, VehicleError
from stoop.extend.notices import notice


@dataclass(frozen=True)
class HoverLimits:
    """Thresholds and priors of the comparison of hover flights."""

    airborne: float = 0.6  #: of the median thrust while any is commanded
    settle: float = 2.0  #: s after take-off and before landing that are left out
    min_duration: float = 4.0  #: s near hover
    block: float = 1.0  #: s; commands correlate for a few tenths of a second
    max_speed: float = 3.0  #: m/s; above, drag and inflow are not small
    prior_flights: float = 6.0  #: degrees of freedom of the prior `USUAL`
    #: prior of the voltage slope; without a correction thrust goes with voltage squared
    slope_std: float = 0.3
    lift_std: float = 0.01  #: relative scatter of the lift between flights, counted as `lift_flights` flights
    lift_flights: float = 3.0
    #: difference of squares that separates two explanations (1 % of chi-square, one degree)
    distinct: float = 6.63
    odd_chance: float = 0.01  #: below which the unexplained part counts
    power: float = 0.8  #: how often a loss of the stated least size is detected
    #: number of healthy flights after which further ones hardly lower the least detectable loss
    many: int = 8
    helps: float = 0.9  #: of the least detectable loss, below which an advice is worth following


LIMITS: Final = HoverLimits()

USUAL: Final = (0.02, 0.01, 0.01, 0.01)  #: standard deviations between flights, in units of d
CHANCE: Final = 0.05  #: of attributing a loss to any rotor of a healthy flight


@dataclass(frozen=True)
class Balance:
    """The rotors of a vehicle as they act on it at hover; they are the columns of its arrays."""

    vehicle: Vehicle

    def __post_init__(self) -> None:
        """Refuse a vehicle without the torque of rotors."""
        if not {"rotors.torque_ratio", "rotors.Q2"} & self.vehicle.rows.keys():
            raise VehicleError(
                f"{self.vehicle.where}: has no rotors with a torque, so the balance of yaw is unknown; write [rotors] "
                "torque_ratio = 0.01 (m), or what was measured, and a table for each rotor"
            )

    @property
    def needs_voltage(self) -> bool:
        """Whether commands are corrected with the measured voltage."""
        return "rotors.nominal_voltage" in self.vehicle.rows

    @cached_property
    def of_thrust(self) -> FloatArray:
        """Shape (4, n): lift and moments (roll, pitch, yaw; m) of a thrust of 1 N of each rotor."""
        center = self._point("mass.center_of_gravity")
        arms = np.array([self._point(f"rotor.{name}.position") - center for name in self.vehicle.rotors])
        return np.vstack([-self._axes.T[2], np.cross(arms, self._axes).T])

    @cached_property
    def of_torque(self) -> FloatArray:
        """Shape (4, n): lift and moments (roll, pitch, yaw; N m) of a torque of 1 N m of each rotor."""
        turns = [1.0 if self.vehicle.file.rotor[n].spin == "ccw" else -1.0 for n in self.vehicle.rotors]
        return np.vstack([np.zeros(len(turns)), -np.array(turns) * self._axes.T])

    @cached_property
    def arm(self) -> float:
        """Mean horizontal distance of the rotors from the center of gravity, m."""
        return float(np.mean(np.hypot(self.of_thrust[1], self.of_thrust[2])))

    def drive(self, commands: Mapping[str, FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return the commanded thrust of each rotor along its axis, N, and torque about it, N m, (n, k) each.

        Commands are those recorded, channel -> (k,), with ``voltage``, V, where the vehicle needs it.
        """
        number = self._number
        recorded = np.array([commands[rotor.channel] for rotor in self.vehicle.file.rotor.values()])
        x = number("rotors.gain", 1.0) * np.maximum(recorded - number("rotors.idle"), 0.0)
        if self.needs_voltage:
            x = x * commands["voltage"] / number("rotors.nominal_voltage")
        factor, torque_factor = (
            np.array([number(f"rotor.{name}.{last}", 1.0) for name in self.vehicle.rotors])[:, None]
            for last in ("factor", "torque_factor")
        )
        thrust, torque = (np.polyval([number(f"rotors.{c}{i}") for i in (2, 1, 0)], x) for c in "TQ")
        if "rotors.torque_ratio" in self.vehicle.rows:
            torque = number("rotors.torque_ratio") * thrust
        return factor * thrust, factor * torque_factor * torque

    def loads(self, thrust: FloatArray, torque: FloatArray) -> FloatArray:
        """Return lift, N, and moments, N m, (4, n) of the thrust (n,) and torque (n,) of each rotor."""
        return np.asarray(self.of_thrust * thrust + self.of_torque * torque)

    @property
    def _axes(self) -> FloatArray:
        """Shape (n, 3): unit vector of each rotor's thrust, body axes."""
        axes = [self._point(f"rotor.{name}.axis", (0.0, 0.0, -1.0)) for name in self.vehicle.rotors]
        return np.array([a / np.linalg.norm(a) for a in axes])

    def _number(self, name: str, default: float = 0.0) -> float:
        return self.vehicle.value(name) if name in self.vehicle.rows else default

    def _point(self, name: str, default: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> FloatArray:
        return np.array([self._number(f"{name}.{a}", d) for a, d in zip("xyz", default, strict=True)])


@dataclass(frozen=True)
class Hover:
    """Commanded thrust and torque of each of n rotors while the vehicle hovered."""

    name: str  #: of the flight
    thrust: FloatArray  #: mean (n,), N
    torque: FloatArray  #: mean (n,), N m
    #: (4, 4), of lift, N, and the moments, N m, of all rotors together: scatter of blocks within the flight
    covariance: FloatArray
    voltage: float  #: mean, V; NaN where it was not recorded
    duration: float  #: s


def hover_commands(flight: Flight, balance: Balance) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return commanded thrust, N, and torque, N m, of each rotor (n, k) at the samples near hover, and which those are.

    A FlightError says that a command is missing, the flight too short or too fast.
    """
    recorded = set(flight.names)
    needed = [rotor.channel for rotor in balance.vehicle.file.rotor.values()]
    needed += ["voltage"] if balance.needs_voltage else []
    if missing := [name for name in needed if name not in recorded]:
        raise FlightError(
            f"{flight.name}: {', '.join(missing)} not recorded; log the commands of all rotors, or name them in a mapping"
        )
    commands = {name: flight.column(name) for name in needed}
    if empty := [name for name in needed if not np.isfinite(commands[name]).any()]:
        raise FlightError(
            f"{flight.name}: {', '.join(empty)} holds no number throughout; look at the column that the mapping names for it"
        )
    thrust, torque = balance.drive(commands)
    total = thrust.sum(axis=0)
    turning = np.isfinite(total) & (total > 0.0)
    if not turning.any():
        raise FlightError(
            f"{flight.name}: the motors are off throughout; choose a log of a flight, and check the commands' unit"
        )
    cut, inside = round(LIMITS.settle * flight.rate), np.zeros(total.size, dtype=bool)
    for stretch in run_slices(turning & (total > LIMITS.airborne * np.median(total[turning]))):
        inside[stretch.start + cut : max(stretch.stop - cut, 0)] = True
    seconds = float(inside.sum()) / flight.rate
    if seconds < LIMITS.min_duration:
        raise FlightError(
            f"{flight.name}: {seconds:.1f} s near hover, take-offs and landings aside; "
            f"{LIMITS.min_duration:g} s are needed at least"
        )
    if {"vn", "ve"} <= recorded:
        speed = np.hypot(flight.column("vn")[inside], flight.column("ve")[inside])
        if np.isfinite(speed).any() and np.nanmedian(speed) > LIMITS.max_speed:
            raise FlightError(
                f"{flight.name}: half of it is faster than {np.nanmedian(speed):.1f} m/s; choose a flight near hover, "
                f"below {LIMITS.max_speed:g} m/s"
            )
    return thrust[:, inside], torque[:, inside], inside


def block_means(values: FloatArray, rate: float, block: float = LIMITS.block) -> FloatArray:
    """Return the means of blocks (n, m), s, of values (n, k) of a rate, Hz: they scatter as the mean does."""
    size = max(round(block * rate), 1)
    count = values.shape[1] // size
    return np.asarray(values[:, : count * size].reshape(len(values), count, size).mean(axis=2))


def hover(flight: Flight, balance: Balance) -> Hover:
    """Return the mean commands of a flight near hover; for errors see `hover_commands`.

    Between start and end of a stretch near hover the velocity hardly changes, so mean forces and moments are those of rest,
    whatever the motion in between.
    """
    thrust, torque, inside = hover_commands(flight, balance)
    voltage = float(np.mean(flight.column("voltage")[inside])) if "voltage" in flight.names else np.nan
    blocks = block_means(balance.of_thrust @ thrust + balance.of_torque @ torque, flight.rate)
    means, covariance = (
        (thrust.mean(axis=1), torque.mean(axis=1)),
        np.asarray(np.cov(blocks) / blocks.shape[1]),
    )
    return Hover(flight.name, *means, covariance, voltage, thrust.shape[1] / flight.rate)


def pooled(flights: Sequence[Hover]) -> Hover:
    """Return the mean of flights of one configuration as one flight."""
    count = len(flights)
    return Hover(
        f"{count} flights",
        np.mean([h.thrust for h in flights], axis=0),
        np.mean([h.torque for h in flights], axis=0),
        np.sum([h.covariance for h in flights], axis=0) / count**2,
        float(np.mean([h.voltage for h in flights])),
        sum(h.duration for h in flights),
    )


@dataclass(frozen=True)
class Battery:
    """Relative change of the commanded lift per relative change of the voltage, and its standard error."""

    slope: float = 0.0
    std: float = LIMITS.slope_std


def battery(lifts: Sequence[FloatArray], voltages: Sequence[FloatArray]) -> Battery:
    """Return the slope of groups of flights, shrunk towards zero by its prior.

    Lifts (k,) of each group are in any unit, voltages (k,) in V; a group with an unknown one is ignored.
    """
    known = [(y, x) for y, x in zip(lifts, voltages, strict=True) if x.size > 1 and np.isfinite(x).all()]
    if not known:
        return Battery()
    y, x = (np.concatenate([v / v.mean() - 1.0 for v in column]) for column in zip(*known, strict=True))
    plain = float(x @ y) / max(float(x @ x), 1e-12)
    flights = LIMITS.lift_flights + max(y.size - len(known) - 1, 0)
    noise = (LIMITS.lift_flights * LIMITS.lift_std**2 + float(np.sum((y - plain * x) ** 2))) / flights
    information = float(x @ x) / noise + LIMITS.slope_std**-2
    return Battery(float(x @ y) / noise / information, information**-0.5)


@dataclass(frozen=True)
class Reference:
    """Flights of the healthy vehicle, at least one."""

    balance: Balance
    flights: tuple[Hover, ...]
    #: healthy flights of further vehicles of the type: for the scatter, not the level
    others: tuple[tuple[Hover, ...], ...] = ()
    #: flights of one configuration each, whatever it is: for the effect of the voltage on the lift
    repeats: tuple[tuple[Hover, ...], ...] = ()

    def __post_init__(self) -> None:
        """Refuse a reference without flights or loads."""
        if not self.flights:
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
        weight = float(np.mean([self._lift(h) for h in self.flights]))
        torque = float(np.mean([np.abs(self.balance.of_torque[3]) @ h.torque for h in self.flights]))
        return np.array([weight, weight * self.balance.arm, weight * self.balance.arm, torque])

    @cached_property
    def battery(self) -> Battery:
        """Effect of the voltage on the commanded lift."""
        groups = (self.flights, *self.others, *self.repeats)
        lifts = [np.array([self._lift(h) for h in group]) for group in groups]
        return battery(lifts, [np.array([h.voltage for h in group]) for group in groups])

    @cached_property
    def voltage(self) -> float:
        """Mean of the healthy flights, V."""
        return float(np.mean([h.voltage for h in self.flights]))

    @cached_property
    def level(self) -> FloatArray:
        """Mean of the healthy flights, (4,), in `units`."""
        return np.asarray(np.mean([self.sums(h) for h in self.flights], axis=0))

    @cached_property
    def degrees(self) -> float:
        """Degrees of freedom of the variances."""
        return LIMITS.prior_flights + sum(len(group) - 1 for group in (self.flights, *self.others))

    @cached_property
    def variances(self) -> FloatArray:
        """Between flights, (4,), in `units` squared."""
        groups = [np.array([self.sums(h) for h in group]) for group in (self.flights, *self.others)]
        squares = sum(((g - g.mean(axis=0)) ** 2).sum(axis=0) for g in groups)
        return np.asarray((LIMITS.prior_flights * np.square(USUAL) + squares) / self.degrees)

    def columns(self, hover: Hover) -> FloatArray:
        """Return the commanded loads of each rotor, (4, n), in `units`."""
        return self.balance.loads(hover.thrust, hover.torque) / self.units[:, None]

    def sums(self, hover: Hover) -> FloatArray:
        """Return the sum over all rotors, (4,), as it would be at the healthy flights' voltage."""
        sums = self.columns(hover).sum(axis=1)
        sums[0] -= self.battery.slope * self._voltage_change(hover)
        return np.asarray(sums)

    def covariance(self, hover: Hover) -> FloatArray:
        """Return the covariance (4, 4) of the difference between another healthy flight and the mean of these."""
        return self.between(hover, len(self.flights)) + self.within(hover)

    def between(self, hover: Hover, count: int) -> FloatArray:
        """Return the covariance (4, 4) between flights for a number `count` of healthy ones."""
        variances = self.variances * (1.0 + 1.0 / count)
        variances[0] += (self.battery.std * self._voltage_change(hover)) ** 2
        return np.diag(variances)

    def within(self, hover: Hover) -> FloatArray:
        """Return the covariance (4, 4) due to the scatter within flights."""
        scatter = hover.covariance + sum(h.covariance for h in self.flights) / len(self.flights) ** 2
        return np.asarray(scatter / np.outer(self.units, self.units))

    def _lift(self, hover: Hover) -> float:
        """Return the commanded lift, N."""
        return float(self.balance.of_thrust[0] @ hover.thrust)

    def _voltage_change(self, hover: Hover) -> float:
        """Return the relative difference of its voltage from the healthy flights'; zero where it is unknown."""
        change = hover.voltage / self.voltage - 1.0
        return change if np.isfinite(change) else 0.0


@dataclass(frozen=True)
class Explanation:
    """A weak rotor, or a mass near it: one size, fitted to lift and moments."""

    rotor: str
    size: float  #: share of thrust and torque that the rotor loses; or mass near it, as a share of the vehicle's
    std: float
    unexplained: float  #: sum of squares of three independent standard deviations

    @property
    def sigmas(self) -> float:
        """Size in standard errors."""
        return self.size / self.std


@dataclass(frozen=True)
class Assessment:
    """The rotors of a flight, compared with the healthy flights."""

    name: str
    weak: tuple[Explanation, ...]  #: for each rotor in turn
    mass: tuple[Explanation, ...]  #: for each rotor in turn
    distance: float  #: from the healthy flights: squares of four independent standard deviations
    degrees: float  #: of freedom, of the variances
    voltage: float  #: V

    @property
    def suspected(self) -> Explanation:
        """The rotor whose loss explains most; losses only, no rotor gains."""
        return max(self.weak, key=lambda s: s.sigmas)

    @property
    def chance(self) -> float:
        """False-alarm probability: one-sided Student's t, times the number of rotors."""
        return min(1.0, len(self.weak) * float(stats.t.sf(self.suspected.sigmas, self.degrees)))

    def mass_near(self, rotor: str) -> Explanation:
        """Return the explanation by a mass."""
        return next(s for s in self.mass if s.rotor == rotor)


def assess(hover: Hover, reference: Reference) -> Assessment:
    """Compare a flight with the healthy ones: the least-squares size of each rotor's loss, and of a mass near it."""
    units, rotors = reference.units, reference.balance.vehicle.rotors
    try:
        whiten = np.linalg.inv(np.linalg.cholesky(reference.covariance(hover)))
    except np.linalg.LinAlgError:
        raise FlightError(
            f"{hover.name}: commands or thrust of this flight, or of the healthy ones, are implausibly large; check unit and "
            "scale of the motor channels in the mapping"
        ) from None
    d = whiten @ (reference.sums(hover) - reference.level)

    def explained(columns: FloatArray) -> tuple[Explanation, ...]:
        out = []
        for rotor, column in zip(rotors, [whiten @ c for c in columns.T], strict=True):
            squares = float(column @ column)
            if squares > 0.0:
                size = float(column @ d) / squares
                out.append(Explanation(rotor, size, squares**-0.5, float(np.sum((d - size * column) ** 2))))
            else:  # a rotor that was never commanded cannot lose thrust
                out.append(Explanation(rotor, 0.0, float("inf"), float(d @ d)))
        return tuple(out)

    masses = reference.balance.of_thrust * np.array([[1.0], [1.0], [1.0], [0.0]]) * units[0] / units[:, None]
    weak, mass = explained(reference.columns(hover)), explained(masses)
    return Assessment(hover.name, weak, mass, float(np.sum(d**2)), reference.degrees, hover.voltage)


def leave_one_out(reference: Reference) -> tuple[Assessment, ...]:
    """Compare each healthy flight with the others; nothing where it is the only one."""
    flights = reference.flights if len(reference.flights) > 1 else ()
    others = (replace(reference, flights=tuple(o for o in flights if o is not h)) for h in flights)
    return tuple(map(assess, flights, others))


@dataclass(frozen=True)
class Verdict:
    """The decision on one flight."""

    #: "healthy", "weak or mass", "mass", "several" (rotors that cannot be distinguished), "odd" (no single rotor explains it)
    kind: str
    rotors: tuple[str, ...]  #: rotors with a loss or a mass nearby
    chance: float  #: probability of so large a deviation in a healthy flight
    notice: Notice


def judge(assessment: Assessment, chance: float = CHANCE) -> Verdict:
    """Decide on a flight with a false-alarm probability of at most `chance`."""
    probability = assessment.chance
    if probability > chance:
        if stats.f.sf(assessment.distance / 4, 4, assessment.degrees) < LIMITS.odd_chance:  # Fisher's F
            return Verdict("odd", (), probability, notice("rotors-odd"))
        smallest = least_detectable(assessment, chance)
        return Verdict("healthy", (), probability, notice("rotors-healthy", loss=smallest))
    best, named = assessment.suspected, indistinct(assessment)
    if len(named) > 1:
        return Verdict("several", named, probability, notice("rotors-indistinct", " or ".join(named)))
    mass = assessment.mass_near(best.rotor)
    if best.unexplained - mass.unexplained > LIMITS.distinct:
        return Verdict("mass", (best.rotor,), probability, notice("rotor-mass", best.rotor, share=mass.size))
    return Verdict("weak or mass", (best.rotor,), probability, notice("rotor-weak-or-mass", best.rotor))


def indistinct(assessment: Assessment) -> tuple[str, ...]:
    """Return the rotor whose loss explains most, and after it those that explain it nearly as well; none where none loses."""
    best = assessment.suspected
    if not best.size > 0.0:
        return ()
    limit = best.unexplained + LIMITS.distinct
    rivals = [s for s in assessment.weak if s is not best and s.size > 0.0 and s.unexplained < limit]
    return best.rotor, *(s.rotor for s in sorted(rivals, key=lambda s: s.unexplained))


def least_detectable(assessment: Assessment, chance: float = CHANCE) -> float:
    """Return the loss of thrust of the best-observed rotor that is detected four times in five."""
    best = min(s.std for s in assessment.weak)
    return _detectable_sigmas(assessment.degrees, len(assessment.weak), chance) * best


def _detectable_sigmas(degrees: float, rotors: int, chance: float) -> float:
    """Return the loss, in standard errors, that is detected four times in five."""
    t = stats.t(degrees)
    return float(t.isf(chance / rotors) + t.isf(1.0 - LIMITS.power))


def advice(
    reference: Reference, flights: Sequence[Hover], verdicts: Sequence[Verdict], chance: float
) -> tuple[Notice, ...]:
    """Return measures that would lower the least detectable loss of the flight where it is largest, each alone.

    It grows with the scatter between flights, with the scatter within each, and with the uncertainty of the former.
    """

    def detectable(hover: Hover, covariance: FloatArray, more: int = 0) -> float:
        """Return the loss of the best-observed rotor that is detected, with so many more healthy flights."""
        columns = reference.columns(hover)
        squares = np.einsum("ik,ij,jk->k", columns, np.linalg.inv(covariance), columns)
        sigmas = _detectable_sigmas(reference.degrees + more, columns.shape[1], chance)
        most = float(squares.max())
        return sigmas / math.sqrt(most) if most > 0.0 else math.inf

    now, worst = max(((detectable(h, reference.covariance(h)), h) for h in flights), key=lambda pair: pair[0])
    count, out = len(reference.flights), []
    then = detectable(worst, reference.between(worst, count))
    if then < LIMITS.helps * now:
        out.append(notice("rotors-calmer-hover", now=now, then=then))
    if count < LIMITS.many:
        covariance = reference.between(worst, LIMITS.many) + reference.within(worst)
        then = detectable(worst, covariance, LIMITS.many - count)
        if count == 1 or then < LIMITS.helps * now:
            code = "rotors-second-healthy" if count == 1 else "rotors-more-healthy"
            out.append(notice(code, now=now, then=then, count=LIMITS.many))
    named = tuple(dict.fromkeys(name for v in verdicts if v.kind != "mass" for name in v.rotors))
    return (*out, *([notice("rotors-swap-propellers", rotors=named, count=len(named))] if named else []))
