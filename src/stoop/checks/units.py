"""Units and the direction of gravity by what columns read: sizes, angles against their rates, noise of one sensor.

The channels may be on clocks of their own. Only statistics of columns are compared, and a unit is a factor, so that an
edit costs nothing: the state of the search is the factor by which each mapped column is still to be multiplied.
"""

from __future__ import annotations

import functools
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
from stoop.checks.engine import Edit, Evidence, Finding, Key, Range, Residual, Residuals, Thresholds, search
from stoop.checks.lines import Lines, where

Signal: TypeAlias = tuple[FloatArray, FloatArray]  #: time (n,) s and values (n,)
Factors: TypeAlias = Mapping[str, float]  #: variable -> by what its mapped column is multiplied

#: rad, rad/s: sizes that no flight exceeds; gyros of drones end at 35 rad/s
LARGEST: Final = {
    "theta": 0.51 * math.pi, "alpha": math.pi, "beta": 0.51 * math.pi, "phi": 2.02 * math.pi, "psi": 2.02 * math.pi,
    "elevator": 0.5 * math.pi, "aileron": 0.5 * math.pi, "rudder": 0.5 * math.pi, "flap": 0.5 * math.pi,
    "p": 40.0, "q": 40.0, "r": 40.0,
}  # fmt: skip
PAIRS: Final = (
    ("phi", "p"),
    ("theta", "q"),
    ("psi", "r"),
    ("alpha", "q"),
)  #: angle, and nearly its derivative


@dataclass(frozen=True)
class Sizes:
    """Median sizes of a variable in use.

    Attributes
    ----------
    low, high : SI
    units : others that logs use, the most usual first
    """

    low: float
    high: float
    units: tuple[str, ...] = ()


_SHARE: Final = Sizes(0.0, 1.5, ("percent",))
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
    "throttle": _SHARE,
    "control_throttle": _SHARE,
    **{f"rotor_{n}": Sizes(0.0, 6.0e3, ("rpm",)) for n in range(1, 17)},
    **{f"pwm_{n}": Sizes(400.0, 3000.0, ("s", "ms")) for n in range(1, 17)},
    **{f"{kind}_{n}": _SHARE for kind in ("motor", "servo") for n in range(1, 17)},
}  #: registry variable -> its median sizes
PULSES: Final = (700.0, 2500.0)  #: us; a command whose median lies between is a pulse


@dataclass(frozen=True)
class Statistics:
    """How the statistics of columns are taken, and what a violated one is worth.

    Attributes
    ----------
    quantile : of sizes; some wild samples prove nothing
    samples : that say anything
    spans : s over which an angle is differenced against noise; the shortest that shows a likeness is taken
    likeness : correlation from which the factor between an angle and a rate means something
    far : logarithm of a factor between angle and rate that is that of a degree, less a factor of two
    noise_band : ratio of the noise of axes of one sensor and one unit
    gravity_span : s over which velocity is differenced
    gravity_samples : that are compared, at most: the thinned record
    upright : least share of the specific force along the vertical axis, in the median
    size, growth, noise, z_axis : odds (logarithm) of a statistic outside of its bounds
    odd_unit : odds of an edit that gives a line the unit of its siblings, which are of one sensor
    several, one_axis : odds of an edit of all angles or rates at once, and of one axis of the specific force alone
    less_usual : odds of each next unit in a list by usage
    """

    quantile: float = 0.995
    samples: int = 20
    spans: tuple[float, ...] = (0.1, 0.5)
    likeness: float = 0.8
    far: float = math.log(0.5 / DEGREE)
    noise_band: float = 4.0
    gravity_span: float = 0.5
    gravity_samples: int = 50_000
    size: float = 30.0
    growth: float = 15.0
    noise: float = 10.0
    upright: float = 0.5
    z_axis: float = 10.0
    odd_unit: float = 3.0
    several: float = -3.0
    one_axis: float = -10.0
    less_usual: float = -3.0


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
    notices = [_notice(one, model, lines) for one in found]
    explained = {name for one in found for names in one.lines for name in names}
    for key, evidence in model(factors, None).items():
        wrong = isinstance(evidence, Range) and evidence.violated and not explained & set(key[1:])
        if wrong and key[0] in _UNEXPLAINED:
            place = where(key[1:], lines)
            notices.append(notice(_UNEXPLAINED[key[0]], key[1], **model.values(key), line=place))
    notices.sort(key=lambda one: list(VARIABLES).index(one.subject))
    refused = [one for one in notices if one.subject in LARGEST]
    return refused, [one for one in notices if one not in refused], dict(factors)


