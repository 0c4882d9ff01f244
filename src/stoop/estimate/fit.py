"""Output error: search with fixed weights, then alternate noise-covariance estimation and Gauss-Newton refinement.

The alternation ends when the likelihood converges, that is when the determinant of the noise covariance no longer falls.

References
----------
Klein and Morelli, *Aircraft System Identification*, 2nd ed., AIAA, 2016, section 6.2.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, ClassVar, Final, Generic, TypeAlias, TypeVar

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.base.blas import on_one_blas_thread
from stoop.base.notices import notice
from stoop.checks.excitation import MASS, with_mass_held
from stoop.checks.vehicle import require_channels, require_data
from stoop.errors import IdentificationError
from stoop.estimate import iterates
from stoop.estimate.estimate import Estimate, simulation_inflation
from stoop.estimate.noise import (
    channel_residuals,
    color_record,
    colored_weights,
    common_time,
    effective_variance,
    first_variance,
    noise_covariance,
)
from stoop.estimate.noise_model import with_noise
from stoop.estimate.refit_problem import SimulationProblem
from stoop.estimate.regression import start_value
from stoop.estimate.treatment import DEFAULT as TREATMENT
from stoop.estimate.treatment import Treatment
from stoop.flight import Flight
from stoop.optimize.ledger import Evaluations, Halt
from stoop.optimize.local_refinement import FULL
from stoop.problem import Layout, Misfit, Weights
from stoop.problem.evidence import Evidence, observed_information, simulation_evidence
from stoop.problem.misfit import horizon_ladder
from stoop.problem.prepare import Prepared, at_readings, decoupled
from stoop.problem.windows import Window
from stoop.results.decisions import DecisionRecord
from stoop.vehicle import Vehicle

#: of the sensitivities of all samples
MAX_BYTES = 2e9
Callback: TypeAlias = Callable[[optimize.Progress], None] | None
State: TypeAlias = optimize.State | None
FittedT = TypeVar("FittedT", bound=Estimate, covariant=True)


@dataclass(frozen=True)
class Alternation:
    """Rounds of refinement and noise estimate: at most `rounds`, until log det R per channel changes by < `tolerance`."""

    rounds: int
    tolerance: float

    def fall(self, before: float, problem: Misfit) -> float:
        """Return by how many tolerances log det R per channel fell since the round before."""
        return (before - problem.noise_logdet) / (self.tolerance * len(problem.weights.covariance))


#: before the weights are fixed for the search
SETTLING: Final = Alternation(3, 0.05)
#: after it
ALTERNATION: Final = Alternation(30, 1e-3)
SHORT: Final = optimize.Settings(iterations=40, gain=1e-4, predicted=1e-4, stall=0, stall_damping=np.inf)


@dataclass(frozen=True)
class Options:
    """Settings of an estimator.

    Attributes
    ----------
    optimizer : str or stoop.optimize.Optimizer
        Name, see :func:`stoop.optimize.names`, or an optimizer of your own, such as a composition with your mutation.
    seed : int
    generations, budget, target_cost
        Limits of the search, see :class:`stoop.optimize.Stop`. A fifth of the budget is kept for the refinement. The
        refinements that settle the weights count, but the budget does not limit them.
    covariance : (n_y,) or (n_y, n_y) array, optional
        A given noise covariance, the inverse of eq. (3)'s Q; estimated when absent.
    method : str
        Name, see :func:`stoop.estimate.methods.names`; the strategy decides when empty.
    treatment : Treatment
        Decisions about data and noise that the estimator may take.
    start : mapping of str to float
        Estimates (SI) by name of an earlier fit, from which a search begins, or from the file's own values where these are
        better; without any the estimates are those of a regression.
    """

    optimizer: str | optimize.Optimizer[Any] = "ps-gde-lm"
    seed: int = 0
    generations: int = 2000
    budget: float = 100_000.0
    target_cost: float = -np.inf
    covariance: FloatArray | None = None
    method: str = ""
    treatment: Treatment = TREATMENT
    start: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        parts = (getattr(self.optimizer, part, None) for part in ("init", "step"))
        if not (isinstance(self.optimizer, str) or all(callable(part) for part in parts)):
            raise IdentificationError(
                "optimizer: it is neither a name nor has it init and step; put a mutation into a composition, such as "
                "stoop_studies.optimizers.compositions.ps_gde(mutation=...)"
            )

    @property
    def optimizer_name(self) -> str:
        """Name of the optimizer."""
        return self.optimizer if isinstance(self.optimizer, str) else self.optimizer.name

    def minimized(
        self, problem: Misfit, starts: FloatArray, spent: float, callback: Callback, state: State
    ) -> optimize.Outcome:
        """Return the outcome of a global search from starts (k, ...), after `spent` trajectories.

        A fifth of the rest of the budget is for the refinement. An optimizer that goes by name may plan with its budget.

        Raises
        ------
        IdentificationError
            No candidate can be simulated.
        """
        budget = max(0.8 * (self.budget - spent), float(len(starts)))
        stop = optimize.Stop(self.generations, budget, self.target_cost)
        given = self.optimizer
        optimizer = optimize.create(given, stop.budget) if isinstance(given, str) else given
        outcome = optimize.minimize(
            optimizer, problem, seed=self.seed, starts=starts, stop=stop, callback=callback, state=state
        )
        if not np.isfinite(outcome.cost):
            raise IdentificationError(f"{problem.layout.vehicle.where}: {outcome.advice}")
        return outcome


@dataclass(frozen=True, eq=False)
class OutputErrorEstimate(Estimate):
    """Estimate by the simulation of each piece from its start; `problem` has the final weights."""

    refits: ClassVar = SimulationProblem
    #: whether the covariance of the measurement noise was given and not estimated
    noise_given: bool = False
    #: (D + E,), where the weights of white noise lead; None where those of the fit are these
    by_white: FloatArray | None = None

    def own_state(self) -> dict[str, Any]:
        """Return whether the noise was given, and the estimate by the weights of white noise."""
        white = {} if self.by_white is None else {"by_white": self.by_white}
        return {"noise_given": np.array(self.noise_given), **white}

    @classmethod
    def own_fields(cls, problem: Misfit, z: FloatArray, arrays: Mapping[str, Any]) -> dict[str, Any]:
        """Return whether the noise was given, and the estimate by the weights of white noise."""
        return {"noise_given": bool(arrays["noise_given"]), "by_white": arrays.get("by_white")}

    @property
    def white(self) -> FloatArray:
        """Unknowns (D + E,) by the weights of white noise, which are those of a search."""
        return self.z if self.by_white is None else self.by_white

    @property
    def disagreement(self) -> FloatArray:
        """By how much the weights of white noise and those of its color disagree, per SI unit of the unknowns (k,)."""
        return np.asarray(self.problem.layout.scales * (self.z - self.white))

    @property
    def correlation_time(self) -> float:
        """Residuals that say as much as one independent one, the median of the channels."""
        colored = self.by_white is not None
        return common_time(self.residuals, self.problem.pieces[0].dt) if colored else self.inflation

    @cached_property
    def evidence(self) -> Evidence:
        """Residuals and sensitivities of the simulation."""
        return simulation_evidence(self.problem, self.z, self.inflation)

    @cached_property
    def white_evidence(self) -> Evidence:
        """Residuals and sensitivities by the weights of white noise."""
        if self.by_white is None:
            return self.evidence
        plain = self.problem.weighted(Weights.of(effective_variance(self.problem, self.residuals)))
        return simulation_evidence(plain, self.z, self.correlation_time)

    @cached_property
    def refit_problem(self) -> SimulationProblem:
        """The simulation with the final weights."""
        return SimulationProblem(self.problem)

    def observed_information(self, factor: FloatArray) -> FloatArray:
        """Return the Hessian (r, r) of half the cost, by second differences."""
        return observed_information(self.problem, self.z, self.evidence, factor)

    @property
    def inflation(self) -> float:
        """Factor by which the variance in the weights exceeds that of the residuals; 1 for given noise."""
        return 1.0 if self.noise_given else simulation_inflation(self)

    @cached_property
    def measurement_noise(self) -> FloatArray:
        """Covariance (n_y, n_y) of the residuals, or as given; NaN for a channel that was never measured."""
        if self.noise_given:
            return self.problem.weights.covariance
        return noise_covariance(self.problem, self.residuals)


DEFAULTS: Final = Options()


def estimation_problem(
    vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window], options: Options
) -> tuple[Misfit, Prepared]:
    """Turn flights and windows into a least-squares problem.

    Raises
    ------
    IdentificationError
        Nothing is free.
    """
    allowed = options.treatment
    taken = list[DecisionRecord]()
    if allowed.held_numbers and (held := with_mass_held(vehicle)) is not vehicle:
        vehicle, found = held, "neither mass nor inertia nor a force is known"
        taken.append(DecisionRecord("held-numbers", "applied", found, f"{MASS} fixed at the file's value"))
    if allowed.recorded_motion and (vehicle := decoupled(vehicle, flights, windows)).measured:
        found = f"{', '.join(vehicle.measured)} recorded, which the reduced model leaves out"
        taken.append(DecisionRecord("recorded-motion", "applied", found, "taken from the record"))
    for name in dict.fromkeys(w.flight for w in windows):
        require_channels(vehicle, flights[name])
    prepared = replace(Prepared.of(vehicle, flights, windows), decisions=tuple(taken))
    prepared = prepared.without_stuck_channels(vehicle) if allowed.stuck_channels else prepared
    for window in windows:  # states that a reduced model holds constant, because they were not recorded
        here = decoupled(vehicle, flights, [window]).measured
        if lost := tuple(c for c in vehicle.held_channels if c not in here):
            assumed = notice("motion-not-recorded", str(window), model=vehicle.reduce, channels=lost)
            prepared = replace(prepared, notices=(*prepared.notices, assumed))
    require_data(vehicle, prepared.windows, prepared.pieces)
    layout = Layout.of(vehicle, prepared.nuisances(vehicle))
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
    pieces = at_readings(vehicle, prepared, flights)
    problem = Misfit(layout, pieces, Weights.of(covariance), horizon_ladder(pieces))
    return problem, prepared


def starts(problem: Misfit, known: Mapping[str, float] | None = None) -> FloatArray:
    """Return starting points (k, D): the file's own values, and estimates (SI) known by name or by equation error."""
    own, layout = problem.layout.start, problem.layout
    if known:
        return np.array([own, layout.unit(np.array([known.get(p.name, p.value) for p in layout.parameters]))])
    guess = start_value(layout, problem.pieces)
    return np.array([own] if guess is None else [own, guess])


