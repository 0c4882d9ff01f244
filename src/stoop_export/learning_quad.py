"""A quadrotor in the terms that learning simulators share, matched at hover.

Thrust and torque grow with the square of a speed of rotation n, which is linear in the channel and has the lag of the vehicle
file: T = constant n^2 with the thrust and its slope of the vehicle at hover. Drag is the derivative of the force by the velocity
at hover. All four rotors are alike: differences between them are means. Axes are forward, left, up, about the center of
gravity; rotors are in the order front right, rear left, front left, rear right (that of PX4's quadrotor in X).
"""

from __future__ import annotations

import json
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from typing import Any, ClassVar, Final
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from stoop import Vehicle
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import SimulationError
from stoop.extend.motion import Trim
from stoop_analysis.derivatives import derivatives
from stoop_export.agreement import omission, omitted_shares
from stoop_export.autopilot_outputs import check_rotor_channels
from stoop_export.exporter import FLIP, Exported, encoded
from stoop_export.gazebo_model import rotor_motors
from stoop_export.matlab import identifier
from stoop_export.parameter_sets import RandomizedExporter
from stoop_export.reference_flight import ReferenceFlight
from stoop_export.rotorpy_model import NOMINAL_SPEED, settled_speeds, static_thrust

QUADRANTS: Final = ((1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0))  #: signs of x and y, forward and left
TURNS: Final = np.array(
    [1.0, 1.0, -1.0, -1.0]
)  #: of rotors as in PX4's quadrotor in X, counterclockwise from above
REVOLUTIONS: Final = 30.0 / np.pi  #: revolutions per minute of 1 rad/s
UP: Final = (0.0, 0.0, -1.0)  #: axis of a vertical rotor, forward, right, down
ALIKE: Final = 1e-6  #: of axes, which are normalized
MORE: Final = {
    "rotors.drag_inflow": 0.0, "rotors.translational": 0.0, "rotors.inertia": 0.0, "ground_effect.rotor": 0.0,
    **{f"body_drag.{kind}.{a}": 0.0 for kind in ("linear", "quadratic", "rotation") for a in "xyz"},
}  # fmt: skip
"""Numbers of terms that not every simulator has, and values at which they do nothing."""


@dataclass(frozen=True, eq=False)
class Quad:
    """A quadrotor of equal rotors.

    Attributes
    ----------
    name : str
    mass, gravity : kg, m/s2
    inertia : (3, 3), kg m2, tensor
    channels : of the rotors, in our order
    places : (4, 3), m
    turns : (4,), 1 for counterclockwise from above
    constant : N s2, thrust over the square of the speed
    torque : m, torque over thrust
    lag : s
    speed_gain, offset : rad/s per unit of the channel, rad/s
    idle, full : ends of the channel
    hover : rad/s
    damping : (3,), N s/m, of the velocity along each axis at hover
    drag : (3,), N s2/m2, quadratic, of the body along each axis
    rotor_inertia : kg m2
    static : (3,), N, N s, N s2, coefficients of the static thrust of one rotor by the speed ``scale (channel - idle)``, rad/s
    scale : rad/s per unit of the channel
    """

    name: str
    mass: float
    gravity: float
    inertia: FloatArray
    channels: tuple[str, ...]
    places: FloatArray
    turns: FloatArray
    constant: float
    torque: float
    lag: float
    speed_gain: float
    offset: float
    idle: float
    full: float
    hover: float
    damping: FloatArray
    drag: FloatArray
    rotor_inertia: float
    static: FloatArray
    scale: float

    @property
    def fastest(self) -> float:
        """Speed at full command, rad/s."""
        return self.offset + self.speed_gain * self.full

    @property
    def arms(self) -> tuple[float, float]:
        """Mean distances of the rotors from the axes through the center of gravity: forward and to the side, m."""
        forward, side = np.abs(self.places[:, :2]).mean(axis=0).tolist()
        return forward, side


