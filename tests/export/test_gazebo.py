"""Gazebo's systems hold a vehicle to first order, exactly where they have its terms, and the files say what the equations do."""

import math
import re
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from naive import gazebo as naive

from stoop.base.autopilots import ARDUPILOT
from stoop.errors import SimulationError, VehicleError
from stoop.simulation import trim
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_text, builtin_vehicle
from stoop_analysis.derivatives import derivatives
from stoop_export import gazebo_autopilots, gazebo_files, rotorpy_flight
from stoop_export.gazebo import flown_alphas, fly_gazebo
from stoop_export.gazebo_model import GazeboModel, gazebo_model, unsupported_rotor_numbers
from stoop_export.gazebo_plugins import damping_loads, motor_loads, wing_loads
from stoop_export.gazebo_wing import unsupported_wing_terms
from stoop_export.jsbsim_flight import excitation_record, relative_differences
from stoop_export.px4_airframe import airframe_number
from stoop_export.reference_flight import reference_flight

VEHICLES = ("quad-x", "twin-boom", "quadplane")
FLIP = np.array([1.0, -1.0, -1.0])
#: CD = 0.02925 + 0.05 (CL0 + CLalpha alpha)^2, and pitching moment by alpha from the place of the forces: as Gazebo has them
WING = """
name = "A <wing> & tail"
mass = { mass = 3.0, inertia = { xx = 0.2, yy = 0.25, zz = 0.4 } }
reference = { area = 0.5, chord = 0.25, span = 2.0, airspeed = 16.0, moment_point = [-0.005, 0.0, 0.0] }
environment = { density = 1.2 }
propulsion = { kind = "constant", thrust = 3.0 }
[controls]
elevator = { mix = { servo_1 = 0.4 }, lag = 0.05 }
[aerodynamics]
CD = { CD0 = 0.03375, CDalpha = 0.15, CDalpha2 = 1.25 }
CL = { CL0 = 0.3, CLalpha = 5.0, CLq = 6.0 }
Cm = { Cm0 = 0.0, Cmq = -12.0, Cmelevator = -0.8 }
CQ = { CQbeta = -0.3 }
Cl = { Clp = -0.4 }
Cn = { Cnbeta = 0.06, Cnr = -0.1 }
"""


def rotor_text() -> str:
    """Return a quadrotor of MulticopterMotorModel's own terms: thrust by the square of the speed, drag, and drag of the body."""
    text = builtin_text("quad-x")
    for old, new in {
        'drive = "command"': 'drive = "speed"\ngain = 1000.0', "T1 = 2.5": "", "T2 = 6.0": "T2 = 8.5e-6", "inflow = 0.25": "",
        "drag = 0.08": "drag = 8e-5",
        "[body_drag]": "[environment]\ndensity = 1.225\n[body_drag]\nlinear = [0.1, 0.2, 0.1]\nrotation = [0.01, 0.01, 0.02]",
    }.items():  # fmt: skip
        assert old in text
        text = text.replace(old, new)
    return text


def made(vehicle: Vehicle, blades: bool = False) -> GazeboModel:
    return gazebo_model(vehicle, trim(vehicle), blades=blades)


def loads_of(model: GazeboModel, angles: list, speeds: list, velocity: list, rates: list) -> np.ndarray:
    out = motor_loads(model.motors, speeds, velocity, rates)
    if model.wing is not None:
        out = out + wing_loads(model.wing, angles, velocity, rates)
    return out if model.damping is None else out + damping_loads(model.damping, velocity, rates)


@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("fixed", [False, True])
def test_the_file_holds_the_equations(name: str, fixed: bool) -> None:
    """Loads of the written file, by a naive twin of the systems' sources, at random motions, angles and speeds."""
    model = made(builtin_vehicle(name))
    files = gazebo_files.folders(model, made(model.vehicle, True))
    twin = naive.Model(files[f"{model.name}/model.sdf"], fixed)
    random = np.random.default_rng(5)
    for _ in range(20):
        velocity, rates = random.normal([15.0, 0.0, 0.0], [8.0, 3.0, 5.0]), random.normal(0.0, 1.0, 3)
        angles = random.normal(0.0, 0.2, len(model.surfaces)).tolist()
        speeds = random.uniform(0.0, 900.0, len(model.motors)).tolist()
        ours = loads_of(model, angles, speeds, velocity.tolist(), rates.tolist())
        twin.angles = {s.name: a for s, a in zip(model.surfaces, angles, strict=True)}
        twin.speeds = {f"rotor_{i}": x for i, x in enumerate(speeds)}
        force, moment = twin.loads((FLIP * velocity).tolist(), (FLIP * rates).tolist())
        theirs = np.concatenate([FLIP * force, FLIP * moment])
        assert theirs == pytest.approx(ours, rel=1e-9, abs=1e-9 * float(np.abs(ours).max()))


