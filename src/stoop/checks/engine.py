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

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Generic, Protocol, TypeAlias, TypeVar

import numpy as np

from stoop.base.arrays import FloatArray

State = TypeVar("State")


@dataclass(frozen=True)
class Thresholds:
    """Limits of the test, chosen so that no clean simulated flight is accused (tests/unit/checks/test_clean_flights.py).

    Attributes
    ----------
    evidence : log-likelihood gained by an edit that is believed; about a hundred edits are tried, each of which a right
        file would gain so much less than once in 3,000
    tie : difference of log-likelihood below which no edit is preferred: odds of ten to one
    improvement : share of a residual's mean square that an edit must leave at most in one channel; less may be coloured noise
    visible : share of a residual's mean square that an edit must change at least, to be judged there
    unexplained : share of a motion's mean square that an edit which needs to explain it by itself may leave
    margin : share of a motion's mean square by which such an edit must explain more: models of vehicles are never exact
    busiest : share of the record that is compared, where the edit changes most: short maneuvers in long logs count
    spans : independent samples, at least
    rounds : wrong lines that are looked for one after the other
    """

    evidence: float = 8.0
    tie: float = 2.3
    improvement: float = 0.5
    visible: float = 0.5
    unexplained: float = 0.3
    margin: float = 0.1
    busiest: float = 0.2
    spans: float = 10.0
    rounds: int = 3


LIMITS: Final = Thresholds()


@dataclass(frozen=True)
class Edit(Generic[State]):
    """One line, or several that go together, written otherwise.

    Attributes
    ----------
    kind : "sign", "unit", "exchange", "spin", ...: part of the notice's code
    lines : variables of the mapping or entries of the vehicle file whose lines change
    fix : what to write
    apply : data or vehicle -> the same with the edit
    complete : whether it must explain the motion by itself; a unit that shrinks a channel shrinks its noise, too
    prior : logarithm of its odds before any data, against an edit as likely as any
    value : what the line says then, such as a unit
    """

    kind: str
    lines: tuple[str, ...]
    fix: str
    apply: Callable[[State], State]
    complete: bool = False
    prior: float = 0.0
    value: str = ""


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
    """What remains of one channel when others predict it.

    Attributes
    ----------
    left, size : (n,)
        Residual and measured channel, in the unit of the channel; NaN where unknown.
    samples : float
        Samples of the record that are as good as one independent sample.
    floor : float
        Mean square of what is no motion.
    """

    left: FloatArray
    size: FloatArray
    samples: float
    floor: float

    def gain(self, before: object, limits: Thresholds, complete: bool) -> tuple[float, bool]:
        """Compare the samples at which both residuals differ most."""
        if not isinstance(before, Residual):
            raise TypeError("residuals of another kind")
        apart = np.abs(before.left - self.left)
        known = np.isfinite(apart) & np.isfinite(before.size) & np.isfinite(self.size)
        count = int(known.sum())
        many = min(count, max(round(limits.spans * self.samples), round(limits.busiest * count)))
        if many < limits.spans * self.samples:
            return 0.0, False
        most = np.flatnonzero(known)[np.argsort(-apart[known], kind="stable")[:many]]
        was, now = (float(np.mean(r.left[most] ** 2)) + 1e-3 * self.floor for r in (before, self))
        if float(np.mean(apart[most] ** 2)) < max(self.floor, limits.visible * min(was, now)):
            return 0.0, False
        motion = float(np.mean(self.size[most] ** 2))
        whole = now < min(limits.unexplained * motion, was - limits.margin * motion)
        clear = now < limits.improvement * was and (whole or not complete)
        return 0.5 * many / self.samples * float(np.log(was / now)), clear


