"""The method ``multiple-shooting``.

Gauss-Newton on windows that do not meet yet, alternating with noise-covariance estimation. Where no start of a vehicle
with rotors is near enough for Gauss-Newton, an optimizer first searches windows that begin as they were measured: each
is then a piece of its own, so that even a wrong candidate can be simulated to their end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Final

import numpy as np
from threadpoolctl import threadpool_limits

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.errors import IdentificationError
from stoop.estimate.filter_error.linearization import refuse_free_delays, undelayed
from stoop.estimate.fit import (
    MAX_ROUNDS,
    NOISE_TOLERANCE,
    SEARCH_SHARE,
    Fit,
    Options,
    estimation_problem,
    starts,
)
from stoop.estimate.noise import effective_variance_of, first_variance, variance_of
from stoop.estimate.shooting.following import FollowingWindows
from stoop.estimate.shooting.search import (
    Iterate,
    ShootingProblem,
    Solution,
    solve,
    with_likeliest_wind_steps,
)
from stoop.estimate.shooting.windows import WINDOW_LENGTH, WindowModel, window_model
from stoop.flight import Flight
from stoop.optimize.minimize import Status
from stoop.problem import Layout, Misfit, Weights
from stoop.problem.prepare import Prepared
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle

DEFAULTS: Final = Options()
SECOND_BUDGET: Final = (
    3000.0  #: trajectories of a search after Gauss-Newton from a fair start did not converge
)
POOR: Final = 0.7  #: of the cost of constant readings: a start that is no better is none
ADVICE: Final[dict[Status, str]] = {
    "converged": "",
    "generations": "the windows do not meet at an optimum; begin nearer, or fix what the data cannot tell",
    "interrupted": "stopped by the user",
}


@dataclass(frozen=True)
class MultipleShooting:
    """Multiple shooting.

    Attributes
    ----------
    length : float, s
        Of a window.
    """

    length: float = WINDOW_LENGTH

    def __call__(
        self,
        vehicle: Vehicle,
        flights: Mapping[str, Flight],
        windows: Sequence[Window],
        options: Options = DEFAULTS,
        callback: Callable[[Any], None] | None = None,
        state: Any = None,
    ) -> Fit:
        """Fit windows, see :mod:`stoop.estimate.methods`.

        `callback` and `state` are those of the global search of vehicles with rotors.
        """
        problem, prepared = estimation_problem(vehicle, flights, windows, options)
        refuse_free_delays(problem)
        with threadpool_limits(limits=1, user_api="blas"):  # more threads would round differently
            shifted = replace(problem, pieces=tuple(undelayed(problem, piece) for piece in problem.pieces))
            if options.covariance is None:
                shifted = shifted.weighted(Weights.of(first_variance(shifted)))
            search = GlobalSearch(ShootingProblem.of(shifted, self.length), options, callback, state)
            found, start = self._solve(search, options)
            return self._fit(problem, prepared, found, start)

    def _solve(self, search: GlobalSearch, options: Options) -> tuple[Refined, optimize.Outcome | None]:
        """Return the solution from the best start; search first where all are poor, or where none converges."""
        problem = search.shooting.problem
        nodes = tuple(shots.measured_nodes() for shots in search.shooting.shots)
        guesses = starts(problem)
        start = search.outcome(guesses) if search.wanted(guesses) else None
        padded = list(np.pad(guesses, [(0, 0), (0, problem.extra)]))
        found = self._from(search.shooting, nodes, padded if start is None else [start.z], options, start)
        if start is None and found.status == "generations" and search.model.global_start:
            limited = replace(options, budget=min(SECOND_BUDGET, options.budget))
            start = replace(search, options=limited).outcome(guesses)
            again = self._from(search.shooting, nodes, [start.z], options, start)
            found = again if again.status == "converged" else found
        return found, start

    def _from(
        self,
        problem: ShootingProblem,
        nodes: tuple[FloatArray, ...],
        begins: Sequence[FloatArray],
        options: Options,
        start: optimize.Outcome | None,
    ) -> Refined:
        at = min((problem.iterate(z, nodes) for z in begins), key=lambda p: p.cost)
        if not np.isfinite(at.cost):
            raise IdentificationError(
                f"{problem.problem.layout.vehicle.where}: not even windows of {self.length:g} s can be flown from the "
                "start; check values and units"
            )
        if start is not None and start.status == "interrupted":
            return Refined(problem, at, 0, "interrupted", False)
        return refined(problem, at, options)

    def _fit(
        self, problem: Misfit, prepared: Prepared, found: Refined, start: optimize.Outcome | None
    ) -> Fit:
        at, status = found.at, found.status
        searched = 0.0 if start is None else start.trajectories
        many = searched + float(found.iterations * (problem.dimension + problem.extra + 2))
        outcome = optimize.Outcome(
            at.z, at.cost, many, found.iterations, status, ADVICE[status],
            np.empty((0, 2)) if start is None else start.history, None if start is None else start.state,
            "gauss-newton" if start is None else start.optimizer,
        )  # fmt: skip
        code = window_model(problem.layout.vehicle).notice
        notices = [notice(code, length=self.length, gap=max(at.gap, 1e-15))]
        if start is not None:
            notices.append(notice("global-start", optimizer=start.optimizer, trajectories=searched))
        if not found.noise_converged and status != "interrupted":
            notices.append(notice("noise-not-converged"))
        residuals = found.problem.residuals(at)
        measured = np.any([np.isfinite(r).any(axis=0) for r in residuals], axis=0)
        return Fit(
            problem,
            prepared,
            at.z,
            outcome,
            at.cost,
            many,
            tuple(notices),
            noise=np.diag(np.where(measured, variance_of(found.problem.problem, residuals), np.nan)),
            own_evidence=found.problem.evidence(at),
            local_problem=partial(FollowingWindows.of, found.problem, at),
            simulated=found.problem.simulated(at),
        )


@dataclass(frozen=True, eq=False)
class Refined:
    """Where the alternation of Gauss-Newton and noise estimate ended."""

    problem: ShootingProblem
    at: Iterate
    iterations: int
    status: Status
    noise_converged: bool


def refined(problem: ShootingProblem, at: Iterate, options: Options) -> Refined:
    """Alternate Gauss-Newton and noise-covariance estimation until both converge."""
    schedule = window_model(problem.problem.layout.vehicle).strictness
    problem = replace(problem, strictness=schedule[-1])
    iterations, before, noise_converged, interrupted = 0, np.inf, False, False
    end = Solution(at, False, 0)
    try:
        for _ in range(MAX_ROUNDS):
            end = solve(problem, end.at, schedule if np.isinf(before) else schedule[-1:])
            iterations += end.iterations
            weights = problem.problem.weights
            limit = NOISE_TOLERANCE * len(weights.covariance)
            noise_converged = options.covariance is not None or abs(before - weights.logdet) < limit
            if noise_converged:
                break
            variance = effective_variance_of(problem.problem, problem.residuals(end.at))
            before, problem = weights.logdet, problem.weighted(Weights.of(variance))
            problem = with_likeliest_wind_steps(problem, end.at)
            end = replace(end, at=problem.iterate(end.at.z, end.at.nodes))
    except KeyboardInterrupt:
        interrupted = True
    status: Status = "interrupted" if interrupted else "converged" if end.converged else "generations"
    return Refined(problem, end.at, iterations, status, noise_converged)


@dataclass(frozen=True, eq=False)
class GlobalSearch:
    """The search of a start by an optimizer, in windows that begin as measured."""

    shooting: ShootingProblem
    options: Options
    callback: Callable[[Any], None] | None
    state: Any

    @property
    def model(self) -> WindowModel:
        """How windows begin and meet."""
        return window_model(self.shooting.problem.layout.vehicle)

    @cached_property
    def windowed(self) -> Misfit:
        """The least-squares problem in which every window is a piece that begins as measured.

        Its unknowns are the free parameters and the biases; initial states are not among them.
        """
        problem = self.shooting.problem
        biases = tuple(n for n in problem.layout.nuisances if n.is_bias)
        layout = Layout(problem.layout.vehicle, problem.layout.parameters, biases)
        pieces = []
        for shots in self.shooting.shots:
            states = shots.measured_starts()
            for w, (a, b) in enumerate(zip(shots.edges, shots.edges[1:], strict=False)):
                start = {name: float(values[w]) for name, values in states.items()}
                pieces.append(shots.piece.part(a, b, start))
        return Misfit(layout, tuple(pieces), problem.weights, (tuple(len(p.time) for p in pieces),))

    def wanted(self, guesses: FloatArray) -> bool:
        """Return whether to search before Gauss-Newton: no start (k, D) explains more than constant readings do."""
        if not self.model.global_start:
            return False
        poor = POOR * self.windowed.reference(0)
        return self.state is not None or not float(np.min(self.windowed.costs(guesses, 0))) < poor

    def outcome(self, guesses: FloatArray) -> optimize.Outcome:
        """Return how the search ended, its vector that of the whole problem."""
        options, problem = self.options, self.shooting.problem
        stop = replace(options.stop, budget=max(SEARCH_SHARE * options.budget, float(len(guesses))))
        found = optimize.minimize(
            optimize.create(options.optimizer, stop.budget), self.windowed, seed=options.seed, starts=guesses,
            stop=stop, callback=self.callback, state=self.state,
        )  # fmt: skip
        if not np.isfinite(found.cost):
            raise IdentificationError(f"{problem.layout.vehicle.where}: {found.advice}")
        d, extra = problem.dimension, problem.extra - self.windowed.extra
        return replace(found, z=np.concatenate([found.z[:d], np.zeros(extra), found.z[d:]]))


fit = MultipleShooting()