def test_motors_follow_with_their_lag() -> None:
    model = made(builtin_vehicle("quad-x"))
    twin = naive.Model(gazebo_files.model(model, model.name))
    twin.speeds = {f"rotor_{i}": 0.0 for i in range(4)}
    for _ in range(200):
        twin.follow({f"rotor_{i}": 500.0 for i in range(4)}, 0.001)
    assert twin.speeds["rotor_0"] == pytest.approx(500.0 * (1.0 - math.exp(-0.2 / 0.05)), rel=1e-9)


@pytest.mark.parametrize("name", ["twin-boom", "quadplane"])
def test_first_order_on_wings(name: str) -> None:
    vehicle = builtin_vehicle(name)
    point = trim(vehicle, vehicle.value("reference.airspeed"))
    model, exact = gazebo_model(vehicle, point), derivatives(vehicle, point)
    known = dict(zip(vehicle.inputs, point.inputs.tolist(), strict=True))
    angles, speeds = ([a.command(known) for a in each] for each in (model.surfaces, model.motors))

    def loads(motion: np.ndarray, angles: list[float]) -> np.ndarray:
        return loads_of(model, angles, speeds, motion[:3].tolist(), motion[3:].tolist())

    motion = np.concatenate([exact.velocity, np.zeros(3)])
    assert loads(motion, angles) == pytest.approx(exact.loads, abs=1e-5 * np.abs(exact.loads).max())
    scale = np.abs(exact.matrix).max()
    tolerance = np.full((6, 6), 1e-4 * scale)
    tolerance[[0, 2, 4]] = 1e-3 * scale  # the drag polar is fitted over a range, without drag by sideslip
    tolerance[:, 0] = 2e-2 * scale  # the speed: coefficients that depend on it
    for i in range(6):
        step = 1e-5 * np.eye(6)[i]
        found = (loads(motion + step, angles) - loads(motion - step, angles)) / 2e-5
        assert (np.abs(found - exact.matrix[:, i]) < tolerance[:, i]).all(), (i, found, exact.matrix[:, i])
    for j, surface in enumerate(model.wing.moved):
        step = 1e-5 * np.eye(len(angles))[j]
        found = (loads(motion, (angles + step).tolist()) - loads(motion, (angles - step).tolist())) / 2e-5
        column = list(exact.controls).index(vehicle.controls[j])
        assert found == pytest.approx(exact.matrix[:, 6 + column], abs=1e-5 * scale), surface


def test_vehicles_of_its_own_terms_are_held_whole() -> None:
    quad = parse_vehicle(rotor_text(), "quad")
    (motor, *_) = made(quad).motors
    numbers = (motor.constant, motor.drag, motor.speed_gain, motor.moment)
    assert numbers == pytest.approx((8.5e-6, 8e-5, 1000.0, 0.016), rel=1e-6)
    assert unsupported_rotor_numbers(quad) == unsupported_wing_terms(parse_vehicle(WING, "wing")) == {}


@pytest.mark.parametrize("kind", ["quad", "wing"])
def test_vehicles_of_its_own_terms_fly_alike(kind: str) -> None:
    """A wing without ailerons and rudder flies straight on."""
    vehicle = parse_vehicle(rotor_text() if kind == "quad" else WING, kind)
    flight = reference_flight(vehicle, trim(vehicle))
    ours, theirs = rotorpy_flight.motion(flight), fly_gazebo(made(vehicle), flight)
    found = np.array([*relative_differences(rotorpy_flight.CHANNELS, ours, theirs).values()])
    moves = np.abs(ours).max(axis=0) > 1e-3
    assert np.abs(theirs[:, ~moves]).max(initial=0.0) < 1e-3
    assert found[moves].max() < 1e-3


