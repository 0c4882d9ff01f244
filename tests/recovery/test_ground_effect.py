"""Ground effect of rotors and of a wing comes back from simulated flights near the ground, with its error bar."""

from __future__ import annotations

import numpy as np
import pytest
from recovery.maneuvers import maneuver

from stoop.estimate.fit import Options
from stoop.simulation import trim
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import builtin_text
from stoop.workflow import identify

ROTOR, LIFT = 1.3, 0.2  #: true coefficients
QUAD = builtin_text("quad-x") + f"\n[ground_effect]\nradius = 0.127\nrotor = {ROTOR}\n"
WING = builtin_text("twin-boom") + f"\n[ground_effect]\nlift = {LIFT}\n"


LOW_HOVER = maneuver(
    20.0, ("down", "doublet", 1.0, 1.5, 0.2), ("roll", "doublet", 6.0, 0.15, 6.0), ("pitch", "doublet", 7.5, 0.15, 6.0),
    ("yaw", "doublet", 9.0, 0.4, 1.0), ("heave", "3-2-1-1", 11.0, 0.25, 1.5), ("down", "doublet", 14.0, 1.5, 0.2), altitude=0.45,
)  # fmt: skip
LOW_PASS = maneuver(
    20.0, ("elevator", "3-2-1-1", 1.0, 0.3, 0.05), ("height", "doublet", 5.0, 2.0, 0.3), ("elevator", "doublet", 12.0, 0.5, 0.05),
    ("height", "doublet", 14.0, 1.5, 0.3), altitude=0.6,
)  # fmt: skip


@pytest.mark.parametrize("method", ["equation-error", ""])
def test_the_ground_effect_of_rotors_is_recovered(method: str) -> None:
    true = parse_vehicle(QUAD, "quad")
    flight = simulate_flight(true, LOW_HOVER, seed=1, name="low")
    assert 0.05 < float(flight.column("height").min()) < 0.25
    start = true.with_numbers({"ground_effect.rotor": {"value": 0.5}})
    job = identify(start, flight, ["0:20"], options=Options(method=method))
    found = job.result.parameters["ground_effect.rotor"]
    assert abs(found.estimate - ROTOR) < 3.5 * found.std_error
    assert found.std_error < 0.2 * ROTOR


def test_the_ground_effect_on_lift_is_recovered() -> None:
    true = parse_vehicle(WING, "wing").reduced("longitudinal")
    flight = simulate_flight(true, LOW_PASS, seed=2, name="low")
    start = true.with_numbers({"ground_effect.lift": {"value": 0.0, "bounds": (-1.0, 1.0)}})
    job = identify(start, flight, ["0:20"])
    found = job.result.parameters["ground_effect.lift"]
    assert abs(found.estimate - LIFT) < 3.5 * found.std_error
    assert found.std_error < 0.3 * LIFT


def test_near_the_ground_less_command_holds_the_vehicle_and_far_above_as_much_as_ever() -> None:
    """Cheeseman and Bennett: T / T_free = 1 + (R/4z)^2 to first order, so the hover command falls by that thrust."""
    true, free = parse_vehicle(QUAD, "quad"), parse_vehicle(builtin_text("quad-x"), "quad")
    near, far = (trim(true, altitude=z) for z in (0.2, 500.0))
    columns = [i for i, c in enumerate(true.recorded) if c.startswith("motor_")]
    np.testing.assert_allclose(far.inputs[columns], trim(free, altitude=500.0).inputs[columns], rtol=1e-6)
    x, quarter2 = near.inputs[columns[0]], (0.127 / 4) ** 2
    thrust = 2.5 * x + 6.0 * x * x
    sea_level = 4 * thrust * (1.0 + ROTOR * quarter2 / (0.2**2 + quarter2))
    assert sea_level == pytest.approx(1.5 * 9.80665, rel=1e-3)
