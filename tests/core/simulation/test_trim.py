"""Steady flight against statics on paper: on rotors, and of a flying wing, with sideslip or in a glide."""

import math
from pathlib import Path

import numpy as np
import pytest
from naive.aircraft import rotation
from scipy.optimize import brentq

from stoop.errors import SimulationError
from stoop.simulation import linearize, trim
from stoop.simulation.trim import Trim
from stoop.vehicle import Vehicle, load_vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle

G = 9.80665


def readings(vehicle: Vehicle, point: Trim) -> dict[str, float]:
    rows = vehicle.parameter_rows(point.changes)
    states = vehicle.initial_states(point.start, rows, point.inputs)
    _, y = vehicle.kernel().evaluate(rows, states, point.inputs[:, None].copy())
    return dict(zip(vehicle.outputs, y[:, 0].tolist(), strict=True))


@pytest.mark.parametrize("name", ["quad-x", "hexa-x", "octo-x", "quadplane"])
def test_templates_hover_on_equal_rotors(name: str) -> None:
    vehicle = builtin_vehicle(name)
    point, area = trim(vehicle), vehicle.rotor_range
    commands = point.inputs[area.columns]
    assert point.residual < 1e-7
    assert 0.3 < commands.min() <= commands.max() < 0.75
    assert commands == pytest.approx(np.full(len(commands), commands[0]), abs=1e-6)
    y = readings(vehicle, point)
    assert [y[c] for c in ("vn", "ve", "vd", "p", "q", "r")] == pytest.approx([0.0] * 6, abs=1e-12)
    assert [y[c] for c in ("ax", "ay", "az")] == pytest.approx([0.0, 0.0, -G], abs=1e-5)
    if name == "quadplane":  # flies on its wings too
        point = trim(vehicle, 18.0)
        assert point.residual < 1e-7
        assert (point.inputs[area.columns] == area.idle).all()
        y = readings(vehicle, point)
        assert np.linalg.norm([y["vn"], y["ve"], y["vd"]]) == pytest.approx(18.0)
        assert {"short period", "phugoid", "Dutch roll"} <= {m.name for m in linearize(vehicle, point).modes}


def test_it_leans_into_the_wind_by_the_angle_of_linear_drag_whatever_the_heading(even: Vehicle) -> None:
    """Drag is linear and alike along all axes, so tan(tilt) = c W / (m g)."""
    for north, east, heading in ((2.0, 0.0, 0.0), (0.0, 8.0, 0.0), (6.0, 0.0, 0.7), (6.0, -3.0, -2.0)):
        point = trim(even, wind=(north, east, 0.0), heading=heading)
        up = rotation(point.start["phi"], point.start["theta"], heading) @ [0.0, 0.0, -1.0]
        lean = 0.1 * np.array([north, east]) / (1.5 * G)
        expected = np.array([*-lean, -1.0]) / np.sqrt(1.0 + lean @ lean)
        assert up == pytest.approx(expected, abs=1e-9)


def test_motion_through_the_air_alone_counts(quad: Vehicle) -> None:
    moving, blown = trim(quad, velocity=(3.0, -2.0, 0.5)), trim(quad, wind=(-3.0, 2.0, -0.5))
    assert moving.inputs == pytest.approx(blown.inputs, abs=1e-9)
    for point, velocity in ((moving, [3.0, -2.0, 0.5]), (blown, [0.0] * 3)):
        assert [readings(quad, point)[c] for c in ("vn", "ve", "vd")] == pytest.approx(velocity, abs=1e-9)
    assert [blown.changes[f"sensors.{c}.bias"] for c in ("vn", "ve", "vd")] == [-3.0, 2.0, -0.5]
    windy = quad.with_numbers({"sensors.ve.bias": {"value": 4.0}})  # of the file, unless another is asked for
    assert trim(windy).inputs == pytest.approx(trim(quad, wind=(0.0, 4.0, 0.0)).inputs, abs=1e-12)
    assert trim(windy, wind=(0.0, 0.0, 0.0)).inputs == pytest.approx(trim(quad).inputs, abs=1e-12)


