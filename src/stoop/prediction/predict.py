"""Prediction: windows simulated with a fitted model without fitting its parameters; specific force of rotors.

A hovering vehicle cannot be simulated for long, but its forces can be compared with the accelerometers sample by sample.
Rotors shake them, so both sides are low-passed at `CUTOFF`, with zero phase, in each stretch without a hole. Two reference
models are compared: a constant, and thrust in proportion to the sum of the squared commands.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.numbers import factor_and_unit
from stoop.base.variables import SPECIFIC_FORCE, VARIABLES
from stoop.errors import SimulationError
from stoop.estimate.estimate import Estimate
from stoop.estimate.instability import growth
from stoop.estimate.regression.rotors import lagged_command, stretches
from stoop.estimate.shooting_windows import WINDOW_LENGTH
from stoop.estimate.shooting_windows import edges as window_edges
from stoop.flight import Flight
from stoop.prediction.initial_state import (
    MIN_STRETCH,
    STRETCH,
    BiasPrior,
    Predicted,
    Predictor,
    Stretch,
    bias_priors,
    innovations,
    predict_stretch,
    stretch_before,
    with_deviation,
)
from stoop.problem import Layout, Misfit, Piece, on_circle
from stoop.problem.observation import START_TIME
from stoop.problem.prepare import Prepared, decoupled
from stoop.problem.windows import Window
from stoop.results.result import Covariance, NoiseCovariance
from stoop.simulation import START_NAMES, trim
from stoop.vehicle import Vehicle
from stoop.vehicle.channels import AIR_FRAME, GROUND_FRAME, check_states

#: Hz, of the specific force
CUTOFF: Final = 5.0


def predictor(fit: Estimate, covariance: FloatArray, recorded_motion: bool = True) -> Predictor:
    """Return the predictor of a fit; `covariance` (k, k) is that of its unknowns, parameters first."""
    names = tuple(p.name for p in fit.problem.layout.parameters)
    outputs = fit.problem.layout.vehicle.outputs
    return Predictor(
        fit.identified_vehicle,
        Covariance(names, covariance[: len(names), : len(names)]),
        NoiseCovariance(outputs, fit.measurement_noise, fit.correlation_time),
        fit.predictor,
        recorded_motion,
    )


def expected_biases(fit: Estimate, flight: str) -> dict[str, BiasPrior]:
    """Return the prior of each sensor bias in a window of a flight, from the fitted maneuvers."""
    of_maneuver: list[dict[str, float]] = [{} for _ in fit.prepared.windows]
    widths = {}
    for nuisance, entry in zip(fit.problem.layout.nuisances, fit.z[fit.problem.dimension :], strict=True):
        if nuisance.is_bias:
            of_maneuver[nuisance.maneuver][nuisance.name] = nuisance.center + nuisance.scale * float(entry)
            widths[nuisance.name] = nuisance.scale
    flights = [window.flight for window in fit.prepared.windows]
    return bias_priors(list(zip(flights, of_maneuver, strict=True)), flight, widths)


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted windows: readings (n, n_y) of each piece, and their standard deviations, measurement noise included.

    `innovations` (n, n_y) are those of a filter, over their standard deviations `expected`; None where the fit is by none.
    """

    prepared: Prepared
    readings: tuple[FloatArray, ...]
    deviations: tuple[FloatArray, ...]
    innovations: tuple[FloatArray, ...] | None = None
    expected: tuple[FloatArray, ...] | None = None

    def log_likelihood(self, outputs: Sequence[str]) -> FloatArray:
        """Return that of each sample (n,) but for a constant, by the filter where there is one."""
        errors, deviations = self.innovations, self.expected
        if errors is None or deviations is None:
            parts = zip(self.prepared.pieces, self.readings, self.deviations, strict=True)
            with np.errstate(divide="ignore", invalid="ignore"):
                errors = tuple(on_circle(piece.measured - y, outputs) / s for piece, y, s in parts)
            deviations = self.deviations
        v, s = np.concatenate(errors), np.concatenate(deviations)
        return np.asarray(-0.5 * np.nansum(v**2 + 2.0 * np.log(s), axis=1))


