"""Normal equations of tall, thin least squares, rounded the same for any number of BLAS threads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, starmap
from typing import Final, TypeAlias

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from stoop.base.arrays import FloatArray, IntArray

STRETCH: Final = 2048  #: of the long axis, over which it is seen which variables have a part


def square(rows: FloatArray) -> FloatArray:
    """Return rows @ rows.T, (v, v), by slices of so few products that BLAS takes one thread."""
    v, n = rows.shape
    width = max(8, 200_000 // max(1, v * v))  # OpenBLAS takes more threads from 262,144 on
    product = np.zeros((v, v))
    for start in range(0, n, width):
        piece = rows[:, start : start + width]
        product += piece @ piece.T
    return product


@dataclass(frozen=True, eq=False)
class TallMatrix:
    """A tall, thin matrix (n, v), by stretches of its long axis, each with the variables that have a part there."""

    shape: tuple[int, int]  #: (n, v)
    stretches: tuple[slice, ...]  #: slices of the long axis
    present: tuple[IntArray, ...]  #: variables with a part in each stretch
    parts: tuple[FloatArray, ...]  #: their rows there

    @classmethod
    def of(cls, rows: FloatArray) -> TallMatrix:
        """Take the matrix from its transpose (v, n)."""
        v, n = rows.shape
        stretches = tuple(slice(start, min(start + STRETCH, n)) for start in range(0, n, STRETCH))
        # greatest and least instead of magnitudes: no copy of what may be tens of megabytes
        high = np.array([rows[:, s].max(axis=1) for s in stretches]).reshape(len(stretches), v)
        low = np.array([rows[:, s].min(axis=1) for s in stretches]).reshape(len(stretches), v)
        present = tuple(np.flatnonzero(there) for there in (high != 0.0) | (low != 0.0))  # NaN too
        parts = tuple(rows[some, s] for some, s in zip(present, stretches, strict=True))
        return cls((n, v), stretches, present, parts)

    @classmethod
    def stacked(cls, parts: Sequence[tuple[IntArray, FloatArray]], variables: int) -> TallMatrix:
        """Return the matrix of stretches one after the other: the variables of each, and their rows (v_i, n_i) there."""
        ends = np.cumsum([0, *(rows.shape[1] for _, rows in parts)]).tolist()
        present, rows = tuple(some for some, _ in parts), tuple(rows for _, rows in parts)
        return cls((ends[-1], variables), tuple(starmap(slice, pairwise(ends))), present, rows)

    def below(self, largest: float) -> TallMatrix:
        """Return the matrix without the variables with numbers that are not below `largest` anywhere."""
        sound = np.ones(self.shape[1], dtype=np.bool_)
        for some, part in zip(self.present, self.parts, strict=True):
            if part.shape[1]:
                sound[some] &= (part.max(axis=1) < largest) & (part.min(axis=1) > -largest)
        if sound.all():
            return self
        kept = [sound[some] for some in self.present]
        pairs = [(some[k], part[k]) for some, part, k in zip(self.present, self.parts, kept, strict=True)]
        return type(self).stacked(pairs, self.shape[1])

    def of_variables(self, chosen: IntArray) -> TallMatrix:
        """Return the matrix of some variables alone, in their order."""
        place = np.full(self.shape[1], -1)
        place[chosen] = np.arange(len(chosen))
        kept = [place[some] >= 0 for some in self.present]
        pairs = zip(self.present, self.parts, kept, strict=True)
        parts = [(place[some[k]], part if k.all() else part[k]) for some, part, k in pairs]
        return type(self).stacked(parts, len(chosen))

    def rows(self, numbers: IntArray) -> FloatArray:
        """Return some rows of the matrix, (m, v)."""
        out = np.zeros((len(numbers), self.shape[1]))
        for some, s, part in zip(self.present, self.stretches, self.parts, strict=True):
            inside = np.flatnonzero((numbers >= s.start) & (numbers < s.stop))
            out[np.ix_(inside, some)] = part[:, numbers[inside] - s.start].T
        return out

    def dense(self) -> FloatArray:
        """Return the whole matrix (n, v), column-major."""
        out = np.zeros(self.shape[::-1])
        for some, s, part in zip(self.present, self.stretches, self.parts, strict=True):
            out[some, s] = part
        return out.T

    def gram(self) -> FloatArray:
        """Return its product with its own transpose, (v, v)."""
        total = np.zeros((self.shape[1], self.shape[1]))
        for some, part in zip(self.present, self.parts, strict=True):
            total[np.ix_(some, some)] += square(part)
        return 0.5 * (total + total.T)

    def project(self, r: FloatArray) -> FloatArray:
        """Return the product of its transpose with r, (v,)."""
        out = np.zeros(self.shape[1])
        for some, s, part in zip(self.present, self.stretches, self.parts, strict=True):
            out[some] += project(part, r[s])
        return out

    def apply(self, step: FloatArray) -> FloatArray:
        """Return its product with a step (v,), (n,)."""
        out = np.empty(self.shape[0])
        for some, s, part in zip(self.present, self.stretches, self.parts, strict=True):
            out[s] = project(part.T, step[some])
        return out


#: derivatives (n, v), with their zeros or by stretches
Jacobian: TypeAlias = FloatArray | TallMatrix


def tall(jacobian: Jacobian) -> TallMatrix:
    """Return a Jacobian by stretches."""
    return jacobian if isinstance(jacobian, TallMatrix) else TallMatrix.of(jacobian.T)


def dense(jacobian: Jacobian) -> FloatArray:
    """Return a Jacobian as an array (n, v)."""
    return jacobian.dense() if isinstance(jacobian, TallMatrix) else jacobian


def project(rows: FloatArray, r: FloatArray) -> FloatArray:
    """Return rows @ r, summed without BLAS: a threaded product rounds by the number of threads."""
    product: FloatArray = np.einsum("vn,n->v", rows, r)
    return product


def solve_damped(normal: FloatArray, right: FloatArray, damping: float) -> FloatArray:
    """Solve (A + damping diag A) x = b, scaled to a unit diagonal, so that units do not matter.

    A variable that nothing depends on (zero diagonal) stays where it is. The solution is NaN where A or b is not finite.
    """
    if not (np.isfinite(normal).all() and np.isfinite(right).all()):
        return np.full(len(right), np.nan)
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-24 * max(float(np.diag(normal).max()), 1e-276)))
    unit = normal / np.outer(scale, scale)
    unit[np.diag_indices_from(unit)] += damping
    try:
        x = cho_solve(cho_factor(unit), right / scale)
    except LinAlgError:
        x = np.linalg.lstsq(unit, right / scale, rcond=None)[0]
    solution: FloatArray = np.asarray(x) / scale
    return solution
