"""One coefficient and its candidate terms, as the rows of a regression; the measures that models are judged by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.regression.domain import Domain


@dataclass(frozen=True, eq=False)
class Rows:
    """A linear regression; constants are taken off, in the domain or by the mean.

    Attributes
    ----------
    y : (n,)
    X : (n, k)
        A column per candidate.
    stretches : tuple of slice
        Rows that belong together: residuals are correlated within them.
    dt : float, s
    domain : Domain
    taken : int
        Degrees of freedom already spent, on constants.
    parents : tuple of tuple of int
        For each column those that it stands on (`stoop.estimate.regression.hierarchy`); none without any.
    """

    y: FloatArray
    X: FloatArray
    stretches: tuple[slice, ...]
    dt: float
    domain: Domain
    taken: int = 0
    parents: tuple[tuple[int, ...], ...] = ()

    @cached_property
    def total(self) -> float:
        """Sum of squares of y."""
        return float(self.y @ self.y)

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(self.y)

    def stands_on(self, column: int) -> tuple[int, ...]:
        """Return the columns without which a column has no meaning."""
        return self.parents[column] if self.parents else ()

    def spread(self, x: FloatArray, v: FloatArray) -> float:
        """Return the variance of x' v for noise of the color that residuals v show."""
        return sum(float(self.domain.spread(x[s, None], v[s], self.dt)[0, 0]) for s in self.stretches)


def stack(parts: Sequence[FloatArray], domain: Domain, dt: float) -> Rows:
    """Return the regression on signals (n, 1 + k) of several stretches, y first.

    A domain in which constants survive leaves them to be taken off: one mean for all stretches.
    """
    turned = [r for p in parts if len(r := domain.rows(p, dt))]
    whole = np.concatenate(turned) if turned else np.empty((0, parts[0].shape[1]))
    edges = np.cumsum([0, *(len(r) for r in turned)])
    if domain.holds_constants and len(whole):
        whole = whole - whole.mean(axis=0)
    slices = tuple(slice(int(a), int(b)) for a, b in pairwise(edges))
    return Rows(whole[:, 0], whole[:, 1:], slices, dt, domain, int(domain.holds_constants))


@dataclass(frozen=True, eq=False)
class Model:
    """Least squares on some columns of a regression.

    Attributes
    ----------
    rows : Rows
    columns : tuple of int
    """

    rows: Rows
    columns: tuple[int, ...]

    @cached_property
    def basis(self) -> FloatArray:
        """Orthonormal columns (n, p) that span the model's."""
        return np.asarray(np.linalg.qr(self.rows.X[:, self.columns])[0])

    @cached_property
    def residual(self) -> FloatArray:
        """What the model leaves (n,)."""
        return self.rows.y - self.basis @ (self.basis.T @ self.rows.y)

    @cached_property
    def rss(self) -> float:
        """Sum of squared residuals."""
        return float(self.residual @ self.residual)

    @property
    def freedom(self) -> int:
        """Degrees of freedom that are left."""
        return self.rows.count - len(self.columns) - self.rows.taken

    @property
    def r2(self) -> float:
        """Share of the sum of squares that is explained."""
        return 1.0 - self.rss / self.rows.total if self.rows.total > 0.0 else 0.0

    @property
    def press(self) -> float:
        """Prediction sum of squares: each row predicted by a fit to all others.

        e_i / (1 - h_ii), with the residual and the leverage of the whole fit, is the residual of the row left
        out (D. M. Allen, Technometrics 16(1), 1974).
        """
        leverage = np.sum(self.basis**2, axis=1) + self.rows.taken / max(self.rows.count, 1)
        return float(np.sum((self.residual / np.maximum(1.0 - leverage, 1e-12)) ** 2))

    def pse(self, largest: float) -> float:
        """Return the predicted squared error: fit error plus a penalty per term for noise of variance `largest`.

        Barron's criterion as Morelli uses it (J. Aircraft 32(6), 1995, eqs. 27 to 29).
        """
        return (self.rss + largest * len(self.columns)) / self.rows.count

    def beyond(self, column: int) -> FloatArray:
        """Return the part (n,) of a column that the model's columns do not span."""
        x = self.rows.X[:, column]
        for _ in range(2):  # once more: rounding
            x = x - self.basis @ (self.basis.T @ x)
        return np.asarray(x)

    def tolerance(self, column: int) -> float:
        """Return the share of a column that the model's columns do not span; one over its variance inflation."""
        x = self.rows.X[:, column]
        size, left = float(x @ x), self.beyond(column)
        return float(left @ left) / size if size > 0.0 else 0.0

    def may_take(self, column: int) -> bool:
        """Whether all that a column stands on is in the model."""
        return set(self.rows.stands_on(column)) <= set(self.columns)

    @property
    def loose(self) -> tuple[int, ...]:
        """Columns that no other column of the model stands on."""
        held = {parent for column in self.columns for parent in self.rows.stands_on(column)}
        return tuple(column for column in self.columns if column not in held)

    def with_column(self, column: int) -> Model:
        """Return the model with one more term."""
        return Model(self.rows, (*self.columns, column))

    def without(self, column: int) -> Model:
        """Return the model with one term less."""
        return Model(self.rows, tuple(c for c in self.columns if c != column))

    def partial_f(self, column: int) -> float:
        """Return the partial F-ratio of a column of the model.

        It is the squared estimate over its variance, which equals (RSS without - RSS with) over the residual
        variance where residuals are white; colored ones raise the variance (Klein and Morelli, section 5.4).
        """
        x = self.without(column).beyond(column)
        effect, spread = float(x @ self.rows.y), self.rows.spread(x, self.residual)
        inflated = spread * self.rows.count / max(self.freedom, 1)
        return effect**2 / inflated if inflated > 0.0 else (np.inf if effect else 0.0)
