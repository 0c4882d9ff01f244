"""Flights on rotors: what is recorded gives the same flight again, and the autopilot flies what it is asked to."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from stoop.errors import ManeuverError, SimulationError
from stoop.flight import Flight, load_flight, save_flight
from stoop.simulation import linearize, trim
from stoop.simulation.autopilot import design, first_order_hold, linear_errors
from stoop.simulation.fly import fly, fly_together, simulate_flight
from stoop.simulation.maneuver import Maneuver, load_maneuver
from stoop.simulation.trim import Flown
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle, load_vehicle

G = 9.80665
BUSY = [
    {"control": "roll", "shape": "doublet", "start": 0.5, "step": 0.3, "amplitude": 8.0},
    {"control": "heave", "shape": "3-2-1-1", "start": 1.0, "step": 0.2, "amplitude": 2.0},
    {"control": "right", "shape": "pulse", "start": 2.0, "duration": 2.0, "amplitude": 2.0},
    {"control": "motor_2", "shape": "pulse", "start": 5.0, "duration": 0.3, "amplitude": 0.1},
]


def maneuver(duration: float = 8.0, *inputs: dict[str, object], **keys: object) -> Maneuver:
    return Maneuver.model_validate({"duration": duration, "input": list(inputs)} | keys)


def pulse(control: str, amplitude: float, start: float = 1.0, duration: float = 100.0) -> dict[str, object]:
    times = {"start": start, "duration": duration}
    return {"control": control, "shape": "pulse", "amplitude": amplitude} | times


def replayed(vehicle: Vehicle, flown: Flown, dt: float) -> np.ndarray:
    rows = vehicle.parameter_rows(flown.trim.changes)
    start = vehicle.initial_states(flown.trim.start, rows, flown.inputs[0])
    truth = vehicle.kernel().trajectories(rows, start, vehicle.late_inputs(flown.inputs, rows, dt), dt)
    return vehicle.late_outputs(truth, rows, dt)[0]


def over_ground(flight: Flight, body: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(columns(flight, "q1", "q2", "q3", "q0")).apply(body)


def columns(flight: Flight, *names: str) -> np.ndarray:
    return np.column_stack([flight.column(name) for name in names])


@pytest.mark.parametrize(("rate", "delay"), [(25.0, 0.0), (77.0, 0.04), (100.0, 0.013), (200.0, 0.004)])
def test_recorded_channels_give_the_same_flight_again(quad: Vehicle, rate: float, delay: float) -> None:
    vehicle = quad.with_numbers({"rotors.delay": {"value": delay}})
    battery = {"fall": 0.05, "sag": 0.8}
    flown = fly(vehicle, maneuver(8.0, *BUSY, rate=rate, battery=battery, wind=(3.0, 1.0, 0.2), heading=0.4))
    assert np.abs(replayed(vehicle, flown, 1.0 / rate) - flown.outputs).max() < 1e-9
    assert np.abs(flown.velocity[-1]).max() < 0.4, "and the autopilot has it in hand"


def test_flights_side_by_side_are_those_alone(quad: Vehicle) -> None:
    """Lanes of other values, delays, maneuvers and lengths have the bits of single flights; failures are values."""
    late = quad.with_numbers({"rotors.delay": {"value": 0.013}, "mass.mass": {"value": 1.6}})
    helpless = quad.with_numbers({"rotor.m1.factor": {"value": 0.0}})
    busy, calm = maneuver(3.0, *BUSY, battery={"sag": 0.8}), maneuver(3.0, *BUSY[:2], wind=(3.0, 1.0, 0.2))
    punctual = quad.with_numbers({"rotors.delay": {"value": 0.0}})
    pairs = [(quad, busy), (helpless, busy), (late, calm), (punctual, calm), (late, maneuver(2.0, *BUSY[:1]))]
    found = fly_together(pairs)
    assert isinstance(found.pop(1), SimulationError)
    del pairs[1]
    for pair, one in zip(pairs, found, strict=True):
        alone = fly(*pair)
        for name in ("states", "inputs", "outputs"):
            assert np.array_equal(getattr(one, name), getattr(alone, name))


def test_it_stays_where_nothing_is_asked_of_it(quad: Vehicle) -> None:
    still = fly(quad, maneuver(8.0, wind=(5.0, -3.0, 0.5)))
    assert np.abs(still.velocity).max() < 1e-3
    away = fly(quad, maneuver(8.0, velocity=(2.0, 1.0, -0.5), heading=1.0))
    assert np.abs(away.velocity - [2.0, 1.0, -0.5]).max() < 1e-3


def test_set_points_are_reached(quad: Vehicle) -> None:
    for control, speed, axis in (("north", 1.5, 0), ("east", -2.0, 1), ("down", 1.0, 2)):
        flown = fly(quad, maneuver(8.0, pulse(control, speed), wind=(2.0, 0.0, 0.0), rate=50.0))
        assert flown.velocity[-1] == pytest.approx(speed * np.eye(3)[axis], abs=0.05), control
        assert np.abs(flown.velocity[:, axis]).max() < 1.35 * abs(speed)
    steps = (pulse("heading", 2.0), pulse("forward", 1.5, 6.0))
    turned = fly(quad, maneuver(12.0, *steps, heading=0.5, rate=50.0))
    assert turned.outputs[-1, quad.outputs.index("psi")] == pytest.approx(2.5, abs=0.03)
    assert turned.velocity[-1] == pytest.approx([1.5 * np.cos(2.5), 1.5 * np.sin(2.5), 0.0], abs=0.06)


@pytest.mark.parametrize("name", ["quad-x", "hexa-x", "octo-x", "quadplane"])
def test_templates_answer_steps_and_come_to_rest(name: str) -> None:
    vehicle = builtin_vehicle(name)
    steps = [
        pulse("roll", 5.0, 1.0, 0.5), pulse("pitch", -5.0, 3.0, 0.5), pulse("yaw", 0.5, 5.0, 0.5),
        pulse("heave", 2.0, 7.0, 0.5), pulse("north", 2.0, 9.0, 3.0), pulse("heading", 0.8, 13.0),
    ]  # fmt: skip
    flown = fly(vehicle, maneuver(25.0, *steps))
    y = dict(zip(vehicle.outputs, flown.outputs.T, strict=True))
    for rate, start, sign in (("p", 1.0, 1), ("q", 3.0, -1), ("r", 5.0, 1)):
        during = (flown.time > start + 0.1) & (flown.time < start + 0.25)
        assert (sign * y[rate][during]).min() > 0.0, f"{rate} goes the way that it is asked to"
    assert y["vd"][int(7.4 * 100)] < -0.2, "heave is up"
    assert y["vn"][int(11.8 * 100)] == pytest.approx(2.0, abs=0.4)
    assert np.abs(flown.outputs[-1, :6]).max() < 0.05
    assert y["psi"][-1] == pytest.approx(0.8, abs=0.03)
    assert not flown.clipped.any()


def test_excitations_are_accelerations(quad: Vehicle) -> None:
    """The first command after their start is the trim's plus the allocated channels, which give them exactly."""
    for control, entry in (("roll", 3), ("pitch", 4), ("yaw", 5), ("heave", 2)):
        flown = fly(quad, maneuver(2.0, pulse(control, 0.01)))
        rows = quad.parameter_rows(flown.trim.changes)
        rates = quad.accelerations(flown.trim.start, flown.inputs[100][:, None].copy(), rows)[:, 0]
        expected = np.zeros(6)
        expected[entry] = -0.01 if control == "heave" else 0.01
        assert rates[2:] == pytest.approx(expected[2:], abs=5e-5), control
    one = fly(quad, maneuver(2.0, pulse("motor_3", 0.02)))
    assert one.inputs[100] - one.inputs[99] == pytest.approx([0.0, 0.0, 0.02, 0.0, 0.0], abs=1e-9)


