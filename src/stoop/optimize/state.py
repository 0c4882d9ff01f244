"""The state that every optimizer shares, and what a step tells about itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, TypeVar

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Books
from stoop.optimize.problem import Problem
from stoop.optimize.stream import Stream


@dataclass(frozen=True, kw_only=True)
class State:
    """Everything a run needs to go on bit-identically; optimizers add their own fields.

    Attributes
    ----------
    optimizer : registered name
    generation : steps taken
    stream : random numbers
    books : trajectories spent, best so far, history
    converged : an optimum was found and confirmed (see the optimizer's docstring for what confirms it)
    """

    optimizer: str
    generation: int
    stream: Stream
    books: Books
    converged: bool = False


@dataclass(frozen=True)
class Event:
    """What one step did, for the progress display; nothing depends on it.

    Attributes
    ----------
    kind : "evolution", "scouts" or "dive"
    cost : best cost that this step saw, on the rung it worked on
    rung : that rung
    text : in plain words; may be empty
    """

    kind: Literal["evolution", "scouts", "dive"]
    cost: float
    rung: int
    text: str = ""


S = TypeVar("S", bound=State)


class Optimizer(Protocol[S]):
    """A search: where it begins, and one step."""

    @property
    def name(self) -> str:
        """Registered name."""

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> S:
        """Return the state before the first step.

        Starts are the user's own guesses, (k, D), or (k, D + E) with nuisances; k may be 0. Who keeps the
        nuisances at zero leaves those of the guesses out.
        """

    def step(self, state: S, problem: Problem) -> tuple[S, Event]:
        """Do one generation (evolution, scouting round or dive); the same state gives the same answer."""
