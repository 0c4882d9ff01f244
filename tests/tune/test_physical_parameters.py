"""Physics in an autopilot's parameters: beside formulas by hand, and beside what its own filter predicts in wind."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.optimize import fsolve
from tune.made_up import TAIL, v_tail

from stoop.simulation import trim
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.document import with_entries
from stoop_analysis.draws import Draws
from stoop_analysis.propagation.wing_figures import Domain
from stoop_tune.physical_parameters import PhysicalParameters as Found
from stoop_tune.physical_parameters import physical_parameters

G, SEA = 9.80665, 1.225
HEIGHT, RHO = 400.0, SEA * (1.0 - 2.25577e-5 * 400.0) ** 4.25588  #: m, kg/m3 of the standard atmosphere
PX4_COPTER = {"MPC_THR_HOVER": 0.5, "EKF2_BCOEF_X": 0.0, "EKF2_BCOEF_Y": 0.0, "EKF2_MCOEF": 0.0,
              "THR_MDL_FAC": 0.0}  # fmt: skip
COPTER = dict.fromkeys(("EK3_DRAG_BCOEF_X", "EK3_DRAG_BCOEF_Y", "EK3_DRAG_MCOEF"), 0.0) | {
    "MOT_THST_HOVER": 0.35, "MOT_THST_EXPO": 0.65, "MOT_SPIN_MIN": 0.1, "MOT_SPIN_MAX": 0.9,
}  # fmt: skip
ROTOR_NUMBERS = ("rotors.T1", "rotors.T2", "rotors.drag", "body_drag.quadratic.x", "body_drag.quadratic.y")
PROPELLER = {"speed_gain": 140.0, "diameter": 0.7, "CT0": 0.11, "CT1": -0.1}
WING_NUMBERS = ("Cm0", "CD0", "CL0", "Cl0", "Cn0", "CQ0", "propulsion.CT0")
PX4_WING = dict.fromkeys(("FW_PSP_OFF", "FW_THR_ASPD_MIN", "FW_THR_ASPD_MAX", "TRIM_ROLL", "TRIM_PITCH", "TRIM_YAW"), 0.0) | {
    "FW_THR_TRIM": 0.6, "FW_T_CLMB_MAX": 5.0, "FW_T_SINK_MIN": 2.0, "FW_AIRSPD_TRIM": 35.0, "FW_AIRSPD_MIN": 30.0,
    "FW_AIRSPD_MAX": 45.0, "FW_THR_MAX": 0.9, "ASPD_SCALE_1": 1.1,
}  # fmt: skip


def quadrotor(seed: int, channel: str = "motor") -> Vehicle:
    rng = np.random.default_rng(seed)
    quad = builtin_vehicle("quad-x")
    side = rng.uniform(0.01, 0.03)
    entries = {("mass", "mass"): rng.uniform(1.2, 1.8), ("rotors", "T1"): rng.uniform(1.0, 3.0),
               ("rotors", "T2"): rng.uniform(5.0, 8.0), ("rotors", "drag"): rng.uniform(0.02, 0.1),
               ("body_drag", "quadratic"): [side, 1.3 * side, 0.03]}  # fmt: skip
    if channel == "pwm":
        entries |= {("rotors", "gain"): 1.0 / 1000.0, ("rotors", "idle"): 1000.0}
        entries |= {("rotor", name, "channel"): f"pwm_{i}" for i, name in enumerate(quad.file.rotor, 1)}
    return with_entries(quad, entries)


def known(vehicle: Vehicle, names: tuple[str, ...], share: float = 0.02, count: int = 400) -> Draws:
    values = np.array([vehicle.value(n) for n in names])
    spread = share * np.abs(values) * np.random.default_rng(0).standard_normal((count, len(names)))
    return Draws(names, values + spread, "covariance")


def of_rotors(vehicle: Vehicle, given: Any, firmware: str = "PX4 multicopter", draws: Any = None) -> Found:
    domain = Domain((0.0, 8.0), 0.0, HEIGHT, RHO, speeds=(0.0, 8.0))
    return physical_parameters(vehicle, firmware, given, domain, draws or known(vehicle, ROTOR_NUMBERS))


def estimates(found: Found) -> dict[str, float]:
    return {one.name: one.figure.estimate for one in found.found}


def hover_command(vehicle: Vehicle) -> float:
    """Solve m g = 4 rho / rho0 (T1 x + T2 x^2)."""
    linear, square = vehicle.value("rotors.T1"), vehicle.value("rotors.T2")
    lift = vehicle.value("mass.mass") * G * SEA / RHO / 4.0
    return (-linear + math.sqrt(linear**2 + 4.0 * square * lift)) / (2.0 * square)


def test_drag_hover_thrust_and_curve_of_px4_are_those_by_hand() -> None:
    vehicle = quadrotor(0)
    mass, x = vehicle.value("mass.mass"), hover_command(vehicle)
    linear, square = vehicle.value("rotors.T1"), vehicle.value("rotors.T2")
    side, ahead = (vehicle.value(f"body_drag.quadratic.{a}") for a in "yx")
    expected = {"EKF2_BCOEF_X": RHO * mass / (2.0 * ahead), "EKF2_BCOEF_Y": RHO * mass / (2.0 * side), "MPC_THR_HOVER": x,
                "EKF2_MCOEF": 4.0 * vehicle.value("rotors.drag") * x / mass * math.sqrt(RHO / SEA),
                "THR_MDL_FAC": square / (linear + square)}  # fmt: skip
    assert estimates(of_rotors(vehicle, PX4_COPTER)) == pytest.approx(expected, rel=2e-3)


def test_a_curve_that_flew_is_between_setpoint_and_pulse_alone() -> None:
    """PX4 logs setpoints of thrust ahead of the curve, pulses behind it."""
    vehicle, curve = quadrotor(0, "pwm"), 0.6
    parameters = PX4_COPTER | {"THR_MDL_FAC": curve, "PWM_MAIN_MIN1": 1050.0, "PWM_MAIN_MAX1": 1950.0}
    found = estimates(of_rotors(vehicle, parameters))
    share = (1000.0 * hover_command(vehicle) - 50.0) / 900.0
    assert found["MPC_THR_HOVER"] == pytest.approx(curve * share**2 + (1.0 - curve) * share, rel=1e-3)
    square = vehicle.value("rotors.T2") * 0.9**2
    linear = (vehicle.value("rotors.T1") + 2 * 0.05 * vehicle.value("rotors.T2")) * 0.9
    assert found["THR_MDL_FAC"] == pytest.approx(square / (linear + square), rel=1e-3)
    straight = with_entries(quadrotor(0), {("rotors", "T1"): 7.0, ("rotors", "T2"): 0.01})
    again = estimates(of_rotors(straight, PX4_COPTER | {"THR_MDL_FAC": curve}))
    assert again["THR_MDL_FAC"] == pytest.approx(curve, abs=0.01)  # straight over the setpoint that it made


def test_arducopter_takes_thrust_between_its_spins_and_density_by_the_root_of_eas2tas() -> None:
    vehicle = quadrotor(1)
    n, x = vehicle.value, hover_command(vehicle)
    found, mass = estimates(of_rotors(vehicle, COPTER, "ArduCopter")), n("mass.mass")
    factor, share = math.sqrt(math.sqrt(SEA / RHO)), (x - 0.1) / 0.8
    assert found["EK3_DRAG_BCOEF_X"] == pytest.approx(SEA * factor * mass / (2 * n("body_drag.quadratic.x")))
    momentum = 4 * n("rotors.drag") * x * RHO / SEA / mass / factor
    assert found["EK3_DRAG_MCOEF"] == pytest.approx(momentum, rel=2e-3)
    assert found["MOT_THST_HOVER"] == pytest.approx(0.65 * share**2 + 0.35 * share, rel=1e-3)
    square, linear = n("rotors.T2") * 0.8, n("rotors.T1") + 0.2 * n("rotors.T2")
    assert found["MOT_THST_EXPO"] == pytest.approx(square / (linear + square), rel=1e-3)
    absent = of_rotors(vehicle, COPTER | {"MOT_BAT_VOLT_MAX": 16.8}, "ArduCopter").absent
    assert list(absent.values()) == [("MOT_THST_HOVER", "MOT_THST_EXPO")]


def ekf2_drag(found: dict[str, float], air: np.ndarray) -> np.ndarray:
    """Return the specific force along x and y that EKF2 predicts for a velocity through the air, step by step."""
    momentum = found["EKF2_MCOEF"] * math.sqrt(RHO / SEA)
    inverse = np.array([1.0 / found["EKF2_BCOEF_X"], 1.0 / found["EKF2_BCOEF_Y"]])
    ellipse = np.linalg.norm(inverse * air[:2] / np.linalg.norm(air[:2]))
    return np.array([-0.5 * ellipse * RHO * v * np.linalg.norm(air) - v * momentum for v in air[:2]])


def ekf3_drag(found: dict[str, float], air: np.ndarray) -> np.ndarray:
    """Return what EKF3 of ArduPilot predicts: by the component of each axis, its density by the root of EAS2TAS."""
    ratio, out = math.sqrt(math.sqrt(SEA / RHO)), []
    for axis, name in enumerate("XY"):
        sign = -1.0 if air[axis] > 0.0 else 1.0
        bluff = 0.5 / found[f"EK3_DRAG_BCOEF_{name}"] * SEA * ratio * air[axis] ** 2 * sign
        out.append(bluff - air[axis] * found["EK3_DRAG_MCOEF"] * ratio)
    return np.array(out)


FILTERS = {
    "PX4 multicopter": ((0.0, 90.0, 180.0, 270.0), PX4_COPTER, ekf2_drag),
    "ArduCopter": ((0.0, 40.0, 90.0, 200.0), COPTER, ekf3_drag),
}


@pytest.mark.parametrize("firmware", FILTERS)
def test_filters_predict_the_specific_force_of_a_hover_in_wind(firmware: str) -> None:
    """In steady flight specific force is gravity's: its parts along x and y are those of the attitude."""
    vehicle, (headings, parameters, filtered) = quadrotor(2), FILTERS[firmware]
    found = estimates(of_rotors(vehicle, parameters, firmware))
    for heading in headings:
        point = trim(vehicle, None, HEIGHT, density=RHO, wind=(-5.0, 0.0, 0.0), heading=math.radians(heading))
        theta, phi = point.start["theta"], point.start["phi"]
        force = np.array([G * math.sin(theta), -G * math.sin(phi) * math.cos(theta)])
        predicted = filtered(found, np.array([point.start[n] for n in "uvw"]))
        assert np.linalg.norm(predicted - force) < 0.03 * np.linalg.norm(force), (heading, predicted, force)
        assert np.linalg.norm(force) > 0.3


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    truth, vehicle = estimates(of_rotors(quadrotor(3), PX4_COPTER)), quadrotor(3)
    exact = np.array([vehicle.value(n) for n in ROTOR_NUMBERS])
    sigma, rng, held = 0.04 * exact, np.random.default_rng(0), []
    for _ in range(80):
        values = exact + sigma * rng.standard_normal(len(exact))
        entries = {tuple(name.split(".")): x for name, x in zip(ROTOR_NUMBERS[:3], values, strict=False)}
        own = with_entries(vehicle, entries | {("body_drag", "quadratic"): [*values[3:], 0.03]})
        draws = Draws(ROTOR_NUMBERS, values + sigma * rng.standard_normal((300, len(exact))), "covariance")
        found = of_rotors(own, PX4_COPTER, draws=draws).found
        held += [one.figure.ci95_lower < truth[one.name] < one.figure.ci95_upper for one in found]
    assert len(held) == 400
    assert 0.90 < np.mean(held) < 0.985


