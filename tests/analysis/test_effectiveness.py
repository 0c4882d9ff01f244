"""Weak rotors: loads as in the equations of motion, truth by balance of forces comes back, healthy flights are left alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from stoop.errors import FlightError, VehicleError
from stoop.flight import Flight, from_columns
from stoop.vehicle import Vehicle, load_vehicle, parse_vehicle
from stoop_analysis.performance import effectiveness
from stoop_analysis.performance.effectiveness import (
    Balance,
    Hover,
    Reference,
    assess,
    hover,
    indistinct,
    judge,
)

EXAMPLE = Path(__file__).parents[2] / "examples" / "crazyflie.toml"
HALF = -0.0103 + 0.6 * 0.1825 - 0.36 * 0.0401  #: N, thrust of a rotor at a command of 0.6
CROOKED = """
format = "stoop-vehicle/1"
name = "crooked"
environment = { density = 1.225 }
rotors = { gain = 0.9, idle = 0.05, nominal_voltage = 12.0, T0 = 0.1, T1 = 2.0, T2 = 7.0, Q0 = 0.001, Q1 = 0.02, Q2 = 0.11 }
[mass]
mass = 1.3
inertia = { xx = 0.02, yy = 0.03, zz = 0.04, xz = 0.002 }
center_of_gravity = [0.01, -0.02, 0.03]
[rotor]
a = { channel = "motor_1", position = [0.2, 0.15, -0.05], axis = [0.1, 0.05, -1.0], spin = "ccw", factor = 0.8 }
b = { channel = "motor_2", position = [-0.2, -0.15, 0.0], spin = "cw", torque_factor = 1.2 }
c = { channel = "motor_3", position = [0.2, -0.2, 0.02], spin = "ccw" }
"""


@pytest.fixture(scope="module")
def quad() -> Balance:
    return Balance(load_vehicle(EXAMPLE))


@pytest.fixture(scope="module")
def hexa() -> Balance:
    return Balance(load_vehicle("hexa-x"))


def accelerations(vehicle: Vehicle, commands: dict[str, float]) -> np.ndarray:
    """Forces, N, and moments, N m, at rest by the vehicle's own equations."""
    from stoop.vehicle.symbolic import build_model

    model = build_model(vehicle)
    values = dict(zip(model.parameters, vehicle.values, strict=True))
    values |= {s: float(name == "e0") for s, name in zip(model.states, vehicle.states, strict=True)}
    values |= dict(zip(model.inputs, (commands[c] for c in vehicle.inputs), strict=True))
    rates = np.array([float(sp.sympify(d).subs(values)) for d in model.derivatives[:6]])
    m = vehicle.value
    inertia = np.diag([m("mass.inertia.xx"), m("mass.inertia.yy"), m("mass.inertia.zz")])
    inertia[0, 2] = inertia[2, 0] = -m("mass.inertia.xz")
    gravity = np.array([0.0, 0.0, 9.80665])
    return np.concatenate([m("mass.mass") * (rates[:3] - gravity), inertia @ rates[3:]])


def test_loads_are_those_of_the_equations() -> None:
    vehicle = parse_vehicle(CROOKED, "crooked")
    commands = {"motor_1": 0.5, "motor_2": 0.7, "motor_3": 0.61, "voltage": 11.1}
    balance = Balance(vehicle)
    thrust, torque = balance.drive({name: np.array([value]) for name, value in commands.items()})
    sums = balance.loads(thrust[:, 0], torque[:, 0]).sum(axis=1)
    load = accelerations(vehicle, commands)
    np.testing.assert_allclose(sums, [-load[2], *load[3:]], rtol=1e-9, atol=1e-12)


def flown(balance: Balance, rng: np.random.Generator, name: str, **truth: float) -> Hover:
    """A flight at rest whose controller commands what its rotors must be commanded, with the usual scatter.

    Truth: rotor name -> share that it loses, "mass" -> share of the weight taped to the rotor named by `near`, "scatter"
    -> times the usual one.
    """
    near, ratio = int(truth.pop("near", 0)), 0.01
    taped, scatter = truth.pop("mass", 0.0), truth.pop("scatter", 1.0)
    unit = np.array([1.0, balance.arm, balance.arm, ratio])  # of a weight of one
    usual = scatter * unit * np.array(effectiveness.USUAL)
    needed = np.array([1.0, 0.0, 0.0, 0.0]) + usual * rng.normal(size=4)
    needed += taped * balance.of_thrust[:, near] * np.array([1.0, 1.0, 1.0, 0.0])
    share = np.array([1.0 - truth.get(rotor, 0.0) for rotor in balance.vehicle.rotors])
    acts = balance.of_thrust + ratio * balance.of_torque
    mixer = np.linalg.pinv(acts)  # of more than four rotors: it does not know the loss
    thrust = mixer @ np.linalg.solve(acts * share @ mixer, needed)
    return Hover(name, thrust, ratio * thrust, np.zeros((4, 4)), float("nan"), 10.0)


