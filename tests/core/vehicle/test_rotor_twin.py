"""Vehicles with rotors against their plain twin: every feature of the tables, far from hover and in motion."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
import pytest
from core.vehicle.test_twin import check_points, flown
from naive.aircraft import Aircraft
from naive.multirotor import Multirotor

from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle

DT, N = 0.001, 150
COMMANDED = """
name = "commanded"
body_drag = { linear = [0.1, 0.12, 0.15], quadratic = [0.02, 0.03, 0.04], rotation = [0.004, 0.005, 0.003] }
mass = { mass = 1.6, center_of_gravity = [0.01, -0.006, 0.02], \
    inertia = { xx = 0.03, yy = 0.028, zz = 0.05, xz = 0.002, xy = -0.001, yz = 0.0015 } }
rotors = { gain = 0.0012, idle = 1050.0, nominal_voltage = 15.2, lag = 0.06, T0 = 0.1, T1 = 1.9, T2 = 7.1, \
    inflow = 0.31, translational = 0.012, drag = 0.11, Q0 = 0.004, Q1 = 0.01, Q2 = 0.13 }
sensors = { accelerometer_position = [0.05, 0.01, -0.02], imu_alignment = [0.05, -0.04, 0.8], vn = { bias = 1.5 }, \
    vd = { scale = 0.98, bias = -0.2 }, az = { scale = 1.02, bias = 0.1 } }
[rotor]
m1 = { channel = "pwm_1", position = [0.17, 0.18, -0.03], axis = [0.1, -0.1, -2.0], spin = "ccw", factor = 0.85 }
m2 = { channel = "pwm_2", position = [-0.17, -0.18, -0.02], spin = "ccw", torque_factor = 1.2 }
m3 = { channel = "pwm_3", position = [0.16, -0.17, -0.03], axis = [0.0, 0.15, -1.0], spin = "cw" }
m4 = { channel = "pwm_4", position = [-0.18, 0.17, -0.03], spin = "cw" }
"""
TURNING = """
name = "turning"
mass = { mass = 1.2, inertia = { xx = 0.02, yy = 0.021, zz = 0.035 } }
environment = { density = 1.1, gravity = 9.81 }
rotors = { drive = "speed", gain = 1000.0, lag = 0.04, T2 = 8.5e-6, inflow = 3.0e-4, drag = 8.0e-5, \
    torque_ratio = 0.016, inertia = 6.0e-5 }