@cache
def aeroplane() -> Vehicle:
    text = builtin_vehicle("twin-boom").text
    head, _, rest = text.partition("[propulsion]")
    text = head + '[propulsion]\nkind = "propeller"\nchannel = "control_throttle"\n'
    text += "".join(f"{n} = {x}\n" for n, x in PROPELLER.items()) + rest[rest.index("\n[aerodynamics.CD]") :]
    for surface, axis in (("elevator", "pitch = -"), ("aileron", "roll = "), ("rudder", "yaw = -")):
        text += f"\n[controls.{surface}]\nmix = {{ control_{axis}0.35 }}\n"
    vehicle = parse_vehicle(text + "\n[sensors]\nV = { scale = 0.95 }\n", "made up")
    return with_entries(vehicle, {("environment", "density"): "standard"})


def of_wings(
    vehicle: Vehicle,
    given: Any,
    firmware: str = "PX4 fixed wing",
    more: Any = (),
    stream: str = "",
    reading: float = 1.0,
) -> Found:
    domain, draws = Domain((30.0, 42.0), 35.0, HEIGHT, RHO), known(vehicle, (*WING_NUMBERS, *more))
    return physical_parameters(vehicle, firmware, given, domain, draws, frozenset({stream}), reading)


def glide(vehicle: Vehicle, speed: float, throttle: float) -> tuple[float, float, float]:
    """Solve angle of attack, elevator and path angle of a steady flight at a throttle, by the equations of the textbook."""
    n = vehicle.value
    pressure, weight = 0.5 * RHO * speed**2 * n("reference.area"), n("mass.mass") * G
    turns, diameter = PROPELLER["speed_gain"] * throttle, PROPELLER["diameter"]
    thrust = RHO * diameter**4 * (PROPELLER["CT0"] * turns**2 + PROPELLER["CT1"] * turns * speed / diameter)

    def balance(x: np.ndarray) -> list[float]:
        alpha, elevator, path = x
        lift = n("CL0") + n("CLalpha") * alpha + n("CLelevator") * elevator
        drag = n("CD0") + n("CDalpha") * alpha + n("CDalpha2") * alpha**2
        return [(pressure * lift + thrust * math.sin(alpha)) / weight - math.cos(path),
                (thrust * math.cos(alpha) - pressure * drag) / weight - math.sin(path),
                n("Cm0") + n("Cmalpha") * alpha + n("Cmelevator") * elevator]  # fmt: skip

    return tuple(fsolve(balance, [0.1, 0.0, 0.0]))


