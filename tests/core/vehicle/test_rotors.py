"""Vehicles with rotors, by hand: balance at hover, which way each motor turns it, what air and motion do."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from naive.interpreted import Evaluate, interpreted
from scipy.optimize import brentq

from stoop.base.atmosphere import standard_density
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_text, builtin_vehicle
from stoop.vehicle.defaults import WIND_NUMBERS

GRAVITY = 9.80665
SINGLE = """
name = "one rotor"
mass = { mass = 0.5, inertia = { xx = 0.01, yy = 0.01, zz = 0.015 } }
environment = { density = 1.225 }
rotor = { only = { channel = "motor_1", position = [0.0, 0.0, 0.0], spin = "ccw" } }
rotors = { T0 = 0.3, T1 = 1.7, T2 = 8.0, Q1 = 0.02, Q2 = 0.1, inflow = 0.4, translational = 0.02, drag = 0.15 }
"""


def motors(vehicle: Vehicle, command: float, **others: float) -> np.ndarray:
    u = np.zeros(len(vehicle.inputs))
    for name, rotor in vehicle.file.rotor.items():
        u[vehicle.inputs.index(rotor.channel)] = command + others.get(name, 0.0)
    return u


def rates(vehicle: Vehicle, evaluate: Evaluate, u: np.ndarray, start: Any, **numbers: float) -> Any:
    rows = vehicle.parameter_rows(numbers)
    d, y = evaluate(rows, vehicle.initial_states(start | {"h": start.get("h", 0.0)}, rows, u), u[:, None])
    return dict(zip(vehicle.states, d[:, 0], strict=True)), dict(zip(vehicle.outputs, y[:, 0], strict=True))


def hover_command(vehicle: Vehicle, altitude: float) -> float:
    """Solve T1 x + T2 x^2 = share of the weight, by the formula of the textbook."""
    needed = vehicle.value("mass.mass") * GRAVITY / len(vehicle.rotors) * 1.225 / standard_density(altitude)
    t1, t2 = vehicle.value("rotors.T1"), vehicle.value("rotors.T2")
    return float((-t1 + math.sqrt(t1 * t1 + 4 * t2 * needed)) / (2 * t2))


@pytest.fixture(scope="module", params=["quad-x", "hexa-x", "octo-x", "quadplane"])
def template(request: pytest.FixtureRequest) -> tuple[Vehicle, Evaluate]:
    vehicle = builtin_vehicle(request.param)
    return vehicle, vehicle.kernel().evaluate


def test_templates_hover(template: tuple[Vehicle, Evaluate]) -> None:
    vehicle, evaluate = template
    x = hover_command(vehicle, 300.0)
    assert 0.4 < x < 0.75, "with room above for maneuvers"
    d, y = rates(vehicle, evaluate, motors(vehicle, x), {"u": 0.0, "psi": 1.0, "h": 300.0})
    moving = [d[s] for s in vehicle.states if s != "e0"]
    assert np.abs(moving).max() < 2e-5  # a propeller of the quadplane sees the smoothed speed
    assert (y["az"], y["psi"]) == (pytest.approx(-GRAVITY, rel=1e-9), pytest.approx(1.0))


def test_more_of_one_motor_and_damping_by_the_inflow(template: tuple[Vehicle, Evaluate]) -> None:
    """Thrust on the right rolls left, in front pitches up; a propeller that turns left (ccw) turns the nose right."""
    vehicle, evaluate = template
    x = hover_command(vehicle, 0.0)
    for name, rotor in vehicle.file.rotor.items():
        d, _ = rates(vehicle, evaluate, motors(vehicle, x, **{name: 0.05}), {"u": 0.0})
        forward, right = (vehicle.value(f"rotor.{name}.position.{axis}") for axis in "xy")
        assert np.sign(round(d["p"], 9)) == -np.sign(right), name
        assert np.sign(round(d["q"], 9)) == np.sign(forward), name
        assert (d["r"] > 0) == (rotor.spin == "ccw"), name
        assert d["w"] < 0, "up"
    for rate in "pq":  # rotors that go down see more air from below and give more thrust
        d, _ = rates(vehicle, evaluate, motors(vehicle, x), {"u": 0.0, rate: 1.0})
        assert d[rate] < -1e-3


def test_x_numbering_is_that_of_px4() -> None:
    v = builtin_vehicle("quad-x")
    corners = [tuple(np.sign([v.value(f"rotor.m{i}.position.{a}") for a in "xy"])) for i in (1, 2, 3, 4)]
    assert corners == [(1, 1), (-1, -1), (1, -1), (-1, 1)]
    assert [v.file.rotor[f"m{i}"].spin for i in (1, 2, 3, 4)] == ["ccw", "ccw", "cw", "cw"]


def test_discs_draw_what_their_thrust_takes() -> None:
    """Momentum theory, held by bisection of T = 2 rho A v sqrt(vh^2 + (va + v)^2) from descents to quick climbs."""
    text = SINGLE.replace("translational = 0.02", "radius = 0.11").replace("T0 = 0.3, ", "")
    vehicle = parse_vehicle(text.replace("T1 = 1.7", "T1 = 0.0").replace("T2 = 8.0", "T2 = 22.0"), "drawing")
    evaluate, area = interpreted(vehicle), math.pi * 0.11**2
    off, speeds = [], itertools.product((-3.0, 0.0, 4.0, 12.0), (0.0, 3.0, 10.0, 20.0))
    for x, (climb, across) in itertools.product((0.4, 0.6, 0.8), speeds):
        _, y = rates(vehicle, evaluate, motors(vehicle, x), {"u": across, "w": -climb})

        def excess(v: float, x: float = x, climb: float = climb, across: float = across) -> float:
            thrust = 22.0 * x * x - 0.4 * x * (climb + v)
            return 2.0 * 1.225 * area * v * math.hypot(climb + v, across) - thrust

        exact = 22.0 * x * x - 0.4 * x * (climb + brentq(excess, -40.0 if across else max(0.0, -climb), 60.0))
        off.append((-0.5 * y["az"] - exact) / (0.4 * x))
    assert np.max(np.abs(off)) < 0.04
    assert np.sqrt(np.mean(np.square(off))) < 0.01, "m/s of induced velocity"


def test_nothing_is_undefined_at_rest(template: tuple[Vehicle, Evaluate]) -> None:
    vehicle, evaluate = template
    rows = vehicle.parameter_rows()
    x = vehicle.initial_states({"u": 0.0}, rows, np.zeros(len(vehicle.inputs)))
    u = np.zeros((len(vehicle.inputs), 1))
    here = np.concatenate(evaluate(rows, x, u))
    assert np.isfinite(here).all()
    for i in range(3):
        moved = x.copy()
        moved[i] = 1e-6
        slope = (np.concatenate(evaluate(rows, moved, u)) - here) / 1e-6
        assert np.isfinite(slope).all()
        assert np.abs(slope).max() < 100.0


def test_aeroplane_fades_where_air_is_not_ahead() -> None:
    """Falling flat, a wing whose lift is linear in the angle would be pulled forward by half the weight."""
    vehicle = builtin_vehicle("quadplane")
    evaluate = vehicle.kernel().evaluate
    u = motors(vehicle, 0.0)
    flights = {"w": 5.0}, {"u": -8.0}, {"u": 18.0}
    falling, backward, ahead = (rates(vehicle, evaluate, u, start)[1] for start in flights)
    assert max(abs(falling["ax"]), abs(backward["az"])) < 0.2
    assert ahead["az"] < -4.0, "lift"


def test_ground_effect_of_rotors_and_wings() -> None:
    """Thrust rises by (R/4)^2 / (h^2 + (R/4)^2), lift by 1 / (1 + (16 h/b)^2), times the numbers of the file."""
    table = '[ground_effect]\nchannel = "agl"\nrotor = 0.8\nradius = 0.2\nlift = 0.3\n'
    vehicle = parse_vehicle(builtin_text("quadplane") + table, "near")

    def az(height: float, command: float, speed: float) -> float:
        u = motors(vehicle, command)
        u[vehicle.inputs.index("agl")] = height
        return rates(vehicle, vehicle.kernel().evaluate, u, {"u": speed})[1]["az"]

    for h in (0.05, 0.2):
        rise = 0.05**2 / (h**2 + 0.05**2)
        assert az(h, 0.6, 0.0) / az(1e6, 0.6, 0.0) == pytest.approx(1.0 + 0.8 * rise, rel=1e-6)
        rise = 1.0 / (1.0 + (16.0 * h / vehicle.value("reference.span")) ** 2)
        assert az(h, 0.0, 18.0) / az(1e6, 0.0, 18.0) == pytest.approx(1.0 + 0.3 * rise, rel=1e-3)


def test_gyroscope_and_reaction() -> None:
    told = 'drive = "speed", gain = 500.0, lag = 0.1, inertia = 1e-4, T2 = 4e-5'
    text = SINGLE.replace("T0 = 0.3, T1 = 1.7, T2 = 8.0, Q1 = 0.02, Q2 = 0.1", told)
    vehicle = parse_vehicle(text, "gyro")
    evaluate = interpreted(vehicle)
    u = motors(vehicle, 0.6)
    d, _ = rates(vehicle, evaluate, u, {"u": 0.0, "only.lag": -100.0})
    assert d["only.lag"] == pytest.approx(1000.0)
    assert d["r"] * 0.015 == pytest.approx(1e-4 * 1000.0), "ccw from above: nose right"
    d, _ = rates(vehicle, evaluate, u, {"u": 0.0, "p": 2.0})
    # Angular momentum points up, -z: omega x h = (2, 0, 0) x (0, 0, -0.03) = (0, 0.06, 0).
    assert d["q"] * 0.01 == pytest.approx(-0.06)


def test_numbers_that_are_free() -> None:
    vehicle = builtin_vehicle("quad-x")
    known = {p.name: p for p in vehicle.parameters}
    free = {f"rotors.{n}" for n in ("T1", "T2", "inflow", "drag", "torque_ratio")}
    free |= {f"body_drag.quadratic.{a}" for a in "xyz"}
    free |= {f"sensors.{c}.bias" for c in ("vn", "ve", "vd", "p", "q", "r", "ax", "ay", "az")}
    assert {name for name, p in known.items() if p.free} == free
    assert all(p.lower <= p.value <= p.upper and (not p.free or p.lower < p.upper) for p in known.values())
    assert [known[name].prior for name in WIND_NUMBERS] == [3.0, 3.0, 0.5]


def test_bounds_go_with_the_size_of_the_vehicle() -> None:
    """Twice the weight on the same rotors: the search looks for twice the thrust."""
    light = builtin_vehicle("quad-x").with_numbers({n: {"value": 0.0} for n in ("rotors.T1", "rotors.T2")})
    heavy = light.with_numbers({"mass.mass": {"value": 3.0}})
    for name in ("rotors.T1", "rotors.T2", "rotors.drag"):
        one, two = (v.parameters[v.rows[name]] for v in (light, heavy))
        assert two.upper > one.upper, name
    assert heavy.parameters[heavy.rows["rotors.T2"]].upper == pytest.approx(4.0 * 3.0 * GRAVITY / 4.0 / 0.25)
    for name in ("rotors.T2", "rotors.torque_ratio", "rotors.lag"):  # positive wherever the search looks
        free = builtin_vehicle("quad-x").with_numbers({name: {"free": True}})
        assert free.parameters[free.rows[name]].lower > 0.0
