"""Units and the direction of gravity by what columns read: sizes, angles against their rates, noise of one sensor.

The channels may be on clocks of their own. Only statistics of columns are compared, and a unit is a factor, so that an
edit costs nothing: the state of the search is the factor by which each mapped column is still to be multiplied.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.rotations import quaternions_of, to_ground
from stoop.base.units import DEGREE, FACTORS, PULSE_FACTORS, ZERO_CELSIUS
from stoop.base.variables import EULER, RATES, SPECIFIC_FORCE, VARIABLES, VELOCITY
from stoop.checks.engine import (
    Edit,
    Evidence,
    Key,
    Lines,
    Range,
    Residual,
    Residuals,
    Thresholds,
    search,
    where,
)

Signal: TypeAlias = tuple[FloatArray, FloatArray]  #: time (n,) s and values (n,)
Factors: TypeAlias = Mapping[str, float]  #: variable -> by what its mapped column is multiplied

#: rad, rad/s: sizes that no flight exceeds; gyros of drones end at 35 rad/s
LARGEST: Final = {
    "theta": 0.51 * math.pi, "alpha": math.pi, "beta": 0.51 * math.pi, "phi": 2.02 * math.pi, "psi": 2.02 * math.pi,
    "elevator": 0.5 * math.pi, "aileron": 0.5 * math.pi, "rudder": 0.5 * math.pi, "flap": 0.5 * math.pi,
    "p": 40.0, "q": 40.0, "r": 40.0,
}  # fmt: skip
#: angle, and nearly its derivative
PAIRS: Final[tuple[tuple[str, str], ...]] = (("phi", "p"), ("theta", "q"), ("psi", "r"), ("alpha", "q"))


@dataclass(frozen=True)
class Sizes:
    """Median sizes of a variable in use, SI, and other units that logs use, the most usual first."""

    low: float
    high: float
    units: tuple[str, ...] = ()


MEDIANS: Final = {
    "az": Sizes(2.0, 60.0, ("g", "mg", "cm/s2", "mm/s2")),
    "voltage": Sizes(2.0, 900.0, ("mV",)),
    "pressure": Sizes(1.0e4, 1.2e5, ("hPa", "kPa")),
    "temperature": Sizes(180.0, 340.0, ("degC",)),
    "density": Sizes(0.2, 1.6),
    **dict.fromkeys(
        ("airspeed_pitot", "airspeed_equivalent", "V", "vn", "ve", "vd"), Sizes(0.0, 400.0, ("cm/s", "mm/s"))
    ),
    "altitude": Sizes(0.0, 2.0e4, ("cm", "mm")),
    **{f"rotor_{n}": Sizes(0.0, 6.0e3, ("rpm",)) for n in range(1, 17)},
    **{f"pwm_{n}": Sizes(400.0, 3000.0, ("s", "ms")) for n in range(1, 17)},
    **dict.fromkeys(
        (
            "throttle",
            "control_throttle",
            *(f"{kind}_{n}" for kind in ("motor", "servo") for n in range(1, 17)),
        ),
        Sizes(0.0, 1.5, ("percent",)),
    ),
}  #: registry variable -> its median sizes
PULSES: Final = (700.0, 2500.0)  #: us; a command whose median lies between is a pulse


@dataclass(frozen=True)
class Statistics:
    """How the statistics of columns are taken, and the odds (logarithm) of one outside of its bounds or of an edit."""

    quantile: float = 0.995  #: of sizes; some wild samples prove nothing
    samples: int = 20  #: that say anything
    #: s over which an angle is differenced against noise; the shortest that shows a likeness is taken
    spans: tuple[float, ...] = (0.1, 0.5)
    likeness: float = 0.8  #: correlation from which the factor between an angle and a rate means something
    #: of a factor between them that is that of a degree, less a factor of two
    far: float = math.log(0.5 / DEGREE)
    noise_band: float = 4.0  #: ratio of the noise of axes of one sensor and one unit
    gravity_span: float = 0.5  #: s over which velocity is differenced
    gravity_samples: int = 50_000  #: that are compared, at most: the thinned record
    upright: float = 0.5  #: least share of the specific force along the vertical axis, in the median
    size: float = 30.0  #: odds of a size
    growth: float = 15.0  #: odds of an angle against its rate
    noise: float = 10.0  #: odds of noise of an axis
    z_axis: float = 10.0  #: odds of the share along the vertical axis
    #: odds of an edit that gives a line the unit of its siblings, which are of one sensor
    odd_unit: float = 3.0
    several: float = -3.0  #: odds of an edit of all angles or rates at once
    one_axis: float = -10.0  #: odds of an edit of one axis of the specific force alone
    less_usual: float = -3.0  #: odds of each next unit in a list by usage


STATISTICS: Final = Statistics()
UNITS: Final = Thresholds(rounds=32)  #: any number of lines may have a wrong unit
#: statistic -> code of the notice
_CODES: Final = {
    "size": "angle-size", "median": "unit-size", "weight": "force-size", "z-axis": "force-axis-unit",
    "noise": "force-axis-unit", "growth": "angle-rate-factor", "gravity": "angle-rate-factor", "up": "force-points-up",
}  # fmt: skip
_UNEXPLAINED: Final = {
    "size": "size-unexplained", "median": "size-unexplained", "weight": "size-unexplained",
    "growth": "angle-rate-unexplained",
}  # fmt: skip


def check_units(
    signals: Mapping[str, Signal], lines: Lines
) -> tuple[list[Notice], list[Notice], dict[str, float]]:
    """Return what contradicts the units of a mapping.

    Parameters
    ----------
    signals : variable -> its samples, SI as mapped
    lines : what the user's mapping says of each variable

    Returns
    -------
    refusals : degrees where radians belong
    notices : other units, the sign of the vertical force, and sizes that no unit explains
    factors : variable -> by what its column is to be multiplied
    """
    model = UnitModel(signals)
    as_mapped: Factors = {}
    found, factors = search(as_mapped, lambda _: unit_edits(signals, lines), model, UNITS)
    notices = []
    for one in found:
        key = one.edits[0].channel
        code = "command-in-pulses" if one.best.kind == "pulses" else _CODES[key[0]]
        notices.append(notice(code, one.best.lines[0], **model.values(key), **one.values(lines)))
    explained = {name for one in found for names in one.lines for name in names}
    for key, evidence in model(factors, None).items():
        wrong = isinstance(evidence, Range) and evidence.violated and not explained & set(key[1:])
        if wrong and key[0] in _UNEXPLAINED:
            place = where(key[1:], lines)
            notices.append(notice(_UNEXPLAINED[key[0]], key[1], **model.values(key), line=place))
    notices.sort(key=lambda one: list(VARIABLES).index(one.subject))
    refused = [one for one in notices if one.subject in LARGEST]
    return refused, [one for one in notices if one not in refused], dict(factors)


class UnitModel:
    """Statistics of columns as `search` needs them, each taken once; with `signs` those that show a sign, too."""

    def __init__(self, signals: Mapping[str, Signal], signs: bool = False) -> None:
        self.signals, self.signs = signals, signs
        there = signals.keys()
        self.largest = {n: largest_size(signals[n][1]) for n in LARGEST if n in there}
        self.median = {n: median_size(signals[n][1]) for n in MEDIANS if n in there}
        # where a heading is too large, its jumps cannot be told from turns
        counted = self.largest.get("psi", 0.0) > LARGEST["psi"]
        pairs = [pair for pair in PAIRS if set(pair) <= there and not (counted and pair[0] == "psi")]
        self.growth = {(a, b): growth(signals[a], signals[b])[0] for a, b in pairs}
        self.turns = growth(signals["psi"], signals["r"])[0] if counted and "r" in there else 0.0
        force = [name for name in SPECIFIC_FORCE if name in there]
        self.force = force if len({signals[name][1].size for name in force}) == 1 else force[-1:]
        # the median size of second differences: noise of the sensor, whatever the vehicle does
        jumps = {n: np.abs(np.diff(signals[n][1][np.isfinite(signals[n][1])], 2)) for n in force}
        self.scatter: dict[str, float] = {
            n: float(np.median(x)) if x.size >= STATISTICS.samples else 0.0 for n, x in jumps.items()
        }
        risen = [name for name in ("pd", "vd") if signs and {name, "altitude"} <= there]
        self.rises = {name: _rise(name, signals) for name in risen}
        level = signals["az"][1][np.isfinite(signals["az"][1])] if "az" in there else np.empty(0)
        self.level = float(np.median(level)) if level.size else 0.0
        # pairs that differ by a degree, of which gravity may show the right one
        need = {*EULER, *SPECIFIC_FORCE, *VELOCITY}
        enough = need <= there and all(signals[name][1].size >= 100 for name in need)
        ratios = {pair: abs(x) for pair, x in self.growth.items() if x and pair[0] in EULER and enough}
        self.ambiguous = [pair for pair, x in ratios.items() if abs(math.log(x)) > STATISTICS.far]

    def __call__(self, factors: Factors, changed: Collection[str] | None) -> Residuals:
        """Return the statistics of columns multiplied by factors, where some of those that changed take part."""
        out: dict[Key, Evidence] = {}
        for key, value, low, high, odds in self._statistics(lambda name: factors.get(name, 1.0), factors):
            concerned = SPECIFIC_FORCE if key[0] in ("weight", "noise", "z-axis", "up") else key[1:]
            if changed is None or set(concerned) & set(changed):
                out[key] = Range(value, low, high, odds)
        if (changed is None or set(EULER) & set(changed)) and self.ambiguous:
            out.update(self._gravity(factors))
        return out

    def _statistics(
        self, f: Callable[[str], float], factors: Factors
    ) -> Iterator[tuple[Key, float, float, float, float]]:
        """Yield each statistic with its bounds, and the odds of one outside."""
        limits = STATISTICS
        for name, size in self.largest.items():
            # a heading that was counted through several turns turns as the yaw rate says
            counted = name == "psi" and self.turns != 0.0 and 0.2 < self.turns * f("psi") / f("r") < 5.0
            yield ("size", name), 0.0 if counted else size * abs(f(name)), 0.0, LARGEST[name], limits.size
        for name, size in self.median.items():
            if size and name != "az":
                known = MEDIANS[name]
                yield ("median", name), size * abs(f(name)), known.low, known.high, limits.size
        if self.median.get("az") and (weight := self.weight(factors)) > 0.0:
            known, level = MEDIANS["az"], self.level * f("az")
            yield ("weight", "az"), weight, known.low, known.high, limits.size
            yield ("up", "az"), level / weight, -np.inf, limits.upright, limits.size
            yield ("z-axis", "az"), abs(level) / weight, limits.upright, np.inf, limits.z_axis
        for (angle, rate), factor in self.growth.items():
            if factor:
                apart = abs(math.log(abs(factor * f(angle) / f(rate))))
                yield ("growth", angle, rate), apart, 0.0, limits.far, limits.growth
                if self.signs:
                    yield ("turns", angle, rate), factor * f(angle) * f(rate), 0.0, np.inf, limits.size
        for name, rise in self.rises.items():
            yield ("rises", name), rise * f(name), -np.inf, 0.0, limits.size
        if len(self.scatter) == len(SPECIFIC_FORCE) and min(self.scatter.values()) > 0.0:
            ratio, band = self._odd_axis(factors)[1], limits.noise_band
            yield ("noise", "az"), ratio, 1.0 / band, band, limits.noise

    def values(self, key: Key) -> dict[str, float | str]:
        """Return what a notice says of a statistic, as mapped."""
        kind, name = key[:2]
        unit = VARIABLES[name].unit if VARIABLES[name].unit != "1" else ""
        if kind in ("growth", "gravity"):
            angle, rate = key[1:] if kind == "growth" else self.ambiguous[0]
            return {"angle": angle, "rate": rate, "factor": abs(self.growth[angle, rate])}
        if kind in ("noise", "z-axis"):
            axis, ratio = self._odd_axis({})
            return {"axis": axis, "ratio": ratio}
        sizes = {"size": self.largest, "median": self.median, "weight": {name: self.weight({})}}
        return {"size": sizes.get(kind, {name: self.level})[name], "unit": unit}

    def weight(self, factors: Factors) -> float:
        """Return the median size of the specific force."""
        parts = [self.signals[name][1] * factors.get(name, 1.0) for name in self.force]
        return median_size(np.sqrt(np.sum(np.square(parts), axis=0)))

    def _odd_axis(self, factors: Factors) -> tuple[str, float]:
        """Return the axis of the specific force with the oddest noise, and that over the noise of the two others."""
        ratios: dict[str, float] = {}
        for name in SPECIFIC_FORCE:
            own, *others = (
                self.scatter[n] * abs(factors.get(n, 1.0))
                for n in (name, *(n for n in SPECIFIC_FORCE if n != name))
            )
            ratios[name] = own / float(np.mean(others))
        axis = max(ratios, key=lambda name: abs(math.log(ratios[name])))
        return axis, ratios[axis]

    def _gravity(self, factors: Factors) -> dict[Key, Evidence]:
        """Compare the velocity over ground with specific force, turned by the attitude, and gravity; m/s."""
        time = self.signals["phi"][0]
        time = time[:: 1 + time.size // STATISTICS.gravity_samples]
        x = {}
        for name in (*EULER, *SPECIFIC_FORCE, "vn", "ve"):
            t, values = self.signals[name]
            known = np.isfinite(values)
            x[name] = factors.get(name, 1.0) * np.interp(time, t[known], values[known])
        attitude = quaternions_of(np.column_stack([x[name] for name in EULER]))
        force = to_ground(attitude, np.column_stack([x[name] for name in SPECIFIC_FORCE]))
        felt = np.cumsum(force[:, :2] * np.gradient(time)[:, None], axis=0)
        steps = max(1, round(STATISTICS.gravity_span / float(np.median(np.diff(time)))))
        out: dict[Key, Evidence] = {}
        for i, name in enumerate(("vn", "ve")):
            left = (x[name] - felt[:, i])[steps:] - (x[name] - felt[:, i])[:-steps]
            out["gravity", name] = Residual(left, left, steps, 0.05**2)
        return out


def unit_edits(signals: Mapping[str, Signal], lines: Lines, signs: bool = False) -> Iterator[Edit[Factors]]:
    """Yield other units of each column and of those of one sensor together, and the sign of the vertical force.

    With `signs` those of rates, angles and what goes down, too: where kinematics will not judge them.
    """
    limits = STATISTICS
    units = {name: lines[name].unit if name in lines else "" for name in signals}
    for sensor in (EULER, RATES, SPECIFIC_FORCE):
        there = tuple(name for name in sensor if name in signals)
        if len(there) > 1 and len({units[name] for name in there}) == 1:
            yield from _units(there, units[there[0]], 0.0 if sensor == SPECIFIC_FORCE else limits.several)
        for name in there:
            siblings = {units[n] for n in there if n != name} - {""}
            odd = len(siblings) == 1 and units[name] not in {"", *siblings}
            if sensor != SPECIFIC_FORCE:
                yield from _units((name,), units[name], limits.odd_unit if odd else 0.0)
            elif odd and len(there) == len(sensor):
                yield _unit((name,), units[name], siblings.pop(), 0.0)
            if name == "az":
                yield from _units((name,), units[name], limits.one_axis)
                yield Edit("sign", (name,), "write scale = -1", _multiplied((name,), -1.0))
    for name in (*RATES, *EULER, "vd", "pd") if signs else ():
        if name in signals:
            yield Edit("sign", (name,), "write scale = -1", _multiplied((name,), -1.0))
    for name in signals.keys() & {*LARGEST, *MEDIANS} - {*EULER, *RATES, *SPECIFIC_FORCE}:
        yield from _units((name,), units[name], 0.0, signals[name])
        if name.startswith("motor_"):
            advice = f"write scale = 0.001 and offset = -1 (of 1000 to 2000 us), or call it pwm_{name[6:]},"
            yield Edit("pulses", (name,), advice, _multiplied((name,), 0.5e-3))


def _units(
    names: tuple[str, ...], unit: str, prior: float, signal: Signal | None = None
) -> Iterator[Edit[Factors]]:
    """Yield the edits that give columns another unit, the most usual first."""
    if names[0] in LARGEST:
        ending = "/s" if names[0] in RATES else ""
        yield _unit(names, unit, ("rad" if unit.startswith("deg") else "deg") + ending, prior)
        return
    si = VARIABLES[names[0]].unit
    factors = PULSE_FACTORS if names[0].startswith("pwm_") else FACTORS
    others = [si] if unit and factors.get(unit, 1.0) != factors.get(si, 1.0) else []
    for rank, other in enumerate((*others, *MEDIANS["az" if names[0] in SPECIFIC_FORCE else names[0]].units)):
        if other == "degC" and signal is not None:
            warmer = _multiplied(names, 1.0 + ZERO_CELSIUS / (median_size(signal[1]) or 1.0))
            yield Edit("unit", names, f'write unit = "{other}"', warmer, value=other)
        elif other != unit:
            yield _unit(names, unit, other, prior + rank * STATISTICS.less_usual)


def _unit(names: tuple[str, ...], unit: str, other: str, prior: float) -> Edit[Factors]:
    factors = PULSE_FACTORS if names[0].startswith("pwm_") else FACTORS
    factor = factors.get(other, 1.0) / factors.get(unit or VARIABLES[names[0]].unit, 1.0)
    return Edit(
        "unit", names, f'write unit = "{other}"', _multiplied(names, factor), prior=prior, value=other
    )


def _multiplied(names: Sequence[str], factor: float) -> Callable[[Factors], Factors]:
    """Return an edit that multiplies columns."""
    return lambda factors: {**factors, **{name: factor * factors.get(name, 1.0) for name in names}}


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


def _rise(name: str, signals: Mapping[str, Signal]) -> float:
    """Return the correlation of a vertical position or velocity with the altitude or its slope; zero where they are unlike."""
    (t, height), (at, x), limits = signals["altitude"], signals[name], STATISTICS
    if t.size < limits.samples:
        return 0.0
    there = np.interp(at, t, height if name == "pd" else np.gradient(height, t), left=np.nan, right=np.nan)
    good = np.isfinite(there) & np.isfinite(x)
    if np.count_nonzero(good) < limits.samples or not np.std(there[good]) > 0.0 or not np.std(x[good]) > 0.0:
        return 0.0
    correlation = float(np.corrcoef(there[good], x[good])[0, 1])
    return correlation if abs(correlation) > limits.likeness else 0.0


def largest_size(x: FloatArray) -> float:
    """Return the size that a column hardly exceeds."""
    known = np.abs(x[np.isfinite(x)])
    return float(np.quantile(known, STATISTICS.quantile)) if known.size else 0.0


def median_size(x: FloatArray) -> float:
    """Return the median size; zeros do not count, and zero where there are too few others."""
    known = np.abs(x[np.isfinite(x) & (x != 0.0)])
    return float(np.median(known)) if known.size >= STATISTICS.samples else 0.0