def test_a_weak_rotor_works_harder_and_a_heavy_side_too(quad: Vehicle, even: Vehicle) -> None:
    def lift(number: str, value: float) -> tuple[float, ...]:
        commands = trim(even.with_numbers({number: {"value": value}})).thrust
        return tuple(2.5 * x + 6.0 * x * x for x in (commands[f"motor_{i}"] for i in (1, 2, 3, 4)))

    one, two, *_ = lift("rotor.m1.factor", 0.8)
    assert 0.8 * one == pytest.approx(two, rel=1e-9), "thrusts, not commands, balance"
    one, two, three, four = lift("mass.center_of_gravity.x", 0.02)
    assert (one + three) * (0.177 - 0.02) == pytest.approx((two + four) * (0.177 + 0.02), rel=1e-9)
    assert trim(quad).residual < 1e-7


def test_of_many_ways_the_one_next_to_equal_commands() -> None:
    """Six rotors, one weak: the change from equal commands has no part that gives no acceleration."""
    text = builtin_vehicle("hexa-x").text.replace("[rotor.m1]", "[rotor.m1]\nfactor = 0.8", 1)
    weak = parse_vehicle(text, "weak.toml")
    point, columns = trim(weak), weak.rotor_range.columns
    level = point.inputs.copy()

    def sinks(c: float) -> float:
        level[columns] = c
        return float(weak.accelerations({"h": 200.0}, level[:, None].copy())[2, 0])

    level[columns] = brentq(sinks, 0.1, 1.0, xtol=1e-13)  # equal commands that lift the weight alone
    effect = weak.rotor_effects({"h": 200.0}, level, {})
    idle = np.linalg.svd(effect)[2][4:]
    assert np.abs(idle @ (point.inputs - level)[columns]).max() < 1e-6
    assert np.ptp(point.inputs[columns]) > 0.02


def test_one_newton_step_finds_the_trim_of_a_neighbor(quad: Vehicle) -> None:
    point = trim(quad, velocity=(2.0, 1.0, 0.0))
    near = point.neighbors()({"mass.mass": np.array([1.5 * (1.0 + 1e-5)])})
    exact = trim(quad.with_numbers({"mass.mass": {"value": 1.5 * (1.0 + 1e-5)}}), velocity=(2.0, 1.0, 0.0))
    assert near.inputs[:, 0] - point.inputs == pytest.approx(exact.inputs - point.inputs, rel=1e-3, abs=1e-12)
    known, x = point.solution
    assert np.abs(known.residuals(x[:, None])).max() < 1e-7


def test_a_hover_that_cannot_be_says_why(even: Vehicle) -> None:
    for changes, how, says in (
        ({"mass.mass": 4.0}, {}, r"too heavy to hover: at full command \(1\) the rotors lift 8\d% of the weight"),
        ({"rotors.T0": 5.0}, {}, r"rises with its rotors at idle \(0\); check mass, T0 and idle"),
        ({"mass.center_of_gravity.x": 0.15, "mass.mass": 2.0}, {}, r"motor_[13] would be 1\.\d+, and its range ends at 1"),
        ({}, {"wind": (400.0, 0.0, 0.0)}, r"no steady flight.*in less wind"),
        ({"rotors.torque_ratio": 0.0, "mass.inertia.xz": 0.0}, {}, "cannot command yaw, so no autopilot holds it"),
        ({"rotor.m1.position.y": -0.177, "rotor.m4.position.y": -0.177}, {}, "apart from each other"),
        ({}, {"airspeed": 12.0}, "no wings to fly 12 m/s on; leave the airspeed out and write velocity"),
    ):  # fmt: skip
        vehicle = even.with_numbers({name: {"value": value} for name, value in changes.items()})
        with pytest.raises(SimulationError, match=says):
            trim(vehicle, **how)  # type: ignore[arg-type]


def test_modes_of_a_hover(even: Vehicle) -> None:
    """Without moments from speed: tilt and rates integrate; speeds decay with c/m; rotors with their lag."""
    model = linearize(even, trim(even))
    modes = {mode.name: mode.eigenvalue for mode in model.modes}
    assert modes["heave"] == pytest.approx(-0.1 / 1.5, abs=1e-6)
    assert modes["lag"] == pytest.approx(-20.0, abs=1e-6)
    assert (model.states[:3], model.inputs) == (("u", "v", "w"), ("motor_1", "motor_2", "motor_3", "motor_4"))
    at = {name: i for i, name in enumerate(model.states)}
    assert model.A[at["u"], at["theta"]] == pytest.approx(-G)
    assert model.A[at["v"], at["phi"]] == pytest.approx(G)


