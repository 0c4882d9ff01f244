"""Regressions on a real flight with holes: the V-tail aeroplane, batch and in real time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stoop.assessment.error_bars import error_bars
from stoop.estimate.fit import Options
from stoop.estimate.regression.least_squares import FrequencyDomain
from stoop.estimate.regression.method import frequency_domain
from stoop.estimate.regression.recursive import RealTime
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.vehicle.load import load_vehicle

EXAMPLE = Path(__file__).parents[2] / "examples" / "vtail.toml"
SPAN = (143.0, 196.0)  #: s; five stretches with holes between
FIRM = ("CLalpha", "CQbeta", "Cmelevator", "Cnr", "Cnrudder")


def test_in_real_time_as_in_batch(vtail_flight: Flight) -> None:
    """What the flight tells firmly agrees within two standard errors, though only one sees the whole record."""
    flight = vtail_flight
    vehicle = load_vehicle(EXAMPLE)
    batch = frequency_domain(
        vehicle, {flight.name: flight}, [Window(flight.name, *SPAN)], Options(method="frequency-domain")
    )
    names = [p.name for p in batch.problem.layout.parameters]
    std = dict(zip(names, error_bars(batch).std, strict=False))
    dt = 1.0 / flight.rate
    first, last = np.searchsorted(flight.time, SPAN)
    online = RealTime(batch.problem.layout.vehicle, dt, FrequencyDomain().frequencies(int(last - first), dt))
    channels = [c for c in (*vehicle.outputs, *vehicle.inputs, "altitude") if c in flight.data]
    for row in np.column_stack([flight.column(c)[first:last] for c in channels]):
        online.update(dict(zip(channels, row, strict=True)))
    found = online.estimate()
    for name in FIRM:
        assert std[name] < 0.15 * abs(batch.estimates[name]), name
        assert abs(found[name].value - batch.estimates[name]) < 2.0 * std[name], name
    assert found["CLalpha"].value > 0.0 > found["Cmelevator"].value
