"""Canonical particle swarm: constriction, and one best place known to all.

References
----------
Kennedy and Eberhart (1995), Particle swarm optimization, IEEE ICNN, 1942-1948.
Clerc and Kennedy (2002), The particle swarm: explosion, stability, and convergence in a multidimensional
complex space, IEEE TEC 6, 58-73: chi = 0.7298 from phi = 2.05 + 2.05.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Ledger
from stoop.optimize.operators import MEMBERS
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, RandomStream, State
from stoop_studies.optimizers.pieces.evolution import first_population

PHI: Final = 2.05  #: weight of a particle's own best, and of the swarm's
CHI: Final = 2.0 / abs(2.0 - 2 * PHI - sqrt((2 * PHI) ** 2 - 8 * PHI))  #: constriction, 0.7298
FIRST: Final = 0.2  #: largest first velocity, in boxes per generation
FASTEST: Final = 0.5  #: largest velocity, in boxes per generation
BOUNCE: Final = -0.5  #: times the velocity of a particle that ran into a bound


@dataclass(frozen=True, kw_only=True)
class SwarmState(State):
    """State of a swarm.

    Attributes
    ----------
    X, V : (n, D) each, places and velocities
    B, F : (n, D) and (n,), the best place of each particle so far, and its cost
    """

    X: FloatArray
    V: FloatArray
    B: FloatArray
    F: FloatArray


@dataclass(frozen=True)
class ParticleSwarm:
    """The constricted swarm with global best; it never claims convergence.

    The publication leaves bounds open. Here a particle that would leave the box stops on the bound and its
    velocity there is reversed and halved; velocities stay below half the box.

    Attributes
    ----------
    name : registered name
    members : of the swarm
    """

    name: str = "pso"
    members: int = MEMBERS

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> SwarmState:
        """Evaluate the first places; the user's own values take the first of them."""
        ledger, generator, X, F = first_population(problem, seed, starts, self.members)
        V = FIRST * (2.0 * generator.random(X.shape) - 1.0)
        stream, evaluations = RandomStream.of(generator), ledger.evaluations
        return SwarmState(
            optimizer=self.name, generation=0, stream=stream, evaluations=evaluations, X=X, V=V, B=X, F=F
        )

    def step(self, state: SwarmState, problem: Problem) -> tuple[SwarmState, Event]:
        """Move every particle once."""
        ledger = Ledger.at(problem, state.evaluations)
        generator = state.stream.generator()
        own, all_ = generator.random((2, *state.X.shape))
        leader = state.B[state.F.argmin()]
        V = CHI * (state.V + PHI * own * (state.B - state.X) + PHI * all_ * (leader - state.X))
        V = np.minimum(np.maximum(V, -FASTEST), FASTEST)
        ahead = state.X + V
        X = np.minimum(np.maximum(ahead, 0.0), 1.0)
        costs = ledger.costs(X, ledger.full)
        better = costs < state.F
        after = replace(
            state,
            X=X,
            V=np.where(ahead == X, V, BOUNCE * V),
            B=np.where(better[:, None], X, state.B),
            F=np.where(better, costs, state.F),
            generation=state.generation + 1,
            stream=RandomStream.of(generator),
            evaluations=ledger.evaluations,
        )
        return after, Event("evolution", float(costs.min()), ledger.full)