def test_trims_climb_and_sink_of_px4_are_those_by_hand() -> None:
    vehicle = aeroplane()
    found = estimates(of_wings(vehicle, PX4_WING))
    ratio, n = math.sqrt(RHO / SEA), vehicle.value
    speed = 35.0 / ratio
    assert found["FW_T_SINK_MIN"] == pytest.approx(-35.0 * math.sin(glide(vehicle, speed, 0.0)[2]), rel=1e-4)
    assert found["FW_T_CLMB_MAX"] == pytest.approx(speed * math.sin(glide(vehicle, speed, 0.9)[2]), rel=5e-3)
    throttle = found["FW_THR_TRIM"] / ratio
    alpha, elevator, path = glide(vehicle, speed, throttle)
    assert path == pytest.approx(0.0, abs=1e-3)
    assert found["FW_PSP_OFF"] == pytest.approx(math.degrees(alpha), rel=1e-2)
    assert found["TRIM_PITCH"] == pytest.approx(elevator / -0.35, rel=1e-2)
    effect = np.array([[n("Claileron"), n("Clrudder")], [n("Cnaileron"), n("Cnrudder")]])
    trims = np.linalg.solve(effect, [-n("Cl0"), -n("Cn0")]) / [0.35, -0.35]
    assert [found["TRIM_ROLL"], found["TRIM_YAW"]] == pytest.approx(trims, rel=1e-3)
    assert found["FW_THR_ASPD_MIN"] > 0.0
    high = estimates(of_wings(vehicle, PX4_WING | {"FW_AIRSPD_TRIM": 1.08 * 35.0}, reading=1.08))
    assert high["FW_PSP_OFF"] == pytest.approx(found["FW_PSP_OFF"], rel=1e-9)