def test_momentum_is_what_the_accelerometers_felt(quad: Vehicle) -> None:
    """Specific force turned into the Earth's axes, plus gravity, is the rate of the velocity over ground."""
    punctual = quad.with_numbers({"sensors.q.delay": {"value": 0.0}})
    flight = simulate_flight(punctual, maneuver(6.0, *BUSY, rate=400.0, wind=(4.0, 0.0, 0.0)), noise=False)
    rate = np.add(over_ground(flight, columns(flight, "ax", "ay", "az")), [0.0, 0.0, G])
    gained = np.cumsum(0.5 * (rate[1:] + rate[:-1]), axis=0) / 400.0
    velocity = columns(flight, "vn", "ve", "vd")
    assert velocity[1:] - velocity[0] == pytest.approx(gained, abs=2e-4)
    # and the power of that force is the gain of kinetic and potential energy, per mass
    power = np.sum(rate * velocity, axis=1) - G * velocity[:, 2]
    work = np.cumsum(0.5 * (power[1:] + power[:-1])) / 400.0
    energy = 0.5 * np.sum(velocity**2, axis=1) + G * flight.column("altitude")
    assert energy[1:] - energy[0] == pytest.approx(work, abs=2e-3)
    position = columns(flight, "pn", "pe", "pd")
    assert np.gradient(position, 1.0 / 400.0, axis=0)[2:-2] == pytest.approx(velocity[2:-2], abs=1e-3)
    assert flight.column("altitude") == pytest.approx(200.0 - position[:, 2], abs=1e-12)