class Fitter(ABC, Generic[FittedT]):
    """A method that searches for the free numbers of a vehicle; :mod:`stoop.estimate.methods` names the methods."""

    @on_one_blas_thread
    def __call__(
        self,
        vehicle: Vehicle,
        flights: Mapping[str, Flight],
        windows: Sequence[Window],
        options: Options = DEFAULTS,
        callback: Callback = None,
        state: State = None,
    ) -> FittedT:
        """Fit the free numbers of a vehicle to windows of flights, jointly."""
        problem, prepared = estimation_problem(vehicle, flights, windows, options)
        return self.search(problem, prepared, options, callback, state)

    @abstractmethod
    def search(
        self, problem: Misfit, prepared: Prepared, options: Options, callback: Callback, state: State
    ) -> FittedT:
        """Return the estimate for a problem whose weights are those of the vehicle file, or given."""


class OutputError(Fitter[OutputErrorEstimate]):
    """Output error with fixed weights, then with those of the residuals."""

    def search(
        self, problem: Misfit, prepared: Prepared, options: Options, callback: Callback, state: State
    ) -> OutputErrorEstimate:
        """Search from the best start, then alternate refinement and noise estimate until both converge.

        Without a given noise covariance local refinements from the best start determine the weights of the search.
        """
        guesses, spent = starts(problem, options.start), 0.0
        if options.covariance is None:
            settled = settle(problem, guesses)
            problem, spent, z = settled.problem, settled.spent, settled.z
            if settled.interrupted:
                cost = float(np.sum(problem.residuals(z[None, :], len(problem.prices) - 1) ** 2))
                advice = "stopped by the user before the search: the estimates are those of a first refinement; run it again"
                outcome = optimize.Outcome(
                    z, cost, 0.0, 0, "interrupted", advice, np.empty((0, 2)), None, options.optimizer_name
                )
                return replace(refine(problem, prepared, outcome), trajectories=spent)
            guesses = np.concatenate([z[None, :], np.pad(guesses, [(0, 0), (0, problem.extra)])])
        outcome = options.minimized(problem, guesses, spent, iterates.shown(problem, callback), state)
        left = options.budget - spent - outcome.trajectories
        given = options.covariance is not None
        done = refine(problem, prepared, outcome, left, estimate_noise=not given, treatment=options.treatment)
        return replace(done, trajectories=done.trajectories + spent)


