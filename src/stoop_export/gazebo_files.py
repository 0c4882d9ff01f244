"""A vehicle's folders for Gazebo: a model for PX4, and one for ArduPilot with a world.

Gazebo's axes are forward, left, up. The frame of the base link lies at the center of gravity of the whole vehicle, because
systems apply forces at the origin of a link. Rotors and surfaces are links of their own, so light that mass properties stay those
of the vehicle; what they are is taken from the base link.

References
----------
SDFormat specification 1.9. PX4-gazebo-models at 0f0e45da (standard_vtol, advanced_plane): names of links, sensors and topics.
ardupilot_gazebo at 082a0fe2: src/ArduPilotPlugin.cc (output -> multiplier * (output + offset)).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop.extend.text import printable, without_rounding
from stoop_export.ardupilot_parameters import PWM
from stoop_export.exporter import FLIP
from stoop_export.gazebo_autopilots import airframe, parameters
from stoop_export.gazebo_model import GazeboModel
from stoop_export.gazebo_plugins import EFFECTS, Blades, Damping, Motor, Surface, Wing
from stoop_export.jsbsim_aircraft import document
from stoop_export.jsbsim_model import leaf
from stoop_export.px4_airframe import airframe_number

SDF: Final = "1.9"
BASE: Final = "base_link"
LIGHT: Final = 1e-5  #: mass and inertia of a rotor's or a surface's link, of the vehicle's
SETTLING: Final = 1e-4  #: s, inertia over damping of a surface's joint, far below its lag
MIN_MOTOR_LAG: Final = 1e-4  #: s, time constant of a motor without a lag
SLOWDOWN: Final = 10.0  #: of rotors as they are seen


def folders(px4: GazeboModel, ardupilot: GazeboModel) -> dict[str, str]:
    """Return the files by their place below the output folder."""
    name = px4.name
    own = f"{name}_ardupilot"
    return {
        f"{name}/model.config": config(px4, name),
        f"{name}/model.sdf": model(px4, name),
        f"{own}/model.config": config(ardupilot, own),
        f"{own}/model.sdf": model(ardupilot, own),
        f"worlds/{own}.sdf": world(ardupilot, own),
        f"px4/{airframe_number(name)}_gz_{name}": airframe(px4),
        f"ardupilot/{name}.parm": parameters(ardupilot),
    }


def _element(tag: str, content: object = None, **attributes: str) -> Element:
    out = Element(tag, attributes)
    if content is not None:
        out.text = _text(content)
    return out


def _text(content: object) -> str:
    if isinstance(content, bool):
        return "1" if content else "0"
    if isinstance(content, float | np.floating):
        return repr(float(content) + 0.0)
    if isinstance(content, Sequence | np.ndarray) and not isinstance(content, str):
        return " ".join(map(_text, content))
    return str(content)


def _group(tag: str, content: Mapping[str, object], **attributes: str) -> Element:
    """Return an element of leaves."""
    out = _element(tag, **attributes)
    out.extend(leaf(name, _text(x)) for name, x in content.items())
    return out


def _system(name: str, content: Mapping[str, object], file: str | None = None) -> Element:
    """Return a system of gz-sim, or a plugin of its own file."""
    words = "".join(f"-{c.lower()}" if c.isupper() else c for c in name)
    if file is not None:
        return _group("plugin", content, filename=file, name=name)
    return _group("plugin", content, filename=f"gz-sim{words}-system", name=f"gz::sim::systems::{name}")


def config(made: GazeboModel, name: str) -> str:
    """Return the description of a model folder."""
    out = _group("model", {"name": name, "version": "1.0"})
    out.insert(2, _element("sdf", "model.sdf", version=SDF))
    SubElement(out, "author").append(leaf("name", "stoop"))
    words = "; ".join(
        (f"{made.vehicle.name}: made by stoop export, see docs/gazebo.md", *made.vehicle.file.notes)
    )
    out.append(leaf("description", printable(words)))
    return document(out)


def model(made: GazeboModel, name: str) -> str:
    """Return ``model.sdf``: for PX4, or for ArduPilot where the motors are blades."""
    root = _element("sdf", version=SDF)
    out = SubElement(root, "model", {"name": name})
    size = body_size(made)
    out.append(leaf("pose", _text((0.0, 0.0, 0.5 * size[2], 0.0, 0.0, 0.0))))
    rotors = [_rotor(made, i, motor) for i, motor in enumerate(made.motors)]
    surfaces = [_surface(made.wing, s, light(made)) for s in made.surfaces] if made.wing is not None else []
    out.append(_base(made, size))
    for link, joint in (*rotors, *surfaces):
        out.extend((link, joint))
    if made.wing is not None and not made.blades:
        out.extend(_pitot(made))
    out.extend(_controllers(made, name))
    if made.wing is not None:
        out.append(_lift_drag(made.wing))
    if made.damping is not None:
        out.append(_damping(made.damping))
    if made.blades:
        for i, (motor, blades) in enumerate(zip(made.motors, made.blades, strict=True)):
            out.extend(_blades(i, motor, blades))
        out.append(_ardupilot(made, name))
    else:
        out.extend(_motor(i, motor) for i, motor in enumerate(made.motors))
    return document(root)


def body_size(made: GazeboModel) -> tuple[float, float, float]:
    """Return length, width and height, m, of the box that is seen and that touches the ground."""
    reach = np.max(np.abs([m.position for m in made.motors] or [(0.1, 0.1, 0.02)]), axis=0)
    length, width = 2.0 * max(float(reach[0]), 0.05), 2.0 * max(float(reach[1]), 0.05)
    if made.wing is not None:
        length, width = max(length, 3.0 * made.wing.chord), max(width, made.wing.span)
    return length, width, 0.1 * min(length, width)


def light(made: GazeboModel) -> tuple[float, float]:
    """Return mass, kg, and moment of inertia, kg m2, of a link of a rotor or a surface."""
    return LIGHT * made.mass, LIGHT * float(np.min(np.linalg.eigvalsh(made.inertia)))


def base_properties(made: GazeboModel) -> tuple[float, FloatArray, FloatArray]:
    """Return mass, center (3,) and tensor (3, 3) of the base link, axes forward, left, up: the vehicle's less other links'."""
    mass, moment = light(made)
    places = [FLIP * m.position for m in made.motors] + [np.zeros(3)] * len(made.surfaces)
    if made.wing is not None and not made.blades:
        places.append(np.zeros(3))  # of the airspeed sensor
    rest = made.mass - mass * len(places)
    center = -mass * np.sum(places, axis=0) / rest if places else np.zeros(3)
    tensor = made.inertia * np.outer(FLIP, FLIP) - len(places) * moment * np.eye(3)
    for m, r in [*((mass, p) for p in places), (rest, center)]:
        tensor = tensor - m * (r @ r * np.eye(3) - np.outer(r, r))
    return rest, center, tensor


def _inertial(mass: float, tensor: FloatArray, center: FloatArray) -> Element:
    out = _group("inertial", {"pose": (*center, 0.0, 0.0, 0.0), "mass": mass})
    entries = {f"i{a}{b}": tensor[i, j] for i, a in enumerate("xyz") for j, b in enumerate("xyz") if j >= i}
    out.append(_group("inertia", entries))
    return out


def _shape(kind: str, name: str, geometry: Element, color: str = "") -> Element:
    out = _element(kind, name=name)
    SubElement(out, "geometry").append(geometry)
    if color:
        out.append(_group("material", {"ambient": color, "diffuse": color}))
    return out


def _base(made: GazeboModel, size: tuple[float, float, float]) -> Element:
    out = _element("link", name=BASE)
    mass, center, tensor = base_properties(made)
    out.append(_inertial(mass, tensor, center))
    for kind, color in (("collision", ""), ("visual", "0.6 0.6 0.6 1")):
        out.append(_shape(kind, f"{BASE}_{kind}", _group("box", {"size": size}), color))
    rates = {"imu": 250, "air_pressure": 50, "magnetometer": 100, "navsat": 30}
    for kind, rate in rates.items():
        content: dict[str, object] = {"always_on": True, "update_rate": rate}
        if made.blades:  # ArduPilot's plugin reads an inertial unit whose axes are forward, right, down
            content = {"pose": (0.0, 0.0, 0.0, math.pi, 0.0, 0.0), "always_on": True, "update_rate": 1000}
        if kind == "imu" or not made.blades:
            out.append(_group("sensor", content, name=f"{kind}_sensor", type=kind))
    return out


def _joint(name: str, child: str, kind: str = "revolute") -> Element:
    return _group("joint", {"parent": BASE, "child": child}, name=name, type=kind)


def _rotor(made: GazeboModel, i: int, motor: Motor) -> tuple[Element, Element]:
    """Return link and joint of a rotor, whose z axis is that of its thrust."""
    link = _element("link", name=f"rotor_{i}")
    x, y, z = FLIP * motor.axis
    pose = (*(FLIP * motor.position), 0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x) + 0.0)
    link.append(leaf("pose", _text(pose)))
    mass, moment = light(made)
    link.append(_inertial(mass, moment * np.eye(3), np.zeros(3)))
    radius = made.vehicle.value("rotors.radius", 0.0) or 0.1 * max(body_size(made)[:2])
    disk = _group("cylinder", {"radius": radius, "length": 0.01})
    link.append(_shape("visual", f"rotor_{i}_visual", disk, "0.2 0.2 0.8 1"))
    joint = _joint(f"rotor_{i}_joint", f"rotor_{i}")
    axis = _group("axis", {"xyz": "0 0 1"})
    axis.append(_group("limit", {"lower": -1e16, "upper": 1e16}))
    joint.append(axis)
    return link, joint


def _surface(wing: Wing, surface: Surface, properties: tuple[float, float]) -> tuple[Element, Element]:
    """Return link and joint of a surface; a rudder turns about z, others about y, trailing edge down."""
    link = _element("link", name=f"{surface.name}_link")
    mass, moment = properties
    link.append(_inertial(mass, moment * np.eye(3), np.zeros(3)))
    joint = _joint(surface.name, f"{surface.name}_link")
    axis = _group("axis", {"xyz": "0 0 1" if wing.role(surface)[0] == "rudder" else "0 -1 0"})
    axis.append(_group("limit", {"lower": -surface.limit, "upper": surface.limit}))
    if surface.lag > 0.0:
        axis.append(_group("dynamics", {"damping": moment / SETTLING}))
    joint.append(axis)
    return link, joint


def _pitot(made: GazeboModel) -> tuple[Element, Element]:
    link = _element("link", name="airspeed_link")
    mass, moment = light(made)
    link.append(_inertial(mass, moment * np.eye(3), np.zeros(3)))
    link.append(_group("sensor", {"always_on": True, "update_rate": 10}, name="air_speed", type="air_speed"))
    return link, _joint("airspeed_joint", "airspeed_link", "fixed")


def _controllers(made: GazeboModel, name: str) -> Iterator[Element]:
    """Yield the controllers of the surfaces' joints: a joint with damping follows a proportional one with a first-order lag."""
    _, moment = light(made)
    for surface in made.surfaces:
        content: dict[str, object] = {"joint_name": surface.name, "sub_topic": surface.name}
        if surface.lag > 0.0:
            gain = moment / SETTLING / surface.lag
            content |= {"p_gain": gain, "i_gain": 0.0, "d_gain": 0.0}
        else:
            content["use_velocity_commands"] = True
        if surface.channel is None:
            content["initial_position"] = surface.command({})
        yield _system("JointPositionController", content)