def _notice(found: Finding[Factors], model: UnitModel, lines: Lines) -> Notice:
    key = found.edits[0].channel
    alternatives = tuple(f"{s.edit.fix} for {where(s.edit.lines, lines)}" for s in found.edits)
    return notice(
        "command-in-pulses" if found.best.kind == "pulses" else _CODES[key[0]],
        found.best.lines[0],
        **model.values(key),
        lines=found.best.lines,
        fix=found.best.fix,
        suggestion=" or ".join(alternatives),
        alternatives=alternatives,
        evidence=found.edits[0].evidence,
    )


class UnitModel:
    """Statistics of columns as `search` needs them, each taken once."""

    def __init__(
        self, signals: Mapping[str, Signal], limits: Statistics = STATISTICS, signs: bool = False
    ) -> None:
        self.signals, self.limits = signals, limits
        self.largest = {n: largest_size(signals[n][1], limits) for n in LARGEST if n in signals}
        self.median = {n: median_size(signals[n][1], limits) for n in MEDIANS if n in signals}
        pairs = [pair for pair in PAIRS if set(pair) <= signals.keys() and not self._has_turns(pair[0])]
        self.growth = {pair: growth(signals[pair[0]], signals[pair[1]], limits)[0] for pair in pairs}
        turning = {"psi", "r"} <= signals.keys() and self._has_turns("psi")
        self.turns = growth(signals["psi"], signals["r"], limits)[0] if turning else 0.0
        force = [name for name in SPECIFIC_FORCE if name in signals]
        self.force = force if len({signals[name][1].size for name in force}) == 1 else force[-1:]
        self.scatter = {name: _scatter(signals[name][1], limits) for name in force}
        risen = [name for name in ("pd", "vd") if signs and {name, "altitude"} <= signals.keys()]
        self.rises = {name: _rise(name, signals, limits) for name in risen}
        self.signs = signs
        self.level = _median_of(signals["az"][1]) if "az" in signals else 0.0

    def __call__(self, factors: Factors, changed: Collection[str] | None) -> Residuals:
        """Return the statistics of columns multiplied by factors, where some of those that changed take part."""
        out: dict[Key, Evidence] = {}
        for key, value, low, high, odds in self._statistics(lambda name: factors.get(name, 1.0)):
            concerned = SPECIFIC_FORCE if key[0] in ("weight", "noise", "z-axis", "up") else key[1:]
            if changed is None or set(concerned) & set(changed):
                out[key] = Range(value, low, high, odds)
        if (changed is None or set(EULER) & set(changed)) and self._ambiguous:
            out.update(self._gravity(factors))
        return out

    def _statistics(self, f: Callable[[str], float]) -> Iterator[tuple[Key, float, float, float, float]]:
        """Yield each statistic with its bounds, and the odds of one outside."""
        limits = self.limits
        for name, size in self.largest.items():
            # a heading that was counted through several turns turns as the yaw rate says
            counted = name == "psi" and self.turns != 0.0 and 0.2 < self.turns * f("psi") / f("r") < 5.0
            yield ("size", name), 0.0 if counted else size * abs(f(name)), 0.0, LARGEST[name], limits.size
        for name, size in self.median.items():
            if size and name != "az":
                yield (
                    ("median", name),
                    size * abs(f(name)),
                    MEDIANS[name].low,
                    MEDIANS[name].high,
                    limits.size,
                )
        if self.median.get("az") and (weight := self.weight(f)) > 0.0:
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
            odd = max(SPECIFIC_FORCE, key=lambda name: abs(math.log(self.noise_ratio(name, f))))
            band = limits.noise_band
            yield ("noise", "az"), self.noise_ratio(odd, f), 1.0 / band, band, limits.noise

    def values(self, key: Key) -> dict[str, float | str]:
        """Return what a notice says of a statistic, as mapped."""
        kind, name = key[:2]
        unit = VARIABLES[name].unit if VARIABLES[name].unit != "1" else ""
        if kind in ("growth", "gravity"):
            angle, rate = key[1:] if kind == "growth" else self._ambiguous[0]
            return {"angle": angle, "rate": rate, "factor": abs(self.growth[angle, rate])}
        if kind in ("noise", "z-axis"):
            ratios = {n: self.noise_ratio(n, _as_mapped) for n in SPECIFIC_FORCE}
            axis = max(ratios, key=lambda n: abs(math.log(ratios[n])))
            return {"axis": axis, "ratio": ratios[axis]}
        sizes = {"size": self.largest, "median": self.median, "weight": {name: self.weight(_as_mapped)}}
        return {"size": sizes.get(kind, {name: self.level})[name], "unit": unit}

    def weight(self, f: Callable[[str], float]) -> float:
        """Return the median size of the specific force."""
        parts = [self.signals[name][1] * f(name) for name in self.force]
        return median_size(np.sqrt(np.sum(np.square(parts), axis=0)), self.limits)

    def noise_ratio(self, name: str, f: Callable[[str], float]) -> float:
        """Return the noise of an axis of the specific force over that of the two others."""
        own, *others = (
            self.scatter[n] * abs(f(n)) for n in (name, *(n for n in SPECIFIC_FORCE if n != name))
        )
        return own / float(np.mean(others))

    def _has_turns(self, angle: str) -> bool:
        """Tell whether a heading is too large for its jumps to be told from turns."""
        return angle == "psi" and self.largest["psi"] > LARGEST["psi"]

    @functools.cached_property
    def _ambiguous(self) -> list[tuple[str, str]]:
        """Pairs that differ by a degree, of which gravity may show the right one."""
        need = {*EULER, *SPECIFIC_FORCE, *VELOCITY}
        if not need <= self.signals.keys() or any(self.signals[name][1].size < 100 for name in need):
            return []
        far = [pair for pair, x in self.growth.items() if x and abs(math.log(abs(x))) > self.limits.far]
        return [pair for pair in far if pair[0] in EULER]

    def _gravity(self, factors: Factors) -> dict[Key, Evidence]:
        """Compare the velocity over ground with specific force, turned by the attitude, and gravity; m/s."""
        time = self.signals["phi"][0]
        time = time[:: 1 + time.size // self.limits.gravity_samples]
        x = {
            name: factors.get(name, 1.0) * _at(time, *self.signals[name])
            for name in (*EULER, *SPECIFIC_FORCE, "vn", "ve")
        }
        attitude = quaternions_of(np.column_stack([x[name] for name in EULER]))
        force = to_ground(attitude, np.column_stack([x[name] for name in SPECIFIC_FORCE]))
        felt = np.cumsum(force[:, :2] * np.gradient(time)[:, None], axis=0)
        steps = max(1, round(self.limits.gravity_span / float(np.median(np.diff(time)))))
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
                yield Edit("sign", (name,), "write scale = -1", multiplied((name,), -1.0))
    for name in (*RATES, *EULER, "vd", "pd") if signs else ():
        if name in signals:
            yield Edit("sign", (name,), "write scale = -1", multiplied((name,), -1.0))
    for name in signals.keys() & {*LARGEST, *MEDIANS} - {*EULER, *RATES, *SPECIFIC_FORCE}:
        yield from _units((name,), units[name], 0.0, signals[name])
        if name.startswith("motor_"):
            advice = f"write scale = 0.001 and offset = -1 (of 1000 to 2000 us), or call it pwm_{name[6:]},"
            yield Edit("pulses", (name,), advice, multiplied((name,), 0.5e-3))


def _units(
    names: tuple[str, ...], unit: str, prior: float, signal: Signal | None = None
) -> Iterator[Edit[Factors]]:
    """Yield the edits that give columns another unit, the most usual first."""
    if names[0] in LARGEST:
        ending = "/s" if names[0] in RATES else ""
        yield _unit(names, unit, ("rad" if unit.startswith("deg") else "deg") + ending, prior)
        return
    si = VARIABLES[names[0]].unit
    others = [si] if unit and _factor(names[0], unit) != _factor(names[0], si) else []
    for rank, other in enumerate((*others, *MEDIANS["az" if names[0] in SPECIFIC_FORCE else names[0]].units)):
        odds = prior + rank * STATISTICS.less_usual
        if other == "degC" and signal is not None:
            median = median_size(signal[1], STATISTICS) or 1.0
            yield Edit(
                "unit",
                names,
                f'write unit = "{other}"',
                multiplied(names, 1.0 + ZERO_CELSIUS / median),
                value=other,
            )
        elif other != unit:
            yield _unit(names, unit, other, odds)


def _unit(names: tuple[str, ...], unit: str, other: str, prior: float) -> Edit[Factors]:
    factor = _factor(names[0], other) / _factor(names[0], unit or VARIABLES[names[0]].unit)
    return Edit("unit", names, f'write unit = "{other}"', multiplied(names, factor), prior=prior, value=other)


def _factor(name: str, unit: str) -> float:
    return PULSE_FACTORS.get(unit, 1.0) if name.startswith("pwm_") else FACTORS.get(unit, 1.0)


def multiplied(names: Sequence[str], factor: float) -> Callable[[Factors], Factors]:
    """Return an edit that multiplies columns."""
    return lambda factors: {**factors, **{name: factor * factors.get(name, 1.0) for name in names}}


def growth(angle: Signal, rate: Signal, limits: Statistics = STATISTICS) -> tuple[float, float]:
    """Return how many times faster an angle changes than a rate says, with its sign, and their correlation.

    Parameters
    ----------
    angle : time (n,) s and values (n,)
    rate : time (m,) s and values (m,)
    limits : spans over which the angle is differenced

    Returns
    -------
    factor, correlation : zeros where they have nothing in common
    """
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


def _rise(name: str, signals: Mapping[str, Signal], limits: Statistics) -> float:
    """Return the correlation of a vertical position or velocity with the altitude or its slope; zero where they are unlike."""
    t, height = signals["altitude"]
    at, x = signals[name]
    if t.size < limits.samples:
        return 0.0
    there = np.interp(at, t, height if name == "pd" else np.gradient(height, t), left=np.nan, right=np.nan)
    good = np.isfinite(there) & np.isfinite(x)
    if np.count_nonzero(good) < limits.samples or not np.std(there[good]) > 0.0 or not np.std(x[good]) > 0.0:
        return 0.0
    correlation = float(np.corrcoef(there[good], x[good])[0, 1])
    return correlation if abs(correlation) > limits.likeness else 0.0


def largest_size(x: FloatArray, limits: Statistics = STATISTICS) -> float:
    """Return the size that a column hardly exceeds."""
    known = np.abs(x[np.isfinite(x)])
    return float(np.quantile(known, limits.quantile)) if known.size else 0.0


def _median_of(x: FloatArray) -> float:
    known = x[np.isfinite(x)]
    return float(np.median(known)) if known.size else 0.0


def median_size(x: FloatArray, limits: Statistics = STATISTICS) -> float:
    """Return the median size; zeros do not count, and zero where there are too few others."""
    known = np.abs(x[np.isfinite(x) & (x != 0.0)])
    return float(np.median(known)) if known.size >= limits.samples else 0.0


def _scatter(x: FloatArray, limits: Statistics) -> float:
    """Return the median size of the second differences: noise of the sensor, whatever the vehicle does."""
    jumps = np.abs(np.diff(x[np.isfinite(x)], 2))
    return float(np.median(jumps)) if jumps.size >= limits.samples else 0.0


def _at(time: FloatArray, t: FloatArray, x: FloatArray) -> FloatArray:
    known = np.isfinite(x)
    return np.interp(time, t[known], x[known])


def _as_mapped(name: str) -> float:
    return 1.0
