"""Rotors with inertia whose speed is recorded: what spins them up turns the body, however the flight is computed."""

import numpy as np
import pytest

from stoop.kernels.filtering import innovations
from stoop.kernels.windows import windows
from stoop.simulation import trim
from stoop.simulation.autopilot import linear_errors
from stoop.simulation.fly import fly
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.delays import at_samples

DT, N = 0.01, 200
HEAVY, SPIN = 0.03, 6e-5  #: kg m2
ALONE = f"""
name = "one rotor"
mass = {{ mass = 1.0, inertia = {{ xx = 0.02, yy = 0.02, zz = {HEAVY} }} }}
rotor = {{ one = {{ channel = "motor_1", position = [0.0, 0.0, 0.0], spin = "ccw" }} }}
rotors = {{ drive = "speed", gain = 900.0, idle = 0.05, nominal_voltage = 16.0, delay = 0.0, T2 = 2e-5, inertia = {SPIN} }}
"""
PLACES = (("a", 1, 1, 1, "ccw"), ("b", 2, -1, -1, "ccw"), ("c", 3, 1, -1, "cw"), ("d", 4, -1, 1, "cw"))
QUAD = """
name = "quad"
mass = { mass = 1.4, inertia = { xx = 0.019, yy = 0.019, zz = 0.03 } }
rotors = { drive = "speed", gain = 1000.0, T2 = 1.3e-5, inflow = 3e-4, torque_ratio = 0.019, inertia = 6e-5 }
[rotor]
""" + "".join(
    f'{n} = {{ channel = "motor_{i}", position = [{0.15 * x}, {0.15 * y}, 0.0], spin = "{spin}" }}\n'
    for n, i, x, y, spin in PLACES
)
GUSTS = "[turbulence]\nairspeed = 4.0\nw = { intensity = 0.5, length = 20.0 }\n"


def record() -> np.ndarray:
    """Return commands with corners, which end at rest, under a voltage that sags with them; slopes are not recorded."""
    t, u = np.arange(N) * DT, np.zeros((N, 4))
    u[:, 0] = 0.5 + 0.1 * np.sin(7.0 * t) + 0.03 * np.sign(np.sin(20.0 * t))
    u[:, 1] = 16.0 - 0.5 * t - 0.3 * np.sin(5.0 * t)
    u[-3:, 0] = 0.05
    return u


def one() -> tuple[Vehicle, np.ndarray, np.ndarray, np.ndarray]:
    vehicle, u = parse_vehicle(ALONE, "one"), record()
    rows = vehicle.parameter_rows()
    return vehicle, rows, vehicle.initial_states({"r": 0.1}, rows, u[0]), u


def turned(u: np.ndarray) -> np.ndarray:
    """Return r of a free body: a rotor that gains momentum upward leaves as much downward."""
    x = 900.0 * (u[:, 0] - 0.05) * u[:, 1] / 16.0
    return 0.1 + SPIN / HEAVY * (x - x[0])


def test_angular_momentum_is_kept() -> None:
    vehicle, rows, start, u = one()
    assert vehicle.inputs == ("motor_1", "voltage", "motor_1.slope", "voltage.slope")
    y = vehicle.kernel().trajectories(rows, start, vehicle.late_inputs(u, rows, DT), DT)[0]
    r = y[:, vehicle.outputs.index("r")]
    assert r == pytest.approx(turned(u), abs=1e-12)
    assert np.ptp(r) > 1.0
    assert not u[:, 2:].any(), "the record stays as it was written"