@pytest.mark.parametrize("name", VEHICLES)
def test_structure(name: str) -> None:
    vehicle = builtin_vehicle(name)
    texts = gazebo_files.folders(made(vehicle), made(vehicle, True))
    for place in (place for place in texts if place.endswith("model.sdf")):
        model = ET.fromstring(texts[place]).find("model")  # noqa: S314 - our own
        assert model.get("name") == place.split("/")[0]
        links, joints = ({e.get("name") for e in model.findall(kind)} | {None} for kind in ("link", "joint"))
        ends = {joint.findtext(end) for joint in model.findall("joint") for end in ("parent", "child")}
        own = {e.text for p in model.iter("plugin") for tag in ("linkName", "link_name") for e in p.iter(tag)}
        assert ends | own <= links
        plugins = [*model.iter("plugin")]
        assert {e.text for p in plugins for tag in ("jointName", "joint_name") for e in p.iter(tag)} <= joints
        total, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
        for link in model.findall("link"):
            poses = (e.findtext("pose") or "0 0 0" for e in (link, link.find("inertial")))
            r = sum(np.array(one.split()[:3], dtype=float) for one in poses)
            entry = {e.tag: float(e.text or "") for e in link.find("inertial/inertia") or ()}
            tensor = np.array([[entry[f"i{min(a, b)}{max(a, b)}"] for b in "xyz"] for a in "xyz"])
            least, middle, most = np.linalg.eigvalsh(tensor)
            assert 0.0 < least <= most <= least + middle + 1e-12  # a body has such a tensor
            mass = float(link.findtext("inertial/mass", ""))
            total, first = total + mass, first + mass * r
            second += tensor + mass * (r @ r * np.eye(3) - np.outer(r, r))
        assert total == pytest.approx(vehicle.value("mass.mass"), rel=1e-12)
        assert np.abs(first).max() < 1e-12 * total
        assert second == pytest.approx(made(vehicle).inertia * np.outer(FLIP, FLIP), rel=1e-9, abs=1e-12)


def test_blades_give_thrust_torque_and_losses() -> None:
    model, plain = (made(builtin_vehicle("quad-x"), blades) for blades in (True, False))
    twin = naive.Model(gazebo_files.model(model, model.name))
    motor, speed = model.motors[2], 600.0

    def mean(velocity: list[float]) -> np.ndarray:
        azimuths = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
        turned = (twin.blades("rotor_2", motor.spin_sign * speed, a, velocity, [0.0] * 3) for a in azimuths)
        force, moment = np.mean([np.concatenate(one) for one in turned], axis=0).reshape(2, 3)
        return np.concatenate([FLIP * force, FLIP * moment])

    for velocity in ([0.0] * 3, [0.0, 0.0, 0.1], [0.1, 0.05, 0.0]):
        ours = motor_loads([motor], [speed], (FLIP * velocity).tolist(), [0.0] * 3)
        assert mean(velocity)[:3] == pytest.approx(ours[:3], abs=1e-4 * abs(ours[2]))
    rest = motor_loads([plain.motors[2]], [speed], [0.0] * 3, [0.0] * 3)
    assert mean([0.0] * 3) == pytest.approx(rest, rel=1e-6, abs=1e-9)


def test_outputs_of_the_autopilots() -> None:
    model = made(builtin_vehicle("quad-x"))
    texts = gazebo_files.folders(model, made(model.vehicle, True))
    sets, motor = sets_of(texts[f"px4/{airframe_number(model.name)}_gz_{model.name}"]), model.motors[0]
    ends = [sets[f"SIM_GZ_EC_{end}1"] for end in ("MIN", "MAX")]
    assert ends == pytest.approx([motor.command({"motor_1": x}) for x in (1e-9, 1.0)], abs=0.5)
    assert (sets["CA_ROTOR0_PX"], sets["CA_ROTOR0_KM"]) == (0.177, 0.016)
    assert "SERVO1_FUNCTION 33\n" in texts[f"ardupilot/{model.name}.parm"]
    root = ET.fromstring(texts[f"{model.name}_ardupilot/model.sdf"])  # noqa: S314
    control = root.find(".//control[@channel='2']")
    multiplier, offset = (float(control.findtext(n)) for n in ("multiplier", "offset"))
    turned = [-multiplier * (x + offset) for x in (0.0, 0.5, 1.0)]  # the third rotor turns clockwise
    assert turned == pytest.approx([motor.command({"motor_1": x}) for x in (1e-12, 0.5, 1.0)], rel=1e-9)


