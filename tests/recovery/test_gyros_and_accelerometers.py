"""A small quadrotor whose log holds gyros, accelerometers and commands only: the default finds thrust, lag, inertia and torque.

It flies by its autopilot in turbulence, so disturbances reach the commands through the rate loop; ordinary least squares on
moments attribute them to the commands.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recovery.maneuvers import maneuver

from stoop.base.variables import EULER
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import parse_vehicle
from stoop.vehicle.schema import WIND
from stoop.workflow import identify

EXAMPLES = Path(__file__).parents[2] / "examples"
LAG = 0.06
GUSTS = """
[turbulence]
airspeed = 5.0
u = { intensity = 0.3, length = 5.0 }
v = { intensity = 0.3, length = 5.0 }
w = { intensity = 0.3, length = 5.0 }
"""
WRONG = {
    "rotors.T1": 0.8, "rotors.lag": 0.5, "rotors.torque_ratio": 1.3, "mass.inertia.xx": 1.4, "mass.inertia.yy": 0.7,
}  # fmt: skip


SHAPES = (
    ("roll", 1.0, 0.1, 40.0),
    ("pitch", 3.5, 0.1, 40.0),
    ("yaw", 6.0, 0.25, 3.0),
    ("heave", 8.0, 0.2, 2.5),
)
INPUTS = [
    (control, "3-2-1-1", 10.0 * k + start, step, sign * amplitude)
    for k, sign in enumerate((1.0, -1.0))
    for control, start, step, amplitude in SHAPES
]


def test_the_default_needs_no_state() -> None:
    text = (EXAMPLES / "crazyflie.toml").read_text()
    text = text.replace('drive = "command"', f'drive = "command"\nlag = {LAG}', 1)
    truth, gusty = (parse_vehicle(text + more, "crazyflie.toml") for more in ("", GUSTS))
    flight = simulate_flight(gusty, maneuver(20.0, *INPUTS), seed=1)
    sensed = replace(flight, data=flight.data.drop_vars([*WIND, *EULER], errors="ignore"))
    begun = truth.with_numbers(
        {n: {"value": f * truth.value(n), "free": True, "bounds": None} for n, f in WRONG.items()}
    )
    result = identify(begun, sensed, ["0.5:19.5"]).result
    assert (result.method, result.status) == ("equation-error", "converged")
    assert "no-states-recorded" in {n.code for n in result.notices}
    found = {name: result.parameters[name].estimate for name in WRONG}
    assert found == {name: pytest.approx(truth.value(name), rel=0.05) for name in WRONG}
    assert np.isfinite([p.std_error for p in result.parameters.values()]).all()