def predict(
    model: Predictor,
    flights: Mapping[str, Flight],
    windows: Sequence[Window],
    biases: Sequence[Mapping[str, BiasPrior]],
) -> Prediction:
    """Simulate windows with a fitted model; no parameter is fitted there.

    `biases` are the priors of the sensors' in each window, by the names of the vehicle's numbers. They and the initial state
    are estimated from the record before each window, see :mod:`stoop.prediction.initial_state`.
    """
    parts = [_of_window(model, flights, w, b) for w, b in zip(windows, biases, strict=True)]
    pieces = [replace(p, maneuver=i) for i, (part, *_) in enumerate(parts) for p in part.pieces]
    notices = tuple(found for part, *_ in parts for found in part.notices)
    found = [one for _, some, _ in parts for one in some]
    filtered = [one for *_, some in parts for one in some]
    noise = np.nan_to_num(model.variance)
    deviations = tuple(np.sqrt(one.deviation**2 + noise) for one in found)
    return Prediction(
        Prepared(tuple(windows), tuple(pieces), notices),
        tuple(one.readings for one in found),
        deviations,
        None if model.filter is None else tuple(v for v, _ in filtered),
        None if model.filter is None else tuple(s for _, s in filtered),
    )


def predict_from(
    model: Predictor,
    flights: Mapping[str, Flight],
    windows: Sequence[Window],
    biases: Mapping[str, BiasPrior],
    start: Mapping[str, float],
) -> Prediction:
    """Simulate windows open loop from a given initial state; neither it nor a sensor bias is estimated there.

    Parameters
    ----------
    model, flights, windows
        As of :func:`predict`.
    biases : mapping
        Priors of the sensors' biases, whose means are taken.
    start : mapping
        States of the vehicle's ``start_names``, SI, at the start of each window; the others, and all after a hole in the
        record, are those of `stoop.problem.observation.guess_start`.

    Raises
    ------
    SimulationError
        A state is unknown or not finite.
    """
    check_states(model.vehicle, start)
    means = {name: prior.mean for name, prior in biases.items()}
    pieces, found, notices = list[Piece](), list[Predicted](), list[Notice]()
    for i, window in enumerate(windows):
        vehicle = _coupled(model, flights, window)
        biased = vehicle.with_numbers({name: {"value": value} for name, value in means.items()})
        prepared = Prepared.of(biased, flights, [window])
        notices += prepared.notices
        for k, piece in enumerate(prepared.pieces):
            own = {**piece.start, **({} if k else start)}
            pieces.append(replace(piece, maneuver=i, start=own, changes={**piece.changes, **means}))
            found.append(_open_loop(replace(model, vehicle=vehicle), pieces[-1]))
    noise = np.nan_to_num(model.variance)
    deviations = tuple(np.sqrt(one.deviation**2 + noise) for one in found)
    prepared = Prepared(tuple(windows), tuple(pieces), tuple(notices))
    return Prediction(prepared, tuple(one.readings for one in found), deviations)


def _coupled(model: Predictor, flights: Mapping[str, Flight], window: Window) -> Vehicle:
    """Return the vehicle of a window; it takes the states that it leaves out from the record if the fit did so."""
    return decoupled(model.vehicle, flights, [window]) if model.recorded_motion else model.vehicle


def _open_loop(model: Predictor, piece: Piece) -> Predicted:
    """Return the readings of a piece from its start, and their standard deviations by the parameters alone."""
    parameters, covariance = model.uncertain()
    layout, ladder = Layout(model.vehicle, parameters, ()), ((len(piece.time),),)
    problem = Misfit(layout, (replace(piece, maneuver=0),), model.weights, ladder)
    return with_deviation(problem, np.full(len(parameters), 0.5), covariance, 0)