WING = """
name = "wing"
mass = { mass = 2.0, inertia = { xx = 0.12, yy = 0.06, zz = 0.17 } }
reference = { area = 0.4, chord = 0.25, span = 1.6, airspeed = 16.0 }
environment = { density = 1.2 }
propulsion = { kind = "constant", thrust = 1.5 }
controls = { elevator = {}, aileron = {} }
[aerodynamics]
CL = { CL0 = 0.2, CLalpha = 4.5 }
CD = { CD0 = 0.025, CDalpha2 = 0.8 }
Cm = { Cm0 = 0.02, Cmalpha = -0.4, Cmq = -4.0, Cmelevator = -0.5 }
CQ = { CQbeta = -0.2 }
Cl = { Cl0 = 0.001, Clbeta = -0.05, Clp = -0.4, Claileron = 0.2 }
Cn = { Cn0 = 0.001, Cnbeta = 0.04, Cnr = -0.05 }
"""
SYMMETRIC = WING.replace("Cn0 = 0.001, ", "").replace("Cl0 = 0.001, ", "")
PROPULSION = 'propulsion = { kind = "constant", thrust = 1.5 }\n'


@pytest.fixture(scope="module")
def glider() -> Vehicle:
    return parse_vehicle(SYMMETRIC.replace(PROPULSION, ""), "glider.toml")


def test_a_wing_flies_the_path_that_was_asked_for_with_sideslip_where_it_is_asymmetric() -> None:
    vehicle = parse_vehicle(WING, "wing.toml")
    point = trim(vehicle)
    assert point.residual < 1e-7
    assert point.start["beta"] == pytest.approx(-0.001 / 0.04, rel=0.05)  # Cn0 + Cnbeta beta = 0
    assert linearize(vehicle, point).modes
    climb = trim(parse_vehicle(SYMMETRIC, "wing.toml"), climb_angle=0.05)
    assert (climb.start.get("beta", 0.0), climb.climb_angle) == (0.0, pytest.approx(0.05, abs=1e-7))


@pytest.mark.parametrize("airspeed", [11.0, 13.0, 20.0])
def test_without_propulsion_it_sinks_by_drag_over_lift_and_does_not_climb(
    glider: Vehicle, airspeed: float
) -> None:
    point = trim(glider, airspeed)
    alpha = point.start["alpha"]
    lift, drag = 0.2 + 4.5 * alpha, 0.025 + 0.8 * alpha**2
    assert math.tan(-point.climb_angle) == pytest.approx(drag / lift, rel=1e-6)
    pressure = 0.5 * 1.2 * airspeed**2 * 0.4
    assert pressure * math.hypot(lift, drag) == pytest.approx(2.0 * 9.80665, rel=1e-4)
    assert point.start["theta"] - alpha == pytest.approx(point.climb_angle, abs=1e-9)
    assert linearize(glider, point).modes
    with pytest.raises(SimulationError, match="leave the climb angle out"):
        trim(glider, climb_angle=0.02)


EXAMPLE = Path(__file__).parents[3] / "examples" / "vtail.toml"


def test_thrust_balances_drag_and_full_power_is_found_from_a_propeller_at_rest() -> None:
    """At rest the thrust does not change with the throttle, so a search that gets there stays there."""
    vehicle = load_vehicle(EXAMPLE)
    draggy = vehicle.with_numbers({"CD0": {"value": 0.12}, "propulsion.CT1": {"value": -0.15}})
    point = trim(draggy, 23.0, density=1.19)
    assert point.residual < 1e-7
    assert 0.5 < point.thrust["control_throttle"] < 1.5
    for airspeed in (15.0, 20.0, 25.0):
        point = trim(vehicle, airspeed, density=1.19)
        up = point.start["alpha"] + 0.10
        drag = 0.5 * 1.19 * airspeed**2 * 0.66 * (0.05 + 0.2 * up + 0.8 * up**2)
        n = 147.2 * point.thrust["control_throttle"]
        pull = 1.19 * 0.40**4 * (0.14 * n**2 - 0.10 * n * airspeed / 0.40)
        assert pull == pytest.approx(drag, rel=0.02), airspeed
