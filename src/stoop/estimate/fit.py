"""The fit: search with frozen weights, then alternate noise estimate and dive until the likelihood rests."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.errors import IdentificationError
from stoop.estimate.equation_error import equation_error
from stoop.estimate.noise import effective_variance, first_variance, noise_variance
from stoop.estimate.ratios import with_mass_held
from stoop.estimate.rotors_seen import check_motors, check_rotors
from stoop.flight import Flight
from stoop.optimize.ledger import Evaluations, Halt
from stoop.optimize.local_refinement import FULL
from stoop.problem import Layout, Misfit, Weights
from stoop.problem.evidence import Evidence, simulation_evidence
from stoop.problem.misfit import horizon_ladder
from stoop.problem.prepare import Prepared, nuisances, prepare
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle

RESTS = 1e-3  #: change of log det R per channel below which the noise estimate has come to rest
MAX_ROUNDS = 30
SEARCH = 0.8  #: of the budget; the rest is for the refinement, without which no nuisance is estimated
MOST_BYTES = 2e9  #: of the sensitivities of all samples
SETTLING = 3  #: dives at most before the weights are frozen
SETTLED = 0.05  #: change of log det R per channel below which they need no further dive
UNSEARCHED = "stopped by the user before the search: the estimates are those of a first dive; run it again"
STOPPED = "stopped by the user while the estimates were refined"
UNRESTED = (
    "The noise estimate did not come to rest: weights and error bars are approximate. Allow a larger budget."
)
SHORT = optimize.Settings(iterations=40, gain=1e-4, predicted=1e-4, stall=0, stall_damping=np.inf)


@dataclass(frozen=True)
class Options:
    """How to search.

    Attributes
    ----------
    optimizer : str
        Name, see :func:`stoop.optimize.names`.
    seed : int
    generations, budget, target_cost
        When to give up, see :class:`stoop.optimize.Stop`; a fifth of the budget is kept for the refinement;
        the few dives that settle the weights count, but are never cut short.
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
    """A finished search.

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
    warnings : tuple of str
    statements : tuple of str
        How to read what this method found.
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
    warnings: tuple[str, ...] = field(default=())
    statements: tuple[str, ...] = field(default=())
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


def pose(
    vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window], options: Options
) -> tuple[Misfit, Prepared]:
    """Turn flights and windows into a least-squares problem.

    Raises
    ------
    IdentificationError
        Nothing is free.
    """
    vehicle = with_mass_held(vehicle) if vehicle.hovers else vehicle
    if vehicle.hovers:
        check_motors(vehicle, flights, windows)
    prepared = without_stuck_channels(vehicle, prepare(vehicle, flights, windows))
    if vehicle.hovers:
        check_rotors(vehicle, prepared.windows, prepared.pieces)
    layout = Layout.of(vehicle, nuisances(vehicle, prepared))
    if layout.dimension == 0:
        raise IdentificationError(f"{vehicle.where}: no number is free; set free = true or use --free NAME")
    for p in layout.parameters:
        if not 0.0 < p.upper - p.lower < np.inf:
            raise IdentificationError(
                f"{vehicle.where}: {p.name}: free, but its bounds are [{p.lower:g}, {p.upper:g}]; write bounds = [low, high]"
            )
    _check_size(vehicle, prepared, layout)
    sigma = np.array([getattr(vehicle.file.sensors, c).sigma for c in vehicle.outputs])
    covariance = sigma**2 if options.covariance is None else options.covariance
    problem = Misfit(layout, prepared.pieces, Weights.of(covariance), horizon_ladder(prepared.pieces))
    return problem, prepared


def _check_size(vehicle: Vehicle, prepared: Prepared, layout: Layout) -> None:
    """Refuse windows whose sensitivities would fill the memory: most often a wrong unit of time."""
    samples = sum(len(p.time) for p in prepared.pieces)
    needed = 8.0 * samples * len(vehicle.outputs) * (layout.dimension + layout.extra)
    if needed > MOST_BYTES:
        seconds = sum(float(p.time[-1] - p.time[0]) for p in prepared.pieces)
        raise IdentificationError(
            f"{vehicle.where}: the windows hold {seconds:.0f} s, {samples} samples, which would need {needed / 1e9:.0f} GB; "
            "fit shorter windows, and check the unit of the log's time"
        )


def starts(problem: Misfit) -> FloatArray:
    """Return first scouts (k, D): the file's own values and the equation-error estimate."""
    layout = problem.layout
    own = layout.unit(np.array([p.value for p in layout.parameters]))
    guess = equation_error(layout, problem.pieces)
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

    Without a given noise covariance the weights are settled first, by dives from the best start; the search
    then runs with frozen weights from there; at last dives and noise estimates alternate until both rest.
    """
    problem, prepared = pose(vehicle, flights, windows, options)
    guesses, spent = starts(problem), 0.0
    if options.covariance is None:
        settled = settle(problem, guesses)
        if settled.interrupted:
            return _unsearched(settled, prepared, options)
        problem, spent = settled.problem, settled.spent
        others = np.pad(guesses, [(0, 0), (0, problem.extra)])
        guesses = np.concatenate([settled.z[None, :], others])
    stop = replace(options.stop, budget=max(SEARCH * (options.budget - spent), float(len(guesses))))
    outcome = optimize.minimize(
        optimize.create(options.optimizer, stop.budget), problem, seed=options.seed, starts=guesses,
        stop=stop, callback=callback, state=state,
    )  # fmt: skip
    if not np.isfinite(outcome.cost):
        raise IdentificationError(f"{vehicle.where}: {outcome.advice}")
    left = options.budget - spent - outcome.trajectories
    done = refine(problem, prepared, outcome, left, estimate_noise=options.covariance is None)
    return replace(done, trajectories=done.trajectories + spent)


def without_stuck_channels(vehicle: Vehicle, prepared: Prepared) -> Prepared:
    """Take a channel that never changes for one that was not measured: it would fit perfectly and rule."""
    stuck = [i for i in range(len(vehicle.outputs)) if _stuck([p.measured[:, i] for p in prepared.pieces])]
    if not stuck:
        return prepared
    pieces = tuple(replace(p, measured=_blanked(p.measured, stuck)) for p in prepared.pieces)
    names = ", ".join(vehicle.outputs[i] for i in stuck)
    note = f"{names}: the readings never change in the fitted windows; taken as not measured"
    return replace(
        prepared, pieces=pieces, notes=(*prepared.notes, note), warnings=(*prepared.warnings, note)
    )


def _stuck(columns: Sequence[FloatArray]) -> bool:
    seen = np.concatenate([c[np.isfinite(c)] for c in columns])
    return seen.size > 1 and float(np.ptp(seen)) <= 1e-12 * max(1.0, float(np.abs(seen).max()))


def _blanked(measured: FloatArray, columns: Sequence[int]) -> FloatArray:
    out = measured.copy()
    out[:, columns] = np.nan
    return out


@dataclass(frozen=True, eq=False)
class Settled:
    """A problem with its weights settled, the place where they were, and what that took."""

    problem: Misfit
    z: FloatArray
    spent: float
    interrupted: bool


def settle(problem: Misfit, guesses: FloatArray) -> Settled:
    """Settle the weights by a few short dives from the best start.

    No budget cuts this short: the weights decide what a cost means, so a search that is resumed with more
    budget must find the same ones.
    """
    problem = problem.weighted(Weights.of(first_variance(problem)))
    costs = problem.costs(guesses, len(problem.prices) - 1)
    z = np.concatenate([guesses[int(np.argmin(costs))], np.zeros(problem.extra)])
    spent = float(len(guesses))
    for _ in range(SETTLING):
        end = _dive(problem, z, SHORT)
        z, spent, before = end.z, spent + end.spent, problem.weights.logdet
        problem = problem.weighted(Weights.of(effective_variance(problem, z)))
        if end.cut_short:
            return Settled(problem, z, spent, interrupted=True)
        if abs(problem.weights.logdet - before) < SETTLED * len(problem.weights.covariance):
            break
    return Settled(problem, z, spent, interrupted=False)


def _unsearched(settled: Settled, prepared: Prepared, options: Options) -> Fit:
    """Return what there is when Ctrl-C came before the search."""
    cost, history = _cost(settled.problem, settled.z), np.empty((0, 2))
    outcome = optimize.Outcome(
        settled.z, cost, 0.0, 0, "interrupted", UNSEARCHED, history, None, options.optimizer
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
    """Alternate the noise estimate and a full dive; population optimizers get their nuisances here.

    An interrupted search is not refined; Ctrl-C during the refinement keeps what there is.
    """
    z, before, spent = outcome.z, np.inf, 0.0
    rested = interrupted = outcome.status == "interrupted"
    for _ in range(0 if interrupted else MAX_ROUNDS):
        end = _dive(problem, z, FULL, budget - spent)
        z, spent = end.z, spent + end.spent
        now = problem.weights.logdet
        rested = not estimate_noise or abs(before - now) < RESTS * len(problem.weights.covariance)
        interrupted = end.cut_short == "interrupted"
        if rested or end.cut_short:
            break
        try:
            before, problem = now, problem.weighted(Weights.of(effective_variance(problem, z)))
        except KeyboardInterrupt:
            interrupted = True
            break
    if interrupted and outcome.status != "interrupted":
        outcome = replace(outcome, status="interrupted", advice=STOPPED)
    notes = () if rested or outcome.status == "interrupted" else (UNRESTED,)
    spent += outcome.trajectories
    warnings = (*prepared.warnings, *notes)
    cost = _cost(problem, z)
    return Fit(problem, prepared, z, outcome, cost, spent, warnings, noise_given=not estimate_noise)


@dataclass(frozen=True, eq=False)
class _End:
    """Where a dive ended, what it took, and what cut it short, if anything did."""

    z: FloatArray
    spent: float
    cut_short: str = ""


def _dive(problem: Misfit, z: FloatArray, settings: optimize.Settings, budget: float = np.inf) -> _End:
    """Dive on the full record; Ctrl-C or an empty purse keeps the best so far."""
    ledger = optimize.Ledger(problem, Evaluations.none(problem), budget)
    try:
        end = optimize.refine(ledger, z, len(problem.prices) - 1, settings)
    except (KeyboardInterrupt, Halt) as reason:
        books = ledger.evaluations
        best = books.best if np.isfinite(books.cost) else z
        return _End(best, books.trajectories, getattr(reason, "status", "interrupted"))
    return _End(end.z if np.isfinite(end.cost) else z, ledger.spent)
