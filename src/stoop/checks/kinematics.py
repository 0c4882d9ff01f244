"""Channels of one flight against each other: rates turn the attitude, velocity moves the position, force makes velocity.

The residuals hold for any vehicle. Offsets of sensors contradict nothing: means are taken off.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.rotations import conjugate, product, quaternions_of, to_ground, vectors_of
from stoop.base.units import DEGREE, FACTORS, KINDS, STANDARD_GRAVITY
from stoop.base.variables import EULER, POSITION, QUATERNION, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.checks.engine import Edit, Evidence, Finding, Key, Residual, Residuals, search
from stoop.checks.lines import Lines, where

MOVED_BY: Final = {"pn": "vn", "pe": "ve", "pd": "vd", "altitude": "vd"}  #: position <- its rate of change
SIGNED: Final = (*RATES, *EULER, "ax", "ay", *VELOCITY, *POSITION, "altitude")
MOTION: Final = frozenset({*SIGNED, "az", *QUATERNION})  #: all that takes part
EXCHANGED: Final = (("vn", "ve"), ("pn", "pe"), ("p", "q"), ("q", "r"), ("p", "r"))
SENSORS: Final = (VELOCITY, POSITION, ("altitude",))  #: what shares a unit

RATE: Final = 50.0  #: Hz at which motions are compared
MAX_SAMPLES: Final = 30_000  #: of that, ten minutes: the part of a longer record that moves most
TURN_SPAN: Final = 0.2  #: s over which rates are compared
MOVE_SPAN: Final = 1.0  #: s over which velocities and accelerations are
FLOORS: Final = {"turn": 0.01, "force": 0.05, "place": 0.1}  #: rad/s, m/s2, m/s; less is no motion


@dataclass(frozen=True)
class Agreement:
    """Limits for rates that follow the attitude, once wrong lines are corrected.

    Attributes
    ----------
    samples : spans that are compared, at least
    turning : rad/s rms; less turning shows nothing
    followed : share of the turning that a matching pair of channels explains
    gain : departure from one that calibrated gyros do not have
    separation : s between attitudes whose noise is independent
    """

    samples: int = 200
    turning: float = 3.0 * DEGREE
    followed: float = 0.8
    gain: float = 0.15
    separation: float = 0.05


AGREEMENT: Final = Agreement()
NORMAL: Final = 1.4826  #: standard deviation over the median of sizes, of normal numbers

Columns: TypeAlias = Mapping[str, FloatArray]  #: variable -> (n,) SI, on one uniform grid


def check_motion(data: Columns, rate: float, lines: Lines) -> tuple[list[Notice], dict[str, FloatArray]]:
    """Return the lines of a mapping that other channels contradict, and the columns with these corrected.

    Signs and axes of body rates are examined in any log; all else only where the user wrote the line.

    Parameters
    ----------
    data : variable -> (n,), gridded, SI
    rate : Hz
    lines : what the user's mapping says of each variable
    """
    step = max(1, round(rate / RATE))
    part = _busiest(data, step)
    thin: Columns = {name: x[part] for name, x in data.items()}
    found, _ = search(thin, lambda columns: mapping_edits(columns, lines), Kinematics(rate / step))
    corrected = dict(data)
    for one in found:
        corrected.update(one.best.apply(corrected))
    return [line_notice(one, lines) for one in found], corrected


def line_notice(found: Finding[Columns], lines: Lines) -> Notice:
    """Return what is wrong with a line of a mapping, and what to write; several where no channel decides."""
    alternatives = tuple(f"{s.edit.fix} for {where(s.edit.lines, lines)}" for s in found.edits)
    return notice(
        f"mapping-{found.best.kind}" if len(found.edits) == 1 else "mapping-ambiguous",
        found.best.lines[0],
        lines=found.best.lines,
        fix=found.best.fix,
        suggestion=" or ".join(alternatives),
        alternatives=alternatives,
        evidence=found.edits[0].evidence,
    )


def _busiest(data: Columns, step: int) -> slice:
    """Return the part of the record that turns and moves most, thinned."""
    size, many = next(iter(data.values())).size, MAX_SAMPLES * step
    watched = [data[name] for name in (*RATES, *VELOCITY) if name in data]
    starts = range(0, max(size - many // 2, 1), many)

    def motion(start: int) -> float:
        return float(np.sum([np.nan_to_num(x[start : start + many]).std() for x in watched]))

    first = max(starts, key=motion)
    return slice(first, first + many, step)


def mapping_edits(data: Columns, lines: Lines) -> Iterator[Edit[Columns]]:
    """Yield every single edit of the mapping that the residuals can judge."""
    own = lines.keys() & data.keys()
    own = own if set(EULER) <= data.keys() else own - set(EULER)
    signed = own | (set(RATES) & data.keys())
    for name in SIGNED:
        if name in signed:
            yield Edit("sign", (name,), "write scale = -1", scaled((name,), -1.0))
    for one, other in EXCHANGED:
        if {one, other} <= signed:
            yield Edit(
                "exchange", (one, other), "exchange the columns", _exchanged(one, other), complete=True
            )
    for names in SENSORS:
        same = tuple(name for name in names if name in own)
        units = {lines[name].unit for name in same}
        unit = units.pop() if len(units) == 1 else ""
        for other, kind in KINDS.items():
            if kind == KINDS.get(unit, "") and FACTORS[other] != FACTORS[unit]:
                change = scaled(same, FACTORS[other] / FACTORS[unit])
                yield Edit("unit", same, f'write unit = "{other}"', change, complete=True)


def scaled(names: Sequence[str], factor: float) -> Callable[[Columns], Columns]:
    """Return an edit that multiplies columns; the quaternion follows its angles."""

    def apply(data: Columns) -> Columns:
        changed = {name: factor * data[name] for name in names}
        if set(EULER) & changed.keys():
            angles = np.column_stack([changed.get(name, data[name]) for name in EULER])
            changed.update(zip(QUATERNION, quaternions_of(angles).T, strict=True))
        return {**data, **changed}

    return apply


def _exchanged(one: str, other: str) -> Callable[[Columns], Columns]:
    return lambda data: {**data, one: data[other], other: data[one]}


class Kinematics:
    """The kinematic residuals of columns at one rate [Hz]: the model that `search` needs."""

    def __init__(self, rate: float) -> None:
        self.rate = rate

    def __call__(self, data: Columns, changed: Collection[str] | None) -> Residuals:
        """Return what disagrees in each channel that others predict, where some of those that changed take part."""
        out: dict[Key, Evidence] = {}
        for kind, parts, residuals in (
            ("turn", {*RATES, *EULER}, self._turn),
            ("place", {*VELOCITY, *MOVED_BY}, self._place),
            ("force", {*EULER, *SPECIFIC_FORCE, *VELOCITY}, self._force),
        ):
            if changed is None or parts & set(changed):
                out.update({(kind, name): residual for name, residual in residuals(data)})
        return out

    def _turn(self, data: Columns) -> Iterator[tuple[str, Residual]]:
        if set(RATES) | set(QUATERNION) <= data.keys():
            implied, measured, _ = mean_rates(data, TURN_SPAN, self.rate)
            for i, name in enumerate(RATES):
                yield name, self._centered("turn", TURN_SPAN, implied[:, i], measured[:, i])

    def _place(self, data: Columns) -> Iterator[tuple[str, Residual]]:
        steps = round(MOVE_SPAN * self.rate)
        for name, cause in MOVED_BY.items():
            if {name, cause} <= data.keys():
                moved = self._slope(data[name], steps) * (-1.0 if name == "altitude" else 1.0)
                left = moved - _means(data[cause], steps)
                yield name, Residual(left, moved, MOVE_SPAN * self.rate, FLOORS["place"] ** 2)

    def _force(self, data: Columns) -> Iterator[tuple[str, Residual]]:
        steps = round(MOVE_SPAN * self.rate)
        if set(SPECIFIC_FORCE) | set(QUATERNION) | set(VELOCITY) <= data.keys():
            attitude = np.column_stack([data[name] for name in QUATERNION])
            felt = to_ground(attitude, np.column_stack([data[name] for name in SPECIFIC_FORCE]))
            felt[:, 2] += STANDARD_GRAVITY
            for i, name in enumerate(VELOCITY):
                gained = self._slope(data[name], steps)
                yield name, self._centered("force", MOVE_SPAN, gained, _means(felt[:, i], steps))

    def _slope(self, x: FloatArray, steps: int) -> FloatArray:
        return np.asarray((x[steps:] - x[:-steps]) * self.rate / steps)

    def _centered(self, kind: str, span: float, y: FloatArray, x: FloatArray) -> Residual:
        """Return a difference without its mean: offsets of sensors contradict nothing."""
        left = y - x
        known = left[np.isfinite(left)]
        mean = float(known.mean()) if known.size else 0.0
        return Residual(left - mean, y, span * self.rate, FLOORS[kind] ** 2)


def _means(x: FloatArray, steps: int) -> FloatArray:
    """Return the mean over each span by the trapezoidal rule, NaN where a sample is missing."""
    known = np.nan_to_num(x)
    running = np.concatenate([[0.0], np.cumsum(0.5 * (known[1:] + known[:-1]))])
    gone = np.concatenate([[0], np.cumsum(~np.isfinite(x))])
    out: FloatArray = (running[steps:] - running[:-steps]) / steps
    out[gone[steps + 1 :] != gone[: -steps - 1]] = np.nan
    return out


def mean_rates(data: Columns, span: float, rate: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the mean rates (n, 3) over a span [s] that the attitude implies and those measured, rad/s; and where."""
    steps = max(2, round(span * rate))
    attitude = np.column_stack([data[name] for name in QUATERNION])
    rates = np.column_stack([data[name] for name in RATES])
    running = np.concatenate([np.zeros((1, 3)), np.cumsum(np.nan_to_num(rates), axis=0)])
    known = np.isfinite(rates).all(axis=1) & np.isfinite(attitude).all(axis=1)
    gone = np.concatenate([[0], np.cumsum(~known)])
    first = np.arange(len(attitude) - steps)
    first = first[gone[first + steps + 1] == gone[first]]
    mean = (running[first + steps + 1] - running[first] - 0.5 * (rates[first] + rates[first + steps])) / steps
    turned = vectors_of(product(conjugate(attitude[first]), attitude[first + steps]))
    return turned * rate / steps, mean, first