def test_the_flight_file_holds_it_all_and_noise_by_seed(quad: Vehicle, tmp_path: Path) -> None:
    windy = maneuver(3.0, *BUSY, wind=(3.0, -1.0, 0.2))
    flight, other = (simulate_flight(quad, windy, seed=s) for s in (2, 3))
    assert not np.array_equal(flight.column("q"), other.column("q"))
    assert np.array_equal(flight.column("motor_1"), other.column("motor_1")), "the autopilot sees true states"
    save_flight(flight, tmp_path / "flight.nc")
    names = {*quad.outputs, "voltage", "altitude", "pn", "pe", "pd", "q0", "q1", "q2", "q3"}
    assert set(load_flight(tmp_path / "flight.nc").data.data_vars) == names | {
        f"motor_{i}" for i in (1, 2, 3, 4)
    }
    truth = json.loads(flight.data.attrs["truth"])
    assert [truth[f"sensors.{c}.bias"] for c in ("vn", "ve", "vd")] == [3.0, -1.0, 0.2]
    assert truth["rotors.T2"] == 6.0


def test_ends_of_the_range_are_reported(quad: Vehicle) -> None:
    hard = maneuver(4.0, {**BUSY[0], "start": 1.0, "step": 0.2, "amplitude": 160.0})
    flown = fly(quad, hard)
    commands = flown.inputs[:, quad.rotor_range.columns]
    assert (commands.min(), commands.max()) == (0.0, 1.0)
    assert (flown.clipped == ((commands == 0.0) | (commands == 1.0))).all()
    found = simulate_flight(quad, hard).notices[1]
    assert found.code == "rotors-saturated"
    assert "motor_1" in found.values["rotors"]
    example = load_maneuver(Path(__file__).parents[3] / "examples" / "maneuver_quadplane.toml")
    assert [n.code for n in simulate_flight(builtin_vehicle("quadplane"), example).notices] == ["simulated"]
    assert np.abs(replayed(quad, flown, 0.01) - flown.outputs).max() < 1e-9


def test_the_battery_falls_and_the_autopilot_makes_up_for_it(quad: Vehicle) -> None:
    fresh = fly(quad, maneuver(6.0, *BUSY[:2]))
    volts = quad.inputs.index("voltage")
    assert (fresh.inputs[:, volts] == 16.0).all()
    tired = fly(quad, maneuver(6.0, *BUSY[:2], battery={"start": 15.5, "fall": 0.1, "sag": 0.9}))
    area, voltage = quad.rotor_range, tired.inputs[:, volts]
    x, hover = tired.inputs[:, area.columns] * voltage[:, None] / 16.0, fresh.trim.inputs[area.columns]
    load = np.mean((x / hover) ** 2, axis=1)
    assert voltage == pytest.approx(15.5 - 0.1 * tired.time - 0.9 * load, abs=1e-9)
    assert x == pytest.approx(fresh.inputs[:, area.columns], abs=0.02)
    # Nearly: between samples the product of two straight lines is none.
    assert np.sqrt(np.mean((tired.outputs - fresh.outputs) ** 2)) < 0.01