fit = OutputError()


@dataclass(frozen=True, eq=False)
class Settled:
    """A problem with settled weights, the point where they were estimated, and the trajectories that took."""

    problem: Misfit
    z: FloatArray
    spent: float
    interrupted: bool = False


def settle(problem: Misfit, guesses: FloatArray) -> Settled:
    """Settle the weights by a few short local refinements from the best start.

    No budget limits these rounds: the weights define the cost, so a search that is resumed with more
    budget must find the same ones.
    """
    problem = problem.weighted(Weights.of(first_variance(problem)))
    costs = problem.costs(guesses, len(problem.prices) - 1)
    z = np.concatenate([guesses[int(np.argmin(costs))], np.zeros(problem.extra)])
    spent = float(len(guesses))
    for _ in range(SETTLING.rounds):
        z, more, cut_short = _refined(problem, z, SHORT)
        spent, before = spent + more, problem.weights.logdet
        try:
            variance = effective_variance(problem, channel_residuals(problem, z))
        except KeyboardInterrupt:
            return Settled(problem, z, spent, True)
        problem = problem.weighted(Weights.of(variance))
        if cut_short or abs(SETTLING.fall(before, problem)) < 1.0:
            return Settled(problem, z, spent, bool(cut_short))
    return Settled(problem, z, spent)


