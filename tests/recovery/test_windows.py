"""Windows found in calm flight with known maneuvers, and what was foretold of the error bars, over seeds."""

from __future__ import annotations

import numpy as np
import pytest
from unit.flown import maneuver

from stoop.estimate.fit import Options
from stoop.input_design.windows import find_windows
from stoop.simulation.fly import simulate_flight
from stoop.vehicle.builtin import resolve_vehicle
from stoop.workflow import identify

Inputs = tuple[tuple[str, str, float, float, float], ...]
QUAD = (
    ("roll", "3-2-1-1", 10.0, 0.15, 15.0), ("pitch", "doublet", 24.0, 0.2, 15.0), ("yaw", "3-2-1-1", 38.0, 0.4, 1.0),
)  # fmt: skip
AIRCRAFT = (
    ("elevator", "3-2-1-1", 8.0, 0.3, 0.03), ("rudder", "doublet", 28.0, 0.8, 0.1), ("aileron", "doublet", 46.0, 0.5, 0.05),
)  # fmt: skip


@pytest.mark.parametrize(("name", "inputs"), [("quad-x", QUAD), ("twin-boom", AIRCRAFT)])
def test_known_maneuvers_are_found_and_calm_flight_is_not(name: str, inputs: Inputs) -> None:
    more, vehicle = {} if name == "quad-x" else {"airspeed": 35.0}, resolve_vehicle(name)
    flown = maneuver(60.0, *inputs, altitude=200.0, rate=100.0, **more)
    flight = simulate_flight(vehicle, flown, seed=1, name="sim")
    found = find_windows({"sim": flight}, vehicle)
    kept = [w for w in found.windows if w.accept]
    spans = [(t, t + {"3-2-1-1": 7, "doublet": 2}[shape] * step) for _, shape, t, step, _ in inputs]
    assert all(any(w.start <= a and w.stop >= b for w in kept) for a, b in spans)
    fitted = [w for w in kept if w.use == "fit"]
    moved = [any(w.start < a + 7.0 * s and w.stop > a for _, _, a, s, _ in inputs) for w in fitted]
    assert np.mean(moved) >= 0.75
    if name == "twin-boom":  # error bars come out as foretold
        told = identify(vehicle, flight, found.texts("fit"), options=Options(budget=5000.0)).result.parameters
        ratios = [told[e.name].std_error / e.std_error for e in found.expected if told[e.name].identifiable]
        assert len(ratios) > 3
        assert 0.5 < float(np.median(ratios)) < 2.0