def test_every_loop_computes_the_same_flight() -> None:
    vehicle, rows, start, u = one()
    kernel, r = vehicle.kernel(), vehicle.outputs.index("r")
    two = np.repeat(rows, 2, axis=1)
    two[vehicle.rows["rotors.delay"], 1] = 0.02
    lanes = vehicle.late_inputs(u, two, DT)
    y = kernel.trajectories(two, np.repeat(start, 2, axis=1), lanes, DT)
    late = u.copy()
    late[2:, 0], late[:2, 0] = u[:-2, 0], u[0, 0]
    assert y[0, :, r] == pytest.approx(turned(u), abs=1e-12)
    assert y[1, :, r] == pytest.approx(turned(late), abs=1e-12)
    whole = vehicle.late_inputs(u, rows, DT)
    none = np.zeros((1, kernel.moves * len(vehicle.outputs), 1))
    unseen = np.full((N, len(vehicle.outputs)), np.nan)
    which = np.zeros(N, dtype=np.int64)
    _, path = innovations(kernel, rows, start, none, which, whole, unseen, DT, states=True)
    states = path[0].T
    assert states[vehicle.states.index("r")] == pytest.approx(turned(u), abs=1e-12)
    first, end, many = (np.array([n], dtype=np.int64) for n in (40, N, 60))
    flown, last = windows(kernel, rows, states[:, 40:41].copy(), whole, first, end, many, DT)
    assert flown[0, :, r] == pytest.approx(turned(u)[40:101], abs=1e-12)
    after, _ = kernel.step(rows, states[:, 7:8].copy(), whole[7, :, None], whole[8, :, None], DT)
    assert after[:, 0] == pytest.approx(states[:, 8], abs=1e-12)
    assert last[:, 0] == pytest.approx(states[:, 100], abs=1e-8), "a filter keeps the length of a quaternion"


def test_steady_flight_has_no_slopes_and_a_lag_needs_none() -> None:
    vehicle = parse_vehicle(QUAD, "quad")
    slopes = [vehicle.inputs.index(f"motor_{i}.slope") for i in (1, 2, 3, 4)]
    assert not trim(vehicle).inputs[slopes].any()
    for inertia in (", inertia = 6e-5, lag = 0.05", ""):
        other = parse_vehicle(QUAD.replace(", inertia = 6e-5", inertia), "other")
        assert not other.sloped
        assert not any(name.endswith(".slope") for name in other.inputs)


def test_at_a_sample_a_slope_is_that_of_both_sides() -> None:
    vehicle, rows, _, u = one()
    u[:, 0] = 3.0 * np.square(np.arange(N) * DT)
    late = at_samples(vehicle, vehicle.late_inputs(u, rows, DT))
    assert late[1:-1, 2] == pytest.approx(6.0 * np.arange(1, N - 1) * DT, abs=1e-9)


@pytest.mark.parametrize("gusts", [False, True])
def test_an_autopilot_knows_the_jump_and_its_flight_is_that_of_the_record(gusts: bool) -> None:
    """Yaw of such a quadrotor answers at once to the slope of its commands: a loop that forgets it is not stable."""
    vehicle = parse_vehicle(QUAD + GUSTS if gusts else QUAD, "quad")
    doublet = {"control": "yaw", "shape": "doublet", "start": 0.5, "step": 0.3, "amplitude": 1.0}
    maneuver = Maneuver.model_validate({"duration": 6.0, "input": [doublet], "rate": 100.0})
    flown = fly(vehicle, maneuver)
    r = flown.outputs[:, vehicle.outputs.index("r")]
    assert np.abs(r).max() > 0.05
    assert np.abs(r[-100:]).max() < 0.01
    if not gusts:
        rows = vehicle.parameter_rows(flown.trim.changes)
        start = vehicle.initial_states(flown.trim.start, rows, flown.inputs[0])
        received = vehicle.late_inputs(flown.inputs, rows, DT)
        again = vehicle.kernel().trajectories(rows, start, received, DT)[0]
        assert again == pytest.approx(flown.outputs, abs=1e-9)
        speeds, spins = 1000.0 * flown.inputs[:, :4], np.array([1.0, 1.0, -1.0, -1.0])
        x, torque = speeds @ spins, 0.019 * 1.3e-5 * np.square(speeds) @ spins
        steady = np.cumsum(np.concatenate([[0.0], 0.5 * (torque[1:] + torque[:-1])])) * DT / 0.03
        reaction = SPIN / 0.03 * (x - x[0])
        assert r - steady == pytest.approx(reaction, abs=3e-3), "drag of blades, and their reaction"


def test_its_linear_model_has_the_slopes() -> None:
    vehicle = parse_vehicle(QUAD, "quad")
    model = linear_errors(vehicle, trim(vehicle))
    per_channel = model.E @ np.linalg.pinv(model.mixing)
    expected = 1000.0 * SPIN / 0.03 * np.array([1.0, 1.0, -1.0, -1.0])
    assert per_channel[11] == pytest.approx(expected, rel=1e-6), "r"
    assert np.delete(per_channel, 11, axis=0) == pytest.approx(0.0, abs=1e-9)
