"""Output error: search with fixed weights, then alternate noise-covariance estimation and Gauss-Newton refinement.

The alternation ends when the likelihood converges, that is when the determinant of the noise covariance no longer falls.

References
----------
Klein and Morelli, *Aircraft System Identification*, 2nd ed., AIAA, 2016, section 6.2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.checks.vehicle import require_rotor_data, require_rotors
from stoop.errors import IdentificationError
from stoop.estimate.noise import effective_variance, first_variance, noise_variance
from stoop.estimate.ratios import with_mass_held
from stoop.estimate.regression.equations import start_value
from stoop.flight import Flight
from stoop.optimize.ledger import Evaluations, Halt
from stoop.optimize.local_refinement import FULL
from stoop.problem import Layout, Misfit, Weights
from stoop.problem.evidence import Evidence, simulation_evidence
from stoop.problem.misfit import horizon_ladder
from stoop.problem.prepare import Prepared, nuisances, prepare, without_stuck_channels
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle

NOISE_TOLERANCE = 1e-3  #: change of log det R per channel below which the noise covariance has converged
MAX_ROUNDS = 30  #: alternations of noise covariance and refinement
SEARCH_SHARE = 0.8  #: of the budget; the rest is for the refinement, without which no nuisance is estimated
MAX_BYTES = 2e9  #: of the sensitivities of all samples
INITIAL_ROUNDS = 3  #: refinements at most before the weights are fixed for the search
INITIAL_TOLERANCE = 0.05  #: change of log det R per channel below which no further one is needed
STOPPED_BEFORE_SEARCH = (
    "stopped by the user before the search: the estimates are those of a first local refinement; run it again"
)
STOPPED = "stopped by the user while the estimates were refined"
SHORT = optimize.Settings(iterations=40, gain=1e-4, predicted=1e-4, stall=0, stall_damping=np.inf)


@dataclass(frozen=True)
class Options:
    """Settings of an estimator.

    Attributes
    ----------
    optimizer : str
        Name, see :func:`stoop.optimize.names`.
    seed : int
    generations, budget, target_cost
        When to stop, see :class:`stoop.optimize.Stop`; a fifth of the budget is kept for the refinement; the few
        refinements that settle the weights count, but are never cut short.
    covariance : (n_y,) or (n_y, n_y) array, optional
        A given noise covariance, the inverse of eq. (3)'s Q; estimated when absent.
    method : str
        Name, see :func:`stoop.estimate.methods.names`; the vehicle's own when empty: multiple shooting with rotors,
        output error without.
    """

    optimizer: str = "ps-gde-lm"
    seed: int = 0
    generations: int = 2000
    budget: float = 100_000.0
    target_cost: float = -np.inf
    covariance: FloatArray | None = None
    method: str = ""

    @property
    def stop(self) -> optimize.Stop:
        """The optimizer's stopping rule."""
        return optimize.Stop(self.generations, self.budget, self.target_cost)


@dataclass(frozen=True, eq=False)
class Fit:
    """Estimates of any method, and what they rest on.

    Attributes
    ----------
    problem : Misfit
        With the final weights.
    prepared : Prepared
    z : (D + E,)
        The optimum.
    outcome : Outcome
        Of the search with the first weights.
    cost : float
        J at the optimum with the final weights.
    trajectories : float
        Whole-trajectory equivalents, refinement included.
    notices : tuple of Notice
        Of the method: how to read its estimates, and what makes them doubtful; those of the windows are `prepared`'s.
    noise : (n_y, n_y), optional
        Covariance of the measurement noise, where the method estimates it; else it is that of the simulation's
        residuals.
    covariance : (D + E, D + E), optional
        Of parameters and nuisances in SI, where the method gives it with the estimates.
    own_evidence : Evidence, optional
        Where it is not that of the simulation, see :attr:`evidence`.
    simulated : tuple of (n, n_y), optional
        Readings of each piece, where they are not those of one simulation from its first sample.
    white : (D + E, D + E), optional
        Like `covariance`, as if residuals were white, where the method looked at their color.
    local_problem : callable, optional
        Gives the problem (:class:`stoop.optimize.Problem`) whose least-squares optimum is the estimate, for refits near
        it, where `problem` is not that.
    noise_given : bool
        Whether the covariance of the measurement noise was given and not estimated.
    """

    problem: Misfit
    prepared: Prepared
    z: FloatArray
    outcome: optimize.Outcome
    cost: float
    trajectories: float
    notices: tuple[Notice, ...] = ()
    noise: FloatArray | None = None
    covariance: FloatArray | None = None
    own_evidence: Evidence | None = None
    local_problem: Callable[[], Any] | None = None
    simulated: tuple[FloatArray, ...] | None = None
    white: FloatArray | None = None
    noise_given: bool = False

    @cached_property
    def evidence(self) -> Evidence:
        """What the estimates rest on, for error bars; a regression that gives none has `covariance`."""
        return self.own_evidence or simulation_evidence(self.problem, self.z, self.inflation)

    @property
    def inflation(self) -> float:
        """By how much the variance in the weights exceeds that of the residuals, for their correlation."""
        if self.noise_given or self.noise is not None:
            return 1.0
        ratio = np.diag(self.problem.weights.covariance) / noise_variance(self.problem, self.z)
        return float(np.median(ratio))

    @property
    def estimates(self) -> dict[str, float]:
        """Free parameters, SI."""
        values = self.problem.layout.physical(self.z[None, :])[0]
        return {p.name: float(v) for p, v in zip(self.problem.layout.parameters, values, strict=True)}