def healthy(balance: Balance, rng: np.random.Generator, count: int, scatter: float = 1.0) -> Reference:
    flights = (flown(balance, rng, f"healthy {i}", scatter=scatter) for i in range(count))
    return Reference(balance, tuple(flights))


@pytest.mark.parametrize("count", [1, 3, 8])
def test_healthy_flights_are_accused_as_often_as_stated(quad: Balance, count: int) -> None:
    rng, verdicts = np.random.default_rng(count), []
    for _ in range(800):
        reference = healthy(quad, rng, count)
        verdicts.append(judge(assess(flown(quad, rng, "new"), reference), 0.05).kind != "healthy")
    assert np.mean(verdicts) < 0.05 + 0.01 + 3.0 * np.sqrt(0.06 / 800)  # 1 % are called odd besides


def test_more_are_accused_where_flights_scatter_twice_as_much(quad: Balance) -> None:
    for count, share in ((1, 0.26), (3, 0.23), (8, 0.14)):
        rng, accused = np.random.default_rng(count), []
        for _ in range(400):
            reference = healthy(quad, rng, count, 2.0)
            verdict = judge(assess(flown(quad, rng, "new", scatter=2.0), reference), 0.05)
            accused.append(bool(verdict.rotors))
        assert np.mean(accused) == pytest.approx(share, abs=3.0 * np.sqrt(share * (1.0 - share) / 400)), count


def test_a_weak_rotor_is_found_and_its_error_bar_holds(quad: Balance, hexa: Balance) -> None:
    rng, pulls = np.random.default_rng(5), []
    for k in range(400):
        rotor = ("M1", "M3")[k % 2]
        found = assess(flown(quad, rng, "new", **{rotor: 0.2}), healthy(quad, rng, 3))
        verdict = judge(found)
        assert (verdict.kind, verdict.rotors) == ("weak or mass", (rotor,))
        pulls.append((found.suspected.size - 0.2) / found.suspected.std)
    assert abs(np.mean(pulls)) < 0.3
    assert 0.7 < np.std(pulls) < 1.25
    rotor = hexa.vehicle.rotors[3]
    found = assess(flown(hexa, rng, "new", **{rotor: 0.4}), healthy(hexa, rng, 5))
    assert found.suspected.rotor == rotor
    assert rotor in judge(found).rotors
    one = flown(quad, rng, "idle")  # a rotor that was never commanded is no suspect
    idle = replace(one, thrust=one.thrust * [1, 1, 0, 1], torque=one.torque * [1, 1, 0, 1])
    found = assess(idle, healthy(quad, rng, 3))
    assert found.weak[2].sigmas == 0.0
    assert judge(found).kind != "healthy"


def test_a_mass_is_told_by_its_yaw_and_what_no_rotor_explains_is_called_odd(quad: Balance) -> None:
    rng = np.random.default_rng(6)
    found = assess(flown(quad, rng, "new", near=2, mass=0.2), healthy(quad, rng, 5))
    assert (judge(found).kind, judge(found).rotors) == ("mass", ("M3",))
    mass = found.mass_near("M3")
    assert abs(mass.size - 0.2) < 3.0 * mass.std
    one, reference = flown(quad, rng, "light"), healthy(quad, rng, 5)
    light = replace(one, thrust=0.8 * one.thrust, torque=0.8 * one.torque)
    assert judge(assess(light, reference)).kind == "odd"


def logged(thrust: np.ndarray, **more: np.ndarray) -> Flight:
    motors = {f"motor_{i}": thrust for i in range(1, 5)}
    return from_columns("flight", np.arange(thrust.size) / 50.0, motors | more)


def hops() -> np.ndarray:
    ground, up = np.zeros(200), np.concatenate([np.full(60, 0.9), np.full(400, 0.6), np.full(50, 0.5)])
    return np.concatenate([ground, up, ground, up, ground])


