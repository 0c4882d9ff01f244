"""Fits by the name of a method, and how far their estimates are from the truth."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from stoop import Flight, Options, Vehicle
from stoop.assessment.error_bars import ErrorBars
from stoop.base.arrays import FloatArray
from stoop.estimate import methods
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import estimation_problem
from stoop.problem import Misfit
from stoop.problem.windows import Window


def fit_by(method: str, vehicle: Vehicle, flights: Any, windows: Any, **options: Any) -> Estimate:
    fitter, state = methods.find(method).fitter(), options.pop("state", None)
    found: Estimate = fitter(vehicle, flights, windows, Options(method=method, **options), None, state)
    return found


def deviations(found: Estimate, truth: Mapping[str, float]) -> FloatArray:
    std = dict(zip(found.estimates, ErrorBars.of(found).std.tolist(), strict=False))
    return np.array([(found.estimates[n] - true) / std[n] for n, true in truth.items()])


def posed(vehicle: Vehicle, flight: Flight, stop: float | None = None) -> Misfit:
    windows = [Window(flight.name, 0.0, float(flight.time[-1]) if stop is None else stop)]
    return estimation_problem(vehicle, {flight.name: flight}, windows, Options())[0]
