"""A vehicle for MuJoCo: a rigid body with actuators in MJCF, and a Python callback for what MJCF cannot express.

MuJoCo's world is north, west, up, its body axes are forward, left, up. The activation of an actuator is the state of its lag
(first order, ``dyntype="filter"``): x of a rotor, or the deflection of a control. A rotor's actuator has the tangent of its
thrust at hover, N over x, and the torque in proportion. The callback adds the identified force and moment less those of the
actuators, so that both together are the identified equations.

References
----------
E. Todorov, T. Erez, Y. Tassa, "MuJoCo: A physics engine for model-based control", IROS 2012.
MuJoCo documentation, "XML Reference", elements actuator/general, site, inertial, version 3.3.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, Final
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from stoop import Vehicle
from stoop.extend.arrays import FloatArray
from stoop.extend.motion import Trim
from stoop_export.autopilot_outputs import check_rotor_channels
from stoop_export.exporter import FLIP
from stoop_export.gazebo_model import rotor_motors
from stoop_export.gazebo_plugins import Motor
from stoop_export.matlab import identifier
from stoop_export.printed_loads import PrintedLoads, printed_loads

FORMAT: Final = "stoop-mujoco/1"
TIME_STEP: Final = 0.002  #: s, of the Runge-Kutta method of order four
_PRODUCTS: Final = ("xx", "yy", "zz", "xy", "xz", "yz")
LENGTH: Final = 0.25  #: m, of the box that stands for a body without rotors


@dataclass(frozen=True, eq=False)
class Thrust:
    """The tangent of a rotor's thrust at hover: max(slope x + rest, 0), N, at a place with an axis; torque over thrust, m."""

    slope: float
    rest: float
    torque: float
    place: FloatArray
    axis: FloatArray


@dataclass(frozen=True, eq=False)
class MujocoModel:
    """Files by name."""

    name: str
    mjcf: str
    content: dict[str, Any]
    script: str

    @property
    def texts(self) -> dict[str, str]:
        """Files by name."""
        text = json.dumps(self.content, indent=1, allow_nan=False) + "\n"
        return {
            f"{self.name}.xml": self.mjcf,
            f"{self.name}.json": text,
            f"{self.name}_mujoco.py": self.script,
        }


def mujoco_model(vehicle: Vehicle, point: Trim) -> MujocoModel:
    """Return the files of a vehicle about a steady flight.

    Raises
    ------
    SimulationError
        The vehicle has reduced equations or rotors that need slopes of channels, or does not hover where it has rotors.
    VehicleError
        Rotors share a channel.
    """
    printed, thrusts = printed_loads(vehicle), {}
    if vehicle.rotors and not point.on_wings:
        check_rotor_channels(vehicle)
        thrusts = {m.name: _thrust(vehicle, point, m) for m in rotor_motors(vehicle, point)}
    name = identifier(vehicle.name)
    template = (files("stoop_export") / "templates" / "mujoco_vehicle.py.txt").read_text(encoding="utf-8")
    for key, text in {"NAME": name, "COMMANDS": printed.commands, "LOADS": printed.loads}.items():
        template = template.replace(f"@{key}@", text)
    content = _content(vehicle, point, printed, thrusts)
    return MujocoModel(name, _mjcf(vehicle, printed, thrusts), content, template)


def _thrust(vehicle: Vehicle, hover: Trim, motor: Motor) -> Thrust:
    """Return the tangent of a motor's thrust at hover over x, by that over its channel."""
    column = vehicle.inputs.index(str(motor.channel))
    x = float(vehicle.commanded(motor.name, vehicle.parameter_rows(hover.changes), hover.inputs)[0])
    speed = motor.offset + motor.speed_gain * float(hover.inputs[column])
    thrust, per_channel = motor.constant * speed**2, 2.0 * motor.constant * speed * motor.speed_gain
    slope = per_channel * float(hover.inputs[column] - motor.idle) / x
    place, axis = FLIP * motor.position, FLIP * motor.axis
    return Thrust(slope, thrust - slope * x, -motor.spin_sign * motor.moment, place, axis)


