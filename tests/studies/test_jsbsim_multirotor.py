"""What is taken for the truth of JSBSim's F450, against JSBSim's own numbers and against our equations."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.base.units import FOOT
from stoop.simulation import initial_states, parameter_rows
from stoop.vehicle import Vehicle
from stoop_studies.verify import multirotor
from stoop_studies.verify.jsbsim_flight import Recording
from stoop_studies.verify.multirotor import (
    CLIMB,
    COMMANDS,
    FOOT_POUND,
    KNOWN,
    LIFTS,
    MOTORS,
    NOTCH,
    RATE,
    SPEEDS,
    THRUST,
    TURNS,
    TWISTS,
    Quadrotor,
    climbs,
    fitted_lag,
    fly,
    lagged,
    motor_curve,
    rotor_coefficients,
    truth,
    vehicle_of,
)

MORE = {
    **{f"{a}_dot": (f"accelerations/{a}idot-rad_sec2", 1.0) for a in "pqr"},
    **{f"{a}_moment": (f"moments/{a}-prop-lbsft", FOOT_POUND) for a in "lmn"},
    **{f"advance_{i}": (f"propulsion/engine[{i}]/advance-ratio", 1.0) for i in range(4)},
}


@pytest.fixture(scope="module")
def craft() -> Quadrotor:
    return Quadrotor()


@pytest.fixture(scope="module")
def flown() -> Recording:
    """A short flight, with more of what JSBSim knows."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(multirotor, "DURATION", 6.0)
        patch.setattr(multirotor, "READ", {**multirotor.READ, **MORE})
        return fly(Quadrotor())


def short_case(craft: Quadrotor, flown: Recording, recorded: str) -> tuple[Vehicle, dict[str, float]]:
    middle = float(np.mean([flown.columns[c].mean() for c in MOTORS]))
    motor = None if recorded == SPEEDS else motor_curve(craft, middle)
    found = truth(craft, flown, motor)
    return vehicle_of(craft, flown, found, motor), found


def test_balances_are_at_the_arms(craft: Quadrotor, flown: Recording) -> None:
    """Thrust times arm, the reaction of the rotors and their gyroscopic moment are what turns JSBSim's body."""
    known = flown.columns
    lift, twist, turn = (np.stack([known[c] for c in names]) for names in (LIFTS, TWISTS, TURNS))
    x, y, _ = np.array([craft.position(i) for i in range(4)]).T[:, :, None]
    signs = np.array([1.0 if craft.sense(i) == "ccw" else -1.0 for i in range(4)])
    up = 6.05e-5 * signs @ turn
    assert -(y * lift).sum(axis=0) + known["q"] * up == pytest.approx(known["l_moment"], abs=2e-5)
    assert (x * lift).sum(axis=0) - known["p"] * up == pytest.approx(known["m_moment"], abs=2e-5)
    assert -twist.sum(axis=0) == pytest.approx(known["n_moment"], abs=1e-9)


def test_hubs_move_as_the_body_turns(craft: Quadrotor, flown: Recording) -> None:
    known = flown.columns
    diameter = 9.4 * 0.0254
    for i, climb in enumerate(climbs(craft, flown)):
        seen = known[f"advance_{i}"] * known[TURNS[i]] / (2.0 * np.pi) * diameter
        assert np.std(seen - climb) < 0.01 * np.std(climb)
        assert np.std(seen + known["w"]) > 0.03 * np.std(climb), "the turning counts"


def step_response(quadrotor: Quadrotor, command: float) -> float:
    """Return the time constant of the thrust after a small step of the command, s; mean of up and down."""
    quadrotor.set({"atmosphere/wind-down-fps": CLIMB / FOOT})
    areas = []
    for step in (NOTCH, -NOTCH):
        quadrotor.settle([command - step] * 4)
        thrust = [quadrotor[THRUST.format(0)]]
        quadrotor.command([command + step] * 4)
        for _ in range(round(0.8 * RATE)):
            quadrotor.run(1.0 / RATE)
            thrust.append(quadrotor[THRUST.format(0)])
        y = np.array(thrust)
        missing = (y[-1] - y) / (y[-1] - y[0])
        areas.append(float(np.sum(missing[1:] + missing[:-1]) / (2.0 * RATE)))
    return float(np.mean(areas))


def test_the_lag_is_that_of_a_step(craft: Quadrotor, flown: Recording) -> None:
    middle = float(np.mean([flown.columns[c].mean() for c in MOTORS]))
    motor = motor_curve(craft, middle)
    lag = fitted_lag(flown, climbs(craft, flown), motor)
    assert lag == pytest.approx(step_response(craft, middle), rel=0.05)
    off = lagged(flown, motor, lag) - np.stack([flown.columns[c] for c in TURNS])
    assert np.std(off[:, 50:]) < 0.1 * np.std(flown.columns[TURNS[0]])


