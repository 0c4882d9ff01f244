"""Canonical particle swarm: constriction, and one best place known to all.

References
----------
Kennedy and Eberhart (1995), Particle swarm optimization, IEEE ICNN, 1942-1948.
Clerc and Kennedy (2002), The particle swarm: explosion, stability, and convergence in a multidimensional
complex space, IEEE TEC 6, 58-73: chi = 0.7298 from phi = 2.05 + 2.05.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import Ledger
from stoop.optimize.population import MEMBERS
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, State
from stoop_studies.optimizers.evolution import advanced, begun, clip, first_population

PHI: Final = 2.05  #: weight of a particle's own best, and of the swarm's
CHI: Final = 2.0 / abs(2.0 - 2 * PHI - sqrt((2 * PHI) ** 2 - 8 * PHI))  #: constriction, 0.7298
FASTEST: Final = 0.5  #: largest velocity, in boxes per generation


@dataclass(frozen=True, kw_only=True)
class SwarmState(State):
    """State of a swarm."""

    #: X, V: (n, D) each, places and velocities
    X: FloatArray
    V: FloatArray
    #: B, F: (n, D) and (n,), the best place of each particle so far, and its cost
    B: FloatArray
    F: FloatArray


@dataclass(frozen=True)
class ParticleSwarm:
    """The constricted swarm with global best; it never claims convergence.

    The publication leaves bounds open. Here a particle that would leave the box stops on the bound and its
    velocity there is reversed and halved; velocities begin below a fifth and stay below half of the box.
    """

    name: str = "pso"
    members: int = MEMBERS

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> SwarmState:
        """Evaluate the first places; the user's own values take the first of them."""
        ledger, generator, X, F = first_population(problem, seed, starts, self.members)
        V = 0.2 * (2.0 * generator.random(X.shape) - 1.0)
        return begun(SwarmState, self.name, ledger, generator, X=X, V=V, B=X, F=F)

    def step(self, state: SwarmState, problem: Problem) -> tuple[SwarmState, Event]:
        """Move every particle once."""
        ledger = Ledger.at(problem, state.evaluations)
        generator = state.stream.generator()
        own, all_ = generator.random((2, *state.X.shape))
        leader = state.B[state.F.argmin()]
        V = CHI * (state.V + PHI * own * (state.B - state.X) + PHI * all_ * (leader - state.X))
        V = np.minimum(np.maximum(V, -FASTEST), FASTEST)
        ahead = state.X + V
        X = clip(ahead)
        costs = ledger.costs(X, ledger.full)
        better = costs < state.F
        V = np.where(ahead == X, V, -0.5 * V)
        B, F = np.where(better[:, None], X, state.B), np.where(better, costs, state.F)
        after = advanced(state, ledger, generator, X=X, V=V, B=B, F=F)
        return after, Event("evolution", float(costs.min()), ledger.full)
