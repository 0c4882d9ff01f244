"""The methods ``equation-error`` and ``frequency-domain``: estimates and error bars without a search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from functools import partial
from typing import Any, Final

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.errors import IdentificationError
from stoop.estimate.fit import SHORT, Fit, Options, estimation_problem
from stoop.estimate.noise import channel_residuals, noise_covariance, noise_variance
from stoop.estimate.regression import kind_of
from stoop.estimate.regression.least_squares import (
    Domain,
    Equations,
    Estimates,
    FrequencyDomain,
    TimeDomain,
    estimate,
)
from stoop.estimate.regression.linear_problem import LinearProblem
from stoop.estimate.shooting_windows import outputs_by_window
from stoop.flight import Flight
from stoop.optimize.ledger import Evaluations, Halt
from stoop.problem import Layout, Misfit, Weights
from stoop.problem.evidence import Evidence, prior_information, unknowns_of
from stoop.problem.observation import observation_model
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle

FAIR_R2: Final = 0.5  #: below, the estimates of an equation are doubtful


def regression(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    windows: Sequence[Window],
    options: Options,
    *_: Any,
    domain: Domain,
) -> Fit:
    """Fit the free numbers to measured accelerations; a method of `stoop.estimate.methods` for each domain.

    An IdentificationError says where the motion was nowhere measured completely, or what is for aircraft only.
    """
    kind = kind_of(vehicle)
    if domain.name not in kind.explanations:
        raise IdentificationError(
            f"{vehicle.where}: frequency-domain regression is for aircraft; use --method equation-error or multiple-shooting"
        )
    fixed = kind.not_estimable(vehicle)
    problem, prepared = estimation_problem(
        vehicle.with_numbers({n: {"free": False} for n in fixed}), flights, windows, options
    )
    equations = kind.of(problem.layout, problem.pieces)
    found = estimate(equations, domain, bounded=not kind.linear)
    if found is None:
        raise IdentificationError(f"{vehicle.where}: no regression is possible: {kind.needed}")
    z, nothing = equations.vector(found.values), np.empty((0, 2))
    outcome = optimize.Outcome(z, 0.0, 0.0, 0, "converged", "", nothing, None, options.method)
    flown = _from_start if observation_model(vehicle).open_loop else _by_window
    fit = flown(Fit(problem, prepared, z, outcome, 0.0, 0.0))
    notices = [
        notice(kind.explanations[domain.name], "", **asdict(domain)),
        notice("r-squared", "", equations=tuple(found.r2), r2=tuple(found.r2.values())),
        *([notice("not-in-regression", ", ".join(fixed))] if fixed else []),
        *(notice("low-r-squared", name, r2=max(r2, 0.0)) for name, r2 in found.r2.items() if r2 < FAIR_R2),
        *kind.notices(found),
        *([] if np.isfinite(fit.cost) else [notice("estimates-diverge", vehicle.where)]),
    ]
    evidence, period = (
        _evidence(problem, equations, found, fit.z, domain),
        domain.period(problem.pieces[0].dt),
    )
    return replace(
        fit,
        outcome=replace(outcome, z=fit.z, cost=fit.cost, trajectories=fit.trajectories),
        notices=tuple(notices),
        own_evidence=evidence,
        local_problem=partial(
            LinearProblem.of, problem, fit.z, evidence, found.sigma, period, not kind.linear
        ),
    )


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
    values = layout.physical(z[None, :])[0]
    numbers = {p.name: {"value": float(v)} for p, v in zip(layout.parameters, values, strict=True)}
    return replace(layout, vehicle=layout.vehicle.with_numbers(numbers), parameters=(), nuisances=())


def _from_start(fit: Fit) -> Fit:
    """Simulate each piece from its first sample, initial states and biases estimated with the parameters fixed."""
    problem, z, spent = fit.problem, fit.z, 0.0
    d, rung = problem.dimension, len(problem.prices) - 1
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
    return replace(fit, problem=problem, z=z, cost=cost, trajectories=spent)


def _by_window(fit: Fit) -> Fit:
    """Simulate windows of a second that each start as measured."""
    problem, layout = fit.problem, fit.problem.layout
    found = [
        (n, n.center + n.scale * float(x))
        for n, x in zip(layout.nuisances, fit.z[layout.dimension :], strict=True)
    ]
    pieces = []
    for piece in problem.pieces:
        biases = {n.name: v for n, v in found if n.is_bias and n.maneuver == piece.maneuver}
        pieces.append(replace(piece, changes={**piece.changes, **biases}))
    fixed = replace(problem, layout=_fixed_layout(problem, fit.z), pieces=tuple(pieces))
    readings = tuple(outputs_by_window(fixed, i) for i in range(len(pieces)))
    flown = replace(fit, simulated=readings)
    return replace(flown, noise=noise_covariance(problem, flown.residuals))


equation_error: Final = partial(regression, domain=TimeDomain())  #: on smoothed samples
frequency_domain: Final = partial(
    regression, domain=FrequencyDomain()
)  #: on Fourier coefficients of a band, of aircraft
