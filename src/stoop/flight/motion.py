"""Channels of one flight against each other: the one line of a mapping that, changed, makes them agree.

Rates turn the attitude, velocity moves the position, and specific force with gravity makes the velocity. Every single
change of a line (a sign, two columns exchanged, a unit) is tried; the one that explains most is told. What no third
channel decides is told of both.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import quaternions_of, to_ground
from stoop.base.units import FACTORS, KINDS, STANDARD_GRAVITY
from stoop.base.variables import EULER, QUATERNION
from stoop.flight.consistency import RATES, turning
from stoop.flight.gridding import complete

FORCE: Final = ("ax", "ay", "az")
VELOCITY: Final = ("vn", "ve", "vd")
POSITION: Final = ("pn", "pe", "pd")
PLACES: Final = {"pn": "vn", "pe": "ve", "pd": "vd", "altitude": "vd"}  #: what moves each
SIGNS: Final = (*RATES, *EULER, "ax", "ay", *VELOCITY, *POSITION, "altitude")
MOTION: Final = frozenset({*SIGNS, "az", *QUATERNION})  #: all that takes part
EXCHANGED: Final = (("vn", "ve"), ("pn", "pe"))
SCALED: Final = (VELOCITY, POSITION, ("altitude",))  #: what shares a unit
THIN: Final = 50.0  #: Hz that are enough
MOST: Final = 30_000  #: samples of that, ten minutes
TURN: Final = 0.2  #: s over which rates are compared
SPAN: Final = 1.0  #: s over which velocities and accelerations are
LIVELY: Final = (
    0.2  #: of the flight, where a change matters most, is looked at: short maneuvers in long logs count
)
LEAST: Final = 10.0  #: s of it, at least
EVIDENCE: Final = 8.0  #: logarithm of how much more likely the channels are with the line changed
BETTER: Final = 0.5  #: of the square of what is unexplained, that a change must reach in one channel
SEEN: Final = 0.5  #: of the square of the noise; what a change moves by less is not seen
EXPLAINED: Final = 0.3  #: of the square of a motion, that may be unexplained by a unit or an exchange
DECIDED: Final = (
    2.3  #: logarithm of how much more likely one change is than another, to be told alone: ten times
)
ROUNDS: Final = 3  #: wrong lines that are looked for, one after the other
FINEST: Final = {"turn": 0.01, "force": 0.05, "place": 0.1}  #: rad/s, m/s2, m/s; less is no motion

Columns = Mapping[str, FloatArray]


@dataclass(frozen=True)
class Change:
    """One line, or two, of a mapping, otherwise.

    Attributes
    ----------
    names : variables whose lines change
    words : what is wrong, for a message
    fix : what to write
    apply : columns -> those that change
    whole : whether it must explain the motion by itself, not only better
    """

    names: tuple[str, ...]
    words: str
    fix: str
    apply: Callable[[Columns], dict[str, FloatArray]]
    whole: bool


@dataclass(frozen=True)
class Told:
    """A change, and the logarithm of how much more likely the channels are with it."""

    change: Change
    evidence: float


def contradictions(
    data: Columns, rate: float, own: Mapping[str, str]
) -> tuple[list[tuple[Told, ...]], dict[str, FloatArray]]:
    """Return what is wrong, each as one change or as several that are as good, and the columns with it mended.

    Parameters
    ----------
    data : variable -> (n,), gridded, SI
    rate : Hz
    own : variable that a mapping of the user's names -> unit that it says; empty where it says none
    """
    step = max(1, round(rate / THIN))
    lively = _liveliest(data, step)
    thin = {name: x[lively] for name, x in data.items()}
    found: list[tuple[Told, ...]] = []
    mended = dict(data)
    for _ in range(ROUNDS):
        best = _best(thin, rate / step, own)
        if not best:
            break
        found.append(best)
        thin.update(best[0].change.apply(thin))
        mended.update(best[0].change.apply(mended))
    return found, mended


def _liveliest(data: Columns, step: int) -> slice:
    """Return the part that turns and moves most, every so many samples: hours say no more than that."""
    size, many = next(iter(data.values())).size, MOST * step
    watched = [data[name] for name in (*RATES, *VELOCITY) if name in data]
    starts = range(0, max(size - many // 2, 1), many)

    def moved(start: int) -> float:
        spreads = [np.nan_to_num(x[start : start + many]).std() for x in watched]
        return float(np.sum(spreads))

    first = max(starts, key=moved)
    return slice(first, first + many, step)


def _best(data: Columns, rate: float, own: Mapping[str, str]) -> tuple[Told, ...]:
    before = _residuals(data, rate)
    told = [Told(c, _evidence(data, c, before, rate)) for c in _changes(data, own)]
    best = max(told, key=lambda t: t.evidence, default=None)
    if best is None or best.evidence < EVIDENCE:
        return ()
    rivals = [best, *_instead(data, best, told, before, rate)]
    with_it = [_with(data, t.change, before, rate) for t in rivals]
    beaten = [any(_over(other, one, rate) > DECIDED for other in with_it) for one in with_it]
    return tuple(t for t, lost in zip(rivals, beaten, strict=True) if not lost) or (best,)


def _instead(
    data: Columns, best: Told, told: Sequence[Told], before: Residuals, rate: float
) -> Iterator[Told]:
    """Yield what explains as much as the best change, and is not needed beside it."""
    mended = {**data, **best.change.apply(data)}
    left = _with(data, best.change, before, rate)
    for other in told:
        if other.change.whole and other.evidence < EVIDENCE:
            continue  # a unit that shrinks a channel shrinks its noise
        as_good = other is not best and _over(left, _with(data, other.change, before, rate), rate) < DECIDED
        if as_good and _evidence(mended, other.change, left, rate) < EVIDENCE:
            yield other


def _with(data: Columns, change: Change, before: Residuals, rate: float) -> Residuals:
    """Return all residuals with a change."""
    return before | _residuals({**data, **change.apply(data)}, rate, change.names)


def _over(one: Residuals, other: Residuals, rate: float) -> float:
    """Return the logarithm of how much more likely the channels are with one change than with another."""
    return sum(_gain(other[key], one[key], rate, whole=False)[0] for key in one)


def _changes(data: Columns, own: Mapping[str, str]) -> Iterator[Change]:
    there = own.keys() & data.keys()
    there = there if set(EULER) <= data.keys() else there - set(EULER)
    for name in SIGNS:
        if name in there:
            yield Change(
                (name,), f"the sign of {name} is wrong", "write scale = -1", _scaling((name,), -1.0), False
            )
    for one, two in EXCHANGED:
        if {one, two} <= there:
            words = f"{one} and {two} are exchanged"
            yield Change((one, two), words, "exchange the columns", _exchanging(one, two), True)
    for names in SCALED:
        alike = tuple(name for name in names if name in there)
        yield from _units(alike, {own[name] for name in alike})


def _units(names: tuple[str, ...], said: set[str]) -> Iterator[Change]:
    """Offer every other unit of the same kind to channels that a mapping gives one unit."""
    unit = said.pop() if len(said) == 1 else ""
    for other, kind in KINDS.items():
        if kind == KINDS.get(unit, "") and FACTORS[other] != FACTORS[unit]:
            words = f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'} in {other}"
            by = FACTORS[other] / FACTORS[unit]
            yield Change(names, words, f'write unit = "{other}"', _scaling(names, by), True)


def _scaling(names: tuple[str, ...], by: float) -> Callable[[Columns], dict[str, FloatArray]]:
    def apply(data: Columns) -> dict[str, FloatArray]:
        return _with_quaternion(data, {name: by * data[name] for name in names})

    return apply


def _exchanging(one: str, two: str) -> Callable[[Columns], dict[str, FloatArray]]:
    def apply(data: Columns) -> dict[str, FloatArray]:
        return {one: data[two], two: data[one]}

    return apply


def _with_quaternion(data: Columns, changed: dict[str, FloatArray]) -> dict[str, FloatArray]:
    if not set(EULER) & changed.keys():
        return changed
    angles = np.column_stack([changed.get(name, data[name]) for name in EULER])
    return {**changed, **dict(zip(QUATERNION, quaternions_of(angles).T, strict=True))}


@dataclass(frozen=True)
class Residual:
    """What one channel leaves of another, and how large that one is, (n,) each, and over how many seconds."""

    kind: str
    span: float
    left: FloatArray
    size: FloatArray


Residuals = dict[tuple[str, str], Residual]  #: kind and channel -> what is left


def _residuals(data: Columns, rate: float, changed: Collection[str] = SIGNS) -> Residuals:
    """Return what disagrees in each channel that others make, wherever some of those that changed take part."""
    out = {}
    for kind, parts, make in MADE:
        if set(changed) & parts:
            out.update({(kind, name): residual for name, residual in make(data, rate)})
    return out


def _turned(data: Columns, rate: float) -> Iterator[tuple[str, Residual]]:
    if set(RATES) | set(QUATERNION) <= data.keys():
        implied, measured = turning(data, TURN, rate)
        for i, name in enumerate(RATES):
            yield name, _centered("turn", TURN, implied[:, i], measured[:, i])


def _moved(data: Columns, rate: float) -> Iterator[tuple[str, Residual]]:
    steps = round(SPAN * rate)
    for name, of in PLACES.items():
        if {name, of} <= data.keys():
            moved = _slope(data[name], steps, rate) * (-1.0 if name == "altitude" else 1.0)
            yield name, Residual("place", SPAN, moved - _mean(data[of], steps), moved)


def _pushed(data: Columns, rate: float) -> Iterator[tuple[str, Residual]]:
    steps = round(SPAN * rate)
    if set(FORCE) | set(QUATERNION) | set(VELOCITY) <= data.keys():
        e = np.column_stack([data[name] for name in QUATERNION])
        pushed = to_ground(e, np.column_stack([data[name] for name in FORCE]))
        pushed[:, 2] += STANDARD_GRAVITY
        for i, name in enumerate(VELOCITY):
            felt = _mean(pushed[:, i], steps)
            yield name, _centered("force", SPAN, _slope(data[name], steps, rate), felt)


MADE: Final = (
    ("turn", {*RATES, *EULER}, _turned),
    ("place", {*VELOCITY, *PLACES}, _moved),
    ("force", {*EULER, *FORCE, *VELOCITY}, _pushed),
)  #: kind, variables that take part, and what makes its residuals


def _centered(kind: str, span: float, y: FloatArray, x: FloatArray) -> Residual:
    """Return a difference without its mean: offsets of sensors contradict nothing."""
    left = y - x
    known = left[np.isfinite(left)]
    middle = float(known.mean()) if known.size else 0.0
    return Residual(kind, span, left - middle, y)


def _slope(x: FloatArray, steps: int, rate: float) -> FloatArray:
    return np.asarray((x[steps:] - x[:-steps]) * rate / steps)


def _mean(x: FloatArray, steps: int) -> FloatArray:
    """Return the mean over each span by the trapezoidal rule, NaN where a sample is missing."""
    known = np.nan_to_num(x)
    running = np.concatenate([[0.0], np.cumsum(0.5 * (known[1:] + known[:-1]))])
    gone = np.concatenate([[0], np.cumsum(~np.isfinite(x))])
    out: FloatArray = (running[steps:] - running[:-steps]) / steps
    out[gone[steps + 1 :] != gone[: -steps - 1]] = np.nan
    return out


def _evidence(data: Columns, change: Change, before: Residuals, rate: float) -> float:
    """Return the logarithm of how much more likely all channels are with a change; 0 where none gains enough."""
    after = _residuals({**data, **change.apply(data)}, rate, change.names)
    gained = [_gain(before[name], after[name], rate, change.whole) for name in after]
    return sum(gain for gain, _ in gained) if any(clear for _, clear in gained) else 0.0


def _gain(old: Residual, new: Residual, rate: float, whole: bool) -> tuple[float, bool]:
    """Return the evidence of one channel for a change, and whether it is clear by itself."""
    apart = np.abs(old.left - new.left)
    known = complete(np.column_stack([apart, old.size, new.size]))
    many = min(int(known.sum()), max(round(LEAST * rate), round(LIVELY * known.sum())))
    if many < LEAST * old.span * rate:
        return 0.0, False
    most = np.flatnonzero(known)[np.argsort(-apart[known], kind="stable")[:many]]
    finest = FINEST[old.kind] ** 2
    was, now = (float(np.mean(r.left[most] ** 2)) + 1e-3 * finest for r in (old, new))
    if float(np.mean(apart[most] ** 2)) < max(finest, SEEN * min(was, now)):
        return 0.0, False
    moved = float(np.mean(new.size[most] ** 2))
    clear = now < BETTER * was and (not whole or now < EXPLAINED * moved)
    return 0.5 * many / (old.span * rate) * float(np.log(was / now)), clear