def test_the_rotor_is_as_heavy_as_its_file_says(craft: Quadrotor, flown: Recording) -> None:
    turns = np.stack([flown.columns[c] for c in TURNS])
    found = rotor_coefficients(craft, flown, turns, climbs(craft, flown))
    assert found["rotors.inertia"] == pytest.approx(6.05e-5, rel=2e-3)
    lift, twist = (np.stack([flown.columns[c] for c in names]) for names in (LIFTS, TWISTS))
    signs = np.array([1.0 if craft.sense(i) == "ccw" else -1.0 for i in range(4)])
    left = -twist.sum(axis=0) - 6.05e-5 * np.gradient(signs @ turns, 1.0 / RATE)
    assert found["rotors.torque_ratio"] == pytest.approx(np.polyfit(signs @ lift, left, 1)[0], rel=0.01)


def test_torque_is_over_the_thrust_that_is_told(craft: Quadrotor, flown: Recording) -> None:
    """With commands alone the yaw that our numbers give is JSBSim's, though thrust rises less with a command."""
    _, known = short_case(craft, flown, COMMANDS)
    told = {n: known[f"rotors.{n}"] for n in ("T2", "inflow", "torque_ratio", "inertia", "lag")}
    middle = float(np.mean([flown.columns[c].mean() for c in MOTORS]))
    x = lagged(flown, motor_curve(craft, middle), told["lag"])
    thrust = told["T2"] * x**2 - told["inflow"] * x * climbs(craft, flown)
    signs = np.array([1.0 if craft.sense(i) == "ccw" else -1.0 for i in range(4)])
    twist = told["torque_ratio"] * (signs @ thrust) * flown.columns["density"] / 1.225
    twist = twist + told["inertia"] * np.gradient(signs @ x, 1.0 / RATE)
    jsbsim = -np.sum([flown.columns[c] for c in TWISTS], axis=0)
    assert np.std((twist - jsbsim)[50:]) < 0.02 * np.std(jsbsim)
    lift = np.stack([flown.columns[c] for c in LIFTS])
    steep = (
        np.polyfit((signs @ thrust)[50:], (signs @ lift)[50:], 1)[0] * 1.225 / flown.columns["density"].mean()
    )
    assert 1.01 < steep < 1.03


def test_a_lag_is_that_of_small_steps() -> None:
    """The closed form on straight lines against Euler's rule in 1000 steps a sample."""
    time = np.arange(60) / RATE
    commands = {c: 0.4 + 0.1 * np.sin(20.0 * time + i) for i, c in enumerate(MOTORS)}
    motor, lag = {"gain": 1000.0, "idle": 0.1}, 0.05
    x = lagged(Recording(time, commands, 9.8), motor, lag)
    fine = np.linspace(0.0, time[-1], 59 * 1000 + 1)
    wanted = 1000.0 * (np.interp(fine, time, commands[MOTORS[0]]) - 0.1)
    slow = [wanted[0]]
    for one in wanted[1:]:
        slow.append(slow[-1] + (one - slow[-1]) * (fine[1] / lag))
    assert x[0] == pytest.approx(np.array(slow)[::1000], rel=1e-4)


def test_equations_agree_at_the_states_flown(craft: Quadrotor, flown: Recording) -> None:
    """No fit: with JSBSim's numbers our equations give JSBSim's accelerations at its own states."""
    vehicle, found = short_case(craft, flown, SPEEDS)
    known, true = flown.columns, {n: {"value": v} for n, v in found.items() if n not in KNOWN}
    vehicle = vehicle.with_numbers(true)
    rows = parameter_rows(vehicle, {}, len(flown.time))
    turns = np.stack([known[c] for c in TURNS])
    told = np.vstack([turns, np.gradient(turns, 1.0 / RATE, axis=1)])
    assert vehicle.inputs == (*TURNS, *(f"{c}.slope" for c in TURNS))
    states = {c: known[c] for c in ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi")}
    start = initial_states(vehicle, {**states, "h": known["altitude"]}, rows, told)
    rates, readings = vehicle.kernel().evaluate(rows, start, told)
    near = dict.fromkeys(("p_dot", "q_dot", "r_dot", "az"), 0.05) | dict.fromkeys(("ax", "ay"), 0.15)
    for name, share in near.items():  # what is left is that tables bend and that a plate is braked by |V| v
        ours = rates[vehicle.states.index(name[0])] if name in MORE else readings[vehicle.outputs.index(name)]
        off = (ours - known[name])[2:-2]
        assert np.sqrt(np.mean(off**2)) < share * np.std(known[name]), name


def test_what_is_told_holds_no_answer(craft: Quadrotor, flown: Recording) -> None:
    for recorded in (SPEEDS, COMMANDS):
        vehicle, found = short_case(craft, flown, recorded)
        free = {p.name: p.value for p in vehicle.parameters if p.free}
        answers = {n for n in found if n not in KNOWN}
        assert answers <= set(free)
        far = {n for n in answers if found[n] and abs(free[n] / found[n] - 1.0) > 0.2}
        assert {"rotors.inflow", "rotors.torque_ratio", "rotors.inertia", "mass.inertia.xx"} <= far


def test_flights_are_the_same_again_and_quiet(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(multirotor, "DURATION", 1.0)
    first, second = (fly(Quadrotor()) for _ in range(2))
    assert all(np.array_equal(first.columns[c], second.columns[c]) for c in first.columns)
    assert "".join(capfd.readouterr()) == "", "JSBSim greets on stdout unless it is told not to"
