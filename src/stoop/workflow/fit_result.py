"""From a finished fit to its result: error bars, predictions, modes, notices, and what the report draws."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from stoop.assessment.covariance import intervals_95
from stoop.assessment.error_bars import ErrorBars, error_bars
from stoop.assessment.goodness_of_fit import left_out_residuals
from stoop.assessment.modes import modes
from stoop.assessment.uncertainty import with_uncertainty
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, as_notice, of_severity
from stoop.base.variables import VARIABLES
from stoop.estimate.excitation import ratios, too_few
from stoop.estimate.fit import Fit, Options
from stoop.estimate.noise import channel_residuals, noise_variance
from stoop.estimate.predict import predict
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.results.result import (
    AirDataTrace,
    Covariance,
    Identification,
    InitialState,
    ManeuverResult,
    NoiseCovariance,
    ParameterEstimate,
    Quantity,
    Result,
    SensorBiases,
    WindEstimate,
)
from stoop.vehicle.notation import symbols
from stoop.workflow.curves import Simulated, channel_units, maneuver_curves
from stoop.workflow.notices import basis_notices, data_notices, fit_warnings, slowest_rate
from stoop.workflow.provenance import versions

TOO_FEW: Final = "there are too few samples for any error bar to hold"
START_UNITS: Final = {"V": "m/s", "p": "rad/s", "q": "rad/s", "r": "rad/s"}  #: of initial states; others rad


def identification(
    fit: Fit,
    flights: Mapping[str, Flight],
    predicted: Sequence[Window],
    options: Options,
    inputs: Mapping[str, str],
    began: float,
    command: str,
) -> Identification:
    """Return the result of a fit with its curves.

    Parameters
    ----------
    fit : Fit
    flights : mapping
        By name, as they were fitted.
    predicted : sequence of Window
        Not fitted; predicted by the model.
    options : Options
    inputs : mapping of str to str
        Names of files to hashes of their content.
    began : float
        `time.perf_counter` at the start.
    command : str
    """
    vehicle = fit.problem.layout.vehicle
    color, bars = fit.inflation, error_bars(fit)
    if too_few(fit.problem, slowest_rate(fit, flights)):
        bars = bars.rejected(TOO_FEW)
    fitted = fit.simulated or [fit.problem.outputs(fit.z, i) for i in range(len(fit.problem.pieces))]
    groups = [Simulated("fit", fit.prepared, fitted, left_out_residuals(fit))]
    if predicted:
        groups.append(Simulated("validation", *predict(fit, flights, predicted)))
    maneuvers, traces = maneuver_curves(vehicle, groups)
    result = _result(fit, bars, maneuvers, flights, inputs, options)
    result = replace(result, modes=modes(fit, result.covariance.names, result.covariance.matrix))
    result = with_uncertainty(result, fit, bars)
    result = replace(result, notices=(*result.notices, *_notices(fit, result, flights, groups, color)))
    return Identification(
        result=replace(result, seconds=time.perf_counter() - began),
        traces=traces,
        vehicle=vehicle.name,
        equations=vehicle.kernel().latex,
        convergence=fit.outcome.history,
        units=channel_units(vehicle),
        symbols=symbols(vehicle),
        air_data=_air_data(flights),
        command=command,
    )


def _notices(
    fit: Fit, result: Result, flights: Mapping[str, Flight], groups: Sequence[Simulated], color: float
) -> list[Notice]:
    """Return what is doubtful about predictions and windows, what the figures rest on, and what the data show."""
    vehicle = fit.problem.layout.vehicle
    of_windows = [n for g in groups for n in of_severity(g.prepared.notices, "warning")]
    prepared = [n for g in groups for n in of_severity(g.prepared.notices, "info")]
    per_mass = ratios(vehicle, {name: (p.estimate, p.std_error) for name, p in result.parameters.items()})
    of_flights = [found for flight in flights.values() for found in flight.notices]
    return [
        *dict.fromkeys(of_windows),
        *of_severity(fit.notices, "info"),
        *([as_notice(per_mass, "info")] if per_mass else []),
        *basis_notices(vehicle, flights, color),
        *data_notices([*of_flights, *prepared]),
    ]


def _result(
    fit: Fit,
    bars: ErrorBars,
    maneuvers: tuple[ManeuverResult, ...],
    flights: Mapping[str, Flight],
    inputs: Mapping[str, str],
    options: Options,
) -> Result:
    vehicle, parameters = fit.problem.layout.vehicle, _parameters(fit, bars)
    names = tuple(parameters)
    return Result(
        parameters=parameters,
        covariance=Covariance(names, bars.covariance[: len(names), : len(names)]),
        noise_covariance=NoiseCovariance(vehicle.outputs, _noise(fit, options)),
        initial_states=_initial_states(fit, bars),
        biases=_biases(fit, bars),
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
        inputs=inputs,
        method=options.method,
    )


def _noise(fit: Fit, options: Options) -> FloatArray:
    """Return the noise covariance; NaN for a channel that was never measured."""
    if fit.noise is not None:
        return fit.noise
    if options.covariance is not None:
        return fit.problem.weights.covariance
    measured = np.any([np.isfinite(p.measured).any(axis=0) for p in fit.problem.pieces], axis=0)
    return np.diag(
        np.where(measured, noise_variance(fit.problem, channel_residuals(fit.problem, fit.z)), np.nan)
    )


def _parameters(fit: Fit, bars: ErrorBars) -> dict[str, ParameterEstimate]:
    out = {}
    for i, p in enumerate(fit.problem.layout.parameters):
        estimate, sigma, at_bound = fit.estimates[p.name], float(bars.std[i]), bool(bars.at_bound[i])
        low, high = intervals_95(np.array([estimate]), np.array([sigma]))[0]
        identifiable = not at_bound and bars.identifiability[p.name].identifiable
        out[p.name] = ParameterEstimate(
            estimate=estimate,
            std_error=np.nan if at_bound else sigma,
            ci95_lower=float(low) if identifiable else np.nan,
            ci95_upper=float(high) if identifiable else np.nan,
            bound_lower=p.lower,
            bound_upper=p.upper,
            at_bound=at_bound,
            identifiable=identifiable,
            unit=p.unit,
            prior_mean=p.value if p.prior is not None else np.nan,
            prior_std=p.prior if p.prior is not None else np.nan,
            start=p.value,
        )
    return out


def _quantity(fit: Fit, bars: ErrorBars, j: int, unit: str) -> Quantity:
    """Return nuisance `j` with its standard error."""
    nuisance = fit.problem.layout.nuisances[j]
    entry = fit.problem.dimension + j
    return Quantity(nuisance.center + nuisance.scale * float(fit.z[entry]), float(bars.std[entry]), unit)


def _initial_states(fit: Fit, bars: ErrorBars) -> tuple[InitialState, ...]:
    out, counts = [], dict.fromkeys(range(len(fit.prepared.windows)), 0)
    for i, piece in enumerate(fit.problem.pieces):
        values = {}
        for j, n in enumerate(fit.problem.layout.nuisances):
            if n.piece == i:
                unit = "m/s" if n.name.startswith("gust.") else START_UNITS.get(n.name, "rad")
                values[n.name] = _quantity(fit, bars, j, unit)
        out.append(InitialState(piece.maneuver, counts[piece.maneuver], float(piece.time[0]), values))
        counts[piece.maneuver] += 1
    return tuple(out)


def _biases(fit: Fit, bars: ErrorBars) -> tuple[SensorBiases, ...]:
    out = []
    for maneuver in range(len(fit.prepared.windows)):
        values = {}
        for j, n in enumerate(fit.problem.layout.nuisances):
            if n.is_bias and n.maneuver == maneuver:
                channel = n.name.split(".")[1]
                values[channel] = _quantity(fit, bars, j, VARIABLES[channel].unit)
        out.append(SensorBiases(maneuver, values))
    return tuple(out)


def _wind(flights: Mapping[str, Flight]) -> tuple[WindEstimate, ...]:
    out = []
    for flight in flights.values():
        air = flight.air
        if air is None or air.method == "none":
            continue
        values = {
            "wind_n": Quantity(air.wind_n, air.wind_n_std, "m/s"),
            "wind_e": Quantity(air.wind_e, air.wind_e_std, "m/s"),
        }
        if np.isfinite(air.pitot_scale):
            values["pitot_scale"] = Quantity(air.pitot_scale, air.pitot_scale_std, "1")
            values["pitot_offset"] = Quantity(air.pitot_offset, air.pitot_offset_std, "m/s")
        out.append(WindEstimate(flight.name, values, air.residual_rms, tuple(map(str, air.notices))))
    return tuple(out)


def _air_data(flights: Mapping[str, Flight]) -> tuple[AirDataTrace, ...]:
    out = []
    for flight in flights.values():
        if flight.air is not None and "time" in flight.air.traces:
            curves = {k: v for k, v in flight.air.traces.items() if k != "time"}
            out.append(AirDataTrace(flight.name, flight.air.traces["time"], curves))
    return tuple(out)
