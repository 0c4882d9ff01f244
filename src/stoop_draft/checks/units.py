"""Sizes of columns as recorded: units, the direction of gravity, angles against their rates, noise of one sensor.

The channels may be on clocks of their own: only statistics of single columns, or of two, are compared with bounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop.extend.variables import FAMILIES, VARIABLES
from stoop_draft.checks.engine import Key, Range, Residuals
from stoop_draft.checks.lines import EAST, EULER, SPECIFIC_FORCE, TWICE, Assignment, Signal, reading

#: rad, rad/s: sizes that no flight exceeds; gyros of drones end at 35 rad/s
LARGEST: Final = {
    "theta": 0.51 * math.pi, "alpha": math.pi, "beta": 0.51 * math.pi, "phi": 2.02 * math.pi, "psi": 2.02 * math.pi,
    "elevator": 0.5 * math.pi, "aileron": 0.5 * math.pi, "rudder": 0.5 * math.pi, "flap": 0.5 * math.pi,
    "p": 40.0, "q": 40.0, "r": 40.0,
}  # fmt: skip
MIN_ANGLE: Final = math.radians(3.0)  #: rad; hardly any flight stays below
#: angle, and nearly its derivative
PAIRS: Final[tuple[tuple[str, str], ...]] = (("phi", "p"), ("theta", "q"), ("psi", "r"), ("alpha", "q"))
#: registry variable -> its median sizes in use, SI
MEDIANS: Final[Mapping[str, tuple[float, float]]] = {
    "az": (2.0, 60.0), "voltage": (2.0, 900.0), "pressure": (1.0e4, 1.2e5), "temperature": (180.0, 340.0),
    "density": (0.2, 1.6), "altitude": (0.0, 2.0e4),
    **dict.fromkeys(("airspeed_pitot", "airspeed_equivalent", "V", "vn", "ve", "vd"), (0.0, 400.0)),
    **{f"rotor_{n}": (0.0, 6.0e3) for n in range(1, 17)},
    **{f"pwm_{n}": (400.0, 3000.0) for n in range(1, 17)},
    **dict.fromkeys(("throttle", "control_throttle"), (0.0, 1.5)),
    **{f"{kind}_{n}": (0.0, 1.5) for kind in ("motor", "servo") for n in range(1, 17)},
}  # fmt: skip
PULSES: Final = (700.0, 2500.0)  #: us; a command whose median lies between is a pulse


@dataclass(frozen=True)
class Statistics:
    """How the statistics of columns are taken, and the odds (logarithm) of one outside of its bounds."""

    quantile: float = 0.995  #: of sizes; some wild samples prove nothing
    samples: int = 20  #: that say anything
    #: s over which an angle is differenced against noise; the shortest that shows a likeness is taken
    spans: tuple[float, ...] = (0.1, 0.5)
    likeness: float = 0.8  #: correlation from which the factor between an angle and a rate means something
    #: of a factor between them that is that of a degree, less a factor of two
    far: float = math.log(math.degrees(0.5))
    noise_band: float = 4.0  #: ratio of the noise of axes of one sensor and one unit
    upright: float = 0.5  #: least share of the specific force along the vertical axis, in the median
    size: float = 30.0  #: odds of a size
    least: float = 5.0  #: odds of a flight without bank or pitch: it hovers
    growth: float = 15.0  #: odds of an angle against its rate
    turns: float = 12.0  #: odds of an angle that turns against its rate
    no_noise: float = 1e-12  #: m/s2; a sensor that scatters less has no noise to compare
    noise: float = 10.0  #: odds of noise of an axis
    z_axis: float = 10.0  #: odds of the share along the vertical axis


STATISTICS: Final = Statistics()


class Sizes:
    """Statistics of columns as recorded, each taken once: the part of the model that needs no common clock."""

    def __init__(self, signals: Mapping[str, Signal]) -> None:
        self.signals = signals
        there = signals.keys()
        self.largest = {n: largest_size(signals[n][1]) for n in (*LARGEST, EAST) if n in there}
        self.median = {n: median_size(signals[n][1]) for n in MEDIANS if n in there}
        self.pairs = [p for p in PAIRS if set(p) <= there]
        large = self.largest.get("psi", 0.0) > LARGEST["psi"]
        through = large and "r" in there and counted(signals["psi"][1])
        self.turns = growth(signals["psi"], signals["r"])[0] if through else 0.0
        force = [name for name in SPECIFIC_FORCE if name in there]
        self.force = force if len({signals[name][1].size for name in force}) == 1 else force[-1:]
        # the median size of second differences: noise of the sensor, whatever the vehicle does
        jumps = {n: np.abs(np.diff(signals[n][1][np.isfinite(signals[n][1])], 2)) for n in force}
        self.scatter: dict[str, float] = {
            n: float(np.median(x)) if x.size >= STATISTICS.samples else 0.0 for n, x in jumps.items()
        }
        level = signals["az"][1][np.isfinite(signals["az"][1])] if "az" in there else np.empty(0)
        self.level = float(np.median(level)) if level.size else 0.0
        self._growth: dict[tuple[str, str], float] = {}

    def __call__(self, state: Assignment, changed: Collection[str] | None) -> Residuals:
        """Return the statistics of edited columns, where some of those that changed take part."""

        def concerned(*names: str) -> bool:
            return changed is None or bool(set(names) & set(changed))

        return {
            key: Range(value, low, high, odds)
            for key, value, low, high, odds in self._statistics(state, concerned)
        }

    def growth(self, state: Assignment, angle: str, rate: str) -> float:
        """Return how many times faster an angle changes than a rate says; zero where they are unlike."""
        (one, f), (other, g) = reading(state, angle), reading(state, rate)
        if (one, other) not in self._growth:
            t, x = self.signals[one]
            self._growth[one, other] = growth((t, without_jumps(angle, x)), self.signals[other])[0]
        return self._growth[one, other] * f / g

    def scales(self, state: Assignment) -> dict[tuple[str, ...], float]:
        """Return the factor of each rate that its angle shows, where it is about that of a degree: converted twice."""
        factors = {rate: self.growth(state, angle, rate) for angle, rate in self.pairs if angle in EULER}
        return {
            (rate,): TWICE[factor > 1.0]
            for rate, factor in factors.items()
            if factor > 0.0 and abs(math.log(factor)) > STATISTICS.far
        }

    def _statistics(
        self, state: Assignment, concerned: Callable[..., bool]
    ) -> Iterator[tuple[Key, float, float, float, float]]:
        """Yield each statistic of variables that are concerned with its bounds, and the odds of one outside."""
        limits = STATISTICS

        def size(name: str, sizes: Mapping[str, float]) -> float:
            column, factor = reading(state, name)
            return sizes[column] * abs(factor)

        for name in (name for name in self.largest if name in LARGEST and concerned(name)):
            # a heading that was counted through several turns turns as the yaw rate says
            turned = self.turns * reading(state, "psi")[1] / reading(state, "r")[1]
            counted = name == "psi" and 0.2 < turned < 5.0
            yield (
                ("size", name),
                0.0 if counted else size(name, self.largest),
                0.0,
                LARGEST[name],
                limits.size,
            )
        for name in (name for name in ("phi", "theta") if name in self.largest and concerned(name)):
            yield ("least", name), size(name, self.largest), MIN_ANGLE, np.inf, limits.least
        for name in filter(concerned, self.median):
            if name != "az" and (median := size(name, self.median)):
                yield ("median", name), median, *MEDIANS[name], limits.size
        force = concerned(*SPECIFIC_FORCE)
        if force and self.median.get("az") and (weight := self.weight(state)) > 0.0:
            level = self.level * reading(state, "az")[1]
            yield ("weight", "az"), weight, *MEDIANS["az"], limits.size
            yield ("up", "az"), level / weight, -np.inf, limits.upright, limits.size
            yield ("z-axis", "az"), abs(level) / weight, limits.upright, np.inf, limits.z_axis
        for angle, rate in (pair for pair in self.pairs if concerned(*pair)):
            factor = self.growth(state, angle, rate)
            factor = factor or np.nan
            apart = abs(math.log(abs(factor)))
            yield ("growth", angle, rate), apart, 0.0, limits.far, limits.growth
            yield ("turns", angle, rate), factor, 0.0, np.inf, limits.turns
        if (
            force
            and len(self.scatter) == len(SPECIFIC_FORCE)
            and min(self.scatter.values()) > limits.no_noise
        ):
            ratio, band = self._odd_axis(state)[1], limits.noise_band
            yield ("noise", "az"), ratio, 1.0 / band, band, limits.noise

    def values(self, key: Key) -> dict[str, float | str]:
        """Return what a notice says of a statistic, as mapped."""
        kind, name = key[:2]
        unit = VARIABLES[name].unit if VARIABLES[name].unit != "1" else ""
        if kind == "growth":
            return {"angle": key[1], "rate": key[2], "factor": abs(self.growth({}, key[1], key[2]))}
        if kind in ("noise", "z-axis"):
            axis, ratio = self._odd_axis({})
            return {"axis": axis, "ratio": ratio}
        sizes = {"size": self.largest, "median": self.median, "weight": {name: self.weight({})}}
        return {"size": sizes.get(kind, {name: self.level})[name], "unit": unit}

    def weight(self, state: Assignment) -> float:
        """Return the median size of the specific force."""
        columns = (reading(state, name) for name in self.force)
        parts = [self.signals[column][1] * factor for column, factor in columns]
        return median_size(np.sqrt(np.sum(np.square(parts), axis=0)))

    def _odd_axis(self, state: Assignment) -> tuple[str, float]:
        """Return the axis of the specific force with the oddest noise, and that over the noise of the two others."""
        sizes = {n: self.scatter[c] * abs(f) for n in SPECIFIC_FORCE for c, f in (reading(state, n),)}
        ratios = {
            name: size / float(np.mean([x for n, x in sizes.items() if n != name]))
            for name, size in sizes.items()
        }
        axis = max(ratios, key=lambda name: abs(math.log(ratios[name])))
        return axis, ratios[axis]


def growth(angle: Signal, rate: Signal) -> tuple[float, float]:
    """Return how many times faster an angle changes than a rate says, with its sign, and their correlation.

    Both are zero where angle and rate, each with times (n,) s and values (n,), have nothing in common.
    """
    limits = STATISTICS
    t, x = (part[np.isfinite(angle[1])] for part in angle)
    s, w = (part[np.isfinite(rate[1])] for part in rate)
    if t.size < limits.samples or s.size < limits.samples:
        return 0.0, 0.0
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * np.diff(s))])
    turned = np.interp(t, s, integral, left=np.nan, right=np.nan)
    period = float(np.median(np.diff(t)))
    for span in limits.spans:
        steps = max(1, round(min(span / period, t.size)))
        a, b = x[steps:] - x[:-steps], turned[steps:] - turned[:-steps]
        good = np.isfinite(b) & (t[steps:] - t[:-steps] < 1.5 * steps * period)  # no hole between
        if good.any():  # a jump of the angle by a whole turn is no change
            good &= np.abs(a) < 20.0 * np.median(np.abs(a[good])) + 1e-12
        a, b = a[good], b[good]
        power = float(a @ a) * float(b @ b)
        if a.size >= limits.samples and power > 0.0:
            correlation = float(a @ b) / math.sqrt(power)
            if abs(correlation) >= limits.likeness:
                return math.copysign(math.sqrt(float(a @ a) / float(b @ b)), correlation), correlation
    return 0.0, 0.0


def without_jumps(name: str, x: FloatArray) -> FloatArray:
    """Return an angle (n,) in radians, or in another unit than it is mapped, that is counted on through whole turns."""
    if name not in FAMILIES["circular"]:
        return x
    out, known = x.copy(), np.isfinite(x)
    out[known] = np.unwrap(x[known], period=full_turn(name, x))
    return out


def full_turn(name: str, x: FloatArray) -> float:
    """Return by how much an angle (n,) jumps after a turn: in radians, still in degrees, or converted twice."""
    if largest_size(x) > LARGEST[name]:
        return 360.0
    small, known = math.radians(2.0 * math.pi), x[np.isfinite(x)]
    steps = np.abs(np.diff(known))
    twice = known.size > 1 and np.ptp(known) < 1.01 * small and float(steps.max()) > 0.9 * small
    return small if twice else 2.0 * np.pi


def counted(psi: FloatArray) -> bool:
    """Tell whether a heading [rad] may be counted through turns: from within one, without a jump."""
    known = psi[np.isfinite(psi)]
    return known.size > 1 and abs(known[0]) < LARGEST["psi"] and float(np.abs(np.diff(known)).max()) < math.pi


def largest_size(x: FloatArray) -> float:
    """Return the size that a column hardly exceeds."""
    known = np.abs(x[np.isfinite(x)])
    return float(np.quantile(known, STATISTICS.quantile)) if known.size else 0.0


def median_size(x: FloatArray) -> float:
    """Return the median size; zeros do not count, and zero where there are too few others."""
    known = np.abs(x[np.isfinite(x) & (x != 0.0)])
    return float(np.median(known)) if known.size >= STATISTICS.samples else 0.0
