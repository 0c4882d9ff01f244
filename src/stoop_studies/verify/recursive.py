"""Recursive estimates at the end of a record against the batch over the same band, and on the way there."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pandas as pd

from stoop.estimate.fit import Options, estimation_problem
from stoop.estimate.regression.aircraft import AircraftEquations
from stoop.estimate.regression.least_squares import FrequencyDomain, estimate
from stoop.estimate.regression.recursive import RealTime
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop_studies.findings import Findings, Setting, holds
from stoop_studies.verify.scenes import AIRCRAFT, multisine_maneuver, with_trim_thrust
from stoop_studies.verify.study import Samples, Verification, records_of, work

DURATION: Final = 60.0  #: s
RATE: Final = 50.0  #: Hz
BAND: Final = FrequencyDomain(0.05, 1.5)
AMPLITUDES: Final = {"elevator": (0.2, 6), "aileron": (0.08, 7), "rudder": (0.15, 8)}  #: rad; first harmonic
EXCITED: Final = 1.2  #: Hz
WELL_IDENTIFIED: Final = 0.02  #: standard error of the batch over the estimate is below
DIFFERENCE_LIMIT: Final = 0.02
CASE: Final = "flight"


def scene(seed: int) -> tuple[Vehicle, Flight]:
    """Return an aircraft, its thrust that of the trim, and its flight."""
    vehicle = with_trim_thrust(resolve_vehicle(AIRCRAFT))
    return vehicle, simulate_flight(vehicle, multisine_maneuver(AMPLITUDES, DURATION, RATE, EXCITED), seed)


@work
def compare(case: str, seed: int) -> dict[str, Any]:
    """Return the estimates of both at the end of the flight of ``seed``."""
    vehicle, flight = scene(seed)
    problem, _ = estimation_problem(
        vehicle, {flight.name: flight}, [Window(flight.name, 0.0, DURATION)], Options()
    )
    equations = AircraftEquations.of(problem.layout, problem.pieces)
    batch = estimate(equations, BAND)
    assert batch is not None  # noqa: S101 - everything was measured
    online = RealTime(vehicle, 1.0 / RATE, BAND.frequencies(len(flight.time), 1.0 / RATE))
    channels = [c for c in (*vehicle.outputs, *vehicle.inputs, "altitude") if c in flight.names]
    for row in np.column_stack([flight.column(c) for c in channels]).tolist():
        online.update(dict(zip(channels, row, strict=True)))
    found = online.estimate()
    names = equations.names
    kept = [k for k, name in enumerate(names) if not name.endswith("0")]
    std = np.sqrt(np.diag(batch.covariance))
    return {
        "names": [names[k] for k in kept],
        "batch": [float(batch.values[k]) for k in kept],
        "std": [float(std[k]) for k in kept],
        "recursive": [found[names[k]].value for k in kept],
    }


def show(setting: Setting, samples: Samples) -> Findings:
    """Return how far the recursive estimates are from the batch's."""
    results, vehicle = samples[CASE], resolve_vehicle(AIRCRAFT)
    batch, std, recursive = (np.array([t[k] for t in results]) for k in ("batch", "std", "recursive"))
    difference, well = np.abs(recursive / batch - 1.0), std < WELL_IDENTIFIED * np.abs(batch)
    largest = pd.DataFrame(difference).where(well).max()  # nothing for what no flight identifies well
    names = results[0]["names"]
    table = pd.DataFrame({
        "parameter": names, "truth": [vehicle.value(name) for name in names], "flights": len(results),
        "well_identified": well.sum(axis=0), "batch_std_error": np.median(std / np.abs(batch), axis=0),
        "median_difference": np.median(difference, axis=0), "largest_difference": difference.max(axis=0),
        "largest_difference_well_identified": largest,
    })  # fmt: skip
    records = records_of(table)
    worst = float(difference[well].max()) if well.any() else np.nan
    claim = holds(
        "at the end of the record every well identified parameter is within 2 % of the batch",
        bool(worst < DIFFERENCE_LIMIT),
        f"largest difference {100.0 * worst:.2f} %, {int(well.sum())} estimates of "
        f"{int(well.any(axis=0).sum())} parameters in {len(results)} flights",
    )
    return Findings.of("Recursive estimates against the batch", (claim,), records)


EXPERIMENT: Final = Verification("recursive", show, runs=50, work="compare", cases=(CASE,))