def _lift_drag(wing: Wing) -> Element:
    content: dict[str, object] = dict(wing.coefficients)
    content |= {"Cem0": 0.0, "Cema": 0.0, "Cema_stall": 0.0}
    content |= {
        "AR": wing.aspect_ratio, "eff": wing.efficiency, "mac": wing.chord, "area": wing.area, "air_density": wing.density,
        "alpha_stall": wing.alpha_stall, "cp": FLIP * wing.cp, "forward": "1 0 0", "upward": "0 0 1", "link_name": BASE,
        "num_ctrl_surfaces": len(wing.surfaces),
    }  # fmt: skip
    out = _system("AdvancedLiftDrag", content)
    for i, surface in enumerate(wing.surfaces):
        effects = {f"{n}_ctrl": surface.effects.get(n, 0.0) for n in EFFECTS}
        out.append(_group("control_surface", {"name": surface.name, "index": i, "direction": 1, **effects}))
    return out


def _damping(damping: Damping) -> Element:
    flip = np.concatenate([FLIP, FLIP])
    linear = without_rounding(damping.linear * np.outer(flip, flip), np.abs(damping.linear).max(initial=0.0))
    content: dict[str, object] = {"link_name": BASE, "disable_added_mass": True, "disable_coriolis": True}
    for i, load in enumerate("xyzkmn"):
        for j, motion in enumerate("UVWPQR"):
            if linear[i, j] != 0.0:
                content[f"{load}{motion}"] = linear[i, j]
        if damping.quadratic[i] != 0.0:
            content[f"{load}{'UVWPQR'[i]}abs{'UVWPQR'[i]}"] = damping.quadratic[i]
        if damping.sideslip[i] != 0.0:
            content[f"{load}VabsU"] = damping.sideslip[i] * flip[i] * flip[1]
    return _system("Hydrodynamics", content)


