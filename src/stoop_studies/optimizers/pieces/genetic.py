"""What a genetic algorithm with real variables is made of, in the unit box.

Random numbers are drawn in the order in which pymoo's operators draw them, so that a run can be compared with
pymoo's own to the last bit.

References
----------
Deb and Agrawal (1995), Simulated binary crossover for continuous search space, Complex Systems 9, 115-148.
Deb and Goyal (1996), A combined genetic adaptive search (GeneAS) for engineering design, Computer Science and
Informatics 26, 30-45 (polynomial mutation).
Deb, Sindhya and Okabe (2007), Self-adaptive simulated binary crossover for real-parameter optimization, GECCO,
1187-1194 (the distribution cut off at bounds).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, IntArray

MATED: Final = 0.9  #: share of couples that cross over, and of children that may mutate
TOGETHER: Final = 1e-14  #: parents nearer than this in a variable hand it on as it is
SAME: Final = 1e-16  #: distance at which two members are one


def tournament(F: FloatArray, number: int, generator: np.random.Generator) -> IntArray:
    """Return the winners, (number,), of pairs from random permutations; equal costs are drawn by lot."""
    rounds = -(-2 * number // len(F))
    order = np.concatenate([generator.permutation(len(F)) for _ in range(rounds)])
    pairs = order[: 2 * number].reshape(number, 2)
    first, second = F[pairs].T
    winners: IntArray = np.where(first < second, pairs[:, 0], pairs[:, 1])
    for i in np.flatnonzero(first == second):
        winners[i] = generator.choice(pairs[i])
    return winners


@dataclass(frozen=True)
class SimulatedBinary:
    """Simulated binary crossover: children lie about their parents as those of one-point crossover of bits do.

    Attributes
    ----------
    eta : distribution index; the larger, the nearer to the parents
    mated : share of couples that cross over
    crossed : share of a couple's variables that do
    swapped : share of these that change places between the children
    """

    eta: float = 15.0
    mated: float = MATED
    crossed: float = 0.5
    swapped: float = 0.5

    def __call__(self, parents: FloatArray, generator: np.random.Generator) -> FloatArray:
        """Return two children, (2, n, D), of each of n couples, (2, n, D)."""
        mate: BoolArray = generator.random((parents.shape[1],)) < self.mated
        if not mate.any():
            return parents
        generator.random(len(mate))  # pymoo draws here whether a couple's children may change places: all may
        cross = generator.random(parents.shape[1:]) < self.crossed
        cross &= np.abs(parents[0] - parents[1]) > TOGETHER
        near, far = self._children(parents[:, cross], generator.random(int(cross.sum())))
        swap = generator.random(len(near)) < self.swapped
        children = parents.copy()
        children[0, cross] = np.where(swap, far, near)
        children[1, cross] = np.where(swap, near, far)
        children[:, ~mate] = parents[:, ~mate]
        return children

    def _children(self, parents: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the children below and above the parents' middle, (k,) each, of parents (2, k)."""
        low, high = parents.min(axis=0), parents.max(axis=0)
        gap, both = high - low, low + high
        below = 0.5 * (both - self._spread(u, 1.0 + 2.0 * low / gap) * gap)
        above = 0.5 * (both + self._spread(u, 1.0 + 2.0 * (1.0 - high) / gap) * gap)
        return _inside(below), _inside(above)

    def _spread(self, u: FloatArray, room: FloatArray) -> FloatArray:
        """Return the children's distance over the parents', where `room` is the largest that fits the box."""
        share = u * (2.0 - np.power(room, -(self.eta + 1.0)))
        inner = share <= 1.0
        spread: FloatArray = np.power(np.where(inner, share, 1.0 / (2.0 - share)), 1.0 / (self.eta + 1.0))
        return spread


@dataclass(frozen=True)
class Polynomial:
    """Polynomial mutation: a small move, cut off at the bounds, of one variable in D on average.

    Attributes
    ----------
    eta : distribution index; the larger, the smaller the move
    mutated : share of children that may mutate
    """

    eta: float = 20.0
    mutated: float = MATED

    def __call__(self, children: FloatArray, generator: np.random.Generator) -> FloatArray:
        """Return the children, (n, D), after mutation."""
        number, dimension = children.shape
        moved = generator.random(children.shape) < min(0.5, 1.0 / dimension)
        mutants = children.copy()
        x = children[moved]
        mutants[moved] = _inside(x + self._move(x, generator.random(len(x))))
        spared = generator.random(number) > self.mutated
        mutants[spared] = children[spared]
        return mutants

    def _move(self, x: FloatArray, u: FloatArray) -> FloatArray:
        """Return by how much places x, (k,), are moved by uniform numbers u, (k,): down below one half."""
        down = u <= 0.5
        far = np.power(1.0 - np.where(down, x, 1.0 - x), self.eta + 1.0)
        base = np.where(down, 2.0 * u + (1.0 - 2.0 * u) * far, 2.0 * (1.0 - u) + 2.0 * (u - 0.5) * far)
        reach = np.power(base, 1.0 / (self.eta + 1.0))
        move: FloatArray = np.where(down, reach - 1.0, 1.0 - reach)
        return move


def repeated(new: FloatArray, *others: FloatArray) -> BoolArray:
    """Return which of the new, (n,), are the same as an earlier one of them, or as one of the others."""
    known = np.asarray(np.tril(_same(new, new), -1).any(axis=1))
    for other in others:
        if len(other):
            known |= _same(new, other).any(axis=1)
    return known


def _same(A: FloatArray, B: FloatArray) -> BoolArray:
    """Return whether members of A, (a, D), and B, (b, D), are one, (a, b)."""
    from scipy.spatial.distance import cdist

    same: BoolArray = cdist(A, B, "sqeuclidean") <= SAME**2
    return same


def _inside(x: FloatArray) -> FloatArray:
    """Return x in the unit box; only rounding takes it out."""
    inside: FloatArray = np.minimum(np.maximum(x, 0.0), 1.0)
    return inside
