"""The Levenberg-Marquardt loop: damped Gauss-Newton steps on any linear model, with any strategy of damping.

A `LinearModel` knows where it is, solves for damped steps and evaluates them; a `Damping` decides how strongly the next step
is damped.

References
----------
Levenberg (1944), Quart. Appl. Math. 2, 164-168. Marquardt (1963), SIAM J. Appl. Math. 11, 431-441 (damping scaled by the
diagonal; the tenfold rule).
Nielsen (1999), Damping parameter in Marquardt's method, IMM-REP-1999-05 (the update by the gain ratio).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

Ending = Literal["converged", "agreed", "stalled", "hopeless", "limit", "diverged"]

MAX_DAMPING: Final = 1e8  #: beyond which no step helps any more


@dataclass
class Damping(ABC):
    """How strongly steps are damped, in parts of the (scaled) diagonal of the normal matrix.

    A rejected step multiplies the value by `growth`, which each further rejection multiplies by `acceleration`; beyond the
    largest value the search is exhausted.
    """

    value: float
    growth: float = 2.0
    acceleration: float = 2.0
    smallest: float = 1e-12
    largest: float = MAX_DAMPING

    def __post_init__(self) -> None:
        self.factor = self.growth

    @property
    def exhausted(self) -> bool:
        """Whether no step helps any more."""
        return self.value > self.largest

    def reject(self) -> None:
        """Damp more strongly after a step that did not lower the cost."""
        self.value *= self.factor
        self.factor *= self.acceleration

    def accept(self, ratio: float) -> None:
        """Damp less after a step that gained `ratio` times what the linear model predicted; negative where unknown."""
        self.value = max(self.smallest, self.relaxed(ratio))
        self.factor = self.growth

    @abstractmethod
    def relaxed(self, ratio: float) -> float:
        """Return the damping after a step that lowered the cost."""


@dataclass
class NielsenDamping(Damping):
    """Nielsen's update: a smooth function of the gain ratio; at most divided by 1 / `shrink`."""

    shrink: float = 1.0 / 3.0

    def relaxed(self, ratio: float) -> float:
        """Return the damping times max(shrink, 1 - (2 ratio - 1)^3)."""
        return self.value * max(self.shrink, 1.0 - (2.0 * ratio - 1.0) ** 3) if ratio >= 0.0 else self.value


@dataclass
class TenfoldDamping(Damping):
    """Marquardt's update: a tenth after each step that lowers the cost, whatever the ratio."""

    def relaxed(self, ratio: float) -> float:
        """Return a tenth of the damping."""
        return self.value / 10.0


@dataclass(frozen=True, eq=False)
class Trial:
    """A step that was evaluated: where it leads (as its model has points), the cost there, and the gain that was predicted.

    The cost is infinite or NaN where it diverges; the gain is not positive where none is predicted.
    """

    point: Any
    cost: float
    predicted: float


class LinearModel(ABC):
    """A sum of squares (or twice a negative log-likelihood) with its linear model about the current point."""

    cost: float
    current: bool = False  #: whether there are derivatives for the current point
    exact: bool = False  #: whether these were taken there, not carried there by an update

    @abstractmethod
    def linearize(self) -> None:
        """Take the derivatives at the current point; they are current and exact then."""

    @abstractmethod
    def step(self, damping: float) -> Any:
        """Return the damped step; None where every direction is held by a bound."""

    @abstractmethod
    def evaluate(self, step: Any) -> Trial:
        """Return what the step leads to."""

    @abstractmethod
    def accept(self, trial: Trial, ratio: float) -> None:
        """Go to a trial that lowered the cost by `ratio` times the prediction, and say what its derivatives are."""

    @property
    def optimal(self) -> bool:
        """Whether no search is needed from the current point."""
        return False

    def finished(self, step: Any) -> Ending | Literal["renew"] | None:
        """Return an ending that the linear model tells before a step is evaluated, or that it must be renewed first."""
        return None

    def stopped(self, damping: Damping) -> Ending | None:
        """Return an ending that the course of the search tells after a trial, whether accepted or not."""
        return None

    def settled(self) -> Ending:
        """Return the ending where no step helps any more."""
        return "stalled"


@dataclass(frozen=True)
class Search:
    """How a search ended: `steps` were accepted out of `trials`."""

    ending: Ending
    trials: int
    steps: int


def levenberg_marquardt(
    model: LinearModel, damping: Damping, max_trials: float = np.inf, max_steps: float = np.inf
) -> Search:
    """Minimize from the model's current point, which it leaves at the best one found.

    At most `max_trials` steps are tried and `max_steps` accepted. The ending is "diverged" where the cost is not finite at the
    start, "limit" where trials or steps are used up, "converged" where every direction is held; the others are the model's.
    """
    trials = steps = 0
    if not np.isfinite(model.cost):
        return Search("diverged", 0, 0)
    while trials < max_trials and steps < max_steps:
        trials += 1
        if model.optimal:
            return Search("converged", trials, steps)
        if not model.current:
            model.linearize()
        step = model.step(damping.value)
        ending = "converged" if step is None else model.finished(step)
        if ending == "renew":
            model.current = False
            continue
        if ending is not None:
            return Search(ending, trials, steps)
        trial = model.evaluate(step)
        if trial.cost < model.cost:
            ratio = (model.cost - trial.cost) / trial.predicted if trial.predicted > 0.0 else -1.0
            model.accept(trial, ratio)
            damping.accept(ratio)
            steps += 1
        elif not model.exact:
            model.current = False
        else:
            damping.reject()
            if damping.exhausted:
                return Search(model.settled(), trials, steps)
        ending = model.stopped(damping)
        if ending is not None:
            return Search(ending, trials, steps)
    return Search("limit", trials, steps)