def _of_window(
    model: Predictor, flights: Mapping[str, Flight], window: Window, priors: Mapping[str, BiasPrior]
) -> tuple[Prepared, list[Predicted], tuple[tuple[FloatArray, FloatArray], ...]]:
    """Prepare and predict one window with the biases of its flight; its innovations where there is a filter."""
    model = replace(model, vehicle=_coupled(model, flights, window))
    biases = {name: prior.mean for name, prior in priors.items()}
    biased = model.vehicle.with_numbers({name: {"value": value} for name, value in biases.items()})
    prepared, kind = Prepared.of(biased, flights, [window]), _PREDICTIONS[biased.frame]
    found, late = [], []
    notices = [n for n in prepared.notices if n.code != "start-defaulted"]
    notices += [notice(code, str(window), length=WINDOW_LENGTH, stretch=STRETCH) for code in kind.codes]
    for piece in prepared.pieces:
        stretch = stretch_before(biased, flights, window, piece)
        stretch, missing, code = _about_steady_flight(biased, stretch)
        stretch = replace(stretch, piece=replace(stretch.piece, changes={**piece.changes, **biases}))
        n, length = len(piece.time), kind.length
        errors = growth(biased, piece, biased.parameter_rows(stretch.piece.changes))
        if errors.excessive and (stable := max(errors.horizon, WINDOW_LENGTH)) < length:
            length = stable
            about = {"rate": errors.rate, "length": length, "stretch": STRETCH}
            notices.append(notice("predicted-unstable", str(window), **about))
        edges = window_edges(n, round(length / piece.dt)) if np.isfinite(length) else (0, n)
        several = len(edges) > 2
        stretches = [stretch.part(biased, a, b) if several else stretch for a, b in pairwise(edges)]
        parts = [predict_stretch(model, one, priors) for one in stretches]
        columns = zip(*((p.readings, p.deviation) for p in parts), strict=True)
        whole = Predicted(*map(np.concatenate, columns))
        found.append(whole)
        if missing:
            notices.append(_unrecorded_start(code, window, biased, missing, whole))
        late += [] if stretch.first else [float(piece.time[0])]
    if late:
        spans = {"stretch": STRETCH, "least": MIN_STRETCH}
        notices.append(notice("start-from-prediction", str(window), times=tuple(late), **spans))
    changed = tuple(replace(p, changes={**p.changes, **biases}) for p in prepared.pieces)
    prepared = replace(prepared, pieces=changed, notices=tuple(notices))
    return prepared, found, innovations(model, prepared, priors)


def _about_steady_flight(vehicle: Vehicle, stretch: Stretch) -> tuple[Stretch, tuple[str, ...], str]:
    """Return the stretch with unrecorded states of its start at steady flight, their channels, and the notice's code."""
    piece = stretch.piece
    early = np.isfinite(piece.whole[piece.time <= piece.time[0] + START_TIME]).any(axis=0)
    recorded = dict(zip(vehicle.outputs, early, strict=True))
    missing = tuple(c for c in vehicle.outputs if c in START_NAMES and not recorded[c])
    start, code = piece.start, ""
    for steady_start in _PREDICTIONS[vehicle.frame].starts if missing else ():
        steady, code = steady_start(vehicle, piece)
        start = {**start, **{c: steady[c] for c in missing if c in steady}}
    return replace(stretch, piece=replace(piece, start=start)), missing if code else (), code


def _unrecorded_start(
    code: str, window: Window, vehicle: Vehicle, missing: Sequence[str], found: Predicted
) -> Notice:
    """Return the notice of states that were not recorded, with their standard errors at the start of the window."""
    errors = []
    for c in missing:
        factor, unit = factor_and_unit(VARIABLES[c].unit)
        errors.append(f"{factor * found.deviation[0, vehicle.outputs.index(c)]:.2g} {unit}")
    return notice(code, str(window), channels=tuple(missing), errors=tuple(errors))


def _trimmed_start(vehicle: Vehicle, piece: Piece) -> tuple[Mapping[str, float], str]:
    """Return the steady flight at the airspeed and altitude of a piece, and the code of its notice."""
    loaded = vehicle.with_numbers({name: {"value": value} for name, value in piece.changes.items()})
    logged = "density" in vehicle.inputs
    density = float(piece.inputs[0, vehicle.inputs.index("density")]) if logged else None
    try:
        return trim(loaded, piece.start["V"], piece.start["h"], density=density).start, "predicted-from-trim"
    except SimulationError:
        return {}, "predicted-from-default"


@dataclass(frozen=True)
class ForceResiduals:
    """Residuals of one axis, rms, m/s2.

    Of the fitted model; of the mean of the fitted windows; of a constant and the sum of squared commands.
    """

    model: float
    constant: float
    static: float


@dataclass(frozen=True)
class ForceFigures:
    """The specific force in one window, by axis ``ax``, ``ay``, ``az``; `role` is "fit" or "validation".

    `seconds` of flight were compared.
    """

    window: Window
    role: str
    axes: Mapping[str, ForceResiduals]
    seconds: float


