"""The autopilot in JSBSim: it holds the attitude, and a maneuver is added to its commands."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.errors import SimulationError
from stoop.exporters.jsbsim_autopilot import AttitudeHold, fly_in_jsbsim
from stoop.simulation import trim
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle.builtin import builtin_vehicle

WINGS = builtin_vehicle("twin-boom")
PULSE = {"control": "aileron", "shape": "pulse", "start": 1.0, "duration": 1.0, "amplitude": 0.03}


def maneuver(duration: float, *inputs: dict[str, object]) -> Maneuver:
    return Maneuver.model_validate(
        {"duration": duration, "rate": 50.0, "airspeed": 35.0, "input": list(inputs)}
    )


def test_wings_are_leveled_after_a_pulse() -> None:
    """The spiral of the free aircraft keeps its bank; the autopilot's aileron works against the pulse."""
    flown = fly_in_jsbsim(WINGS, maneuver(12.0, PULSE), noise=False)
    free = simulate_flight(WINGS, maneuver(12.0, PULSE), noise=False)
    assert np.abs(flown.column("phi")).max() > 0.05
    assert abs(flown.column("phi")[-1]) < 0.3 * abs(free.column("phi")[-1])
    aileron = flown.column("aileron") - flown.column("aileron")[0]
    assert aileron[51:100].max() < 0.0301
    assert aileron[100:130].min() < -0.001


def test_what_it_commands_is_feedback_of_attitude_and_rates() -> None:
    hold = AttitudeHold.of(WINGS, trim(WINGS, 35.0))
    state = {**dict.fromkeys("pqr", 0.0), **hold.point.start, "phi": 0.1, "q": 0.1}
    moved = dict(zip(hold.controls, hold.deflections(state), strict=True))
    assert moved["aileron"] < 0.0, "left aileron against a bank to the right"
    assert moved["elevator"] > 0.0, "nose down against pitching up"
    assert abs(moved["rudder"]) < 0.1 * abs(moved["aileron"]), (
        "against the yawing moment of the ailerons alone"
    )


def test_noise_is_that_of_the_vehicle_file() -> None:
    quiet, noisy = (fly_in_jsbsim(WINGS, maneuver(4.0), seed=3, noise=on) for on in (False, True))
    assert np.std(noisy.column("V") - quiet.column("V")) == pytest.approx(WINGS.file.sensors.V.sigma, rel=0.2)
    assert np.array_equal(noisy.column("elevator"), quiet.column("elevator"))


def test_a_multirotor_is_refused() -> None:
    with pytest.raises(SimulationError, match="flies on wings; give the maneuver an airspeed"):
        fly_in_jsbsim(builtin_vehicle("quad-x"), Maneuver(duration=1.0))