def test_arduplane_has_percent_and_hundredths_of_a_degree_and_pitots_a_scale() -> None:
    names = ("PTCH_TRIM_DEG", "TRIM_THROTTLE", "TECS_CLMB_MAX", "TECS_SINK_MIN", "ARSPD_RATIO")
    parameters = dict.fromkeys(names, 2.0) | {"AIRSPEED_CRUISE": 35.0, "THR_MAX": 90.0}
    vehicle = aeroplane()
    new = of_wings(vehicle, parameters, "ArduPlane", ("sensors.V.scale",))
    px4, found, ratio = estimates(of_wings(vehicle, PX4_WING)), estimates(new), math.sqrt(RHO / SEA)
    assert found["PTCH_TRIM_DEG"] == pytest.approx(px4["FW_PSP_OFF"])
    assert found["TRIM_THROTTLE"] == pytest.approx(100.0 * px4["FW_THR_TRIM"] / ratio)
    assert found["TECS_SINK_MIN"] == pytest.approx(px4["FW_T_SINK_MIN"] / ratio)
    assert found["ARSPD_RATIO"] == pytest.approx(2.0 / 0.95**2)
    assert all(one.value == round(one.value) for one in new.found if one.name == "TRIM_THROTTLE")
    older = of_wings(vehicle, {"TRIM_PITCH_CD": 0.0, "TRIM_ARSPD_CM": 3500.0}, "ArduPlane")
    assert estimates(older)["TRIM_PITCH_CD"] == pytest.approx(100.0 * found["PTCH_TRIM_DEG"])
    for stream, flown in (("airspeed", 1.0), ("airspeed_validated", 1.1)):  # what the log holds
        scaled = of_wings(vehicle, PX4_WING, more=("sensors.V.scale",), stream=stream)
        assert estimates(scaled)["ASPD_SCALE_1"] == pytest.approx(flown / 0.95), stream