def _motor(i: int, motor: Motor) -> Element:
    lag = max(motor.lag, MIN_MOTOR_LAG)
    return _system("MulticopterMotorModel", {
        "jointName": f"rotor_{i}_joint", "linkName": f"rotor_{i}", "turningDirection": "ccw" if motor.spin_sign > 0 else "cw",
        "timeConstantUp": lag, "timeConstantDown": lag, "maxRotVelocity": motor.max_speed, "motorConstant": motor.constant,
        "momentConstant": motor.moment, "commandSubTopic": "command/motor_speed", "motorNumber": i,
        "rotorDragCoefficient": motor.drag, "rollingMomentCoefficient": 0.0, "rotorVelocitySlowdownSim": SLOWDOWN,
        "motorType": "velocity",
    })  # fmt: skip


def _blades(i: int, motor: Motor, blades: Blades) -> Iterator[Element]:
    """Yield the two blades of a motor, which turn with its link."""
    for side in (1.0, -1.0):
        yield _system("LiftDrag", {
            "a0": blades.angle, "cla": blades.lift, "cda": blades.drag, "cma": 0.0, "alpha_stall": 1.4, "cla_stall": 0.0,
            "cda_stall": 0.0, "cma_stall": 0.0, "area": blades.area, "air_density": blades.density,
            "cp": (side * blades.radius, 0.0, 0.0), "forward": (0.0, side * motor.spin_sign, 0.0), "upward": "0 0 1",
            "link_name": f"rotor_{i}",
        })  # fmt: skip


