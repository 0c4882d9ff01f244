"""A log of 50 Hz is fitted on a grid of its own rate: the estimates and errors are those of a grid of 100 Hz."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop.exporters.flight_logs import save_flight_as
from stoop.flight import load
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle.builtin import builtin_vehicle
from stoop.workflow.identification import identify

RATE = 50.0  #: Hz


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of an airplane that flies doublets of all surfaces, with noise."""
    sizes = {"elevator": 0.05, "aileron": 0.05, "rudder": 0.07}
    inputs = [
        {"control": name, "shape": "doublet", "start": 1.0 + 3.0 * i, "step": 0.5, "amplitude": size}
        for i, (name, size) in enumerate([*sizes.items(), *sizes.items()])
    ]
    maneuver = Maneuver.model_validate({"duration": 20.0, "rate": RATE, "input": inputs})
    path = tmp_path_factory.mktemp("log") / "flight.ulg"
    save_flight_as(simulate_flight(builtin_vehicle("twin-boom"), maneuver, seed=4), path)
    return path


def test_a_coarser_grid_of_the_logs_own_rate_gives_the_same_estimates(log: Path) -> None:
    vehicle = builtin_vehicle("twin-boom")
    assert load(log).rate == RATE
    own, fine = (identify(vehicle, load(log, rate=rate), ["1:19.5"]).result for rate in (None, 100.0))
    known = [n for n, p in fine.parameters.items() if p.identifiable and not p.at_bound]
    assert len(known) > 20
    for name in known:
        one, other = own.parameters[name], fine.parameters[name]
        assert abs(one.estimate - other.estimate) < 0.25 * other.std_error, name
    ratios = [own.parameters[n].std_error / fine.parameters[n].std_error for n in known]
    assert np.quantile(ratios, [0.1, 0.9]) == pytest.approx([1.0, 1.0], abs=0.12)
