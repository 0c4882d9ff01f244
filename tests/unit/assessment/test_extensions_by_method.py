"""Score tests after multiple shooting and filter error: defects of a quadrotor and of a gusty flight are named."""

from __future__ import annotations

import numpy as np
import pytest
from unit.flown import maneuver

from stoop.assessment.error_bars import error_bars
from stoop.assessment.extensions import extension_tests
from stoop.estimate import filter_error, multiple_shooting
from stoop.estimate.fit import Options
from stoop.problem.windows import Window
from stoop.results.extensions import ExtensionTests
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.vehicle.document import with_entries
from stoop.vehicle.extensions import extended
from stoop_studies.verify import scenes

SECONDS = 16.0
INPUTS = (
    ("roll", "doublet", 1.0, 0.15, 8.0), ("pitch", "doublet", 2.0, 0.15, 8.0), ("yaw", "doublet", 3.0, 0.4, 1.5),
    ("heave", "3-2-1-1", 4.0, 0.25, 2.0), ("north", "doublet", 4.5, 2.0, 2.5), ("east", "doublet", 5.0, 2.0, 2.5),
    ("down", "doublet", 5.5, 2.0, 1.0), ("roll", "doublet", 11.0, 0.15, 8.0), ("pitch", "doublet", 12.0, 0.15, 8.0),
    ("yaw", "doublet", 13.0, 0.4, 1.5), ("heave", "3-2-1-1", 14.0, 0.25, 2.0),
)  # fmt: skip
TEXT = resolve_vehicle("quad-x").text
FORWARD = TEXT + "\n[sensors]\naccelerometer_position = [0.05, 0.0, 0.0]\n"
DEFECTS = {
    "mass.mass": (TEXT, TEXT.replace("mass = 1.5\n", "mass = 1.8\n"), 1.5),
    "mass.inertia.xx": (TEXT, TEXT.replace("xx = 0.0291", "xx = 0.0437"), 0.0291),
    "rotors.lag": (TEXT, TEXT.replace("lag = 0.05\n", ""), 0.05),
    "sensors.accelerometer_position.x": (FORWARD, TEXT, 0.05),
    "rotor.m1.factor": (TEXT.replace("[rotor.m1]", "[rotor.m1]\nfactor = 0.9"), TEXT, 0.9),
    "body_drag.quadratic.x": (TEXT, TEXT[: TEXT.index("[body_drag]")], 0.02),
}  #: extension -> the file of the truth, the file of the fit, the true value


def lacking(truth: str, fitted: str, seed: int) -> ExtensionTests:
    flown = maneuver(SECONDS, *INPUTS, rate=100.0, wind=(2.0, -1.0, 0.0))
    flight = simulate_flight(parse_vehicle(truth, "truth"), flown, seed=seed, name="sim")
    windows = [Window("sim", 0.0, SECONDS)]
    done = multiple_shooting.fit(parse_vehicle(fitted, "quad"), {"sim": flight}, windows, Options(seed=1))
    return extension_tests(done, error_bars(done))


@pytest.mark.parametrize("seed", [1, 2])
def test_right_quadrotor_lacks_nothing(seed: int) -> None:
    found = lacking(TEXT, TEXT, seed)
    assert (found.tested > 30, found.found) == (True, ())


@pytest.mark.parametrize("name", DEFECTS)
def test_defect_of_a_quadrotor_is_named(name: str) -> None:
    truth, fitted, value = DEFECTS[name]
    found = lacking(truth, fitted, 1)
    best = found.found[0]
    assert name in (best.name, *best.rivals)
    (one,) = (e for e in found.found if e.name == name)
    # a large change is more than one linear step
    assert one.value == pytest.approx(value, rel=0.5)


def lacking_in_gusts(truth: Vehicle) -> ExtensionTests:
    rng, flown, names = np.random.default_rng(1), scenes.maneuvers(), ("pitch", "roll")
    flights = {n: simulate_flight(truth, flown[n], seed=int(rng.integers(2**31)), name=n) for n in names}
    windows = [Window(n, 0.0, scenes.DURATION) for n in names]
    done = filter_error.steady(scenes.turbulent_aircraft(), flights, windows, Options(seed=1))
    return extension_tests(done, error_bars(done))


def test_lag_is_named_in_gusts_and_a_right_aircraft_lacks_nothing() -> None:
    right = scenes.turbulent_aircraft()
    best = lacking_in_gusts(with_entries(right, {("controls", "aileron", "lag"): 0.04})).found[0]
    assert best.name in ("controls.aileron.lag", "controls.aileron.delay")
    assert best.value == pytest.approx(0.04, rel=0.3)
    assert lacking_in_gusts(right).found == ()


def test_gusts_that_a_method_assumes_are_extended_with_the_vehicle() -> None:
    """The table is set after the file was read, as the method of gusty flights does."""
    vehicle = scenes.turbulent_aircraft()
    assert "turbulence" not in vehicle.text
    wider, _ = extended(vehicle)
    assert wider.states == vehicle.states
    assert set(vehicle.rows) <= set(wider.rows)
