"""From a finished fit to its result: error bars, predictions, modes and notices."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from stoop.assessment.covariance import NORMAL_95
from stoop.assessment.error_bars import ErrorBars
from stoop.assessment.extensions import extension_notices
from stoop.assessment.flown_model import flown_model
from stoop.assessment.goodness_of_fit import left_out_residuals, press_notices
from stoop.assessment.modes import modes
from stoop.assessment.uncertainty import with_uncertainty
from stoop.assessment.verdict import uses, verdict
from stoop.base.notices import Notice, as_notice, attempt, notice, of_severity
from stoop.base.packages import hooks
from stoop.base.variables import POSITION, RATES, VARIABLES
from stoop.checks.excitation import ratios, too_few
from stoop.errors import VehicleError
from stoop.estimate.estimate import Estimate
from stoop.flight import Flight
from stoop.prediction.predict import expected_biases, predict, predictor
from stoop.results.extensions import ResponseMisfit
from stoop.results.result import InitialState, ParameterEstimate, Quantity, Result, SensorBiases, WindEstimate
from stoop.strategy.decision import Fitted
from stoop.vehicle import parse_vehicle
from stoop.workflow.curves import Simulated, maneuver_curves
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.outputs import versions, with_values
from stoop.workflow.summary import basis_notices, data_notices, fit_warnings

#: of initial states; others rad
START_UNITS: Final = dict.fromkeys("uvw", "m/s") | {n: VARIABLES[n].unit for n in ("V", *RATES, *POSITION)}


def fitted_model(decided: Fitted) -> FittedModel:
    """Return the model of a finished search: error bars, predictions, modes and notices."""
    fit, bars, origin = decided.estimate, decided.tested.bars, decided.provenance
    flights, options, predicted = decided.flights, decided.options, decided.setup.held_back
    vehicle, color = fit.problem.layout.vehicle, fit.correlation_time
    if too_few(fit.problem):
        bars = replace(bars, refused=notice("error-bars-of-few-samples"))
    parameters = _parameters(fit, bars)
    model = predictor(fit, bars.covariance, options.treatment.recorded_motion)
    bands = fit.deviations(bars.covariance)
    groups = [Simulated("fit", fit.prepared, fit.readings, left_out_residuals(fit), bands)]
    if predicted:
        ahead = predict(model, flights, predicted, [expected_biases(fit, w.flight) for w in predicted])
        band = ahead.deviations
        groups.append(Simulated("validation", ahead.prepared, ahead.readings, None, band, ahead.innovations))
    maneuvers, traces = maneuver_curves(vehicle, groups, noise=model.noise)

    states, biases = _nuisances(fit, bars)
    result = Result(
        parameters=parameters,
        covariance=model.covariance,
        noise_covariance=model.noise,
        initial_states=states,
        biases=biases,
        wind=_wind(flights),
        maneuvers=maneuvers,
        cost=fit.cost,
        trajectories=fit.trajectories,
        seconds=0.0,
        seed=options.seed,
        optimizer=fit.outcome.optimizer,
        status=fit.outcome.status,
        advice=fit.outcome.advice,
        notices=fit_warnings(parameters, bars, maneuvers, fit, flights),
        versions=versions(),
        inputs=origin.inputs,
        method=options.method,
        decisions=decided.decisions,
        process_noise=fit.process_noise,
        innovation_correlation=fit.innovation_correlation,
    )
    failed = [*decided.tested.notices]  # of error bars, then of detectors
    found = attempt(failed, (), modes, fit, result.covariance.names, result.covariance.matrix)
    flown = (model.vehicle.coupled_to(()), flights, maneuvers, traces)
    detectors = hooks("response_misfits", list[ResponseMisfit])
    left = tuple(one for find in detectors for one in attempt(failed, (), find, *flown))
    result = replace(result, modes=found, extensions=decided.tested.tests, response_misfits=left)
    terms = flown_model(result, fit)
    result = with_uncertainty(result, fit, bars, terms)

    prepared = [one for group in groups for one in group.prepared.notices]
    of_flights = [one for flight in flights.values() for one in flight.notices]
    per_mass = ratios(vehicle, {name: (p.estimate, p.std_error) for name, p in result.parameters.items()})
    refused = list[Notice]()
    try:
        parse_vehicle(with_values(vehicle, fit.estimates), "vehicle.toml")
    except VehicleError as error:
        refused.append(notice("estimates-refused", text=str(error)))
    notices = [
        *extension_notices(result.extensions),
        *result.notices,
        *dict.fromkeys(of_severity(prepared, "warning")),
        *of_severity(fit.notices, "info"),
        *attempt(failed, [], press_notices, fit),
        *refused,
        *([as_notice(per_mass, "info")] if per_mass else []),
        *basis_notices(vehicle, flights, color),
        *data_notices([*of_flights, *of_severity(prepared, "info")]),
        *failed,
    ]
    result = replace(result, notices=tuple(notices), seconds=time.perf_counter() - origin.began)
    result = replace(result, verdict=verdict(result, uses(vehicle, terms.sizes)))
    return FittedModel(
        vehicle=model.vehicle.coupled_to(()),
        result=result,
        flights=tuple(flights.values()),
        traces=traces,
        fresh=fit,
        convergence=fit.outcome.history,
        command=origin.command,
        files=origin.files,
    )


def _parameters(fit: Estimate, bars: ErrorBars) -> dict[str, ParameterEstimate]:
    out = {}
    for i, p in enumerate(fit.problem.layout.parameters):
        estimate, sigma, at_bound = fit.estimates[p.name], float(bars.std[i]), bool(bars.at_bound[i])
        identifiable = not at_bound and bars.identifiability[p.name].identifiable
        out[p.name] = ParameterEstimate(
            estimate=estimate,
            std_error=np.nan if at_bound else sigma,
            ci95_lower=estimate - NORMAL_95 * sigma if identifiable else np.nan,
            ci95_upper=estimate + NORMAL_95 * sigma if identifiable else np.nan,
            bound_lower=p.lower,
            bound_upper=p.upper,
            at_bound=at_bound,
            identifiable=identifiable,
            unit=p.unit,
            prior_mean=p.prior_mean if p.prior is not None else np.nan,
            prior_std=p.prior if p.prior is not None else np.nan,
            start=p.value,
        )
    return out


def _nuisances(fit: Estimate, bars: ErrorBars) -> tuple[tuple[InitialState, ...], tuple[SensorBiases, ...]]:
    """Return the initial states of every segment and the biases of every maneuver, with their standard errors."""
    pieces, count = fit.problem.pieces, len(fit.prepared.windows)
    states: list[dict[str, Quantity]] = [{} for _ in pieces]
    biases: list[dict[str, Quantity]] = [{} for _ in range(count)]
    for entry, n in enumerate(fit.problem.layout.nuisances, fit.problem.dimension):
        value, std = n.center + n.scale * float(fit.z[entry]), float(bars.std[entry])
        if n.piece is None:
            channel = n.name.split(".")[1]
            biases[n.maneuver][channel] = Quantity(value, std, VARIABLES[channel].unit)
        else:
            unit = "m/s" if n.name.startswith("gust.") else START_UNITS.get(n.name, "rad")
            states[n.piece][n.name] = Quantity(value, std, unit)
    segments = [sum(p.maneuver == piece.maneuver for p in pieces[:i]) for i, piece in enumerate(pieces)]
    rows = zip(pieces, segments, states, strict=True)
    initial = tuple(InitialState(p.maneuver, segment, float(p.time[0]), own) for p, segment, own in rows)
    return initial, tuple(SensorBiases(maneuver, values) for maneuver, values in enumerate(biases))


def _wind(flights: Mapping[str, Flight]) -> tuple[WindEstimate, ...]:
    out = []
    for name, air in ((f.name, f.air) for f in flights.values()):
        if air is None or air.method == "none":
            continue
        units = {"wind_n": "m/s", "wind_e": "m/s"}
        if np.isfinite(air.pitot_scale):
            units |= {"pitot_scale": "1", "pitot_offset": "m/s"}
        values = {n: Quantity(getattr(air, n), getattr(air, f"{n}_std"), unit) for n, unit in units.items()}
        out.append(WindEstimate(name, values, air.residual_rms, tuple(air.notices)))
    return tuple(out)
