"""The loop: steps until an optimum is confirmed, the target reached, or the means used up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import IdentificationError
from stoop.optimize.ledger import Evaluations, Halt, Ledger
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, Optimizer, State

Status = Literal["converged", "target", "budget", "generations", "stalled", "interrupted"]

ADVICE: Final[dict[str, str]] = {
    "converged": "",
    "target": "the target cost was reached and the search ended there; leave it out to go to the optimum",
    "budget": "the trajectories that it may simulate (--budget) ran out; allow more, or narrow the bounds",
    "generations": "the generations that it may take (--generations) ran out; allow more, or narrow the bounds",
    "interrupted": "stopped by the user; resume to go on from the last whole generation",
    "nothing": "no candidate gave a finite cost; check values, bounds and units, or shorten the maneuver",
}


@dataclass(frozen=True)
class Stop:
    """When to give up: steps, trajectories of the full record, a cost that is good enough; whatever comes first.

    The budget is exceeded only by columns of a Jacobian that are taken again because they diverged.
    """

    generations: int = 2000
    budget: float = np.inf
    target_cost: float = -np.inf


@dataclass(frozen=True)
class Progress:
    """What a callback is shown after each step; `state` may be saved."""

    state: State
    event: Event

    @property
    def cost(self) -> float:
        """Best cost so far."""
        return self.state.evaluations.cost

    @property
    def trajectories(self) -> float:
        """Spent so far."""
        return self.state.evaluations.trajectories


@dataclass(frozen=True)
class Outcome:
    """How a run ended."""

    z: FloatArray  #: (D + E,), best point; the center of the box if no candidate was finite
    cost: float  #: its cost on the full record
    trajectories: float  #: spent, in trajectories of the full record, whatever was thrown away included
    generation: int  #: whole steps taken
    status: Status  #: "converged" is found and confirmed
    advice: str  #: what to change if it did not converge; empty if it did
    history: FloatArray = field(repr=False)  #: (k, 2), trajectories spent and best cost at each improvement
    #: after the last whole step, to resume from; None if there was none
    state: State | None = field(repr=False)
    optimizer: str  #: registered name


def minimize(
    optimizer: Optimizer[Any],
    problem: Problem,
    *,
    seed: int,
    starts: FloatArray | None = None,
    stop: Stop = Stop(),
    callback: Callable[[Progress], None] | None = None,
    state: State | None = None,
) -> Outcome:
    """Search for the least cost on the full record.

    A budget, a target or Ctrl-C may end the run inside a step; then the best point of that step counts, and
    `state` is from before the step, so that resuming repeats it and ends where an undisturbed run would.

    Parameters
    ----------
    optimizer, problem, stop
    seed : ignored when resuming
    starts : (k, D) or (k, D + E), own guesses in the unit box, with nuisances where they are known, tried first
    callback : called with a `Progress` after each step
    state : where to go on from

    Raises
    ------
    IdentificationError
        If there is nothing to search, or the state belongs to another run.
    """
    starts = _checked(optimizer, problem, state, starts)
    evaluations = Evaluations.none(problem) if state is None else state.evaluations
    resumed = state is not None
    ledger = Ledger(problem, evaluations, stop.budget, stop.target_cost)
    try:
        if state is None:
            state = optimizer.init(ledger, seed, starts)
        while (status := _status(state, stop)) is None:
            found = optimizer.step(state, ledger)
            if not (isinstance(found, tuple) and len(found) == 2 and isinstance(found[0], State)):
                raise IdentificationError(
                    f"optimizer {optimizer.name}: its step returned {type(found).__name__}, not (state, event)"
                )
            state, event = found
            if callback is not None:
                callback(Progress(state, event))
    except Halt as halt:
        status = halt.status
    except KeyboardInterrupt:
        status = "interrupted"
    except (TypeError, ValueError, LookupError, ArithmeticError) as error:
        if not resumed:
            raise
        what = " ".join(str(error).split())
        raise IdentificationError(
            f"optimize: the search cannot continue from the saved state ({what}); start anew"
        ) from error
    evaluations = ledger.evaluations
    return Outcome(
        z=evaluations.best,
        cost=evaluations.cost,
        trajectories=evaluations.trajectories,
        generation=0 if state is None else state.generation,
        status=status,
        advice=ADVICE[status if np.isfinite(evaluations.cost) or status == "interrupted" else "nothing"],
        history=evaluations.history,
        state=state,
        optimizer=optimizer.name,
    )


def _status(state: State, stop: Stop) -> Status | None:
    """Return why to stop before the next step, if there is a reason."""
    if state.converged:
        return "converged"
    if state.evaluations.cost <= stop.target_cost:
        return "target"
    if state.evaluations.trajectories >= stop.budget:
        return "budget"
    return "generations" if state.generation >= stop.generations else None


def _checked(
    optimizer: Optimizer[Any], problem: Problem, state: State | None, starts: FloatArray | None
) -> FloatArray:
    """Refuse what cannot be searched or resumed; return starts, (k, D) or (k, D + E), their first D in the unit box."""
    dimension, whole = problem.dimension, problem.dimension + problem.extra
    if dimension < 1:
        raise IdentificationError("optimize: no variable is free; free at least one parameter")
    if state is not None and state.optimizer != optimizer.name:
        raise IdentificationError(
            f"optimize: the saved state is of {state.optimizer}, not {optimizer.name}; start anew"
        )
    if state is not None and len(state.evaluations.best) != whole:
        raise IdentificationError(
            f"optimize: the saved state has {len(state.evaluations.best)} variables, the problem {whole}; start anew"
        )
    if starts is None:
        return np.empty((0, dimension))
    own = np.atleast_2d(np.array(starts, dtype=np.float64))
    if own.shape[1] not in (dimension, whole) or not np.isfinite(own).all():
        raise IdentificationError(
            f"optimize: starts must be finite and {dimension} wide, not {own.shape}; give one row per guess"
        )
    own[:, :dimension] = np.clip(own[:, :dimension], 0.0, 1.0)
    return own
