"""The state that every optimizer shares, its random numbers, and what a step reports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, TypeVar

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Evaluations
from stoop.optimize.problem import Problem


@dataclass(frozen=True)
class RandomStream:
    """State of a stream of random numbers as a value (the fields of NumPy's PCG64)."""

    state: int
    inc: int
    has_uint32: int
    uinteger: int

    @classmethod
    def of(cls, generator: np.random.Generator) -> RandomStream:
        """Return the state of a generator."""
        state = generator.bit_generator.state
        return cls(state["state"]["state"], state["state"]["inc"], state["has_uint32"], state["uinteger"])

    @classmethod
    def from_seed(cls, seed: int) -> RandomStream:
        """Return the start of the stream of a seed."""
        return cls.of(np.random.Generator(np.random.PCG64(seed)))

    def generator(self) -> np.random.Generator:
        """Return a generator that continues from here; this value does not change."""
        bits = np.random.PCG64(0)
        bits.state = {
            "bit_generator": "PCG64",
            "state": {"state": self.state, "inc": self.inc},
            "has_uint32": self.has_uint32,
            "uinteger": self.uinteger,
        }
        return np.random.Generator(bits)


@dataclass(frozen=True, kw_only=True)
class State:
    """Everything a run needs to continue bit-identically; optimizers add their own fields.

    Attributes
    ----------
    optimizer : registered name
    generation : steps taken
    stream : random numbers
    evaluations : trajectories spent, best so far, history
    converged : an optimum was found and confirmed (see the optimizer's docstring for what confirms it)
    """

    optimizer: str
    generation: int
    stream: RandomStream
    evaluations: Evaluations
    converged: bool = False


@dataclass(frozen=True)
class Event:
    """What one step did, for the progress display; nothing depends on it.

    Attributes
    ----------
    kind : "evolution", "scouts" or "refinement"
    cost : best cost of this step, on the rung it worked on
    rung : that rung
    text : for the display; may be empty
    """

    kind: Literal["evolution", "scouts", "refinement"]
    cost: float
    rung: int
    text: str = ""


S = TypeVar("S", bound=State)


class Optimizer(Protocol[S]):
    """A search: its initial state, and one step."""

    @property
    def name(self) -> str:
        """Registered name."""

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> S:
        """Return the state before the first step.

        Starts are the user's own guesses, (k, D), or (k, D + E) with nuisances; k may be 0. Optimizers that keep the
        nuisances at zero ignore those of the guesses.
        """

    def step(self, state: S, problem: Problem) -> tuple[S, Event]:
        """Do one generation (evolution, scouting round or local refinement); the same state gives the same result."""
