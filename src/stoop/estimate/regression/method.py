"""The methods ``equation-error`` and ``frequency-domain``: estimates and error bars without a search."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from typing import Any, ClassVar, Final

import numpy as np

from stoop import optimize
from stoop.base.arrays import BoolArray, FloatArray
from stoop.base.notices import notice
from stoop.errors import IdentificationError
from stoop.estimate.estimate import Estimate, simulation_inflation
from stoop.estimate.fit import SHORT, Options, estimation_problem
from stoop.estimate.noise import channel_residuals, noise_variance
from stoop.estimate.refit_problem import RefitProblem
from stoop.estimate.regression import kind_of
from stoop.estimate.regression.aircraft import AircraftEquations
from stoop.estimate.regression.least_squares import Domain, Equations, Estimates, FrequencyDomain, TimeDomain
from stoop.estimate.regression.rotors import RotorEquations
from stoop.estimate.shooting_windows import outputs_by_window
from stoop.flight import Flight
from stoop.optimize.ledger import Evaluations, Halt
from stoop.problem import Layout, Misfit, Weights
from stoop.problem.evidence import Evidence, PieceEvidence, Unknown, prior_information, unknowns_of
from stoop.problem.observation import observation_model
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle

#: below, the estimates of an equation are doubtful
FAIR_R2: Final = 0.5


@dataclass(frozen=True, eq=False)
class LinearProblem(RefitProblem):
    """The weighted equations as residuals, linear about the estimates.

    Equations of rotors are linearized there, those left out stay out, and the weights of the equations stay.
    """

    kind: ClassVar = "regression"
    #: its layout has the priors that the regression used
    problem: Misfit
    #: (D + E,), the estimates
    center: FloatArray
    #: equation errors (n, q) and regressors (n, q, D + E) of each stretch
    stretches: tuple[PieceEvidence, ...]
    #: equation -> standard deviation of its errors, SI; q entries
    deviations: Mapping[str, float]
    #: s from row to row; infinite for rows that are no samples of time
    dt: float
    #: whether the bounds of the parameters hold
    bounded: bool

    @classmethod
    def of(
        cls,
        problem: Misfit,
        z: FloatArray,
        evidence: Evidence,
        deviations: Mapping[str, float],
        dt: float,
        bounded: bool,
    ) -> LinearProblem:
        """Return the problem about estimates z (D + E,); a parameter without prior information has no prior."""
        layout, known = problem.layout, np.diag(evidence.prior) > 0.0
        pairs = zip(layout.parameters, known, strict=False)  # nuisances come last
        parameters = tuple(p if k else replace(p, prior=None) for p, k in pairs)
        problem = replace(problem, layout=replace(layout, parameters=parameters))
        return cls(problem, z, evidence.pieces, deviations, dt, bounded)

    @classmethod
    def restored(cls, problem: Misfit, arrays: Mapping[str, Any]) -> LinearProblem:
        """Return the problem from its `arrays`."""
        each = range(sum(name.startswith("regressors.") for name in arrays))
        stretches = tuple(PieceEvidence(arrays[f"errors.{i}"], arrays[f"regressors.{i}"]) for i in each)
        deviations = dict(zip(arrays["equations"].tolist(), arrays["deviations"].tolist(), strict=True))
        dt, bounded = float(arrays["dt"]), bool(arrays["bounded"])
        return cls(problem, arrays["center"], stretches, deviations, dt, bounded)

    @property
    def arrays(self) -> dict[str, Any]:
        """Arrays that :meth:`restored` takes beside `problem`."""
        out: dict[str, Any] = {n: np.array(getattr(self, n)) for n in ("center", "dt", "bounded")}
        names, values = list(self.deviations), list(self.deviations.values())
        out |= {"equations": np.array(names), "deviations": np.array(values)}
        for i, stretch in enumerate(self.stretches):
            out |= {f"errors.{i}": stretch.residual, f"regressors.{i}": stretch.jacobian}
        return out

    @property
    def box(self) -> tuple[float, float]:
        """Bounds of the parameters, infinite for a regression without bounds."""
        return (0.0, 1.0) if self.bounded else (-np.inf, np.inf)

    @property
    def equations(self) -> tuple[str, ...]:
        """Names of the equations."""
        return tuple(self.deviations)

    @property
    def spacing(self) -> float:
        """Time from row to row, s; infinite for rows that are no samples of time."""
        return self.dt

    @property
    def present(self) -> tuple[BoolArray, ...]:
        """Which equation errors (n, q) of each stretch there are."""
        return tuple(stretch.present for stretch in self.stretches)

    @cached_property
    def _linear(self) -> tuple[FloatArray, FloatArray]:
        """Modeled minus measured (n,) at the estimates, weighted, and the derivative (n, D + E)."""
        residual = [-s.residual.ravel() for s in self.stretches]
        scales = self.problem.layout.scales
        slopes = [s.jacobian.reshape(s.residual.size, -1) * scales for s in self.stretches]
        return np.concatenate(residual), np.concatenate(slopes)

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return weighted modeled minus measured responses, then the residuals of the priors, (B, n_r)."""
        residual, slopes = self._linear
        equations = residual + (Z - self.center) @ slopes.T
        return np.concatenate([equations, self.problem.layout.prior_residuals(Z)], axis=1)

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[FloatArray, float]:
        """Return the derivative of the residuals, which costs nothing."""
        return np.concatenate([self._linear[1], self.problem.layout.prior_jacobian(z)]), 0.0

    def in_units(self, white: Sequence[FloatArray]) -> list[FloatArray]:
        """Return weighted values (n, q) of each stretch in SI."""
        return [w * np.array(list(self.deviations.values())) for w in white]


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
    held = vehicle.with_numbers({n: {"free": False} for n in fixed})
    problem, prepared = estimation_problem(held, flights, windows, options)
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