def _content(
    vehicle: Vehicle, point: Trim, printed: PrintedLoads, thrusts: dict[str, Thrust]
) -> dict[str, Any]:
    """Return what the script reads."""
    values = vehicle.parameter_rows(point.changes)[:, 0].tolist()

    def own(name: str) -> str:
        """Return the name of a number's row, which tied numbers share."""
        return printed.numbers[vehicle.rows[name]]

    loads = [
        [t.slope, t.rest, *t.axis, *(np.cross(t.place, t.axis) + t.torque * t.axis)]
        if (t := thrusts.get(a)) is not None
        else [0.0] * 8
        for a in printed.actuators
    ]
    return {
        "format": FORMAT,
        "vehicle": vehicle.name,
        "gravity": vehicle.value("environment.gravity"),
        "numbers": dict(zip(printed.numbers, values, strict=True)),
        "actuators": list(printed.actuators),
        "lags": [None if lag is None else own(lag) for lag in printed.lags],
        "mass": own("mass.mass"),
        "inertia": {n: own(f"mass.inertia.{n}") for n in _PRODUCTS if f"mass.inertia.{n}" in vehicle.rows},
        "channels": dict(zip(printed.channels, point.inputs.tolist(), strict=True)),
        "altitude": float(point.start["h"]),
        "start": _steady(vehicle, point),
        "actuator_loads": loads,
    }


def _steady(vehicle: Vehicle, point: Trim) -> dict[str, float]:
    """Return velocity along the body axes, m/s, and quaternion of the steady flight."""
    states = vehicle.initial_states(point.start, vehicle.parameter_rows(point.changes), point.inputs)[:, 0]
    known = dict(zip(vehicle.states, states.tolist(), strict=True))
    return {n: known[n] for n in (*"uvw", "e0", "e1", "e2", "e3")}


def _mjcf(vehicle: Vehicle, printed: PrintedLoads, thrusts: dict[str, Thrust]) -> str:
    """Return the model file: the body with a site for each rotor, the actuators."""
    root = Element("mujoco", model=identifier(vehicle.name))
    SubElement(root, "compiler", angle="radian", autolimits="true")
    gravity = f"0 0 {-vehicle.value('environment.gravity')!r}"
    SubElement(root, "option", timestep=repr(TIME_STEP), integrator="RK4", gravity=gravity)
    world = SubElement(root, "worldbody")
    body = SubElement(world, "body", name="vehicle", pos="0 0 1")
    SubElement(body, "freejoint", name="vehicle")
    inertia = FLIP[:, None] * vehicle.inertia_tensor() * FLIP
    full = _numbers(inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    SubElement(
        body, "inertial", pos="0 0 0", mass=repr(vehicle.value("mass.mass")), fullinertia=full
    )  # fmt: skip
    reach = max((float(np.linalg.norm(t.place[:2])) for t in thrusts.values()), default=LENGTH)
    SubElement(body, "geom", type="box", size=_numbers((0.5 * reach, 0.3 * reach, 0.1 * reach)))
    SubElement(body, "site", name="center", size="0.01")
    actuators = SubElement(root, "actuator")
    for name, lag in zip(printed.actuators, printed.lags, strict=True):
        place = "center"
        own = {"gainprm": "0"}
        if name in thrusts:
            t, place = thrusts[name], f"rotor {name}"
            SubElement(body, "site", name=place, pos=_numbers(t.place), zaxis=_numbers(t.axis), size="0.02")
            own = {"gainprm": repr(t.slope), "biastype": "affine", "biasprm": f"{t.rest!r} 0 0",
                   "forcerange": "0 1e9", "gear": f"0 0 1 0 0 {t.torque!r}"}  # fmt: skip
        if name in vehicle.rotors:
            own["ctrlrange"] = "0 1e9"
        if lag is not None:
            own |= {"dyntype": "filter", "dynprm": repr(vehicle.value(lag))}
        SubElement(actuators, "general", {"name": name, "site": place, **own})
    indent(root)
    return tostring(root, encoding="unicode") + "\n"


def _numbers(values: Iterator[float] | FloatArray | tuple[float, ...]) -> str:
    return " ".join(repr(float(x)) for x in values)