def sets_of(text: str) -> dict[str, float]:
    pairs = [line.removeprefix("param set-default ").split() for line in text.splitlines()]
    return {p[0]: float(p[1]) for p in pairs if len(p) == 2 and p[0].isupper()}


@pytest.mark.parametrize(("name", "frame"), [
    ("-quad-x", (1, 1)), ("quad-plus", (1, 0)), ("hexa-x", (2, 1)), ("octo-x", (3, 1)), ("quadplane", (1, 1)),
])  # fmt: skip
def test_the_frame_follows_from_where_rotors_stand(name: str, frame: tuple[int, int]) -> None:
    backward, name = name.startswith("-"), name.removeprefix("-")
    tables = re.split(r"(?m)^(?=\[)", builtin_text(name))
    rotors = [table for table in tables if table.startswith("[rotor.")]
    rest = [table for table in tables if table not in rotors]
    vehicle = parse_vehicle("".join([*rest, *(f"\n{r}" for r in rotors[:: -1 if backward else 1])]), name)
    if name == "quad-plus":  # the rear one stands at -180 degrees, and ArduPilot's at 180
        rear = min(vehicle.file.rotor, key=lambda rotor: vehicle.value(f"rotor.{rotor}.position.x"))
        vehicle = vehicle.with_numbers({f"rotor.{rear}.position.y": {"value": -1e-6}})
    model = gazebo_model(vehicle, trim(vehicle))
    sets = sets_of(gazebo_autopilots.parameters(model))
    head = "Q_FRAME" if name == "quadplane" else "FRAME"
    assert (sets[f"{head}_CLASS"], sets[f"{head}_TYPE"], gazebo_autopilots.notes(model)) == (*frame, [])
    for n, rotor in enumerate(vehicle.file.rotor, 1):
        azimuth, spin = ARDUPILOT.frames[frame][int(sets[f"SERVO{n}_FUNCTION"]) - 33]
        x, y = (vehicle.value(f"rotor.{rotor}.position.{a}") for a in "xy")
        assert math.cos(math.atan2(y, x) - math.radians(azimuth)) > 0.98
        assert vehicle.file.rotor[rotor].spin == spin
    assert len({sets[f"SERVO{n}_FUNCTION"] for n in range(1, len(rotors) + 1)}) == len(rotors)


def test_an_unknown_frame_does_not_arm() -> None:
    vehicle = parse_vehicle(builtin_text("quad-x").replace('spin = "ccw"', 'spin = "cw"', 1), "odd")
    model = gazebo_model(vehicle, trim(builtin_vehicle("quad-x")))
    sets = sets_of(gazebo_autopilots.parameters(model))
    assert (sets["FRAME_CLASS"], sets.get("FRAME_TYPE")) == (0, None)
    assert any("FRAME_CLASS is 0" in note for note in gazebo_autopilots.notes(model))


def test_cruise_and_hover_in_the_parameters() -> None:
    """Airspeeds are equivalent ones, trims give the joints of the steady flight, and the thrust curve that of the rotors."""
    vehicle = builtin_vehicle("quadplane")
    point = trim(vehicle, vehicle.value("reference.airspeed"), 400.0)
    model, blades = gazebo_model(vehicle, point), gazebo_model(vehicle, point, blades=True)
    px4, ardupilot = sets_of(gazebo_autopilots.airframe(model)), sets_of(gazebo_autopilots.parameters(blades))
    speed = vehicle.value("reference.airspeed") * math.sqrt(model.wing.density / 1.225)
    assert speed < 0.99 * vehicle.value("reference.airspeed")
    assert (px4["FW_AIRSPD_TRIM"], ardupilot["AIRSPEED_CRUISE"]) == pytest.approx((speed, speed), abs=0.01)
    known, hover = (dict(zip(vehicle.inputs, p.inputs.tolist(), strict=True)) for p in (point, model.hover))
    for i, surface in enumerate(model.wing.moved):
        assert px4[f"CA_SV_CS{i}_TRIM"] * surface.limit == pytest.approx(surface.command(known), abs=1e-4)
        n = len(model.motors) + i + 1
        x = (ardupilot[f"SERVO{n}_TRIM"] - 1000.0) / 1000.0
        angle = 2.0 * model.wing.role(surface)[1] * surface.limit * (x - 0.5)
        assert angle == pytest.approx(surface.command(known), abs=1e-3 * surface.limit)
    propeller = model.motors[-1]
    share = (propeller.command(known) - propeller.min_speed) / (propeller.max_speed - propeller.min_speed)
    assert px4["FW_THR_TRIM"] == pytest.approx(share, abs=1e-3)
    assert ardupilot["TRIM_THROTTLE"] == pytest.approx(100.0 * share, abs=0.6)
    rotor, f = model.motors[0], px4["THR_MDL_FAC"]
    turns, least, most = rotor.command(hover), rotor.min_speed, rotor.max_speed
    u, relative = (turns - least) / (most - least), (turns**2 - least**2) / (most**2 - least**2)
    assert f * u**2 + (1.0 - f) * u == pytest.approx(px4["MPC_THR_HOVER"], abs=1e-3)
    assert px4["MPC_THR_HOVER"] == pytest.approx(relative, abs=1e-3)