def refine(
    problem: Misfit,
    prepared: Prepared,
    outcome: optimize.Outcome,
    budget: float = np.inf,
    estimate_noise: bool = True,
    treatment: Treatment = TREATMENT,
) -> OutputErrorEstimate:
    """Alternate noise-covariance estimation and Gauss-Newton refinement until the likelihood converges.

    Population optimizers get their nuisances here. An interrupted search is not refined. Ctrl-C during the refinement
    keeps the best estimates so far.
    """
    z, before, spent, recorded, noise = outcome.z, np.inf, 0.0, problem, None
    color, by_white = None, None
    converged = interrupted = outcome.status == "interrupted"
    for _ in range(0 if interrupted else ALTERNATION.rounds):
        z, more, cut_short = _refined(problem, z, FULL, budget - spent)
        spent, interrupted = spent + more, cut_short == "interrupted"
        last = color is None or by_white is not None  # weights of the kind that the estimate will have
        # also where it rises: what fits worse repeats itself more and counts less, and would drift on
        converged = not estimate_noise or (ALTERNATION if last else SETTLING).fall(before, problem) < 1.0
        if cut_short or (converged and last):
            break
        try:
            before = problem.noise_logdet
            noise, weighted = with_noise(recorded, partial(channel_residuals, z=z), noise, treatment)
            color = None
            if treatment.noise_color:
                color = colored_weights(weighted, channel_residuals(weighted, z))
            if color is not None and (converged or by_white is not None):
                weighted, by_white = weighted.weighted(color), z if by_white is None else by_white
            problem = weighted
        except KeyboardInterrupt:
            interrupted = True
            break
    if interrupted and outcome.status != "interrupted":
        advice = "stopped by the user while the estimates were refined"
        outcome = replace(outcome, status="interrupted", advice=advice)
    notices = () if converged or outcome.status == "interrupted" else (notice("noise-not-converged"),)
    found, taken = ([], ()) if noise is None else noise.findings(problem, [str(w) for w in prepared.windows])
    notices = (*found, *notices)
    cost = float(np.sum(problem.residuals(z[None, :], len(problem.prices) - 1) ** 2))
    spent += outcome.trajectories
    common = (problem, prepared, z, outcome, cost, spent, notices)
    if by_white is not None:
        taken = (*taken, color_record(problem, channel_residuals(problem, z)))
    return OutputErrorEstimate(*common, not estimate_noise, by_white, decisions=taken)


def _refined(
    problem: Misfit, z: FloatArray, settings: optimize.Settings, budget: float = np.inf
) -> tuple[FloatArray, float, str]:
    """Refine locally on the full record; return the point, the number of trajectories, and the reason of an early stop.

    Ctrl-C or a spent budget keeps the best point so far; the reason is empty without them.
    """
    ledger = optimize.Ledger(problem, Evaluations.none(problem), budget)
    try:
        end = optimize.refine(ledger, z, len(problem.prices) - 1, settings)
        iterates.show(problem, end.z, end.cost)
    except (KeyboardInterrupt, Halt) as reason:
        done = ledger.evaluations
        best = done.best if np.isfinite(done.cost) else z
        return best, done.trajectories, getattr(reason, "status", "interrupted")
    return end.z if np.isfinite(end.cost) else z, ledger.spent, ""
