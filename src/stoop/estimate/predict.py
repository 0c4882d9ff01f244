"""Prediction: windows simulated with a fitted model; nothing is fitted there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.errors import SimulationError
from stoop.estimate.fit import Fit
from stoop.estimate.shooting.windows import WINDOW_LENGTH, outputs_by_window
from stoop.flight import Flight
from stoop.problem import Layout, Misfit, Piece, Weights
from stoop.problem.misfit import horizon_ladder
from stoop.problem.observation import START_TIME, observation_model
from stoop.problem.prepare import Prepared, prepare
from stoop.problem.windows import Window
from stoop.simulation import START_NAMES, trim
from stoop.vehicle import Vehicle


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
    """Simulate windows with the fitted model.

    The initial state is the line through the first 0.2 s of measurements, less the biases; the biases are
    those of the fitted maneuvers.

    Returns
    -------
    prepared : Prepared
    simulated : list of (n, n_y)
        Readings of each piece.
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

    Parameters
    ----------
    vehicle : Vehicle
    flights : mapping of str to Flight
    windows : sequence of Window
    biases : sequence of mappings
        Of the sensors in each window, by the names of the vehicle's numbers, SI.
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
        early = piece.measured[piece.time <= piece.time[0] + START_TIME]
        recorded = dict(zip(vehicle.outputs, np.isfinite(early).any(axis=0), strict=True))
        missing = tuple(c for c in vehicle.outputs if c in START_NAMES and not recorded[c])
        start = piece.start
        if missing and observation_model(vehicle).open_loop:
            steady = _steady(biased, piece)
            start = {**start, **{c: steady[c] for c in missing if c in steady}}
            code = "predicted-from-trim" if steady else "predicted-from-default"
            notices.append(notice(code, str(window), channels=missing))
        pieces.append(replace(piece, start=start, changes={**piece.changes, **biases}))
    return replace(prepared, pieces=tuple(pieces), notices=tuple(notices))


def _steady(vehicle: Vehicle, piece: Piece) -> dict[str, float]:
    """Return the state of the steady flight that a piece might have begun from; empty where there is none."""
    loaded = vehicle.with_numbers({name: {"value": value} for name, value in piece.changes.items()})
    logged = "density" in vehicle.inputs
    density = float(piece.inputs[0, vehicle.inputs.index("density")]) if logged else None
    try:
        return trim(loaded, piece.start["V"], piece.start["h"], density=density).start
    except SimulationError:
        return {}
