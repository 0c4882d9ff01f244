"""The default, "ps-gde-lm": PS-GDE with Levenberg-Marquardt refinement on a horizon ladder, and ordered SHADE as safety net."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ladder import Optima, climb, explains, refine_fully
from stoop.optimize.ledger import Evaluations, Ledger, sum_of_squares
from stoop.optimize.local_refinement import AGREE
from stoop.optimize.population import DEFAULT, MEMBERS, Population, latin_hypercube
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, RandomStream, State

FROM_START: Final = 0  #: lineage of a refinement from the user's own values


@dataclass(frozen=True, kw_only=True)
class PsGdeLmState(State):
    """State of a run of the default."""

    starts: FloatArray  #: (k, D + E), the user's own values, until they are tried
    scouts: FloatArray  #: (rounds * scouts, D), one Latin hypercube for every `rounds` rounds
    round: int  #: rounds begun
    queue: FloatArray  #: (q, D), candidates of this round still to be followed up
    passed: bool  #: whether a candidate of this round passed every gate
    resumed: bool  #: whether the best, unfinished refinement was continued in this round
    deferred: FloatArray  #: (s, D + E), candidates that a gate stopped
    scores: FloatArray  #: (s,), their costs over the trivial model's
    least: FloatArray  #: (rungs,), least cost that refinements reached on each rung
    optima: Optima  #: where full refinements ended
    lineages: int  #: how many lineages have begun
    trusted: bool  #: the best is a converged refinement from the user's own values that explains the data
    population: Population | None  #: once the first scouts are used up
    population_size: int  #: of the next population
    #: trajectories of full refinements from deferred candidates, and of unfinished ones
    prolonged: float = 0.0
    evolved: float = 0.0  #: trajectories of populations, refinements of their members included

    @property
    def neglected(self) -> bool:
        """Whether a round ended with candidates of which none passed."""
        return bool(len(self.deferred) and self.round and not self.passed)

    def prolongable(self, least: float) -> bool:
        """Whether there is a deferred candidate, or the best refinement, at the least cost known, ran out of iterations."""
        if self.neglected or self.resumed or not len(self.optima.costs):
            return self.neglected
        best = self.optima.best()
        return bool(self.optima.unfinished[best] and self.optima.costs[best] <= least)


Step = tuple[PsGdeLmState, Event]


@dataclass(frozen=True)
class PsGdeLm:
    """PS-GDE with Levenberg-Marquardt refinement and a horizon ladder.

    A step is the refinement from the user's own values, a scouting round, the follow-up of one candidate, or a
    generation (or refinement) of the population. Full refinements that no gate recommends, and after the first rounds the
    population, may each take as many trajectories as scouting does, in turns: whichever of the three finds the optimum, the
    others at most triple its cost (balanced budgets, as of the restarts of Hansen (2009), Benchmarking a BI-population
    CMA-ES on the BBOB-2009 function testbed, GECCO companion, 2389-2395). The search counts as converged when

    - two refinements of different lineage (scouts, the user's values, one population) come on the full record to
      within 0.1 % of the best cost known, one of them to convergence; three where the model leaves more than a
      tenth of the trivial model's cost (`ladder.Optima.confirmed`); or
    - the refinement from the user's own values converged, explains the data (`ladder.GATE`), and a whole scouting
      round brought nothing better; a candidate that leaves more on a shortened record than this optimum on the
      full one is not followed up the ladder (`ladder.climb`).

    """

    name: str = "ps-gde-lm"
    scouts: int = 20  #: candidates per round
    tops: int = 5  #: of them that are followed up
    rounds: int = 5  #: before the first population

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> PsGdeLmState:
        """Draw the scouts; nothing is evaluated yet."""
        D, width = problem.dimension, problem.dimension + problem.extra
        generator = np.random.Generator(np.random.PCG64(seed))
        scouts = latin_hypercube(self.scouts * self.rounds, D, generator)
        return PsGdeLmState(
            optimizer=self.name,
            generation=0,
            stream=RandomStream.of(generator),
            evaluations=Evaluations.none(problem),
            starts=np.pad(starts, [(0, 0), (0, width - starts.shape[1])]),  # nuisances not given are zero
            scouts=scouts,
            round=0,
            queue=np.empty((0, D)),
            passed=False,
            resumed=False,
            deferred=np.empty((0, width)),
            scores=np.empty(0),
            least=np.full(len(problem.prices), np.inf),
            optima=Optima.none(D),
            lineages=1,
            trusted=False,
            population=None,
            population_size=MEMBERS,
        )

    def step(self, state: PsGdeLmState, problem: Problem) -> Step:
        """Try starts, queued candidates, the best deferred one, an unfinished refinement, scouts, the population."""
        ledger = Ledger.at(problem, state.evaluations)
        scouted = ledger.spent - state.prolonged - state.evolved
        if len(state.starts):
            state, event = _try_starts(state, ledger)
        elif len(state.queue):
            state, event = _follow_up_next(state, ledger)
        elif state.prolonged <= scouted and state.prolongable(ledger.cost):
            before = ledger.spent
            state, event = _prolong(state, ledger)
            state = replace(state, prolonged=state.prolonged + ledger.spent - before)
        elif state.round < self.rounds or state.evolved > scouted:
            state, event = self._scout(state, ledger)
        else:
            before = ledger.spent
            state, event = _evolve(state, ledger)
            state = replace(state, evolved=state.evolved + ledger.spent - before)
        return replace(state, evaluations=ledger.evaluations, generation=state.generation + 1), event

    def _scout(self, state: PsGdeLmState, ledger: Ledger) -> Step:
        """Evaluate one round of candidates on the shortest record; the best few are queued."""
        first = state.round % self.rounds * self.scouts
        if state.round and not first:
            generator = state.stream.generator()
            scouts = latin_hypercube(self.scouts * self.rounds, ledger.dimension, generator)
            state = replace(state, scouts=scouts, stream=RandomStream.of(generator))
        X = state.scouts[first : first + self.scouts]
        F = ledger.costs(X, 0)
        order = np.argsort(F, kind="stable")[: self.tops]
        queue = X[order[np.isfinite(F[order])]]
        event = Event("scouts", float(F.min()), 0, f"{len(X)} scouts, {len(queue)} followed up")
        if state.round:
            kept = np.argsort(state.scores, kind="stable")[: int(not state.passed)]
            state = replace(state, deferred=state.deferred[kept], scores=state.scores[kept])
        return replace(state, queue=queue, round=state.round + 1, passed=False, resumed=False), event


def _try_starts(state: PsGdeLmState, ledger: Ledger) -> Step:
    """Refine from the best of the user's values: at once if it explains the data, else by the ladder.

    Where that does not lead to a trusted optimum, the other values join the first scouts.
    """
    # one by one: a budget that ends between them keeps the best of those before
    F = np.array([sum_of_squares(ledger.residuals(z[None, :], ledger.full)[0]) for z in state.starts])
    best = int(F.argmin())
    others = np.delete(state.starts, best, axis=0)[:, : ledger.dimension]
    z = state.starts[best]
    state = replace(state, starts=state.starts[:0])
    if explains(ledger, float(F[best]), ledger.full):
        state, event = _refine(state, ledger, z, FROM_START)
    else:
        state, event = _follow_up(state, ledger, z, FROM_START)
    scouts = state.scouts.copy()
    if not state.trusted:
        scouts[: len(others)] = others[: len(scouts)]
    return replace(state, scouts=scouts), event


def _follow_up_next(state: PsGdeLmState, ledger: Ledger) -> Step:
    """Follow up the next candidate of the queue."""
    z = np.concatenate([state.queue[0], np.zeros(ledger.extra)])
    before = ledger.cost
    state = replace(state, queue=state.queue[1:], lineages=state.lineages + 1)
    state, event = _follow_up(state, ledger, z, state.lineages - 1)
    trusted = state.trusted and ledger.cost >= before * (1.0 - AGREE)
    unbeaten = trusted and not len(state.queue)
    return replace(state, trusted=trusted, converged=state.converged or unbeaten), event


def _prolong(state: PsGdeLmState, ledger: Ledger) -> Step:
    """Refine the best deferred candidate on the full record or, once a round, go on with the unfinished best refinement."""
    if state.neglected:
        z, lineage = state.deferred[int(state.scores.argmin())], state.lineages
        state = replace(state, deferred=state.deferred[:0], scores=state.scores[:0], lineages=lineage + 1)
        return _refine(state, ledger, z, lineage)
    state = replace(state, resumed=True)
    return _refine(state, ledger, ledger.best, int(state.optima.lineages[state.optima.best()]))


def _follow_up(state: PsGdeLmState, ledger: Ledger, z: FloatArray, lineage: int) -> Step:
    """Climb the ladder from z; refine on the full record if every gate opens, else defer the candidate."""
    rungs = len(ledger.prices)
    # a state that was saved with another ladder knows nothing of this one
    least = state.least if len(state.least) == rungs else np.full(rungs, np.inf)
    found = climb(ledger, z, least, ledger.cost if state.trusted else np.inf)
    state = replace(state, least=found.least)
    if found.passed:
        state, event = _refine(state, ledger, found.z, lineage, found.score)
        return replace(state, passed=True), event
    deferred = np.concatenate([state.deferred, found.z[None, :]])
    event = Event("refinement", found.cost, found.rung, "stopped at a gate")
    return replace(state, deferred=deferred, scores=np.append(state.scores, found.score)), event


def _refine(state: PsGdeLmState, ledger: Ledger, z: FloatArray, lineage: int, score: float = 0.0) -> Step:
    """Refine on the full record and see whether that confirms the best."""
    end = refine_fully(ledger, z, state.optima.least_converged(), score)
    optima = state.optima.add(end, lineage)
    confirmed = optima.confirmed(ledger.cost, ledger.reference(ledger.full))
    own = lineage == FROM_START and end.converged and end.cost <= ledger.cost
    trusted = state.trusted or bool(own and explains(ledger, end.cost, ledger.full))
    text = f"{end.ending} after {end.iterations} steps" + (", confirmed" if confirmed else "")
    event = Event("refinement", end.cost, ledger.full, text)
    return replace(state, optima=optima, trusted=trusted, converged=state.converged or confirmed), event


def _evolve(state: PsGdeLmState, ledger: Ledger) -> Step:
    """Start a new population, refine one of its members, or evolve it by one generation."""
    population, generator = state.population, state.stream.generator()
    if population is None or population.exhausted:
        # of a new lineage, as it uses nothing of what was found before
        X = latin_hypercube(state.population_size, ledger.dimension, generator)
        population = Population.first(X, ledger.costs(X, ledger.full))
        size, lineages = DEFAULT.grown(state.population_size), state.lineages + 1
        state = replace(state, population_size=size, lineages=lineages)
        text = f"new population of {len(X)}"
    else:
        if population.age >= population.due:
            member, population = population.next_start(state.optima.X)
            if member is not None:
                return _refine_member(state, population, member, ledger)
        trials = population.ask(generator)
        population = population.tell(trials, ledger.costs(trials.X, ledger.full), generator)
        text = ""
    event = Event("evolution", float(population.F.min()), ledger.full, text)
    return replace(state, population=population, stream=RandomStream.of(generator)), event


def _refine_member(state: PsGdeLmState, population: Population, member: int, ledger: Ledger) -> Step:
    """Refine a member of the population; the end stays in the population."""
    before = ledger.cost
    z = np.concatenate([population.X[member], np.zeros(ledger.extra)])
    state, event = _refine(state, ledger, z, state.lineages - 1)
    improved = ledger.cost < before * (1.0 - 1e-12)
    x = state.optima.X[-1]
    # the population lives where the nuisances are zero: only there may its members be compared
    cost = float(ledger.costs(x[None, :], ledger.full)[0]) if ledger.extra else event.cost
    return replace(state, population=population.with_refined(member, x, cost, improved)), event