def test_takeoffs_and_landings_are_left_out(quad: Balance) -> None:
    found = hover(logged(hops()), quad)
    np.testing.assert_allclose(found.thrust, HALF)
    np.testing.assert_allclose(found.torque, HALF * 0.00596)
    assert found.duration == pytest.approx(2 * (510 / 50 - 4.0))
    both = effectiveness.pooled((found, found))
    np.testing.assert_allclose(both.thrust, found.thrust)


def test_error_of_the_mean_knows_that_commands_correlate(quad: Balance) -> None:
    rng = np.random.default_rng(10)
    slow = np.repeat(rng.normal(size=400), 10) * 0.05  # constant for 0.2 s each
    stretch = np.concatenate([np.zeros(100), 0.6 + slow, np.zeros(100)])
    found = hover(logged(stretch), quad)
    true = 0.05 * 4 * (0.1825 - 2 * 0.6 * 0.0401) / np.sqrt(slow.size / 10)
    assert 0.7 * true < np.sqrt(found.covariance[0, 0]) < 1.4 * true


def test_what_cannot_be_used_is_said(quad: Balance) -> None:
    still = EXAMPLE.read_text("utf-8").replace("torque_ratio = 0.00596", "torque_ratio = 0.0")
    whole, idle = logged(hops()), Balance(parse_vehicle(still, "still"))
    without = replace(whole, data=whole.data.drop_vars("motor_2"))
    ended = np.concatenate([np.zeros(50), np.full(300, 0.6)])
    fast = logged(hops(), vn=np.full(hops().size, 8.0), ve=np.zeros(hops().size))
    for call, words in (
        (lambda: hover(logged(np.zeros(500)), quad), "motors are off"),
        (lambda: hover(logged(ended), quad), "near hover, take-offs and landings aside"),
        (lambda: hover(fast, quad), "choose a flight near hover"),
        (lambda: hover(without, quad), "motor_2 not recorded"),
        (lambda: Reference(quad, ()), "no healthy flight"),
        (lambda: Balance(load_vehicle("twin-boom")), "has no rotors"),
        (lambda: Reference(idle, (hover(logged(hops()), idle),)), "check T, Q or torque_ratio"),
    ):
        with pytest.raises((FlightError, VehicleError), match=words):
            call()
    rng = np.random.default_rng(9)
    assert effectiveness.leave_one_out(healthy(quad, rng, 1)) == ()
    assert [a.name for a in effectiveness.leave_one_out(healthy(quad, rng, 2))] == ["healthy 0", "healthy 1"]


def test_what_the_voltage_does_is_told_by_repeats(quad: Balance) -> None:
    rng = np.random.default_rng(11)
    groups = [3.6 + 0.1 * rng.normal(size=4) for _ in range(6)]
    noisy = [1.0 + 0.5 * (v / v.mean() - 1.0) + 0.003 * rng.normal(size=4) for v in groups]
    lifts = [rng.uniform(0.3, 0.5) * x for x in noisy]
    told = effectiveness.battery(lifts, groups)
    assert abs(told.slope - 0.5) < 3.0 * told.std < 0.3
    assert effectiveness.battery([np.array([0.3])], [np.array([3.6])]) == effectiveness.Battery()
    unknown = [np.array([np.nan, np.nan])]
    assert effectiveness.battery([np.array([0.3, 0.4])], unknown) == effectiveness.Battery()


def test_rotors_that_explain_it_nearly_as_well_are_named_with_it(hexa: Balance, quad: Balance) -> None:
    """A rotor of six and its neighbor differ by less than flights do, until the loss is large."""
    rng = np.random.default_rng(14)
    reference, rotor = healthy(hexa, rng, 3), hexa.vehicle.rotors[0]
    small = assess(flown(hexa, rng, "small", **{rotor: 0.15}), reference)
    assert len(indistinct(small)) > 1
    assert indistinct(small)[0] == small.suspected.rotor
    assert rotor in indistinct(small)
    plain = assess(flown(quad, rng, "large", M3=0.4), healthy(quad, rng, 3))
    assert indistinct(plain) == ("M3",)
    gains = assess(flown(quad, rng, "gains", M1=-0.3, M2=-0.3, M3=-0.3, M4=-0.3), healthy(quad, rng, 3))
    assert indistinct(gains) == ()