def test_gusts_push_and_the_autopilot_holds(quad: Vehicle) -> None:
    gusts = "airspeed = 5.0\nu = { intensity = 0.8, length = 30.0 }\nw = { intensity = 0.5, length = 15.0 }"
    gusty = parse_vehicle(f"{quad.text}\n[turbulence]\n{gusts}\n", "gusty.toml")
    one, again, other = (fly(gusty, maneuver(4.0, wind=(4.0, 0.0, 0.0)), seed=s) for s in (5, 5, 6))
    assert np.array_equal(one.outputs, again.outputs)
    assert not np.array_equal(one.outputs, other.outputs)
    assert 0.01 < np.abs(one.velocity).max() < 1.0
    assert one.inputs[:, gusty.rotor_range.columns].std(axis=0).min() > 1e-3


def test_what_cannot_be_flown(twin_boom: Vehicle, quad: Vehicle) -> None:
    slow = parse_vehicle(quad.text.replace("lag = 0.05", "lag = 0.05, voltage_average = 30.0"), "slow.toml")
    refused, quadplane = (ManeuverError, SimulationError), load_vehicle("quadplane")
    for vehicle, given, says in (
        (quad, {"input": [pulse("elevator", 0.1)]}, "moves 'elevator', but the controls are roll, pitch, yaw, heave, north"),
        (quad, {"airspeed": 12.0}, "no wings to fly 12 m/s on"),
        (quad, {"airspeed": 12.0, "input": [pulse("roll", 1.0)]}, "leave it out, write velocity, and move roll, pitch, yaw"),
        (quad, {"duration": 30000.0}, "more than 500000 samples under the autopilot; lower one of them"),
        (quad, {"noise": {"V": 0.1}}, "noise: 'V' is not observed; channels are vn, ve, vd"),
        (quad, {"duration": 400.0, "input": [pulse("roll", 1.0)], "rate": 2.0}, "diverges at .* s; raise the rate of the"),
        (quadplane, {"airspeed": 20.0, "input": [pulse("pitch", 1.0)]},
         "moves 'pitch', but the controls are elevator.* or leave the airspeed out: 'pitch'"),
        (twin_boom, {"velocity": (1.0, 0.0, 0.0)}, "velocity: .*twin.* has no rotors to hover on; write airspeed"),
        (twin_boom, {"battery": {"fall": 0.1}}, "battery: no rotor of .* depends on the voltage"),
        (twin_boom, {"input": [pulse("heave", 1.0)]}, "moves 'heave', but the controls are elevator"),
        (slow, {"battery": {"sag": 0.5}}, r"battery.sag: .* take the voltage over 30 s \(voltage_average\)"),
    ):  # fmt: skip
        with pytest.raises(refused, match=says):
            simulate_flight(vehicle, Maneuver.model_validate({"duration": 2.0} | given))


def test_a_quadplane_flies_on_its_wings_in_a_wind() -> None:
    vehicle = builtin_vehicle("quadplane")
    inputs = [{**BUSY[0], "control": "elevator", "amplitude": 0.03}]
    keys = {"airspeed": 18.0, "heading": 0.8, "wind": (3.0, -2.0, 0.0)}
    flown = fly(vehicle, maneuver(4.0, *inputs, **keys))
    still = fly(vehicle, maneuver(4.0, *inputs, **keys | {"wind": (0.0, 0.0, 0.0)}))
    assert flown.velocity - still.velocity == pytest.approx(np.tile([3.0, -2.0, 0.0], (401, 1)), abs=1e-9)
    assert flown.outputs[:, :3] == pytest.approx(flown.velocity, abs=1e-6)
    assert still.velocity[0] == pytest.approx([18.0 * np.cos(0.8), 18.0 * np.sin(0.8), 0.0], abs=1e-6)
    assert np.abs(replayed(vehicle, flown, 0.01) - flown.outputs).max() < 1e-9


def test_an_aircraft_in_a_wind_records_its_speed_over_ground(twin_boom: Vehicle) -> None:
    inputs, wind = [{**BUSY[0], "control": "aileron", "amplitude": 0.05}], (4.0, -3.0, 0.5)
    flight = simulate_flight(twin_boom, maneuver(5.0, *inputs, wind=wind, heading=1.0), noise=False)
    V, alpha, beta = columns(flight, "V", "alpha", "beta").T
    v = [V * np.cos(alpha) * np.cos(beta), V * np.sin(beta), V * np.sin(alpha) * np.cos(beta)]
    expected = over_ground(flight, np.column_stack(v)) + wind
    assert pytest.approx(expected, abs=1e-8) == columns(flight, "vn", "ve", "vd")
    assert flight.column("psi")[0] == pytest.approx(1.0)
    calm = simulate_flight(twin_boom, maneuver(5.0, *inputs, heading=1.0), noise=False)
    assert "vn" not in calm.data
    assert np.array_equal(calm.column("V"), V), "a steady wind carries the aircraft along"


