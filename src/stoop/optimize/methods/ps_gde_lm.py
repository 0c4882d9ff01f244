"""The default, "ps-gde-lm": PS-GDE with Levenberg-Marquardt prey on a horizon ladder.

The user's own values first, then scouts on the shortest record whose best few are followed up the ladder, and
ordered SHADE as the safety net. It ends when an optimum is confirmed; see `PsGdeLm`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize import herd as herds
from stoop.optimize.confirmation import Ends, no_ends
from stoop.optimize.herd import Herd
from stoop.optimize.ladder import Descent, descend, explains, finish
from stoop.optimize.ledger import Ledger, blank, opened, sum_of_squares
from stoop.optimize.levenberg import AGREE
from stoop.optimize.pieces.initialization import MEMBERS, latin_hypercube
from stoop.optimize.problem import Problem
from stoop.optimize.state import Event, State
from stoop.optimize.stream import from_generator

FROM_START: Final = 0  #: lineage of a dive from the user's own values


@dataclass(frozen=True, kw_only=True)
class PreyState(State):
    """Where a run of the default stands.

    Attributes
    ----------
    starts : (k, D + E), the user's own values, until they are tried
    scouts : (rounds * scouts, D), one Latin hypercube for all rounds
    round : rounds begun
    queue : (q, D), prey of this round still to be followed
    passed : whether a prey of this round passed every gate
    gone_on : whether the best was followed further in this round
    shelved, scores : (s, D + E) and (s,), prey that a gate stopped, and their costs over the trivial model's
    seen : (rungs,), least cost that dives reached on each rung
    ends : where full dives ended
    lineages : how many lineages have begun
    trusted : the best is a converged dive from the user's own values that explains the data
    herd : the population, once the scouts are used up
    herd_size : of the next herd
    """

    starts: FloatArray
    scouts: FloatArray
    round: int
    queue: FloatArray
    passed: bool
    gone_on: bool
    shelved: FloatArray
    scores: FloatArray
    seen: FloatArray
    ends: Ends
    lineages: int
    trusted: bool
    herd: Herd | None
    herd_size: int


@dataclass(frozen=True)
class PsGdeLm:
    """PS-GDE with Levenberg-Marquardt prey and a horizon ladder.

    A step is the dive from the user's own values, a scouting round, the chase of one prey, or a generation
    (or dive) of the herd. The search counts as converged when

    - two dives of different lineage (scouts, the user's values, one herd) come on the full record to within
      0.1 % of the best cost known, one of them to convergence; three where the model leaves more than a
      tenth of the trivial model's cost (`confirmation`); or
    - the dive from the user's own values converged, explains the data (`ladder.GATE`), and a whole scouting
      round brought nothing better; a prey that leaves more on a shortened record than this optimum on the
      full one is not followed up the ladder (`ladder.descend`).

    Attributes
    ----------
    scouts : candidates per round
    tops : prey per round
    rounds : at most
    """

    name: str = "ps-gde-lm"
    scouts: int = 20
    tops: int = 5
    rounds: int = 5

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> PreyState:
        """Draw the scouts; nothing is evaluated yet."""
        D, width = problem.dimension, problem.dimension + problem.extra
        generator = np.random.Generator(np.random.PCG64(seed))
        scouts = latin_hypercube(self.scouts * self.rounds, D, generator)
        return PreyState(
            optimizer=self.name,
            generation=0,
            stream=from_generator(generator),
            books=blank(problem),
            starts=_widened(starts, width),
            scouts=scouts,
            round=0,
            queue=np.empty((0, D)),
            passed=False,
            gone_on=False,
            shelved=np.empty((0, width)),
            scores=np.empty(0),
            seen=np.full(len(problem.prices), np.inf),
            ends=no_ends(D),
            lineages=1,
            trusted=False,
            herd=None,
            herd_size=MEMBERS,
        )

    def step(self, state: PreyState, problem: Problem) -> tuple[PreyState, Event]:
        """Do what is next."""
        ledger = opened(problem, state.books)
        state, event = self._next(state, ledger)
        return replace(state, books=ledger.books, generation=state.generation + 1), event

    def _next(self, state: PreyState, ledger: Ledger) -> tuple[PreyState, Event]:
        """Choose: starts, queued prey, the best of the shelved, an unfinished dive, scouts, the herd."""
        if len(state.starts):
            return _try_starts(state, ledger)
        if len(state.queue):
            return _chase(state, ledger)
        if len(state.shelved) and state.round and not state.passed:
            return _rescue(state, ledger)
        if _may_go_on(state, ledger):
            return _go_on(state, ledger)
        if state.round < self.rounds:
            return self._scout(state, ledger)
        return _graze(state, ledger)

    def _scout(self, state: PreyState, ledger: Ledger) -> tuple[PreyState, Event]:
        """Look at one round of candidates on the shortest record; the best few are queued."""
        X = state.scouts[state.round * self.scouts : (state.round + 1) * self.scouts]
        F = ledger.costs(X, 0)
        order = np.argsort(F, kind="stable")[: self.tops]
        queue = X[order[np.isfinite(F[order])]]
        event = Event("scouts", float(F.min()), 0, f"{len(X)} scouts, {len(queue)} prey")
        keep = slice(0, None if state.round == 0 else 0)
        return replace(
            state,
            queue=queue,
            round=state.round + 1,
            passed=False,
            gone_on=False,
            shelved=state.shelved[keep],
            scores=state.scores[keep],
        ), event


def _widened(starts: FloatArray, width: int) -> FloatArray:
    """Return starts (k, D + E), nuisances that are not given at zero."""
    return np.pad(starts, [(0, 0), (0, width - starts.shape[1])])


def _try_starts(state: PreyState, ledger: Ledger) -> tuple[PreyState, Event]:
    """Dive from the best of the user's values: at once if it explains the data, else by the ladder.

    Where that does not lead to a trusted optimum, the other values join the first scouts.
    """
    # one by one: a budget that ends between them keeps the best of those before
    F = np.array([sum_of_squares(ledger.residuals(z[None, :], ledger.full)[0]) for z in state.starts])
    best = int(F.argmin())
    others = np.delete(state.starts, best, axis=0)[:, : ledger.dimension]
    z = state.starts[best]
    state = replace(state, starts=state.starts[:0])
    if explains(ledger, float(F[best]), ledger.full):
        state, event = _dive(state, ledger, z, FROM_START)
    else:
        state, event = _follow(state, ledger, z, FROM_START)
    trusted = state.ends.converged.any() and explains(ledger, ledger.cost, ledger.full)
    scouts = state.scouts.copy()
    if not trusted:
        scouts[: len(others)] = others[: len(scouts)]
    return replace(state, scouts=scouts, trusted=bool(trusted)), event


def _chase(state: PreyState, ledger: Ledger) -> tuple[PreyState, Event]:
    """Follow the next prey of the queue."""
    z = np.concatenate([state.queue[0], np.zeros(ledger.extra)])
    before = ledger.cost
    state = replace(state, queue=state.queue[1:], lineages=state.lineages + 1)
    state, event = _follow(state, ledger, z, state.lineages - 1)
    trusted = state.trusted and ledger.cost >= before * (1.0 - AGREE)
    unbeaten = trusted and not len(state.queue)
    return replace(state, trusted=trusted, converged=state.converged or unbeaten), event


def _follow(state: PreyState, ledger: Ledger, z: FloatArray, lineage: int) -> tuple[PreyState, Event]:
    """Go up the ladder from z; dive on the full record if every gate opens, else shelve."""
    descent = descend(ledger, z, state.seen, ledger.cost if state.trusted else np.inf)
    state = replace(state, seen=descent.seen)
    if not descent.passed:
        return _shelve(state, descent)
    state, event = _dive(state, ledger, descent.z, lineage, descent.score)
    return replace(state, passed=True), event


def _shelve(state: PreyState, descent: Descent) -> tuple[PreyState, Event]:
    """Keep a prey that a gate stopped, for a round in which none passes."""
    shelved = np.concatenate([state.shelved, descent.z[None, :]])
    event = Event("dive", descent.cost, descent.rung, "stopped at a gate")
    return replace(state, shelved=shelved, scores=np.append(state.scores, descent.score)), event


def _rescue(state: PreyState, ledger: Ledger) -> tuple[PreyState, Event]:
    """Dive on the full record from the best of the shelved: no prey of the round has passed."""
    z = state.shelved[int(state.scores.argmin())]
    state = replace(state, shelved=state.shelved[:0], scores=state.scores[:0], lineages=state.lineages + 1)
    return _dive(state, ledger, z, state.lineages - 1)


def _may_go_on(state: PreyState, ledger: Ledger) -> bool:
    """Whether the best is the end of a dive that ran out of iterations; once a round."""
    ends = state.ends
    if state.gone_on or not len(ends.costs):
        return False
    return bool(ends.unfinished[ends.best()]) and float(ends.costs[ends.best()]) <= ledger.cost


def _go_on(state: PreyState, ledger: Ledger) -> tuple[PreyState, Event]:
    """Follow the best further."""
    lineage = int(state.ends.lineages[state.ends.best()])
    return _dive(replace(state, gone_on=True), ledger, ledger.best, lineage)


def _dive(
    state: PreyState, ledger: Ledger, z: FloatArray, lineage: int, score: float = 0.0
) -> tuple[PreyState, Event]:
    """Dive on the full record and see whether that confirms the best."""
    end = finish(ledger, z, state.ends.optimum(), score)
    ends = state.ends.add(end, lineage)
    confirmed = ends.confirmed(ledger.cost, ledger.reference(ledger.full))
    text = f"{end.ending} after {end.iterations} steps" + (", confirmed" if confirmed else "")
    event = Event("dive", end.cost, ledger.full, text)
    return replace(state, ends=ends, converged=state.converged or confirmed), event


def _graze(state: PreyState, ledger: Ledger) -> tuple[PreyState, Event]:
    """Move the herd by one generation, one dive, or to a new place."""
    if state.herd is None or herds.spent(state.herd):
        return _gather(state, ledger)
    if state.herd.age < state.herd.due:
        return _evolve(state, state.herd, ledger)
    member, herd = herds.prey(state.herd, state.ends.X)
    if member is None:
        return _evolve(state, herd, ledger)
    return _sacrifice(state, herd, member, ledger)


def _gather(state: PreyState, ledger: Ledger) -> tuple[PreyState, Event]:
    """Gather a new herd, of a new lineage, that knows nothing of what was found before."""
    generator = state.stream.generator()
    X = latin_hypercube(state.herd_size, ledger.dimension, generator)
    herd = herds.gather(X, ledger.costs(X, ledger.full))
    size = herds.grown(state.herd_size)
    event = Event("evolution", float(herd.F.min()), ledger.full, f"new herd of {len(X)}")
    stream = from_generator(generator)
    return replace(state, herd=herd, herd_size=size, lineages=state.lineages + 1, stream=stream), event


def _evolve(state: PreyState, herd: Herd, ledger: Ledger) -> tuple[PreyState, Event]:
    """Move the herd by one generation."""
    generator = state.stream.generator()
    trials = herds.ask(herd, generator)
    costs = ledger.costs(trials.X, ledger.full)
    herd = herds.tell(herd, trials, costs, generator)
    event = Event("evolution", float(herd.F.min()), ledger.full)
    return replace(state, herd=herd, stream=from_generator(generator)), event


def _sacrifice(state: PreyState, herd: Herd, member: int, ledger: Ledger) -> tuple[PreyState, Event]:
    """Dive from a member of the herd; its end stays in the herd."""
    before = ledger.cost
    z = np.concatenate([herd.X[member], np.zeros(ledger.extra)])
    state, event = _dive(state, ledger, z, state.lineages - 1)
    improved = ledger.cost < before * (1.0 - 1e-12)
    x = state.ends.X[-1]
    # the herd lives where the nuisances are zero: only there may its members be compared
    cost = float(ledger.costs(x[None, :], ledger.full)[0]) if ledger.extra else event.cost
    return replace(state, herd=herds.settle(herd, member, x, cost, improved)), event
