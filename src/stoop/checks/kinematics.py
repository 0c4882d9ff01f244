"""Channels of one flight against each other: rates turn the attitude, velocity moves the position, force makes velocity.

The residuals hold for any vehicle. Offsets of sensors contradict nothing: means are taken off.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, TypeAlias

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.robust import MAD
from stoop.base.rotations import conjugate, product, quaternions_of, to_ground, vectors_of
from stoop.base.units import DEGREE, FACTORS, KINDS, STANDARD_GRAVITY
from stoop.base.variables import EULER, POSITION, QUATERNION, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.checks.engine import Edit, Evidence, Key, Lines, Residual, Residuals, search, where

MOVED_BY: Final = {"pn": "vn", "pe": "ve", "pd": "vd", "altitude": "vd"}  #: position <- its rate of change
SIGNED: Final = (*RATES, *EULER, "ax", "ay", *VELOCITY, *POSITION, "altitude")
MOTION: Final = frozenset({*SIGNED, "az", *QUATERNION})  #: all that takes part
EXCHANGED: Final = (("vn", "ve"), ("pn", "pe"), ("p", "q"), ("q", "r"), ("p", "r"))


@dataclass(frozen=True)
class Agreement:
    """How motions are compared, and limits for rates that follow the attitude, once wrong lines are corrected."""

    rate: float = 50.0  #: Hz at which motions are compared
    longest: int = 30_000  #: samples of that, ten minutes: the part of a longer record that moves most
    turn: float = 0.2  #: s over which rates are compared
    move: float = 1.0  #: s over which velocities and accelerations are
    #: rad/s, m/s2, m/s; less is no motion
    floors: Mapping[str, float] = field(default_factory=lambda: {"turn": 0.01, "force": 0.05, "place": 0.1})
    samples: int = 200  #: spans that are compared, at least
    turning: float = 3.0 * DEGREE  #: rad/s rms; less turning shows nothing
    followed: float = 0.8  #: share of the turning that a matching pair of channels explains
    gain: float = 0.15  #: departure from one that calibrated gyros do not have
    separation: float = 0.05  #: s between attitudes whose noise is independent


LIMITS: Final = Agreement()
Columns: TypeAlias = Mapping[str, FloatArray]  #: variable -> (n,) SI, on one uniform grid


def check_motion(data: Columns, rate: float, lines: Lines) -> tuple[list[Notice], dict[str, FloatArray]]:
    """Return the lines of a mapping that other channels contradict, and the columns with these corrected.

    Signs and axes of body rates are examined in any log; all else only where the user wrote the line. The columns are
    gridded at `rate` [Hz], SI.
    """
    step = max(1, round(rate / LIMITS.rate))
    size, many = next(iter(data.values())).size, LIMITS.longest * step
    watched = [data[name] for name in (*RATES, *VELOCITY) if name in data]
    starts = range(0, max(size - many // 2, 1), many)
    motions = [
        float(np.sum([np.nan_to_num(x[start : start + many]).std() for x in watched])) for start in starts
    ]
    first = starts[int(np.argmax(motions))]
    thin: Columns = {name: x[first : first + many : step] for name, x in data.items()}
    found, _ = search(thin, lambda columns: mapping_edits(columns, lines), Kinematics(rate / step))
    corrected = dict(data)
    notices = []
    for one in found:
        corrected.update(one.best.apply(corrected))
        code = f"mapping-{one.best.kind}" if len(one.edits) == 1 else "mapping-ambiguous"
        notices.append(notice(code, one.best.lines[0], **one.values(lines)))
    return notices, corrected


def mapping_edits(data: Columns, lines: Lines) -> Iterator[Edit[Columns]]:
    """Yield every single edit of the mapping that the residuals can judge."""
    own = lines.keys() & data.keys()
    own = own if set(EULER) <= data.keys() else own - set(EULER)
    signed = own | (set(RATES) & data.keys())
    for name in SIGNED:
        if name in signed:
            yield Edit("sign", (name,), "write scale = -1", _scaled((name,), -1.0))
    for one, other in EXCHANGED:
        if {one, other} <= signed:
            yield Edit(
                "exchange", (one, other), "exchange the columns", _exchanged(one, other), complete=True
            )
    for names in (VELOCITY, POSITION, ("altitude",)):  # what shares a unit
        same = tuple(name for name in names if name in own)
        units = {lines[name].unit for name in same}
        unit = units.pop() if len(units) == 1 else ""
        for other, kind in KINDS.items():
            if kind == KINDS.get(unit, "") and FACTORS[other] != FACTORS[unit]:
                change = _scaled(same, FACTORS[other] / FACTORS[unit])
                yield Edit("unit", same, f'write unit = "{other}"', change, complete=True)


def _scaled(names: Sequence[str], factor: float) -> Callable[[Columns], Columns]:
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


@dataclass(frozen=True)
class Kinematics:
    """The kinematic residuals of columns at one rate [Hz]: the model that `search` needs."""

    rate: float

    def __call__(self, data: Columns, changed: Collection[str] | None) -> Residuals:
        """Return what disagrees in each channel that others predict, where some of those that changed take part."""
        there, steps = data.keys(), round(LIMITS.move * self.rate)
        parts: dict[Key, tuple[FloatArray, FloatArray]] = {}  # measured, and predicted by the others
        if {*RATES, *QUATERNION} <= there and (changed is None or {*RATES, *EULER} & set(changed)):
            implied, measured, _ = _mean_rates(data, LIMITS.turn, self.rate)
            for i, name in enumerate(RATES):
                parts["turn", name] = implied[:, i], measured[:, i]
        slopes = {
            name: (data[name][steps:] - data[name][:-steps]) * self.rate / steps
            for name in (*MOVED_BY, *VELOCITY)
            if name in data
        }
        for name, cause in MOVED_BY.items():
            if {name, cause} <= there and (changed is None or {*VELOCITY, *MOVED_BY} & set(changed)):
                moved = slopes[name] * (-1.0 if name == "altitude" else 1.0)
                parts["place", name] = moved, _means(data[cause], steps)
        force = {*EULER, *SPECIFIC_FORCE, *VELOCITY}
        if {*SPECIFIC_FORCE, *QUATERNION, *VELOCITY} <= there and (changed is None or force & set(changed)):
            attitude = np.column_stack([data[name] for name in QUATERNION])
            felt = to_ground(attitude, np.column_stack([data[name] for name in SPECIFIC_FORCE]))
            felt[:, 2] += STANDARD_GRAVITY
            for i, name in enumerate(VELOCITY):
                parts["force", name] = slopes[name], _means(felt[:, i], steps)
        out: dict[Key, Evidence] = {}
        for key, (y, x) in parts.items():
            left = y - x
            known = left[np.isfinite(left)]
            if key[0] != "place" and known.size:
                left = left - float(known.mean())
            span = LIMITS.turn if key[0] == "turn" else LIMITS.move
            out[key] = Residual(left, y, span * self.rate, LIMITS.floors[key[0]] ** 2)
        return out


def _means(x: FloatArray, steps: int) -> FloatArray:
    """Return the mean over each span by the trapezoidal rule, NaN where a sample is missing."""
    known = np.nan_to_num(x)
    running = np.concatenate([[0.0], np.cumsum(0.5 * (known[1:] + known[:-1]))])
    gone = np.concatenate([[0], np.cumsum(~np.isfinite(x))])
    out: FloatArray = (running[steps:] - running[:-steps]) / steps
    out[gone[steps + 1 :] != gone[: -steps - 1]] = np.nan
    return out


def _mean_rates(data: Columns, span: float, rate: float) -> tuple[FloatArray, FloatArray, FloatArray]:
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


def check_rates(data: Columns, rate: float, lines: Lines) -> list[Notice]:
    """Compare body rates with those that the attitude implies: scale, clipping, lag, or nothing in common.

    The columns are gridded at `rate` [Hz], SI, signs and axes already corrected.
    """
    if not {*RATES, *QUATERNION} <= data.keys():
        return []
    implied, measured, first = _mean_rates(data, LIMITS.turn, rate)
    if len(first) < LIMITS.samples:
        return []
    # How far the attitude scatters beside what the rates say: second differences over a time longer than the grid's
    # filter remembers, and their median, which passes over maneuvers in which both disagree.
    steps = max(1, round(LIMITS.separation * rate))
    close, rates, at = _mean_rates(data, LIMITS.separation, rate)
    left = np.full((len(data["q0"]), 3), np.nan)
    left[at] = (close - rates) * max(2, steps) / rate
    jumps = left[steps:] - left[:-steps]
    known = jumps[np.isfinite(jumps).all(axis=1)]
    noise = MAD * np.median(np.abs(known), axis=0) / np.sqrt(6.0) if len(known) else np.zeros(3)
    noise = noise * np.sqrt(2.0) * rate / max(2, round(LIMITS.turn * rate))
    implied, measured = implied - implied.mean(axis=0), measured - measured.mean(axis=0)
    out = []
    for i, name in enumerate(RATES):
        y, x = implied[:, i], measured[:, i]
        size = float(np.sqrt(np.mean(y**2)))
        turning = np.sqrt(max(size**2 - noise[i] ** 2, 0.0))
        if turning < max(LIMITS.turning, noise[i]):
            continue
        power = float(y @ y) * float(x @ x)
        correlation = float(y @ x) / np.sqrt(power) * size / turning if power > 0.0 else 0.0
        gain = float(y @ x) / float(x @ x) if power > 0.0 else 0.0
        unlike = abs(correlation) ** 2 < LIMITS.followed
        if unlike or abs(gain - 1.0) > LIMITS.gain:
            values = {"correlation": float(correlation), "gain": float(gain)}
            code = "rate-unlike-attitude" if unlike else "rate-scale"
            out.append(notice(code, name, **values, line=where((name,), lines)))
    return out