def test_joints_end_where_the_channel_ends() -> None:
    for channel, gain, center, limit in (("pwm_1", 7e-4, 1500, 0.35), ("elevator_cmd", 1, 0.0, 0.4363323)):
        written = f"mix = {{ {channel} = {gain} }}, center = {{ {channel} = {center} }}"
        wing = made(parse_vehicle(WING.replace("mix = { servo_1 = 0.4 }", written), "wing")).wing
        assert [s.limit for s in wing.moved] == pytest.approx([limit]), channel


def test_elevons_are_known_by_their_moments() -> None:
    aileron = "\naileron = { mix = { servo_1 = 0.4, servo_2 = -0.4 }, lag = 0.05 }"
    old = "servo_1 = 0.4 }, lag = 0.05 }"
    text = WING.replace(old, f"servo_1 = 0.4, servo_2 = 0.4 }}, lag = 0.05 }}{aileron}")
    model = made(parse_vehicle(text.replace("Clp = -0.4", "Clp = -0.4, Claileron = 0.2"), "wing"))
    assert [s.limit for s in model.wing.moved] == pytest.approx([0.4, 0.4])
    assert [model.wing.role(s) for s in model.wing.moved] == [("left elevon", -1.0), ("right elevon", -1.0)]
    texts = gazebo_files.folders(model, model)
    assert "CA_SV_CS0_TYPE 5\n" in texts[f"px4/{airframe_number(model.name)}_gz_{model.name}"]
    assert "SERVO3_FUNCTION 78\n" in texts[f"ardupilot/{model.name}.parm"]


def test_what_it_cannot_hold() -> None:
    term = 'CLV = 0.1\nCLx = { value = 0.2, term = "alpha*elevator" }'
    wing = parse_vehicle(builtin_text("twin-boom").replace("CLV = 0.0", term), "wing")
    assert set(unsupported_wing_terms(wing)) == {"CLV", "CLx", "CQV"}
    text = builtin_text("quad-x")
    sliding = parse_vehicle(text.replace("inflow = 0.25", "inflow = 0.25\ntranslational = 0.001"), "quad")
    assert unsupported_rotor_numbers(sliding) == {"rotors.translational": 0.0}
    shared = parse_vehicle(text.replace('channel = "motor_2"', 'channel = "motor_1"'), "quad")
    octo, boom = made(builtin_vehicle("octo-x")), builtin_vehicle("twin-boom")
    point = trim(boom)
    for refused, error, said in (
        (lambda: made(shared), VehicleError, "share a channel"),
        (lambda: gazebo_autopilots.airframe(replace(octo, motors=octo.motors * 2)), VehicleError, "outputs for 8 motors"),
        (lambda: gazebo_model(boom.reduced("longitudinal"), point), SimulationError, "full equations"),
    ):  # fmt: skip
        with pytest.raises(error, match=said):
            refused()
    record = excitation_record(boom, point)
    low, high = flown_alphas([record])
    assert flown_alphas([]) is None
    assert low < point.start["alpha"] < high
    assert gazebo_model(boom, point, (low, high)).wing.alpha_stall > high + 0.5
