"""Which stretches of a flight are windows: maneuvers of any size and length, and flights that are one maneuver."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.errors import FlightError
from stoop.flight import Flight, from_columns
from stoop.input_design.windows import find_windows
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import builtin_vehicle

RATE = 50.0
TIME = np.arange(0.0, 60.0, 1.0 / RATE)


def rolled(aileron: FloatArray, gust: FloatArray, feedback: float = 0.0) -> Flight:
    """Return a flight whose roll rate follows ailerons and gusts by one lag: p' = -5 p + 40 delta + gust."""
    p, phi, delta = (np.zeros(TIME.size) for _ in range(3))
    for k in range(1, TIME.size):
        delta[k - 1] = aileron[k - 1] - feedback * (p[k - 1] + phi[k - 1])
        p[k] = p[k - 1] + (-5.0 * p[k - 1] + 40.0 * delta[k - 1] + gust[k - 1]) / RATE
        phi[k] = phi[k - 1] + p[k - 1] / RATE
    columns = {"p": p, "q": 0.0 * p, "r": 0.0 * p, "phi": phi, "aileron": delta}
    return from_columns("f", TIME, columns | {"vn": 20.0 + 0.0 * p, "ve": 0.0 * p, "vd": 0.0 * p})


def doublets(*inputs: tuple[float, float, float]) -> FloatArray:
    """Return doublets: start [s], step [s], amplitude [rad]."""
    out = np.zeros(TIME.size)
    for start, step, size in inputs:
        out += size * ((start <= TIME) & (start + step > TIME))
        out -= size * ((start + step <= TIME) & (start + 2.0 * step > TIME))
    return out


CALM = np.zeros(TIME.size)


@pytest.mark.parametrize("step", [0.2, 0.3, 0.5])
@pytest.mark.parametrize("size", [0.06, 0.2])
def test_a_small_or_short_doublet_beside_a_large_one_is_a_window(step: float, size: float) -> None:
    found = find_windows({"f": rolled(doublets((10.0, 0.6, 0.2), (40.0, step, size)), CALM)}).windows
    assert [w.start <= start and w.stop >= start + 1.0 for w, start in zip(found, (10.0, 40.0), strict=True)]
    assert len(found) == 2


def noise(seed: int, seconds: float) -> FloatArray:
    """Return levels of a random sign and size that last some time each."""
    levels = np.random.default_rng(seed).normal(size=TIME.size)
    return np.repeat(levels, round(seconds * RATE))[: TIME.size]


def test_a_log_that_is_busy_throughout_has_windows_and_an_autopilot_in_gusts_has_none() -> None:
    busy = find_windows({"f": rolled(0.05 * noise(1, 0.4), CALM)}).windows
    assert sum(w.stop - w.start for w in busy if w.purpose == "fit") > 10.0
    with pytest.raises(FlightError, match="no maneuver here"):
        find_windows({"f": rolled(CALM, 2.0 * noise(2, 0.4), feedback=0.1)})


def test_a_flight_whose_inputs_stand_still_has_no_windows_for_a_vehicle_either() -> None:
    vehicle = builtin_vehicle("twin-boom")
    still = parse_maneuver("duration = 20.0\nrate = 50.0\nairspeed = 35.0\n", "m")
    flight = simulate_flight(vehicle, still, seed=1, name="still")
    with pytest.raises(FlightError, match="no maneuver here"):
        find_windows({"still": flight}, vehicle)