@dataclass(frozen=True, eq=False)
class ForceCurves:
    """Low-passed specific force (n, 3) of one window, m/s2, and the sum of squared commands (n,) at times (n,), s."""

    time: FloatArray
    measured: FloatArray
    model: FloatArray
    squares: FloatArray

    def residuals(self, fitted: Sequence[ForceCurves]) -> dict[str, ForceResiduals]:
        """Return residuals by axis; two models without aerodynamics are estimated from the fitted windows."""
        measured = np.concatenate([c.measured for c in fitted])
        squares = np.concatenate([c.squares for c in fitted])
        constant = np.tile(measured.mean(axis=0), (len(self.time), 1))
        regressors, static = np.column_stack([np.ones(len(squares)), squares]), constant.copy()
        gains = np.linalg.lstsq(regressors, measured[:, 2], rcond=None)[0]
        static[:, 2] = gains @ [np.ones(len(self.time)), self.squares]
        found = [np.sqrt(np.mean((self.measured - y) ** 2, axis=0)) for y in (self.model, constant, static)]
        return {c: ForceResiduals(*(float(f[i]) for f in found)) for i, c in enumerate(SPECIFIC_FORCE)}


def force_figures(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    windows: Sequence[Window],
    predicted: Sequence[Window],
    biases: Callable[[str], Mapping[str, BiasPrior]],
) -> tuple[ForceFigures, ...]:
    """Return the residuals of fitted and predicted windows; none of a vehicle without rotors.

    The vehicle has its estimates; `biases` returns the priors of the sensors' biases in a flight.
    """
    count, of_kind = len(windows), _PREDICTIONS[vehicle.frame].curves
    both = [*windows, *predicted]
    means = {w.flight: {name: prior.mean for name, prior in biases(w.flight).items()} for w in both}
    curves = [of(vehicle, flights, w, means[w.flight]) for of in of_kind for w in both]
    fitted = [c for c in curves[:count] if c.time.size]
    return tuple(
        ForceFigures(
            w, "fit" if i < count else "validation", c.residuals(fitted), len(c.time) / flights[w.flight].rate
        )
        for i, (w, c) in enumerate(zip(both, curves, strict=False))  # curves of some kinds only
        if c.time.size and fitted
    )


def force_curves(
    vehicle: Vehicle, flights: Mapping[str, Flight], window: Window, biases: Mapping[str, float]
) -> ForceCurves:
    """Return measured and modeled specific force of a window, low-passed.

    The vehicle has its estimates; `biases` are those of the sensors and the wind, SI.
    """
    parts = [(np.empty(0), np.empty((0, 7)))]
    for piece in Prepared.of(vehicle, flights, [window]).pieces:
        for stretch in stretches(vehicle, replace(piece, changes={**piece.changes, **biases})):
            rows, own = vehicle.parameter_rows(stretch.piece.changes), stretch.samples
            spins = [lagged_command(vehicle, stretch.piece, name, rows)[own] for name in vehicle.rotors]
            forces = [stretch.measured[:, 3:], stretch.modeled(vehicle, rows)[:, 3:]]
            columns = np.column_stack([*forces, np.sum(np.square(spins), axis=0)])
            parts.append((piece.time[own], low_passed(columns, piece.dt)))
    time, slow = (np.concatenate(column) for column in zip(*parts, strict=True))
    return ForceCurves(time, slow[:, :3], slow[:, 3:6], slow[:, 6])


def low_passed(columns: FloatArray, dt: float) -> FloatArray:
    """Return columns (n, k) below `CUTOFF`, without phase: a Butterworth filter that runs forward and backward."""
    from scipy.signal import butter, sosfiltfilt

    sos = butter(2, min(CUTOFF, 0.45 / dt), fs=1.0 / dt, output="sos")
    pad = min(len(columns) - 1, round(3.0 / (CUTOFF * dt)))
    return np.asarray(sosfiltfilt(sos, columns, axis=0, padlen=pad))


@dataclass(frozen=True)
class PredictionModel:
    """How a kind of vehicle is predicted."""

    #: s after which a prediction begins anew
    length: float = np.inf
    #: of notices about that
    codes: tuple[str, ...] = ()
    #: where not measured
    starts: tuple[Callable[[Vehicle, Piece], tuple[Mapping[str, float], str]], ...] = ()
    #: of the specific force, as :func:`force_curves`
    curves: tuple[Callable[..., ForceCurves], ...] = ()


_PREDICTIONS: Final = {
    AIR_FRAME: PredictionModel(starts=(_trimmed_start,)),
    GROUND_FRAME: PredictionModel(WINDOW_LENGTH, codes=("predicted-in-windows",), curves=(force_curves,)),
}