def estimation_problem(
    vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window], options: Options
) -> tuple[Misfit, Prepared]:
    """Turn flights and windows into a least-squares problem.

    Raises
    ------
    IdentificationError
        Nothing is free.
    """
    vehicle = with_mass_held(vehicle)
    require_rotors(vehicle, flights, windows)
    prepared = without_stuck_channels(vehicle, prepare(vehicle, flights, windows))
    if vehicle.rotors:
        require_rotor_data(vehicle, prepared.windows, prepared.pieces)
    layout = Layout.of(vehicle, nuisances(vehicle, prepared))
    if layout.dimension == 0:
        raise IdentificationError(f"{vehicle.where}: no number is free; set free = true or use --free NAME")
    for p in layout.parameters:
        if not 0.0 < p.upper - p.lower < np.inf:
            raise IdentificationError(
                f"{vehicle.where}: {p.name}: free, but its bounds are [{p.lower:g}, {p.upper:g}]; write bounds = [low, high]"
            )
    samples = sum(len(p.time) for p in prepared.pieces)
    needed = 8.0 * samples * len(vehicle.outputs) * (layout.dimension + layout.extra)
    if needed > MAX_BYTES:  # most often a wrong unit of time
        seconds = sum(float(p.time[-1] - p.time[0]) for p in prepared.pieces)
        raise IdentificationError(
            f"{vehicle.where}: the windows hold {seconds:.0f} s, {samples} samples, which would need {needed / 1e9:.0f} GB; "
            "fit shorter windows, and check the unit of the log's time"
        )
    sigma = np.array([getattr(vehicle.file.sensors, c).sigma for c in vehicle.outputs])
    covariance = sigma**2 if options.covariance is None else options.covariance
    problem = Misfit(layout, prepared.pieces, Weights.of(covariance), horizon_ladder(prepared.pieces))
    return problem, prepared


def starts(problem: Misfit) -> FloatArray:
    """Return starting points (k, D): the file's own values and the equation-error estimate."""
    layout = problem.layout
    own = layout.unit(np.array([p.value for p in layout.parameters]))
    guess = start_value(layout, problem.pieces)
    return np.array([own] if guess is None else [own, guess])


def fit(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    windows: Sequence[Window],
    options: Options = Options(),
    callback: Callable[[optimize.Progress], None] | None = None,
    state: optimize.State | None = None,
) -> Fit:
    """Fit the free numbers of a vehicle to windows of flights, jointly.

    Without a given noise covariance the weights are settled first, by local refinements from the best start; the search
    then runs with fixed weights from there; at last refinement and noise estimate alternate until both converge.
    """
    problem, prepared = estimation_problem(vehicle, flights, windows, options)
    guesses, spent = starts(problem), 0.0
    if options.covariance is None:
        settled = settle(problem, guesses)
        if settled.interrupted:
            return _unsearched(settled, prepared, options)
        problem, spent = settled.problem, settled.spent
        others = np.pad(guesses, [(0, 0), (0, problem.extra)])
        guesses = np.concatenate([settled.z[None, :], others])
    stop = replace(options.stop, budget=max(SEARCH_SHARE * (options.budget - spent), float(len(guesses))))
    outcome = optimize.minimize(
        optimize.create(options.optimizer, stop.budget), problem, seed=options.seed, starts=guesses,
        stop=stop, callback=callback, state=state,
    )  # fmt: skip
    if not np.isfinite(outcome.cost):
        raise IdentificationError(f"{vehicle.where}: {outcome.advice}")
    left = options.budget - spent - outcome.trajectories
    done = refine(problem, prepared, outcome, left, estimate_noise=options.covariance is None)
    return replace(done, trajectories=done.trajectories + spent)