@dataclass(frozen=True)
class Range:
    """A number that lies within bounds in any flight.

    Attributes
    ----------
    value, low, high : float
    odds : float
        Logarithm of how much less likely a number outside is.
    """

    value: float
    low: float
    high: float
    odds: float

    @property
    def violated(self) -> bool:
        """Whether the number lies outside; one that is unknown does not."""
        return self.value < self.low or self.value > self.high

    def gain(self, before: object, limits: Thresholds, complete: bool) -> tuple[float, bool]:
        """Return the odds that the edit wins or loses."""
        if not isinstance(before, Range):
            raise TypeError("evidence of another kind")
        gained = before.odds * before.violated - self.odds * self.violated
        return gained, gained > 0.0


@dataclass(frozen=True)
class Scored(Generic[State]):
    """An edit, the log-likelihood that it gains, and the channel that gains most by it."""

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


def search(
    state: State,
    edits: Callable[[State], Iterable[Edit[State]]],
    model: Model[State],
    limits: Thresholds = LIMITS,
) -> tuple[list[Finding[State]], State]:
    """Return the wrong lines, most evident first, and the data with them corrected."""
    found: list[Finding[State]] = []
    for _ in range(limits.rounds):
        tested = _Test(state, model, limits)
        finding = tested.best(edits(state))
        if finding is None:
            break
        found.append(finding)
        state = finding.best.apply(state)
    return found, state


class _Test(Generic[State]):
    """The edits of one state, held against it and against each other."""

    def __init__(self, state: State, model: Model[State], limits: Thresholds) -> None:
        self.state, self.model, self.limits = state, model, limits
        self.before = model(state, None)

    def best(self, edits: Iterable[Edit[State]]) -> Finding[State] | None:
        """Return the best edit with those that explain the data as well; None where none is believed."""
        scored = [self._score(edit, self.state, self.before) for edit in edits]
        first = max(scored, key=lambda s: s.evidence, default=None)
        if first is None or first.evidence < self.limits.evidence:
            return None
        rivals = [first, *(s for s in scored if s is not first and self._rivals(s, first))]
        outcomes = [self._outcome(s.edit) for s in rivals]
        beaten = [
            any(
                self._over(one, other) + b.edit.prior - a.edit.prior > self.limits.tie
                for b, other in zip(rivals, outcomes, strict=True)
            )
            for a, one in zip(rivals, outcomes, strict=True)
        ]
        kept = [s for s, lost in zip(rivals, beaten, strict=True) if not lost]
        return Finding(tuple(sorted(kept or [first], key=lambda s: -s.evidence)))

    def _rivals(self, other: Scored[State], first: Scored[State]) -> bool:
        """Tell whether an edit explains as much as the best one, and is not needed beside it."""
        if other.edit.complete and other.evidence < self.limits.evidence:
            return False
        left = self._outcome(first.edit)
        lost = self._over(self._outcome(other.edit), left) + first.edit.prior - other.edit.prior
        if lost >= self.limits.tie:
            return False
        beside = self._score(other.edit, first.edit.apply(self.state), left)
        return beside.evidence < self.limits.evidence

    def _outcome(self, edit: Edit[State]) -> dict[Key, Evidence]:
        """Return all residuals with an edit."""
        return {**self.before, **self.model(edit.apply(self.state), edit.lines)}

    def _over(self, worse: Residuals, better: Residuals) -> float:
        """Return the log-likelihood of one outcome over another."""
        return sum(better[key].gain(worse[key], self.limits, complete=False)[0] for key in better)

    def _score(self, edit: Edit[State], state: State, before: Residuals) -> Scored[State]:
        """Return an edit with what it gains; nothing where no channel is convincing by itself."""
        after = self.model(edit.apply(state), edit.lines)
        gains = {key: after[key].gain(before[key], self.limits, edit.complete) for key in after}
        channel = max(gains, key=lambda key: gains[key][0], default=())
        clear = any(convincing for _, convincing in gains.values())
        total = sum(gained for gained, _ in gains.values()) + edit.prior
        return Scored(edit, total if clear else 0.0, channel)
