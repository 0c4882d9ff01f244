"""The paper's local search (section IV.C): golden section along the negative gradient, in the unit box."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Ledger

BETA: Final = (sqrt(5.0) - 1.0) / 2.0
STEP: Final = 1e-6  #: of the forward difference; a cost is rounded more coarsely than a residual


def golden_section(function: Callable[[float], float], low: float, high: float, tolerance: float) -> float:
    """Return the middle of the last two points of a golden-section search for a minimum.

    The paper's Fig. 2, with the evaluation that its first branch leaves out: the interval shrinks until the
    two inner points are nearer than `tolerance`.
    """
    right = low + BETA * (high - low)
    left = low + high - right
    f_right, f_left = function(right), function(left)
    while abs(left - right) >= tolerance:
        if f_left <= f_right:
            high, right, f_right = right, left, f_left
            left = low + high - right
            f_left = function(left)
        else:
            low, left, f_left = left, right, f_right
            right = low + BETA * (high - low)
            f_right = function(right)
    return 0.5 * (left + right)


@dataclass(frozen=True)
class SteepestDive:
    """One step down the gradient, kept if it improves (the paper's steps 4 and 5, repaired).

    Attributes
    ----------
    reach : how far along the unit negative gradient, in the unit box
    tolerance : of the search, relative to the reach
    """

    reach: float = 0.1
    tolerance: float = 0.1

    def __call__(self, ledger: Ledger, x: FloatArray, cost: float) -> tuple[FloatArray, float]:
        """Return where the dive from x ends, and the cost there."""
        gradient = forward_gradient(ledger, x, cost)
        length = float(np.sqrt((gradient * gradient).sum()))
        if not np.isfinite(length) or length == 0.0:
            return x, cost

        def place(t: float) -> FloatArray:
            return np.clip(x - t * gradient / length, 0.0, 1.0)

        def price(t: float) -> float:
            return float(ledger.costs(place(t)[None, :], ledger.full)[0])

        t = golden_section(price, 0.0, self.reach, self.tolerance * self.reach)
        end = price(t)
        return (place(t), end) if end < cost else (x, cost)


def forward_gradient(ledger: Ledger, x: FloatArray, cost: float) -> FloatArray:
    """Return the gradient of the cost by forward differences, backward at an upper bound; D evaluations."""
    steps = np.where(x + STEP <= 1.0, STEP, -STEP)
    with np.errstate(invalid="ignore"):
        gradient: FloatArray = (ledger.costs(x + np.diag(steps), ledger.full) - cost) / steps
    return gradient
