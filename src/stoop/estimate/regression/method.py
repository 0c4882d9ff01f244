"""The methods ``equation-error`` and ``frequency-domain``: estimates and error bars without a search."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from typing import Any, ClassVar, Final

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.errors import IdentificationError
from stoop.estimate.estimate import Estimate, simulation_inflation
from stoop.estimate.fit import SHORT, Options, estimation_problem
from stoop.estimate.noise import channel_residuals, noise_variance
from stoop.estimate.regression import kind_of
from stoop.estimate.regression.aircraft import AircraftEquations
from stoop.estimate.regression.least_squares import (
    Domain,
    Equations,
    Estimates,
    FrequencyDomain,
    TimeDomain,
)
from stoop.estimate.regression.linear_problem import LinearProblem
from stoop.estimate.regression.rotors import RotorEquations
from stoop.estimate.shooting_windows import outputs_by_window
from stoop.flight import Flight
from stoop.optimize.ledger import Evaluations, Halt
from stoop.problem import Layout, Misfit, Weights
from stoop.problem.evidence import Evidence, Unknown, prior_information, unknowns_of
from stoop.problem.observation import observation_model
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle

#: below, the estimates of an equation are doubtful
FAIR_R2: Final = 0.5


@dataclass(frozen=True, eq=False)
class RegressionEstimate(Estimate):
    """Estimate by least squares on measured accelerations; readings are those of a simulation from each piece's start."""

    refits: ClassVar = LinearProblem
    #: equation errors and regressors
    evidence_of_equations: Evidence
    #: the weighted equations, linear about the estimate
    equations: LinearProblem

    def own_state(self) -> dict[str, Any]:
        """Return the equations, their weights, and the information of the priors."""
        evidence, linear = self.evidence_of_equations, self.equations
        return {
            **linear.arrays,
            "maneuvers": np.array([stretch.maneuver for stretch in evidence.pieces]),
            "estimated": np.array([u.fixed != "method" for u in evidence.unknowns]),
            "prior": evidence.prior,
            "white": np.array(evidence.white),
            "first.covariance": linear.problem.weights.covariance,
            "first.root": linear.problem.weights.root,
        }

    @classmethod
    def own_fields(cls, problem: Misfit, z: FloatArray, arrays: Mapping[str, Any]) -> dict[str, Any]:
        """Return the equations."""
        first = problem.weighted(Weights(arrays["first.covariance"], arrays["first.root"]))
        found = LinearProblem.restored(first, arrays)
        unknowns = unknowns_of(problem.layout, z, set(np.flatnonzero(arrays["estimated"]).tolist()))
        pairs = zip(found.stretches, arrays["maneuvers"].tolist(), strict=True)
        stretches = tuple(replace(stretch, maneuver=maneuver) for stretch, maneuver in pairs)
        evidence = Evidence(unknowns, stretches, arrays["prior"], white=bool(arrays["white"]))
        linear = LinearProblem.of(first, z, evidence, found.deviations, found.dt, found.bounded)
        return {"evidence_of_equations": evidence, "equations": linear}

    @classmethod
    def suited(cls, problem: Misfit) -> type[Estimate]:
        """Return the class with readings of windows for a vehicle that cannot be flown open loop."""
        open_loop = observation_model(problem.layout.vehicle).open_loop
        return RegressionEstimate if open_loop else WindowedRegressionEstimate

    @property
    def evidence(self) -> Evidence:
        """Equation errors and regressors."""
        return self.evidence_of_equations

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Parameters and nuisances; those that are not in the equations are not estimated."""
        return self.evidence_of_equations.unknowns

    @property
    def refit_problem(self) -> LinearProblem:
        """The weighted equations."""
        return self.equations

    @property
    def inflation(self) -> float:
        """Factor by which the variance in the weights exceeds that of the residuals, for their correlation."""
        return simulation_inflation(self)


@dataclass(frozen=True, eq=False)
class WindowedRegressionEstimate(RegressionEstimate):
    """Likewise of a vehicle that cannot be flown open loop; readings are those of windows that each start as measured."""

    @cached_property
    def readings(self) -> tuple[FloatArray, ...]:
        """Readings (n, n_y) of the windows of each piece."""
        layout = self.problem.layout
        entries = zip(layout.nuisances, self.z[layout.dimension :], strict=True)
        found = [(n, n.center + n.scale * float(x)) for n, x in entries]
        pieces = []
        for piece in self.problem.pieces:
            biases = {n.name: v for n, v in found if n.is_bias and n.maneuver == piece.maneuver}
            pieces.append(replace(piece, changes={**piece.changes, **biases}))
        fixed = replace(self.problem, layout=_fixed_layout(self.problem, self.z), pieces=tuple(pieces))
        return tuple(outputs_by_window(fixed, i) for i in range(len(pieces)))

    @property
    def inflation(self) -> float:
        """Return 1: the weights are the variances of the residuals."""
        return 1.0

    def reading_slopes(self, index: int) -> None:
        """Return None: windows start as measured, so that their readings depend on more than the unknowns."""


def regression(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    windows: Sequence[Window],
    options: Options,
    *_: Any,
    domain: Domain,
    kinds: Callable[[Vehicle], type[AircraftEquations] | type[RotorEquations]] = kind_of,
) -> RegressionEstimate:
    """Fit the free numbers to measured accelerations; a method of `stoop.estimate.methods` for each domain.

    An IdentificationError says where the motion was nowhere measured completely, or what is for aircraft only.
    """
    kind = kinds(vehicle)
    if domain.name not in kind.explanations:
        raise IdentificationError(
            f"{vehicle.where}: frequency-domain regression is for aircraft; use --method equation-error or multiple-shooting"
        )
    fixed = kind.not_estimable(vehicle)
    problem, prepared = estimation_problem(
        vehicle.with_numbers({n: {"free": False} for n in fixed}), flights, windows, options
    )
    equations = kind.of(problem.layout, problem.pieces)
    found = equations.estimate(domain, bounded=not kind.linear)
    if found is None:
        raise IdentificationError(f"{vehicle.where}: no regression is possible: {kind.needed}")
    z = equations.vector(found.values)
    notices = [
        notice(kind.explanations[domain.name], "", **asdict(domain)),
        notice("r-squared", "", equations=tuple(found.r2), r2=tuple(found.r2.values())),
        *([notice("not-in-regression", ", ".join(fixed))] if fixed else []),
        *(notice("low-r-squared", name, r2=max(r2, 0.0)) for name, r2 in found.r2.items() if r2 < FAIR_R2),
        *equations.notices(found),
    ]
    flown, cost, spent = problem, 0.0, 0.0
    if open_loop := observation_model(vehicle).open_loop:
        flown, z, cost, spent = _from_start(problem, z)
    if not np.isfinite(cost):
        notices.append(notice("estimates-diverge", vehicle.where))
    outcome = optimize.Outcome(z, cost, spent, 0, "converged", "", np.empty((0, 2)), None, options.method)
    evidence = _evidence(problem, equations, found, z, domain)
    period, bounded = domain.period(problem.pieces[0].dt), not kind.linear
    linear = LinearProblem.of(problem, z, evidence, found.sigma, period, bounded)
    form = RegressionEstimate if open_loop else WindowedRegressionEstimate
    return form(flown, prepared, z, outcome, cost, spent, tuple(notices), evidence, linear)


def _evidence(
    problem: Misfit, equations: Equations, found: Estimates, z: FloatArray, domain: Domain
) -> Evidence:
    """Return the evidence of the regression among all unknowns; a constant that the domain does not keep has no prior."""
    unknowns, places = unknowns_of(problem.layout, z, set(equations.places)), list(equations.places)
    prior, pieces = prior_information(unknowns), []
    if not domain.keeps_constants:
        means = [places[k] for k in equations.constants.values()]
        prior[means, means] = 0.0
    for own in found.evidence:
        jacobian = np.zeros((*own.residual.shape, len(unknowns)))
        jacobian[:, :, places] = own.jacobian
        pieces.append(replace(own, jacobian=jacobian))
    return Evidence(unknowns, tuple(pieces), prior, white=not domain.colored)


def _fixed_layout(problem: Misfit, z: FloatArray) -> Layout:
    """Return a layout without unknowns, of the vehicle with its estimates."""
    layout = problem.layout
    numbers = {name: {"value": value} for name, value in layout.values(z).items()}
    return replace(layout, vehicle=layout.vehicle.with_numbers(numbers), parameters=(), nuisances=())


def _from_start(problem: Misfit, z: FloatArray) -> tuple[Misfit, FloatArray, float, float]:
    """Estimate initial states and biases with the parameters fixed, each piece simulated from its first sample.

    Returns the problem with the weights of these residuals, its vector, its cost, and the trajectories that it took.
    """
    d, rung, spent = problem.dimension, len(problem.prices) - 1, 0.0
    states = replace(problem, layout=replace(_fixed_layout(problem, z), nuisances=problem.layout.nuisances))
    if states.extra:
        ledger = optimize.Ledger(states, Evaluations.none(states), np.inf)
        with suppress(KeyboardInterrupt, Halt):
            end = optimize.refine(ledger, z[d:], len(states.prices) - 1, SHORT)
            z = np.concatenate([z[:d], end.z]) if np.isfinite(end.cost) else z
        spent = ledger.spent
    with np.errstate(over="ignore"):  # of a simulation about to diverge
        cost = float(np.sum(problem.residuals(z[None, :], rung) ** 2))
        if np.isfinite(cost):
            problem = problem.weighted(Weights.of(noise_variance(problem, channel_residuals(problem, z))))
            cost = float(np.sum(problem.residuals(z[None, :], rung) ** 2))
    return problem, z, cost, spent


#: on smoothed samples
equation_error: Final = partial(regression, domain=TimeDomain())
#: on Fourier coefficients of a band, of aircraft
frequency_domain: Final = partial(regression, domain=FrequencyDomain())