def _ardupilot(made: GazeboModel, name: str) -> Element:
    """Return ArduPilot's plugin: outputs 1, 2, ... are the motors, then the surfaces."""
    out = _system("ArduPilotPlugin", {
        "fdm_addr": "127.0.0.1", "fdm_port_in": 9002, "connectionTimeoutMaxCount": 5, "lock_step": True,
        "modelXYZToAirplaneXForwardZDown": (0.0, 0.0, 0.0, math.pi, 0.0, 0.0),
        "gazeboXYZToNED": (0.0, 0.0, 0.0, math.pi, 0.0, 0.5 * math.pi), "imuName": f"{BASE}::imu_sensor",
    }, "ArduPilotPlugin")  # fmt: skip
    low, high = PWM
    ends = {"servo_min": low, "servo_max": high}
    for i, motor in enumerate(made.motors):  # commanded speed = multiplier * (output + offset)
        span = motor.max_speed - motor.min_speed
        content = {"jointName": f"rotor_{i}_joint", "useForce": False, "type": "VELOCITY",
                   "multiplier": motor.spin_sign * span, "offset": motor.min_speed / span, **ends}  # fmt: skip
        out.append(_group("control", content, channel=str(i)))
    if made.wing is None:
        return out
    for i, surface in enumerate(made.wing.moved, len(made.motors)):
        content = {"jointName": surface.name, "useForce": False, "type": "COMMAND", "cmd_topic": f"/model/{name}/{surface.name}",
                   "multiplier": 2.0 * made.wing.role(surface)[1] * surface.limit, "offset": -0.5, **ends}  # fmt: skip
        out.append(_group("control", content, channel=str(i)))
    return out


def world(made: GazeboModel, name: str) -> str:
    """Return a world with the model on level ground, with the systems that ArduPilot's plugin needs."""
    root = _element("sdf", version=SDF)
    out = SubElement(root, "world", {"name": name})
    steps = {"max_step_size": 0.001, "real_time_factor": 1.0}
    out.append(_group("physics", steps, name="1ms", type="ignore"))
    out.append(leaf("gravity", _text((0.0, 0.0, -made.vehicle.value("environment.gravity")))))
    for system in ("Physics", "UserCommands", "SceneBroadcaster", "Imu"):
        out.append(_system(system, {}))
    out.append(_group("spherical_coordinates", {
        "surface_model": "EARTH_WGS84", "world_frame_orientation": "ENU", "latitude_deg": -35.363262,
        "longitude_deg": 149.165237, "elevation": 584, "heading_deg": 0,
    }))  # fmt: skip
    light_from = {"pose": "0 0 10 0 0 0", "direction": "-0.5 0.1 -0.9"}
    out.append(_group("light", light_from, name="sun", type="directional"))
    ground = SubElement(out, "model", {"name": "ground"})
    ground.append(leaf("static", "1"))
    link = SubElement(ground, "link", {"name": "ground"})
    for kind in ("collision", "visual"):
        link.append(_shape(kind, kind, _group("plane", {"normal": "0 0 1", "size": "1000 1000"})))
    out.append(_group("include", {"uri": f"model://{name}"}))
    return document(root)
