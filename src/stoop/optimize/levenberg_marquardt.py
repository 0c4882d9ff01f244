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
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Evaluations
from stoop.optimize.minimize import ADVICE as SEARCH_ADVICE
from stoop.optimize.minimize import Progress, Status
from stoop.optimize.state import Event, RandomStream, State

Ending = Literal["converged", "agreed", "stalled", "hopeless", "limit", "diverged"]

MAX_DAMPING: Final = 1e8  #: beyond which no step helps any more
ADVICE: Final[Mapping[str, str]] = {
    **SEARCH_ADVICE,
    "stalled": "no step lowers the cost further, but derivatives promise more; begin nearer, or fix parameters that the "
    "data do not determine",
    "interrupted": "stopped by the user; resume to go on from the last step",
}  #: by the status of successive searches


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


@dataclass(frozen=True, kw_only=True)
class StagesState(State):
    """Successive searches of one fit: where each began, where it stands, and how it ended; the last may be under way."""

    origins: FloatArray  #: (s, n)
    points: FloatArray  #: (s, n)
    costs: FloatArray  #: (s, m), at the origin and after each accepted step, NaN behind
    endings: str  #: of each, separated by commas; empty for one under way
    damping: FloatArray  #: (s, 2), value and factor
    memory: FloatArray = field(default_factory=lambda: np.empty((0, 0)))  #: (s, l) of the models
    start: State | None = None  #: of the search for the origin of the first, where there was one


class StagedModel(LinearModel):
    """A linear model whose point is a vector, so that a search can be saved after every trial."""

    watch: Callable[[Damping], None]

    @property
    @abstractmethod
    def point(self) -> FloatArray:
        """The current point, (n,)."""

    @property
    def memory(self) -> FloatArray:
        """What the model keeps of earlier points, (l,)."""
        return np.empty(0)

    def recall(self, memory: FloatArray) -> None:
        """Take over the `memory` of a saved search, where there was one."""

    @abstractmethod
    def go_to(self, point: FloatArray) -> None:
        """Go to a point; derivatives are not current there."""

    def stopped(self, damping: Damping) -> Ending | None:
        """Keep where the search stands; it goes on."""
        self.watch(damping)
        return None


@dataclass(eq=False)
class Stage:
    """One of successive searches: as a row of `StagesState`."""

    origin: FloatArray
    point: FloatArray
    costs: list[float]
    damping: tuple[float, float]
    memory: FloatArray
    ending: str = ""


class Stages:
    """Successive searches that are saved after every trial and resumed as if uninterrupted.

    A resumed fit repeats what lies between its searches; a search that begins at the point of a saved one is not repeated.

    Parameters
    ----------
    name : str
        Of the method, in its states.
    price : float
        Of a step, in trajectories.
    generations, budget : float
        Steps and trajectories of all searches together, see :class:`stoop.optimize.minimize.Stop`.
    callback : callable, optional
        Called with a `Progress` after each trial.
    state : State, optional
        Where to go on from; of another kind, it is the state of the search for a start.
    """

    def __init__(
        self,
        name: str,
        price: float,
        generations: float = np.inf,
        budget: float = np.inf,
        callback: Callable[[Progress], None] | None = None,
        state: State | None = None,
    ) -> None:
        self.name, self.price, self.generations, self.budget = name, price, generations, budget
        self.callback = callback
        self.stages: list[Stage] = []
        self.start, self._saved = state, list[Stage]()
        if isinstance(state, StagesState):
            self.start = state.start
            memory = state.memory if len(state.memory) else np.empty((len(state.origins), 0))
            rows = zip(
                state.origins, state.points, state.costs, state.damping, memory, state.endings.split(","), strict=True
            )  # fmt: skip
            for origin, point, costs, d, kept, ending in rows if len(state.origins) else ():
                known, damping = costs[np.isfinite(costs)].tolist(), (float(d[0]), float(d[1]))
                self._saved.append(Stage(origin, point, known, damping, kept, ending))

    @property
    def spent(self) -> tuple[int, float]:
        """Steps and trajectories so far, those of the search for a start included."""
        steps = sum(len(stage.costs) - 1 for stage in self.stages)
        if self.start is None:
            return steps, self.price * steps
        before, spent = self.start.generation, self.start.evaluations.trajectories
        return before + steps, spent + self.price * steps

    @property
    def state(self) -> StagesState | None:
        """To resume from; None where nothing was searched yet."""
        if not self.stages and self.start is None:
            return None
        generation, spent = self.spent
        longest = max((len(stage.costs) for stage in self.stages), default=0)
        costs = np.full((len(self.stages), longest), np.nan)
        for row, stage in zip(costs, self.stages, strict=True):
            row[: len(stage.costs)] = stage.costs
        last = self.stages[-1] if self.stages else None
        best, cost = (last.point, last.costs[-1]) if last else (np.empty(0), np.inf)
        return StagesState(
            optimizer=self.name,
            generation=generation,
            stream=RandomStream.from_seed(0),
            evaluations=Evaluations(spent, best, cost, np.empty((0, 2))),
            origins=np.array([stage.origin for stage in self.stages]),
            points=np.array([stage.point for stage in self.stages]),
            costs=costs,
            endings=",".join(stage.ending for stage in self.stages),
            damping=np.array([stage.damping for stage in self.stages]),
            memory=np.array([stage.memory for stage in self.stages]),
            start=self.start,
        )

    def started(self, progress: Progress) -> None:
        """Keep the state of the search for a start."""
        self.start = progress.state
        self._report(progress.event)

    def search(self, model: StagedModel, damping: Damping, max_steps: float = np.inf) -> Status:
        """Search from the model's point, or go on where a saved search from there stands; return how it ended.

        A saved search that had used up its steps goes on if it is given more.
        """
        generation, spent = self.spent
        left = min(self.generations - generation, (self.budget - spent) // self.price)
        max_steps = max(0.0, min(max_steps, left))
        stage = self._saved.pop(0) if self._saved else None
        if stage is None or not np.array_equal(stage.origin, model.point):
            self._saved = []  # another start than that of the saved searches
            begun = (damping.value, damping.factor)
            stage = Stage(model.point, model.point, [model.cost], begun, model.memory)
        self.stages.append(stage)
        if stage.point is not stage.origin:
            model.go_to(stage.point)
            model.recall(stage.memory)
        if stage.ending and stage.ending != "limit":
            return self._status(stage.ending)
        damping.value, damping.factor = stage.damping

        def watch(now: Damping) -> None:
            stage.damping, stage.memory = (now.value, now.factor), model.memory
            if model.cost < stage.costs[-1]:
                stage.point = model.point
                stage.costs.append(model.cost)
            self._report(Event("refinement", model.cost, 0))

        model.watch = watch
        stage.ending = levenberg_marquardt(model, damping, max_steps=max_steps + 1 - len(stage.costs)).ending
        return self._status(stage.ending)

    def _status(self, ending: str) -> Status:
        """Return what an ending means to the user."""
        if ending == "limit":
            return "generations" if self.spent[0] >= self.generations else "budget"
        return "converged" if ending == "converged" else "stalled"

    def _report(self, event: Event) -> None:
        state = self.state
        if self.callback is not None and state is not None:
            self.callback(Progress(state, event))