def quad_of(vehicle: Vehicle, point: Trim, tool: str) -> Quad:
    """Return a vehicle as a quadrotor of equal rotors about a hover.

    Raises
    ------
    SimulationError
        The vehicle is no quadrotor in X on its rotors, or a rotor is tilted.
    VehicleError
        Rotors share a channel.
    """
    if len(vehicle.rotors) != len(QUADRANTS) or point.on_wings:
        raise SimulationError(
            f"{vehicle.where}: {tool} flies quadrotors on their rotors; this vehicle has {len(vehicle.rotors)} rotors, or an "
            "airspeed was given; export it to mujoco"
        )
    if vehicle.sloped:
        raise SimulationError(
            f"{vehicle.where}: the reaction to the spin-up of rotors without a lag needs slopes of channels; give rotors.lag"
        )
    check_rotor_channels(vehicle)
    motors = rotor_motors(vehicle, point)
    at = {tuple(np.sign(np.round(FLIP * m.position, 6))[:2].tolist()): m for m in motors}
    ordered = [at[q] for q in QUADRANTS if q in at]
    turns = np.array([float(m.spin_sign) for m in ordered])
    if len(ordered) != len(QUADRANTS) or abs(turns @ TURNS) != len(QUADRANTS):
        raise SimulationError(
            f"{vehicle.where}: {tool} has one rotor in each quadrant, and opposite ones turn alike; export this vehicle to mujoco"
        )

    def mean(name: str) -> float:
        return float(np.mean([getattr(m, name) for m in ordered]))

    if np.any(np.abs(np.array([m.axis for m in ordered]) - UP) > ALIKE):
        raise SimulationError(
            f"{vehicle.where}: {tool} has vertical rotors only; export this vehicle to mujoco"
        )
    scale = NOMINAL_SPEED if vehicle.drive == "command" else 1.0
    settled = float(np.mean(list(settled_speeds(vehicle, point).values())))
    x = settled * np.array([0.5, 1.0, 1.5])
    static = np.polyfit(scale * x, static_thrust(vehicle, point, x), 2)[::-1]
    hover = {
        m.name: m.offset + m.speed_gain * point.inputs[vehicle.inputs.index(str(m.channel))] for m in ordered
    }
    return Quad(
        identifier(vehicle.name), vehicle.value("mass.mass"), vehicle.value("environment.gravity"),
        FLIP[:, None] * vehicle.inertia_tensor() * FLIP, tuple(str(m.channel) for m in ordered),
        np.array([FLIP * m.position for m in ordered]), turns, mean("constant"), mean("moment"), mean("lag"),
        mean("speed_gain"), mean("offset"), mean("idle"), mean("full"), float(np.mean(list(hover.values()))),
        -np.diag(derivatives(vehicle, point).matrix)[:3],
        np.array([vehicle.value(f"body_drag.quadratic.{a}", 0.0) for a in "xyz"]), vehicle.value("rotors.inertia", 0.0),
        static, scale * vehicle.value("rotors.gain", 1.0),
    )  # fmt: skip


