"""Prediction: windows simulated with a fitted model; nothing is fitted there. The specific force of rotors beside the record.

A hovering vehicle cannot be simulated for long, but its forces can be compared with the accelerometers sample by sample.
Rotors shake them, so both sides are low-passed at `CUTOFF`, with zero phase and per stretch without a hole. Two reference
models stand beside: a constant, and thrust in proportion to the sum of the squared commands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.base.variables import SPECIFIC_FORCE
from stoop.errors import SimulationError
from stoop.estimate.fit import Fit
from stoop.estimate.regression.rotors import lagged_command, stretches
from stoop.estimate.shooting_windows import WINDOW_LENGTH, outputs_by_window
from stoop.flight import Flight
from stoop.problem import Layout, Misfit, Weights
from stoop.problem.misfit import horizon_ladder
from stoop.problem.observation import START_TIME, observation_model
from stoop.problem.prepare import Prepared, prepare
from stoop.problem.windows import Window
from stoop.simulation import START_NAMES, parameter_rows, trim
from stoop.vehicle import Vehicle

CUTOFF: Final = 5.0  #: Hz, of the specific force


def identified_vehicle(fit: Fit) -> Vehicle:
    """Return the vehicle with its free numbers at their estimates."""
    changes = {name: {"value": value} for name, value in fit.estimates.items()}
    return fit.problem.layout.vehicle.with_numbers(changes)


def mean_biases(fit: Fit, flight: str) -> dict[str, float]:
    """Return each bias averaged over the fitted maneuvers of a flight, or of all flights if it has none."""
    windows = fit.prepared.windows
    own = {i for i, w in enumerate(windows) if w.flight == flight} or set(range(len(windows)))
    found: dict[str, list[float]] = {}
    for nuisance, entry in zip(fit.problem.layout.nuisances, fit.z[fit.problem.dimension :], strict=True):
        if nuisance.is_bias and nuisance.maneuver in own:
            found.setdefault(nuisance.name, []).append(nuisance.center + nuisance.scale * float(entry))
    return {name: float(np.mean(values)) for name, values in found.items()}


def predict(
    fit: Fit, flights: Mapping[str, Flight], windows: Sequence[Window]
) -> tuple[Prepared, list[FloatArray]]:
    """Simulate windows with the fitted model; return pieces and the readings (n, n_y) of each.

    The initial state is the line through the first 0.2 s of measurements, less the biases; the biases are
    those of the fitted maneuvers.
    """
    biases = [mean_biases(fit, window.flight) for window in windows]
    return predicted(identified_vehicle(fit), flights, windows, biases)


def predicted(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    windows: Sequence[Window],
    biases: Sequence[Mapping[str, float]],
) -> tuple[Prepared, list[FloatArray]]:
    """Simulate windows with a vehicle as it is, see :func:`predict`.

    `biases` are those of the sensors in each window, by the names of the vehicle's numbers, SI.
    """
    parts = [_of_window(vehicle, flights, w, b) for w, b in zip(windows, biases, strict=True)]
    pieces = tuple(replace(p, maneuver=i) for i, part in enumerate(parts) for p in part.pieces)
    notices = [found for part in parts for found in part.notices]
    weights = Weights.of(np.ones(len(vehicle.outputs)))  # a simulation weighs nothing
    problem = Misfit(replace(Layout.of(vehicle, ()), parameters=()), pieces, weights, horizon_ladder(pieces))
    if observation_model(vehicle).open_loop:
        simulated = [problem.outputs(np.empty(0), i) for i in range(len(pieces))]
    else:
        simulated = [outputs_by_window(problem, i) for i in range(len(pieces))]
        notices += [notice("predicted-in-windows", str(w), length=WINDOW_LENGTH) for w in windows]
    return Prepared(tuple(windows), pieces, tuple(notices)), simulated


def _of_window(
    vehicle: Vehicle, flights: Mapping[str, Flight], window: Window, biases: Mapping[str, float]
) -> Prepared:
    """Prepare one window with the biases of its flight, with which its start is read.

    Where nothing was measured at the start, it is that of the steady flight at that airspeed; nothing is fitted here.
    """
    biased = vehicle.with_numbers({name: {"value": value} for name, value in biases.items()})
    prepared = prepare(biased, flights, [window])
    pieces, notices = [], [n for n in prepared.notices if n.code != "start-defaulted"]
    for piece in prepared.pieces:
        early = np.isfinite(piece.measured[piece.time <= piece.time[0] + START_TIME]).any(axis=0)
        recorded = dict(zip(vehicle.outputs, early, strict=True))
        missing = tuple(c for c in vehicle.outputs if c in START_NAMES and not recorded[c])
        start = piece.start
        if missing and observation_model(vehicle).open_loop:
            loaded = biased.with_numbers({name: {"value": value} for name, value in piece.changes.items()})
            logged = "density" in vehicle.inputs
            density = float(piece.inputs[0, vehicle.inputs.index("density")]) if logged else None
            try:
                steady = trim(loaded, start["V"], start["h"], density=density).start
                code = "predicted-from-trim"
            except SimulationError:
                steady, code = {}, "predicted-from-default"
            start = {**start, **{c: steady[c] for c in missing if c in steady}}
            notices.append(notice(code, str(window), channels=missing))
        pieces.append(replace(piece, start=start, changes={**piece.changes, **biases}))
    return replace(prepared, pieces=tuple(pieces), notices=tuple(notices))


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
        static[:, 2] = np.linalg.lstsq(regressors, measured[:, 2], rcond=None)[0] @ [
            np.ones(len(self.time)),
            self.squares,
        ]
        found = [np.sqrt(np.mean((self.measured - y) ** 2, axis=0)) for y in (self.model, constant, static)]
        return {c: ForceResiduals(*(float(f[i]) for f in found)) for i, c in enumerate(SPECIFIC_FORCE)}


def force_figures(
    fit: Fit, flights: Mapping[str, Flight], predicted: Sequence[Window]
) -> tuple[ForceFigures, ...]:
    """Return the residuals of fitted and predicted windows; none of a vehicle without rotors."""
    vehicle, dt, count = identified_vehicle(fit), fit.problem.pieces[0].dt, len(fit.prepared.windows)
    windows = [*fit.prepared.windows, *predicted] if vehicle.rotors else []
    curves = [force_curves(vehicle, flights, w, mean_biases(fit, w.flight)) for w in windows]
    fitted = [c for c in curves[:count] if c.time.size]
    return tuple(
        ForceFigures(w, "fit" if i < count else "validation", c.residuals(fitted), len(c.time) * dt)
        for i, (w, c) in enumerate(zip(windows, curves, strict=True))
        if c.time.size and fitted
    )


def force_curves(
    vehicle: Vehicle, flights: Mapping[str, Flight], window: Window, biases: Mapping[str, float]
) -> ForceCurves:
    """Return measured and modeled specific force of a window, low-passed.

    The vehicle has its estimates; `biases` are those of the sensors and the wind, SI.
    """
    parts = [(np.empty(0), np.empty((0, 7)))]
    for piece in prepare(vehicle, flights, [window]).pieces:
        for stretch in stretches(vehicle, replace(piece, changes={**piece.changes, **biases})):
            rows, own = parameter_rows(vehicle, stretch.piece.changes), stretch.samples
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
