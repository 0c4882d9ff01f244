"""Likelihood-ratio test of single edits: which changed line makes data agree that contradict each other.

A hypothesis is an `Edit` of one line of a mapping or of a vehicle file. A model turns the data into named residuals; an
edit is scored by the log-likelihood that it gains over all residuals it touches. Residuals are taken as Gaussian with
unknown variance, so that one channel gains n / 2 ln(s0^2 / s1^2) with n independent samples. The best edit above one
threshold is applied, and the search repeats with what is left; edits that explain the data as well are reported together.

References
----------
Kay, *Fundamentals of Statistical Signal Processing, Vol. II: Detection Theory*, section 6.4 (generalized likelihood
ratio test).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Generic, Protocol, TypeAlias, TypeVar

import numpy as np

from stoop.extend.arrays import FloatArray, IntArray, robust_std
from stoop_draft.checks.entries import Change, Lines, where

State = TypeVar("State")


def empty_columns(columns: Mapping[str, FloatArray]) -> set[str]:
    """Return the names of the columns without a finite number, which show nothing to any detector."""
    return {name for name, x in columns.items() if not np.isfinite(x).any()}


@dataclass(frozen=True)
class Thresholds:
    """Limits of the test, chosen so that no clean simulated flight is accused (tests/draft/checks/test_clean_flights.py)."""

    #: log-likelihood gained by an edit that is believed; about a hundred edits are tried, each of which a right file would
    #: gain so much less than once in 3,000
    evidence: float = 8.0
    tie: float = 2.3  #: difference of log-likelihood below which no edit is preferred: odds of ten to one
    #: share of a residual's mean square left at most in one channel; else colored noise
    improvement: float = 0.5
    visible: float = 0.5  #: share of a residual's mean square that an edit must change, to be judged there
    unexplained: float = 0.3  #: share of a motion's mean square that a `complete` edit may leave
    #: share of it that such an edit must explain more: models of vehicles are never exact
    margin: float = 0.1
    busiest: float = 0.2  #: of the record, where the edit changes most: short maneuvers in long logs count
    #: mean square of the fifth (`busiest`) that an edit changes most over the white noise in it, at least: twice 3.25, that
    #: of normal numbers, so that as much motion as noise changes
    motion: float = 6.5
    spans: float = 10.0  #: independent samples, at least
    rounds: int = 32  #: wrong lines that are looked for one after the other


LIMITS: Final = Thresholds()


@dataclass(frozen=True)
class Edit(Generic[State]):
    """One line, or several that go together, written otherwise."""

    kind: str  #: "sign", "unit", "exchange", "spin", ...: part of the notice's code
    lines: tuple[str, ...]  #: variables of the mapping or entries of the vehicle file whose lines change
    fix: str  #: what to write
    apply: Callable[[State], State]  #: data or vehicle -> the same with the edit
    #: it must explain the motion by itself; a unit that shrinks a channel shrinks its noise, too
    complete: bool = False
    prior: float = 0.0  #: logarithm of its odds before any data, against an edit as likely as any
    value: str = ""  #: what the lines say then, such as a unit
    units: tuple[str, ...] = ()  #: of each line, where these change

    def advice(self, lines: Lines) -> str:
        """Return what to write and where."""
        return f"{self.fix} for {where(self.lines, lines)}"

    def changes(self, lines: Lines) -> tuple[Change, ...]:
        """Return the same as changes of a mapping; none where it is no line of one."""
        return ()


class Evidence(Protocol):
    """What one channel says of two hypotheses."""

    def gain(self, before: object, limits: Thresholds, complete: bool) -> tuple[float, bool]:
        """Return the log-likelihood gained since `before`, and whether it convinces by itself."""


Key: TypeAlias = tuple[str, ...]  #: kind of evidence, and its channels
Residuals: TypeAlias = Mapping[Key, Evidence]
#: data, and the lines that changed (None: any) -> residuals in which these take part
Model: TypeAlias = Callable[[State, Collection[str] | None], Residuals]


@dataclass(frozen=True, eq=False)
class Residual:
    """What remains of one channel when others predict it."""

    left: FloatArray  #: (n,) residual, in the unit of the channel; NaN where unknown
    size: FloatArray  #: (n,) measured channel
    samples: float  #: samples of the record that are as good as one independent sample
    floor: float  #: mean square of what is no motion
    level: bool = False  #: a level, not a motion: an edit that shrinks the channel explains nothing by that

    def __str__(self) -> str:
        """Return how much remains, as a share of the channel."""
        size = float(np.nanmean(self.size**2)) + self.floor
        return f"{math.sqrt(float(np.nanmean(self.left**2)) / size):.0%} unexplained"

    def gain(self, before: object, limits: Thresholds, complete: bool) -> tuple[float, bool]:
        """Compare the samples at which both residuals differ most."""
        if not isinstance(before, Residual):
            raise TypeError("residuals of another kind")
        change = before.left - self.left
        apart = np.abs(change)
        known = np.isfinite(apart) & np.isfinite(before.size) & np.isfinite(self.size)
        count = int(known.sum())
        least = math.ceil(limits.spans * self.samples)
        many = min(count, max(least, round(limits.busiest * count)))
        if many < least:
            return 0.0, False
        most = np.flatnonzero(known)[_largest(apart[known], many)]
        was, now = (float(np.mean(r.left[most] ** 2)) + 1e-3 * self.floor for r in (before, self))
        changed = float(np.mean(apart[most] ** 2))
        if changed < max(self.floor, limits.visible * min(was, now)):
            return 0.0, False
        apart = np.diff(change, 2)
        noise = (
            robust_std(apart[np.isfinite(apart)]) ** 2 / 6.0
        )  # second differences of white noise have six times its variance
        if changed < limits.motion * noise:  # what an edit changes is noise
            return 0.0, False
        # relative to the channel: an edit that multiplies it changes the density of what was recorded
        was, now = (
            x / (float(np.mean(r.size[most] ** 2)) + 1e-3 * self.floor)
            for x, r in ((was, before), (now, self))
        )
        whole = self.level or now < min(limits.unexplained, was - limits.margin)
        clear = now < limits.improvement * was and (whole or not complete)
        return 0.5 * many / self.samples * float(np.log(was / now)), clear


def _largest(x: FloatArray, count: int) -> IntArray:
    """Return the places (count,) of the largest numbers; of those equal to the least of them, the first ones."""
    least = np.partition(x, x.size - count)[x.size - count]
    taken = x > least
    equal = np.flatnonzero(x == least)
    taken[equal[: count - np.count_nonzero(taken)]] = True
    return np.flatnonzero(taken)


@dataclass(frozen=True)
class Range:
    """A number that lies within bounds in any flight; `odds`: logarithm of how much less likely one outside is."""

    value: float
    low: float
    high: float
    odds: float

    def __str__(self) -> str:
        """Return the number."""
        return f"{self.value:.3g}"

    @property
    def violated(self) -> bool:
        """Whether the number lies outside."""
        return self.outside > 0.0

    @property
    def outside(self) -> float:
        """How far the number lies outside; nothing where it is unknown (NaN)."""
        return float(np.fmax(0.0, np.fmax(self.low - self.value, self.value - self.high)))

    def gain(self, before: object, limits: Thresholds, complete: bool) -> tuple[float, bool]:
        """Return the odds that the edit wins or loses."""
        if not isinstance(before, Range):
            raise TypeError("evidence of another kind")
        if np.isnan(before.value) or np.isnan(self.value):
            return 0.0, False
        if before.violated and self.outside > before.outside:  # no correction makes it worse
            return -math.inf, False
        gained = before.odds * before.violated - self.odds * self.violated
        return gained, gained >= limits.evidence


@dataclass(frozen=True)
class Penalty:
    """Minus the logarithm of a prior density, such as that of a wind."""

    value: float

    def gain(self, before: object, limits: Thresholds, complete: bool) -> tuple[float, bool]:
        """Return the log-density that the edit wins or loses."""
        if not isinstance(before, Penalty):
            raise TypeError("evidence of another kind")
        return before.value - self.value, before.value - self.value > limits.tie


@dataclass(frozen=True)
class Scored(Generic[State]):
    """An edit, the log-likelihood that it gains, and the channel that shows it: a violated bound, else what gains most."""

    edit: Edit[State]
    evidence: float
    channel: Key


@dataclass(frozen=True)
class Finding(Generic[State]):
    """One wrong line: the best edit, and edits that explain the data as well, best first."""

    edits: tuple[Scored[State], ...]

    @property
    def best(self) -> Edit[State]:
        """The edit that explains most."""
        return self.edits[0].edit

    @property
    def lines(self) -> tuple[tuple[str, ...], ...]:
        """Lines of each edit."""
        return tuple(one.edit.lines for one in self.edits)

    def values(self, lines: Lines) -> dict[str, str | float | tuple[str, ...]]:
        """Return what a notice says of wrong lines of a mapping, and of what to write."""
        alternatives = tuple(s.edit.advice(lines) for s in self.edits)
        changes = [tuple(map(str, s.edit.changes(lines))) for s in self.edits]
        # those of one are certain where every other alternative makes them, and more
        least = min(changes, key=len)
        return {
            "lines": self.best.lines,
            "fix": self.best.fix,
            "suggestion": " or ".join(alternatives),
            "alternatives": alternatives,
            "changes": least if all(set(least) <= set(one) for one in changes) else (),
            "evidence": self.edits[0].evidence,
        }


def search(
    state: State,
    edits: Callable[[State], Iterable[Edit[State]]],
    model: Model[State],
    limits: Thresholds = LIMITS,
) -> tuple[list[Finding[State]], State]:
    """Return the wrong lines, most evident first, and the data with them corrected."""
    found: list[Finding[State]] = []
    for _ in range(limits.rounds):
        finding = _best(state, edits(state), model, limits)
        if finding is None:
            break
        undone = [one for one in found if _undoes(finding.best, one.best)]
        found = [one for one in found if one not in undone] if undone else [*found, finding]
        state = finding.best.apply(state)
    return found, state


def _undoes(edit: Edit[State], other: Edit[State]) -> bool:
    """Tell whether an edit takes back another, found before others of what it had explained: a sign twice, or axes."""
    same = (edit.kind, edit.lines, edit.value) == (other.kind, other.lines, other.value)
    return same and edit.kind in ("sign", "exchange", "frame")


def not_excluded(
    state: State, edits: Iterable[Edit[State]], model: Model[State], limits: Thresholds = LIMITS
) -> list[Edit[State]]:
    """Return the edits that the data contradict no more than what is written."""
    before = model(state, None)
    out = []
    for edit in edits:
        after = _changed(edit, state, before, model)
        if sum(after[key].gain(before[key], limits, complete=False)[0] for key in after) > -limits.tie:
            out.append(edit)
    return out


def _best(
    state: State, edits: Iterable[Edit[State]], model: Model[State], limits: Thresholds
) -> Finding[State] | None:
    """Return the best edit with those that explain the data as well; None where none is believed."""
    before = model(state, None)

    def outcome(edit: Edit[State]) -> dict[Key, Evidence]:
        """Return all residuals with an edit."""
        return {**before, **_changed(edit, state, before, model)}

    def over(worse: Residuals, better: Residuals) -> float:
        """Return the log-likelihood of one outcome over another."""
        return sum(better[key].gain(worse[key], limits, complete=False)[0] for key in better)

    scored = [_score(edit, state, before, model, limits) for edit in edits]
    first = max(scored, key=lambda s: s.evidence, default=None)
    if first is None or first.evidence < limits.evidence:
        return None
    rivals, outcomes = [first], [outcome(first.edit)]
    corrected = first.edit.apply(state)
    for one in scored:  # those that explain as much, and are not needed beside it
        if one is first or one.evidence < limits.evidence:
            continue
        with_it = outcome(one.edit)
        if over(with_it, outcomes[0]) + first.edit.prior - one.edit.prior < limits.tie:
            beside = _score(one.edit, corrected, outcomes[0], model, limits)
            if beside.evidence < limits.evidence:
                rivals.append(one)
                outcomes.append(with_it)
    kept = [
        a
        for a, own in zip(rivals, outcomes, strict=True)
        if not any(
            over(own, other) + b.edit.prior - a.edit.prior > limits.tie
            for b, other in zip(rivals, outcomes, strict=True)
        )
    ]
    return Finding(tuple(sorted(kept or [first], key=lambda s: -s.evidence)))


def _changed(edit: Edit[State], state: State, before: Residuals, model: Model[State]) -> Residuals:
    """Return the residuals that an edit changes, of those there were: one that is new has nothing to be compared with."""
    return {key: own for key, own in model(edit.apply(state), edit.lines).items() if key in before}


def _score(
    edit: Edit[State], state: State, before: Residuals, model: Model[State], limits: Thresholds
) -> Scored[State]:
    """Return an edit with what it gains; nothing where no channel is convincing by itself."""
    after = _changed(edit, state, before, model)
    gains = {key: after[key].gain(before[key], limits, edit.complete) for key in after}
    channel = max(
        gains, key=lambda key: (isinstance(after[key], Range) and gains[key][1], gains[key][0]), default=()
    )
    clear = any(convincing for _, convincing in gains.values())
    total = sum(gained for gained, _ in gains.values()) + edit.prior
    return Scored(edit, total if clear else 0.0, channel)