[rotor]
a = { channel = "motor_1", position = [0.2, 0.0, 0.0], spin = "cw" }
b = { channel = "motor_2", position = [-0.1, 0.17, 0.0], axis = [0.0, 0.5, -1.0], spin = "ccw" }
c = { channel = "motor_3", position = [-0.1, -0.17, 0.0], axis = [0.0, -0.4, -1.0], spin = "ccw" }
"""
DISCS = "radius = 0.12, drag_inflow = 0.002, translational = 0.004"
POWER = COMMANDED.replace("T1 = 1.9, T2 = 7.1", "T1 = 4.9, T2 = 12.1")
DRAWN = POWER.replace("translational = 0.012", DISCS)
MEASURED = TURNING.replace("gain = 1000.0, lag = 0.04, ", "").replace("motor_", "rotor_")
UNLAGGED = TURNING.replace("lag = 0.04", "idle = 0.1, nominal_voltage = 15.2")


@dataclass(frozen=True)
class Case:
    text: str
    inputs: Mapping[str, tuple[float, float]]  #: how a channel's name begins -> mean and swing
    rtol: float = 1e-9
    spread: float = 1.0  #: of speeds and rates
    slope: float = 0.0  #: swing of the slopes of channels, per s


CASES = {
    "commanded": Case(COMMANDED, {"pwm": (1500.0, 400.0), "voltage": (15.0, 0.8)}),
    "drawn": Case(DRAWN, {"pwm": (1600.0, 250.0), "voltage": (15.0, 0.8)}, 1e-2, 0.6),  # two steps, not all
    "turning": Case(TURNING, {"motor": (0.6, 0.3)}),
    "measured": Case(MEASURED, {"rotor": (600.0, 250.0)}, slope=4000.0),
    "unlagged": Case(UNLAGGED, {"motor": (0.6, 0.5), "voltage": (15.0, 0.8)}, slope=4.0),
}
NAMES = (*"uvwpqr", "phi", "theta", "psi", "h")
START = dict(zip(NAMES, (4.0, -2.0, 1.5, 0.5, -0.4, 0.9, 0.4, -0.3, 2.5, 300.0), strict=True))


def means(spec: Case, channel: str) -> tuple[float, float]:
    if channel.endswith(".slope"):
        return 0.0, spec.slope
    return next(v for head, v in spec.inputs.items() if channel.startswith(head))


def test_trajectories() -> None:
    spec = CASES["commanded"]
    vehicle = parse_vehicle(spec.text, "commanded")
    t, rng = np.arange(N) * DT, np.random.default_rng(5)
    mean, swing = np.array([means(spec, c) for c in vehicle.inputs]).T
    waves = [0.6 * np.sin((3.0 + i) * t + i) + 0.6 * np.sign(np.sin(9.0 * t + i)) for i in range(len(mean))]
    u = mean + swing * np.array(waves).T  # with corners, some of which stop a motor
    changes = {p.name: p.value * rng.uniform(0.96, 1.04) for p in vehicle.parameters}
    rows = vehicle.parameter_rows(changes)
    y = vehicle.kernel().trajectories(rows, vehicle.initial_states(START, rows, u[0]), u, DT)[0]
    expected = flown(Multirotor(spec.text, changes), vehicle.inputs, START, u, DT)
    size, turn = np.abs(expected).max(axis=0), y - expected
    turn[:, 6:9] -= 2 * np.pi * np.round(turn[:, 6:9] / (2 * np.pi))
    assert (np.ptp(expected, axis=0) > 1e-2 * size).all(), "every channel moves"
    np.testing.assert_allclose(turn / size, 0.0, atol=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_single_points(name: str) -> None:
    spec = CASES[name]
    vehicle = parse_vehicle(spec.text, name)
    rng, count = np.random.default_rng(2), 20
    spread = dict(zip(NAMES, (12.0, 12.0, 8.0, 4.0, 4.0, 3.0, 3.0, 1.4, 3.0, 900.0), strict=True))
    start = {k: s * spec.spread * rng.uniform(-1, 1, count) for k, s in spread.items()}
    told = [means(spec, c) for c in vehicle.inputs]
    u = np.array([m + 1.2 * s * rng.uniform(-1, 1, count) for m, s in told])
    lag = {"pwm": 0.2, "motor": 150.0}.get(vehicle.inputs[0].partition("_")[0], 0.0)
    assert any(channel.endswith(".slope") for channel in vehicle.inputs) == (spec.slope > 0.0)
    twin = Multirotor(spec.text, {})
    check_points(vehicle, twin, start, u, spec.rtol, lambda s: lag * rng.uniform(-1, 1, s))


def test_a_quadplane_is_its_aeroplane_and_its_rotors() -> None:
    """In forward flight the loads of both twins add up; what hovering vehicles smooth is far below."""
    vehicle = builtin_vehicle("quadplane")
    text = (files("stoop") / "data" / "quadplane.toml").read_text()
    rng, count = np.random.default_rng(4), 10
    spread = dict.fromkeys(("p", "q", "r", "phi"), 0.5)
    spread |= {"u": 4.0, "v": 1.5, "w": 1.5, "theta": 0.3, "psi": 3.0}
    start = {k: s * rng.uniform(-1, 1, count) for k, s in spread.items()} | {"h": np.full(count, 250.0)}
    start["u"] += 18.0
    u = rng.uniform(0.0, 0.6, (len(vehicle.inputs), count))
    rows = vehicle.parameter_rows(None, count)
    d, _ = vehicle.kernel().evaluate(rows, vehicle.initial_states(start, rows, u), u)
    plane, lifted = Aircraft(text, {}, {}), Multirotor(text, {})
    for b in range(count):
        named = dict(zip(vehicle.inputs, u[:, b].tolist(), strict=True))
        s = lifted.start({k: float(v[b]) for k, v in start.items()}, named)
        rho = lifted.density(250.0, named)
        force, moment = lifted.loads(s[:3], s[3:6], lifted.commanded(named), np.zeros(4), rho)
        f, m = plane.loads(s[:16], named, plane.commanded(named))
        angular = np.linalg.solve(lifted.inertia, moment + m - np.cross(s[3:6], lifted.inertia @ s[3:6]))
        gravity = s[6:15].reshape(3, 3).T @ [0.0, 0.0, 9.80665]
        linear = (force + f) / 5.0 + gravity - np.cross(s[3:6], s[:3])
        np.testing.assert_allclose(d[:3, b], linear, atol=3e-3)
        np.testing.assert_allclose(d[3:6, b], angular, atol=3e-3)
