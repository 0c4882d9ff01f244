"""Prediction: fly windows with a fitted model; nothing is fitted there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stoop.cost import Layout, Misfit, Piece
from stoop.cost.misfit import horizon_ladder
from stoop.flight import Flight
from stoop.identify.fit import Fit
from stoop.identify.prepare import Prepared, prepare
from stoop.identify.windows import Window
from stoop.vehicle import Vehicle

FloatArray = NDArray[np.float64]


def identified_vehicle(fit: Fit) -> Vehicle:
    """Return the vehicle with its free numbers at their estimates."""
    changes = {name: {"value": value} for name, value in fit.estimates.items()}
    return fit.problem.layout.vehicle.with_numbers(changes)


def mean_biases(fit: Fit) -> dict[str, float]:
    """Return each bias averaged over the fitted maneuvers: what is known of it elsewhere."""
    found: dict[str, list[float]] = {}
    offset = fit.problem.dimension
    for j, nuisance in enumerate(fit.problem.layout.nuisances):
        if nuisance.is_bias:
            found.setdefault(nuisance.name, []).append(nuisance.center + nuisance.scale * fit.z[offset + j])
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
    vehicle = identified_vehicle(fit)
    prepared = prepare(vehicle, flights, windows)
    biases = mean_biases(fit)
    pieces = tuple(_unbiased(piece, biases) for piece in prepared.pieces)
    prepared = replace(prepared, pieces=pieces)
    problem = Misfit(
        replace(Layout.of(vehicle, ()), parameters=()), pieces, fit.problem.weights, horizon_ladder(pieces)
    )
    return prepared, [problem.outputs(np.empty(0), i) for i in range(len(pieces))]


def _unbiased(piece: Piece, biases: Mapping[str, float]) -> Piece:
    start = {name: value - biases.get(f"sensors.{name}.bias", 0.0) for name, value in piece.start.items()}
    return replace(piece, start=start, changes={**piece.changes, **biases})