class QuadExporter(RandomizedExporter):
    """A target of quadrotors of equal rotors.

    Attributes
    ----------
    tool : str
    has : terms of :data:`MORE` and others that the simulator has
    """

    tool: ClassVar[str]
    has: ClassVar[tuple[str, ...]] = ()

    @cached_property
    def quad(self) -> Quad:
        """The vehicle of the model."""
        return quad_of(self.vehicle, self.point, self.tool)

    def numbers_of(self, vehicle: Vehicle) -> Mapping[str, Any]:
        """Return the simulator's numbers of a vehicle about a hover."""
        return self.parameters(quad_of(vehicle, self.steady(vehicle), self.tool))

    def with_content(
        self, texts: Mapping[str, str], content: Mapping[str, Any], main: str, *templates: str
    ) -> Exported:
        """Return files with numbers as JSON, and with scripts by the first part of the names of their templates."""
        name = self.quad.name
        made = {**texts, f"{name}.json": json.dumps(content, indent=1, allow_nan=False) + "\n"}
        for template in templates:
            text = (files("stoop_export") / "templates" / f"{template}.py.txt").read_text("utf-8")
            made[f"{name}_{template.rpartition('_')[0]}.py"] = text.replace("@NAME@", name)
        return Exported(encoded(made), main, (*self.model.unidentified, *self.completed))

    @abstractmethod
    def parameters(self, quad: Quad) -> dict[str, Any]:
        """Return the simulator's own numbers of a vehicle, in its units."""

    def lacks(self) -> list[str]:
        """Return dead zones, rate limits and delays, and what they make."""
        advice = f"{self.tool} has no {{}}: give it commands as rotors receive them."
        return self.without_actuators(lambda numbers: advice.format(", ".join(numbers)))

    @property
    def omitted(self) -> Mapping[str, float]:
        """Numbers of terms that the simulator leaves out, and the values at which they do nothing."""
        v = self.vehicle
        lost = {
            n: end
            for n, end in (MORE | {"rotors.drag": 0.0, "rotors.inflow": 0.0}).items()
            if n not in self.has
        }
        factors = {n: 1.0 for n in v.rows if n.startswith("rotor.") and n.endswith("factor")}
        return {n: end for n, end in (lost | factors).items() if v.value(n, end) != end}

    def with_omissions(self, made: Exported, flight: ReferenceFlight) -> Exported:
        """Return the files with a note on each term that the simulator leaves out."""
        shares = omitted_shares(flight, self.omitted)
        return made.with_notes(omission(self.tool, name, x) for name, x in shares.items())


def channels_behind(flight: ReferenceFlight, k: int, channels: Sequence[str]) -> FloatArray:
    """Return the channels (n,) at which rotors, once settled, turn as ours do at sample k of a flight."""
    vehicle = flight.vehicle
    x = dict(zip(vehicle.states, flight.states[k].tolist(), strict=True))
    now = dict(zip(vehicle.inputs, flight.inputs[k].tolist(), strict=True))
    lags = {rotor.channel: f"{name}.lag" for name, rotor in vehicle.file.rotor.items()}
    gain, idle = vehicle.value("rotors.gain", 1.0), vehicle.value("rotors.idle", 0.0)
    return np.array([x[lags[c]] / gain + idle if lags[c] in x else now[c] for c in channels])


def urdf(quad: Quad, links: tuple[str, ...], before: Element | None = None) -> str:
    """Return a quadrotor as a URDF: a base at the center of gravity, four rotors, and links without mass at the center.

    Parameters
    ----------
    quad : Quad
    links : (k,)
        Names of the rotors' links in the order in which the simulator counts them, ours, then those at the center.
    before : Element, optional
        A first child of the root.
    """
    root = Element("robot", name=quad.name)
    root.extend([] if before is None else [before])
    base = SubElement(root, "link", name="base_link")
    base.append(_inertial(quad.mass, quad.inertia))
    for kind in ("visual", "collision"):
        shape = SubElement(base, kind)
        SubElement(shape, "origin", rpy="0 0 0", xyz="0 0 0")
        reach = float(np.linalg.norm(quad.places[:, :2], axis=1).max())
        SubElement(SubElement(shape, "geometry"), "cylinder", radius=repr(reach), length=repr(0.2 * reach))
    for i, name in enumerate(links):
        place = quad.places[i] if i < len(quad.places) else np.zeros(3)
        SubElement(root, "link", name=name).append(_inertial(0.0, np.zeros((3, 3))))
        joint = SubElement(root, "joint", name=f"{name}_joint", type="fixed")
        SubElement(joint, "parent", link="base_link")
        SubElement(joint, "child", link=name)
        SubElement(joint, "origin", rpy="0 0 0", xyz=" ".join(map(repr, place.tolist())))
    indent(root)
    return '<?xml version="1.0"?>\n' + tostring(root, encoding="unicode") + "\n"


def _inertial(mass: float, inertia: FloatArray) -> Element:
    """Return the mass properties of a link; entries are those of the tensor."""
    out = Element("inertial")
    SubElement(out, "origin", rpy="0 0 0", xyz="0 0 0")
    SubElement(out, "mass", value=repr(mass))
    at = {f"i{'xyz'[i]}{'xyz'[j]}": repr(float(inertia[i, j])) for i in range(3) for j in range(i, 3)}
    SubElement(out, "inertia", at)
    return out