@dataclass(frozen=True, eq=False)
class Settled:
    """A problem with settled weights, the point where they were estimated, and the trajectories that took."""

    problem: Misfit
    z: FloatArray
    spent: float
    interrupted: bool


def settle(problem: Misfit, guesses: FloatArray) -> Settled:
    """Settle the weights by a few short local refinements from the best start.

    No budget cuts this short: the weights decide what a cost means, so a search that is resumed with more
    budget must find the same ones.
    """
    problem = problem.weighted(Weights.of(first_variance(problem)))
    costs = problem.costs(guesses, len(problem.prices) - 1)
    z = np.concatenate([guesses[int(np.argmin(costs))], np.zeros(problem.extra)])
    spent = float(len(guesses))
    for _ in range(INITIAL_ROUNDS):
        end = _refined(problem, z, SHORT)
        z, spent, before = end.z, spent + end.spent, problem.weights.logdet
        problem = problem.weighted(Weights.of(effective_variance(problem, z)))
        if end.cut_short:
            return Settled(problem, z, spent, interrupted=True)
        if abs(problem.weights.logdet - before) < INITIAL_TOLERANCE * len(problem.weights.covariance):
            break
    return Settled(problem, z, spent, interrupted=False)


def _unsearched(settled: Settled, prepared: Prepared, options: Options) -> Fit:
    """Return what there is when Ctrl-C came before the search."""
    cost, history = _cost(settled.problem, settled.z), np.empty((0, 2))
    outcome = optimize.Outcome(
        settled.z, cost, 0.0, 0, "interrupted", STOPPED_BEFORE_SEARCH, history, None, options.optimizer
    )
    return replace(refine(settled.problem, prepared, outcome), trajectories=settled.spent)


def _cost(problem: Misfit, z: FloatArray) -> float:
    return float(np.sum(problem.residuals(z[None, :], len(problem.prices) - 1) ** 2))


def refine(
    problem: Misfit,
    prepared: Prepared,
    outcome: optimize.Outcome,
    budget: float = np.inf,
    estimate_noise: bool = True,
) -> Fit:
    """Alternate noise-covariance estimation and Gauss-Newton refinement until the likelihood converges.

    Population optimizers get their nuisances here.

    An interrupted search is not refined; Ctrl-C during the refinement keeps what there is.
    """
    z, before, spent = outcome.z, np.inf, 0.0
    converged = interrupted = outcome.status == "interrupted"
    for _ in range(0 if interrupted else MAX_ROUNDS):
        end = _refined(problem, z, FULL, budget - spent)
        z, spent = end.z, spent + end.spent
        now = problem.weights.logdet
        converged = not estimate_noise or abs(before - now) < NOISE_TOLERANCE * len(
            problem.weights.covariance
        )
        interrupted = end.cut_short == "interrupted"
        if converged or end.cut_short:
            break
        try:
            before, problem = now, problem.weighted(Weights.of(effective_variance(problem, z)))
        except KeyboardInterrupt:
            interrupted = True
            break
    if interrupted and outcome.status != "interrupted":
        outcome = replace(outcome, status="interrupted", advice=STOPPED)
    notices = () if converged or outcome.status == "interrupted" else (notice("noise-not-converged"),)
    spent += outcome.trajectories
    return Fit(
        problem, prepared, z, outcome, _cost(problem, z), spent, notices, noise_given=not estimate_noise
    )


@dataclass(frozen=True, eq=False)
class _LocalOptimum:
    """Where a local refinement ended, the trajectories it took, and what cut it short, if anything did."""

    z: FloatArray
    spent: float
    cut_short: str = ""


def _refined(
    problem: Misfit, z: FloatArray, settings: optimize.Settings, budget: float = np.inf
) -> _LocalOptimum:
    """Refine locally on the full record; Ctrl-C or a spent budget keeps the best so far."""
    ledger = optimize.Ledger(problem, Evaluations.none(problem), budget)
    try:
        end = optimize.refine(ledger, z, len(problem.prices) - 1, settings)
    except (KeyboardInterrupt, Halt) as reason:
        done = ledger.evaluations
        best = done.best if np.isfinite(done.cost) else z
        return _LocalOptimum(best, done.trajectories, getattr(reason, "status", "interrupted"))
    return _LocalOptimum(end.z if np.isfinite(end.cost) else z, ledger.spent)
