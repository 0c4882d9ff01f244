"""Which of many candidate terms a regression needs.

Stepwise regression adds the candidate that explains most and removes what has become needless; multivariate orthogonal
functions order the candidates by what each explains beyond those before it. A product or power enters after the
variables that it is made of, which stay as long as it does (marginality: J. A. Nelder, "A reformulation of linear
models", Journal of the Royal Statistical Society A 140(1), 1977).

References
----------
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., Sunflyte, 2016,
sections 5.4 and 5.5.
E. A. Morelli, "Global nonlinear aerodynamic modeling using multivariate orthogonal functions", *Journal of
Aircraft* 32(2), 1995, pp. 270-277.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final, Protocol

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.regression.domain import Domain

MAX_STEPS: Final = 200
TOLERANCE: Final = 0.01  #: least share of a candidate that is new (variance inflation of 100)
ROWS_PER_TERM: Final = 3  #: that elimination from all candidates needs
SIGNIFICANCE: Final = 0.001  #: chance of a needless term in one coefficient


@dataclass(frozen=True, eq=False)
class Regression:
    """One coefficient and its candidate terms; constants are removed, by the domain or by the mean.

    Attributes
    ----------
    y : (n,)
    X : (n, k)
        A column per candidate.
    stretches : tuple of slice
        Rows of one record each: residuals are correlated within them.
    dt : float, s
    domain : Domain
    spent : int
        Degrees of freedom that the constant took.
    parents : tuple of tuple of int
        For each column those of the variables that it is a product or power of; empty without marginality.
    """

    y: FloatArray
    X: FloatArray
    stretches: tuple[slice, ...]
    dt: float
    domain: Domain
    spent: int = 0
    parents: tuple[tuple[int, ...], ...] = ()

    @classmethod
    def of(cls, signals: Sequence[FloatArray], domain: Domain, dt: float) -> Regression:
        """Return the regression on signals (n, 1 + k) of several stretches, y first."""
        rows = [r for s in signals if len(r := domain.rows(s, dt))]
        whole = np.concatenate(rows) if rows else np.empty((0, signals[0].shape[1]))
        edges = np.cumsum([0, *(len(r) for r in rows)])
        if domain.keeps_constants and len(whole):
            whole = whole - whole.mean(axis=0)
        stretches = tuple(slice(int(a), int(b)) for a, b in pairwise(edges))
        return cls(whole[:, 0], whole[:, 1:], stretches, dt, domain, int(domain.keeps_constants))

    @cached_property
    def total(self) -> float:
        """Sum of squares of y."""
        return float(self.y @ self.y)

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(self.y)

    @property
    def max_noise(self) -> float:
        """Variance of y: no noise can be larger (Morelli's sigma_max^2)."""
        return self.total / max(self.count, 1)

    def parents_of(self, column: int) -> tuple[int, ...]:
        """Return the columns that a column needs beside it."""
        return self.parents[column] if self.parents else ()


@dataclass(frozen=True, eq=False)
class Model:
    """Least squares on some columns of a regression."""

    regression: Regression
    columns: tuple[int, ...]

    @cached_property
    def basis(self) -> FloatArray:
        """Orthonormal basis (n, p) of the model's columns."""
        return np.asarray(np.linalg.qr(self.regression.X[:, self.columns])[0])

    @cached_property
    def residual(self) -> FloatArray:
        """Residuals (n,)."""
        return self.regression.y - self.basis @ (self.basis.T @ self.regression.y)

    @cached_property
    def rss(self) -> float:
        """Sum of squared residuals."""
        return float(self.residual @ self.residual)

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the residuals."""
        return self.regression.count - len(self.columns) - self.regression.spent

    @property
    def r2(self) -> float:
        """Coefficient of determination."""
        return 1.0 - self.rss / self.regression.total if self.regression.total > 0.0 else 0.0

    @property
    def press(self) -> float:
        """Prediction sum of squares: each row predicted by a fit to all others.

        e_i / (1 - h_ii), with the residual and the leverage of the whole fit, is the residual of the row left
        out (D. M. Allen, Technometrics 16(1), 1974).
        """
        leverage = np.sum(self.basis**2, axis=1) + self.regression.spent / max(self.regression.count, 1)
        return float(np.sum((self.residual / np.maximum(1.0 - leverage, 1e-12)) ** 2))

    @property
    def pse(self) -> float:
        """Predicted squared error: fit error plus a penalty per term for the largest possible noise.

        Barron's criterion as Morelli uses it (J. Aircraft 32(6), 1995, eqs. 27 to 29).
        """
        return (self.rss + self.regression.max_noise * len(self.columns)) / self.regression.count

    def orthogonal_part(self, column: int) -> FloatArray:
        """Return the part (n,) of a column that the model's columns do not span."""
        x = self.regression.X[:, column]
        for _ in range(2):  # twice, against rounding
            x = x - self.basis @ (self.basis.T @ x)
        return np.asarray(x)

    def tolerance(self, column: int) -> float:
        """Return the share of a column that the model's columns do not span; one over its variance inflation."""
        x = self.regression.X[:, column]
        size, part = float(x @ x), self.orthogonal_part(column)
        return float(part @ part) / size if size > 0.0 else 0.0

    def admits(self, column: int) -> bool:
        """Whether a column is new to the model, and all its parents are in it."""
        parents = set(self.regression.parents_of(column))
        return parents <= set(self.columns) and self.tolerance(column) >= TOLERANCE

    @property
    def removable(self) -> tuple[int, ...]:
        """Columns that are no parents of another column of the model."""
        needed = {parent for column in self.columns for parent in self.regression.parents_of(column)}
        return tuple(column for column in self.columns if column not in needed)

    def with_column(self, column: int) -> Model:
        """Return the model with one more term."""
        return Model(self.regression, (*self.columns, column))

    def without(self, column: int) -> Model:
        """Return the model with one term less."""
        return Model(self.regression, tuple(c for c in self.columns if c != column))

    def partial_f(self, column: int) -> float:
        """Return the partial F-ratio of a column of the model.

        It is the squared estimate over its variance, which equals (RSS without - RSS with) over the residual
        variance where residuals are white; colored ones raise the variance (Klein and Morelli, section 5.4).
        """
        r = self.regression
        x = self.without(column).orthogonal_part(column)
        scatters = (r.domain.scatter(x[s, None], self.residual[s], r.dt)[0, 0] for s in r.stretches)
        effect, variance = float(x @ r.y), sum(map(float, scatters))
        inflated = variance * r.count / max(self.freedom, 1)
        return effect**2 / inflated if inflated > 0.0 else (np.inf if effect else 0.0)

    def best_candidate(self) -> int | None:
        """Return the column outside the model that lowers the sum of squares most; None where none is admitted."""
        gains = {}
        for column in range(self.regression.X.shape[1]):
            if column not in self.columns and self.freedom >= 2 and self.admits(column):
                x = self.orthogonal_part(column)
                gains[column] = float(x @ self.regression.y) ** 2 / float(x @ x)
        return max(gains, key=gains.__getitem__) if gains else None


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
        Of the criterion.
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

    @classmethod
    def to(cls, model: Model, action: str, column: int, f: float, threshold: float) -> Step:
        """Return the step that ended in a model."""
        return cls(action, column, f, threshold, len(model.columns), model.r2, model.press, model.pse)


@dataclass(frozen=True, eq=False)
class Selection:
    """The selected model, columns in the order of entering, and every step there."""

    model: Model
    steps: tuple[Step, ...]


class Criterion(Protocol):
    """Whether a model needs a term."""

    def needs(self, model: Model, column: int) -> bool:
        """Whether a model needs one of its columns."""

    def threshold(self, model: Model) -> float:
        """Return the threshold of the criterion's statistic."""


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

        tried = max(model.regression.X.shape[1], 1)
        return float(f.isf(self.significance / tried, 1, max(model.freedom, 1)))

    def needs(self, model: Model, column: int) -> bool:
        """Whether F is above the threshold."""
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


def stepwise(regression: Regression, criterion: Criterion = PartialF()) -> Selection:
    """Add the candidate that explains most, remove what is no longer needed, until nothing changes.

    Twice: from no term, and from all candidates, needless ones removed first. Terms that cancel each other - static
    stability, damping and elevator in a slow pitching moment - explain nothing one by one, so forward selection misses
    them; backward elimination does not. The end with the lower PRESS is kept.
    """
    ends = [_stepped(Model(regression, ()), criterion)]
    everything = Model(regression, ())
    for column in sorted(range(regression.X.shape[1]), key=lambda c: len(regression.parents_of(c)) > 0):
        if everything.admits(column):
            everything = everything.with_column(column)
    if regression.count > ROWS_PER_TERM * len(everything.columns):
        ends.append(_stepped(everything, criterion))
    return min(ends, key=lambda end: end.model.press)


def _stepped(model: Model, criterion: Criterion) -> Selection:
    """Step from a model until no term comes or goes."""
    model, steps = _pruned(model, criterion)
    seen = {frozenset(model.columns)}
    while len(steps) < MAX_STEPS and (column := model.best_candidate()) is not None:
        larger = model.with_column(column)
        if not criterion.needs(larger, column):
            break
        added = Step.to(larger, "add", column, larger.partial_f(column), criterion.threshold(larger))
        model, removed = _pruned(larger, criterion)
        steps += [added, *removed]
        if frozenset(model.columns) in seen:  # a cycle
            break
        seen.add(frozenset(model.columns))
    return Selection(model, tuple(steps))


def _pruned(model: Model, criterion: Criterion) -> tuple[Model, list[Step]]:
    """Remove needless terms, the weakest first."""
    steps = list[Step]()
    while model.columns:
        weakest = min(model.removable, key=model.partial_f)
        if criterion.needs(model, weakest):
            break
        smaller = model.without(weakest)
        steps.append(
            Step.to(smaller, "remove", weakest, model.partial_f(weakest), criterion.threshold(model))
        )
        model = smaller
    return model, steps


def orthogonal(regression: Regression) -> Selection:
    """Order candidates by what each explains beyond those before it; cut where the predicted squared error is least.

    Gram-Schmidt orthogonalization makes what each function explains independent of those that follow, so the
    order is found one by one and the error falls by a known amount at each.
    """
    model, steps = Model(regression, ()), list[Step]()
    best, kept = model.pse, 0
    while (column := model.best_candidate()) is not None and len(steps) < MAX_STEPS:
        before, model = model, model.with_column(column)
        variance = max(model.rss / max(model.freedom, 1), np.finfo(float).tiny)
        steps.append(Step.to(model, "add", column, float(before.rss - model.rss) / variance, best))
        best, kept = (model.pse, len(steps)) if model.pse < best else (best, kept)
    columns = tuple(step.column for step in steps[:kept])
    return Selection(Model(regression, columns), tuple(steps))