def test_what_the_model_does_not_determine_is_left_out_with_the_reason() -> None:
    found = of_wings(aeroplane(), PX4_WING)
    assert "FW_AIRSPD_MAX is a true airspeed of 45.88 m/s, flown was 30 to 42 m/s" in found.absent
    assert found.absent["no number that was estimated moves it"] == ("ASPD_SCALE_1",)
    jet = with_entries(builtin_vehicle("twin-boom"), {("environment", "density"): "standard"})
    domain = Domain((30.0, 42.0), 35.0, HEIGHT, RHO)
    found = physical_parameters(jet, "PX4 fixed wing", PX4_WING, domain, known(jet, ("CD0", "CL0")))
    assert "FW_T_SINK_MIN" in estimates(found)
    assert found.absent["the thrust is not modeled over a throttle from 0 to 1"][0] == "FW_THR_TRIM"
    assert found.absent["the model is not moved by control_pitch"] == ("TRIM_PITCH",)
    quad = quadrotor(0)
    guessed = replace(known(quad, ROTOR_NUMBERS), undetermined=("body_drag.quadratic.x",))
    found = of_rotors(quad, PX4_COPTER, draws=guessed)
    assert [names for why, names in found.absent.items() if "priors" in why] == [("EKF2_BCOEF_X",)]
    wide = of_rotors(quad, PX4_COPTER, draws=known(quad, ROTOR_NUMBERS, 0.5))
    small = wide.absent["the drag of the body is not three standard errors above zero"]
    assert small == ("EKF2_BCOEF_X", "EKF2_BCOEF_Y")
    assert not of_rotors(quad, {}, "Betaflight", guessed).found


def test_trims_by_outputs_are_those_by_commands() -> None:
    """A V-tail and two ailerons, servo by servo as PX4 allocates them; the trim of a servo itself is no command."""
    outputs = v_tail(aeroplane(), -0.35, 0.35, -0.35)
    commands = estimates(of_wings(aeroplane(), PX4_WING | TAIL))
    for held, pitch in (({}, 0.0), ({"CA_SV_CS2_TRIM": 0.1, "CA_SV_CS3_TRIM": 0.1}, 0.1)):
        found = estimates(of_wings(outputs, PX4_WING | TAIL | held))
        for axis, less in (("ROLL", 0.0), ("PITCH", pitch), ("YAW", 0.0)):
            assert found[f"TRIM_{axis}"] == pytest.approx(commands[f"TRIM_{axis}"] - less, rel=1e-4)
