"""Which of many candidate terms a regression needs.

Stepwise regression adds the candidate that says most and takes back what has become needless; orthogonal
functions order the candidates by what each says beyond those before it. Both are judged by rules that are
small functions of a model and one of its columns. A column comes in after those that it stands on, and they stay
as long as it does (`stoop.estimate.regression.hierarchy`).

References
----------
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., Sunflyte, 2016,
sections 5.4 and 5.5.
E. A. Morelli, "Global nonlinear aerodynamic modeling using multivariate orthogonal functions", *Journal of
Aircraft* 32(2), 1995, pp. 270-277.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from stoop.estimate.regression.rows import Model, Rows

MOST_STEPS: Final = 200
TOLERANCE: Final = 0.01  #: a candidate of which less is new (variance inflation above 100) is not tried
ROWS_PER_TERM: Final = 3  #: fewer rows cannot carry all candidates at once
SIGNIFICANCE: Final = 0.001  #: chance of a needless term in one coefficient


@dataclass(frozen=True)
class Step:
    """One step.

    Attributes
    ----------
    action : str
        "add" or "remove".
    column : int
    f : float
        Partial F-ratio of the term, when it came or went.
    threshold : float
        What the rule wanted of its measure.
    terms : int
        In the model after the step.
    r2, press, pse : float
        Of the model after the step.
    """

    action: str
    column: int
    f: float
    threshold: float
    terms: int
    r2: float
    press: float
    pse: float


@dataclass(frozen=True, eq=False)
class Selection:
    """What was chosen, in the order of entering, and every step there."""

    model: Model
    steps: tuple[Step, ...]


class Rule(Protocol):
    """Whether a term earns its place."""

    def needs(self, model: Model, column: int) -> bool:
        """Whether a model needs one of its columns."""

    def threshold(self, model: Model) -> float:
        """Return the number that the rule holds its measure against."""


@dataclass(frozen=True)
class PartialF:
    """The partial F-ratio exceeds what the largest of so many needless candidates reaches by chance.

    Attributes
    ----------
    significance : float
        Chance that any needless candidate gets in (Bonferroni).
    """

    significance: float = SIGNIFICANCE

    def threshold(self, model: Model) -> float:
        """Return the quantile of F(1, degrees of freedom)."""
        from scipy.stats import f

        tried = max(model.rows.X.shape[1], 1)
        return float(f.isf(self.significance / tried, 1, max(model.freedom, 1)))

    def needs(self, model: Model, column: int) -> bool:
        """Whether F is beyond the threshold."""
        return model.partial_f(column) > self.threshold(model)


@dataclass(frozen=True)
class Press:
    """The prediction sum of squares falls with the term."""

    def threshold(self, model: Model) -> float:
        """Return zero: any fall counts."""
        return 0.0

    def needs(self, model: Model, column: int) -> bool:
        """Whether PRESS would rise without the term."""
        return model.press < model.without(column).press


def stepwise(rows: Rows, rule: Rule = PartialF()) -> Selection:
    """Add the candidate that explains most of what is left, take back what is no longer needed, until nothing moves.

    This is done twice: from no term at all, and from all candidates, needless ones taken out first. Terms that
    cancel each other - static stability, damping and elevator in a slow pitching moment - explain nothing one
    by one, so the way up misses them; the way down does not. The end with the lower PRESS is kept.

    Parameters
    ----------
    rows : Rows
    rule : Rule
    """
    ends = [_moved(Model(rows, ()), rule)]
    everything = _independent(rows)
    if rows.count > ROWS_PER_TERM * len(everything):
        ends.append(_moved(Model(rows, everything), rule))
    return min(ends, key=lambda end: end.model.press)


def _independent(rows: Rows) -> tuple[int, ...]:
    """Return the candidates in their order, less those that the ones before span."""
    model = Model(rows, ())
    for column in sorted(range(rows.X.shape[1]), key=lambda c: len(rows.stands_on(c)) > 0):
        if model.may_take(column) and model.tolerance(column) >= TOLERANCE:
            model = model.with_column(column)
    return model.columns


def _moved(model: Model, rule: Rule) -> Selection:
    """Move from a model until no term wants in or out."""
    model, steps = _pruned(model, rule)
    seen = {frozenset(model.columns)}
    while len(steps) < MOST_STEPS:
        moved = _added(model, rule)
        if moved is None:
            break
        model, step = moved
        model, taken_back = _pruned(model, rule)
        steps += [step, *taken_back]
        if frozenset(model.columns) in seen:  # in and out again: it would go on for ever
            break
        seen.add(frozenset(model.columns))
    return Selection(model, tuple(steps))


def _added(model: Model, rule: Rule) -> tuple[Model, Step] | None:
    """Return the model with the most telling candidate, if the rule wants it."""
    column = most_telling(model)
    if column is None:
        return None
    larger = model.with_column(column)
    return (larger, told("add", larger, larger, column, rule)) if rule.needs(larger, column) else None


def _pruned(model: Model, rule: Rule) -> tuple[Model, list[Step]]:
    """Take out needless terms, the least telling first."""
    steps = list[Step]()
    while model.columns:
        weakest = min(model.loose, key=model.partial_f)
        if rule.needs(model, weakest):
            break
        smaller = model.without(weakest)
        steps.append(told("remove", model, smaller, weakest, rule))
        model = smaller
    return model, steps


def most_telling(model: Model) -> int | None:
    """Return the candidate outside the model that lowers the sum of squares most; None where none is new."""
    gains = {}
    for column in range(model.rows.X.shape[1]):
        if column in model.columns or model.freedom < 2 or not model.may_take(column):
            continue
        if model.tolerance(column) < TOLERANCE:
            continue
        x = model.beyond(column)
        gains[column] = float(x @ model.rows.y) ** 2 / float(x @ x)
    return max(gains, key=gains.__getitem__) if gains else None


def told(action: str, judged: Model, after: Model, column: int, rule: Rule) -> Step:
    """Return the record of a step."""
    return Step(
        action, column, judged.partial_f(column), rule.threshold(judged),
        len(after.columns), after.r2, after.press, after.pse(largest_noise(after.rows)),
    )  # fmt: skip


def largest_noise(rows: Rows) -> float:
    """Return the variance of y: no noise can be larger (Morelli's sigma_max^2)."""
    return rows.total / max(rows.count, 1)


def orthogonal(rows: Rows) -> Selection:
    """Order candidates by what each says beyond those before it; cut where the predicted squared error is least.

    Gram-Schmidt orthogonalization makes what each function explains independent of those that follow, so the
    order is found one by one and the error falls by a known amount at each.
    """
    model, steps = Model(rows, ()), list[Step]()
    largest = largest_noise(rows)
    best, kept = model.pse(largest), 0
    while (column := most_telling(model)) is not None and len(steps) < MOST_STEPS:
        model = model.with_column(column)
        freedom = max(model.freedom, 1)
        f = float(model.without(column).rss - model.rss) / max(model.rss / freedom, np.finfo(float).tiny)
        pse = model.pse(largest)
        steps.append(Step("add", column, f, best, len(model.columns), model.r2, model.press, pse))
        best, kept = (pse, len(steps)) if pse < best else (best, kept)
    columns = tuple(step.column for step in steps[:kept])
    return Selection(Model(rows, columns), tuple(steps))