WIND = (3.0, -2.0, 0.4)


def test_its_linear_model_is_that_of_the_exact_derivatives(quad: Vehicle) -> None:
    """Other coordinates, the same motion: eigenvalues agree; those of position and heading are zero in both."""
    point = trim(quad, wind=WIND, heading=0.6)
    exact = linearize(quad, point)
    keep = [i for i, n in enumerate(exact.states) if n not in ("psi", "h")]
    expected = np.linalg.eigvals(exact.A[np.ix_(keep, keep)])
    found = np.linalg.eigvals(linear_errors(quad, point).A)
    for value in expected:
        near = int(np.argmin(np.abs(found - value)))
        assert found[near] == pytest.approx(value, abs=2e-4 * (1.0 + abs(value)))
        found = np.delete(found, near)
    assert np.abs(found).max() < 2e-3, "three positions and a heading"


def test_commands_in_straight_lines_are_held_exactly() -> None:
    rng = np.random.default_rng(1)
    A, B, x = rng.standard_normal((5, 5)), rng.standard_normal((5, 2)), rng.standard_normal(5)
    E = rng.standard_normal((5, 2))
    r0, r1, dt = rng.standard_normal(2), rng.standard_normal(2), 0.3
    F, G0, G1 = first_order_hold(A, B, E, dt)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        return A @ y + B @ (r0 + (r1 - r0) * t / dt) + E @ (r1 - r0) / dt

    flown = solve_ivp(rate, (0.0, dt), x, rtol=1e-11, atol=1e-12).y[:, -1]
    assert F @ x + G0 @ r0 + G1 @ r1 == pytest.approx(flown, abs=1e-9)


@pytest.mark.parametrize(("dt", "delay"), [(0.0025, 7), (0.01, 1), (0.05, 2)])
def test_the_delayed_system_has_the_poles_of_the_one_without_delay(quad, dt, delay):
    """Built as a whole, commands on their way among the states: poles of F - GK, and zeros for the waiting."""
    point = trim(quad, wind=WIND)
    model = linear_errors(quad, point)
    gains = design(quad, point, model, dt, delay)
    F, G0, G1 = first_order_hold(model.A, model.B, model.E, dt)
    n, m = model.B.shape
    # errors, then r[k], r[k+1], ..., r[k+delay-1]; the command that follows them is `new`
    whole = np.zeros((n + delay * m, n + delay * m))
    new = np.zeros((m, n + delay * m))
    new[:, :n] = -gains.errors
    for i in range(delay):
        new[:, n + i * m : n + (i + 1) * m] = -gains.underway[i]
    rows = np.vstack([np.hstack([np.zeros((delay * m, n)), np.eye(delay * m)]), new])  # r[k] ... r[k+delay]
    whole[:n, :n] = F
    whole[:n] += G0 @ rows[:m] + G1 @ rows[m : 2 * m]
    whole[n:] = rows[m:]
    poles = np.linalg.eigvals(whole)
    assert np.abs(poles).max() < 1.0 - 0.1 * dt
    slow = np.sort(np.abs(poles))[::-1][:n]
    punctual = design(quad, point, model, dt, 1)
    drive = F @ G1 + G0
    # u[k+1] = -K s[k+1] with delay 1: K F is what it makes of e[k]
    K = punctual.errors @ np.linalg.inv(F)
    assert slow == pytest.approx(np.sort(np.abs(np.linalg.eigvals(F - drive @ K)))[::-1], abs=1e-6)


def test_a_vehicle_that_turns_over_between_samples_is_refused(quad: Vehicle) -> None:
    point = trim(quad)
    model = linear_errors(quad, point)
    wild = replace(model, A=model.A + 1e4 * np.eye(len(model.A)))
    with pytest.raises(SimulationError, match="no autopilot was found that holds it at 1 Hz; raise the rate"):
        design(quad, point, wild, 1.0, 1)