def check_rates(data: Columns, rate: float, lines: Lines, limits: Agreement = AGREEMENT) -> list[Notice]:
    """Compare body rates with those that the attitude implies: scale, clipping, lag, or nothing in common.

    Parameters
    ----------
    data : variable -> (n,), gridded, signs and axes already corrected
    rate : Hz
    lines : what the user's mapping says of each variable
    """
    if not set(RATES) | set(QUATERNION) <= set(data):
        return []
    implied, measured, first = mean_rates(data, TURN_SPAN, rate)
    if len(first) < limits.samples:
        return []
    noise = _attitude_noise(data, rate, limits) * np.sqrt(2.0) * rate / max(2, round(TURN_SPAN * rate))
    implied, measured = implied - implied.mean(axis=0), measured - measured.mean(axis=0)
    out = []
    for i, name in enumerate(RATES):
        y, x = implied[:, i], measured[:, i]
        size = float(np.sqrt(np.mean(y**2)))
        turning = np.sqrt(max(size**2 - noise[i] ** 2, 0.0))
        if turning < max(limits.turning, noise[i]):
            continue
        power = float(y @ y) * float(x @ x)
        correlation = float(y @ x) / np.sqrt(power) * size / turning if power > 0.0 else 0.0
        gain = float(y @ x) / float(x @ x) if power > 0.0 else 0.0
        values: dict[str, float | str] = {
            "correlation": float(correlation),
            "gain": float(gain),
            "line": where((name,), lines),
        }
        if abs(correlation) ** 2 < limits.followed:
            out.append(notice("rate-unlike-attitude", name, **values))
        elif abs(gain - 1.0) > limits.gain:
            out.append(notice("rate-scale", name, **values))
    return out


def _attitude_noise(data: Columns, rate: float, limits: Agreement) -> FloatArray:
    """Return (3,) rad: how far the attitude about each body axis scatters, beside what the rates say.

    Second differences over a time longer than the grid's filter remembers: neighbors on the grid scatter less than what
    was recorded. The median passes over maneuvers in which attitude and rates disagree.
    """
    steps = max(1, round(limits.separation * rate))
    span = max(2, steps)
    implied, measured, first = mean_rates(data, limits.separation, rate)
    left = np.full((len(data["q0"]), 3), np.nan)
    left[first] = (implied - measured) * span / rate
    jumps = left[steps:] - left[:-steps]
    known = jumps[np.isfinite(jumps).all(axis=1)]
    return NORMAL * np.median(np.abs(known), axis=0) / np.sqrt(6.0) if len(known) else np.zeros(3)
