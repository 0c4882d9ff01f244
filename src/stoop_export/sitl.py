"""A vehicle as an autopilot commands it in JSBSim: normalized commands in place of recorded channels, and a ground to stand on.

Commands of surfaces go from -1 to 1, positive where the moment about their axis is (roll to the right, nose up, nose to the
right); those of motors from 0 to 1. Mixers are the model's own: an autopilot commands axes. Values that the vehicle file
lacks are assumed and reported: where full deflection lies, how much thrust there is, and what the vehicle stands on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from stoop import Vehicle, trim
from stoop.extend import motion
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import VehicleError
from stoop.extend.units import UNITS
from stoop.extend.vehicles import full_command
from stoop_export import jsbsim_aircraft
from stoop_export.autopilot_outputs import (
    FULL_DEFLECTION,
    check_rotor_channels,
    full_deflection,
    surface_role,
)
from stoop_export.jsbsim_flight import Record, Settings
from stoop_export.jsbsim_model import THRUST, channel, component, leaf, node, number, prop, value

FOOT, POUND_FORCE = UNITS["ft"].factor, UNITS["lbf"].factor
AXES: Final = {
    "aileron": "roll",
    "elevator": "pitch",
    "rudder": "yaw",
}  #: of the surfaces that an autopilot has
_AXES_OF: Final = {
    "aileron": ("aileron",), "elevator": ("elevator",), "rudder": ("rudder",),
    "elevon": ("aileron", "elevator"), "V-tail": ("elevator", "rudder"),
}  # fmt: skip
"""Kind of a surface -> commands that it serves."""
#: of the largest about any axis, below which nothing turns the vehicle about an axis
MIN_MOMENT: Final = 1e-3
MIN_SHARE: Final = 0.2  #: of the largest moment about an axis, below which a control is not used for it
ROUNDING: Final = 1e-9  #: of a full deflection
SAG: Final = 0.02  #: m, of the undercarriage under the weight
_DAMPING: Final = 0.7  #: of critical, of the undercarriage
THROTTLE: Final = "fcs/throttle-cmd-norm"
_surface_place: Final = "fcs/{}-cmd-norm".format
_motor_place: Final = "fcs/esc-cmd-norm[{}]".format


@dataclass(frozen=True, eq=False)
class Command:
    """A normalized command and what it does to the recorded channels.

    Attributes
    ----------
    place : property
    name : surface (aileron, elevator or rudder), "throttle", or the rotor
    channels : change of each channel, in its unit, from zero to full command
    steady : its value in steady flight
    full_deflections : of each control of the vehicle that it moves, rad at full command; negative where the recorded one
        turns the other way
    """

    place: str
    name: str
    channels: Mapping[str, float]
    steady: float
    full_deflections: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class AutopilotCommands:
    """All commands of a vehicle.

    Attributes
    ----------
    vehicle : with the numbers of its steady flight
    neutral : (n_u,), channels at zero commands
    surfaces, motors, rotors : commands
    wings, hover : steady flights, where there are some
    assumed : what the vehicle file does not tell, for the user
    uncommanded : controls that no autopilot commands
    """

    vehicle: Vehicle
    neutral: FloatArray
    surfaces: tuple[Command, ...]
    throttle: Command | None
    rotors: tuple[Command, ...]
    wings: motion.Trim | None
    hover: motion.Trim | None
    assumed: tuple[str, ...]
    uncommanded: tuple[str, ...]

    @property
    def outputs(self) -> tuple[Command, ...]:
        """All commands in the order of the outputs: rotors, throttle, surfaces."""
        return (*self.rotors, *((self.throttle,) if self.throttle is not None else ()), *self.surfaces)

    def settings(self, record: Record, given: Settings) -> Settings:
        """Return what JSBSim is given for a record, by commands; channels that no command moves stay as they are."""
        places = [channel(n) for n in self.vehicle.inputs]
        moved = {channel(n) for c in self.outputs for n in c.channels}
        gains = np.array(
            [[c.channels.get(n, 0.0) for c in self.outputs] for n in (*self.vehicle.inputs, THRUST)]
        )
        thrust = np.full(len(record.time), given.constants.get(THRUST, 0.0))
        columns = np.column_stack([record.inputs - self.neutral, thrust])
        signals = columns @ np.linalg.pinv(gains).T
        inputs = {c.place: signals[:, i] for i, c in enumerate(self.outputs)}
        inputs |= {p: given.inputs[p] for p in places if p in given.inputs and p not in moved}
        constants = {p: x for p, x in given.constants.items() if p != THRUST}
        return Settings(given.start, inputs, constants)


def autopilot_commands(
    vehicle: Vehicle, airspeed: float | None, altitude: float, density: float | None
) -> AutopilotCommands:
    """Return the commands of a vehicle, whose steady flights are at an airspeed, m/s (V* if None), altitude, m, and density.

    Raises
    ------
    VehicleError
        The equations are reduced, and an autopilot flies all axes; rotors share a channel; or no surface turns the vehicle.
    SimulationError
        No steady flight.
    """
    if vehicle.reduce != "full":
        raise VehicleError(f'{vehicle.where}: an autopilot needs all axes; set model.reduce = "full"')
    check_rotor_channels(vehicle)
    neutral, assumed = vehicle.neutral_inputs(0.0), list[str]()
    wings = None
    if vehicle.controls and "reference.airspeed" in vehicle.rows:
        speed = vehicle.value("reference.airspeed") if airspeed is None else airspeed
        wings = trim(vehicle, speed, altitude, 0.0, density)
    hover = trim(vehicle, None, altitude, 0.0, density) if vehicle.file.rotor else None
    if wings is not None:
        vehicle = vehicle.with_numbers({n: {"value": x} for n, x in wings.changes.items()})
    area, rotors = vehicle.rotor_range, []
    for i, (name, rotor) in enumerate(vehicle.file.rotor.items()):
        at, column = area.names.index(rotor.channel), vehicle.inputs.index(rotor.channel)
        steady = float(hover.inputs[column] - area.idle[at]) if hover is not None else 0.0
        span = float(area.full[at] - area.idle[at])
        if not math.isfinite(span):
            span = 2.0 * steady
            assumed.append(f"full command of {rotor.channel} is twice that of hover, {span:.4g} above idle")
        rotors.append(Command(_motor_place(i), name, {rotor.channel: span}, steady / span))
    surfaces, uncommanded = _surfaces(vehicle, wings, neutral, assumed)
    if not surfaces and not rotors:
        raise VehicleError(
            f"{vehicle.where}: an autopilot needs rotors, or controls that turn the vehicle about its axes; the file has none"
        )
    return AutopilotCommands(
        vehicle, neutral, surfaces, _throttle(vehicle, wings, neutral, assumed), tuple(rotors), wings, hover,
        tuple(assumed), uncommanded,
    )  # fmt: skip


def _surfaces(
    vehicle: Vehicle, wings: motion.Trim | None, neutral: FloatArray, assumed: list[str]
) -> tuple[tuple[Command, ...], tuple[str, ...]]:
    """Return the commands of the surfaces, and the controls that have none.

    Controls that bear the name of an axis command it. An axis without one is commanded by what turns the vehicle about it.
    """
    if wings is None:
        return (), ()
    moments = np.array([wings.surface_moments(vehicle, c) for c in vehicle.controls]).T
    used: dict[str, dict[str, float]] = {}
    ends = {c: _full_deflection(vehicle, c, neutral) for c in vehicle.controls}
    allocated = allocated_axes(
        vehicle.controls, moments, {c: end or FULL_DEFLECTION for c, end in ends.items()}
    )
    for row, (name, axis) in enumerate(AXES.items()):
        if name in vehicle.controls:
            moment = moments[row, vehicle.controls.index(name)]
            used[name] = {name: math.copysign(ends[name] or FULL_DEFLECTION, moment)}
        elif axis in allocated:
            used[name] = allocated[axis]
    if not used:
        return (), tuple(vehicle.controls)
    controls = list(dict.fromkeys(c for deflections in used.values() for c in deflections))
    assumed += [f"full {c} is {math.degrees(FULL_DEFLECTION):g} deg" for c in controls if ends[c] is None]
    rows = vehicle.parameter_rows()
    columns = np.array([[deflections.get(c, 0.0) for deflections in used.values()] for c in controls])
    zero = np.array([float(vehicle.commanded(c, rows, neutral)[0]) for c in controls])
    held = np.array([wings.deflections[c] for c in controls]) - zero
    steady = dict(zip(used, np.linalg.pinv(columns) @ held, strict=True))
    out = []
    for name, deflections in used.items():
        signals = {c: np.array([x]) for c, x in deflections.items()}
        change = wings.inputs_about(vehicle, signals, 1)[0] - wings.inputs
        channels = {n: float(x) for n, x in zip(vehicle.inputs, change, strict=True) if x != 0.0}
        out.append(Command(_surface_place(name), name, channels, float(steady[name]), deflections))
    return tuple(out), tuple(c for c in vehicle.controls if c not in controls)


def _full_deflection(vehicle: Vehicle, control: str, neutral: FloatArray) -> float | None:
    """Return the deflection of a control with all its channels at full command, rad; None where no end is known."""
    size = 0.0
    for name in vehicle.channels_of(control):
        mix = f"controls.{control}.mix.{name}"
        if mix in vehicle.rows:
            end = full_deflection(name, vehicle.value(mix), float(neutral[vehicle.inputs.index(name)]))
            size += abs(end or 0.0)
    return size or None


def allocated_axes(
    controls: Sequence[str], moments: FloatArray, ends: Mapping[str, float]
) -> dict[str, dict[str, float]]:
    """Return the deflections at full command, rad, of axes that no control is named after.

    Parameters
    ----------
    controls : of the vehicle
    moments : (3, n), p', q', r' per rad of each control
    ends : full deflection of each control, rad

    Returns
    -------
    axis -> control -> deflection, such that the axes do not disturb each other and one control at least is at its end; axes
    about which nothing turns the vehicle are left out
    """
    largest = np.abs(moments).max(axis=1, keepdims=True)
    turning = (largest > MIN_MOMENT * largest.max())[:, 0]
    shares = np.where(turning[:, None], moments, 0.0) / np.where(largest > 0.0, largest, 1.0)
    names, spare = list(AXES), [i for i, c in enumerate(controls) if c not in AXES]
    serves = np.zeros(moments.shape, dtype=bool)
    for i in spare:
        role = surface_role(*shares[:, i].tolist())[0].split()[-1]
        for axis in _AXES_OF[role]:
            row = names.index(axis)
            serves[row, i] = abs(shares[row, i]) > MIN_SHARE
    missing = [k for k, name in enumerate(names) if name not in controls and serves[k].any()]
    columns = [i for i in spare if serves[missing, i].any()]
    if not missing:
        return {}
    solved = np.linalg.pinv(np.where(serves, shares, 0.0)[np.ix_(missing, columns)])
    out = {}
    for k, deflections in zip(missing, solved.T, strict=True):
        scale = 1.0 / max(abs(x) / ends[controls[i]] for i, x in zip(columns, deflections, strict=True))
        found = {controls[i]: float(scale * x) for i, x in zip(columns, deflections, strict=True)}
        out[AXES[names[k]]] = {c: x for c, x in found.items() if abs(x) > ROUNDING * ends[c]}
    return out


def _throttle(
    vehicle: Vehicle, wings: motion.Trim | None, neutral: FloatArray, assumed: list[str]
) -> Command | None:
    """Return the command of the propulsion; full throttle gives twice the steady thrust where no channel says more."""
    file = vehicle.file.propulsion
    if file is None or wings is None:
        return None
    if file.kind == "constant":
        steady = vehicle.value("propulsion.thrust")
        _check_thrust(vehicle, steady)
        assumed.append(f"full throttle is twice the steady thrust, {2.0 * steady:.4g} N")
        return Command(THROTTLE, "throttle", {THRUST: 2.0 * steady}, 0.5)
    at = vehicle.inputs.index(file.channel)
    steady, full = float(wings.inputs[at] - neutral[at]), full_command(file.channel)
    span = 2.0 * steady if full is None else full - float(neutral[at])
    _check_thrust(vehicle, span)
    if full is None:
        assumed.append(f"full throttle is twice the steady {file.channel}, {span:.4g} above idle")
    return Command(THROTTLE, "throttle", {file.channel: span}, steady / span)


def _check_thrust(vehicle: Vehicle, span: float) -> None:
    if not span > 0.0:
        raise VehicleError(
            f"{vehicle.where}: the steady flight needs no thrust, so full throttle cannot be derived from it; "
            "give another --airspeed"
        )


def aircraft(commands: AutopilotCommands) -> str:
    """Return the aircraft file whose channels are moved by the commands, and which stands on the ground."""
    vehicle = commands.vehicle
    root = ET.fromstring(jsbsim_aircraft.aircraft(vehicle))  # noqa: S314 - our own
    controls = root.find("flight_control")
    reactions = root.find("ground_reactions")
    if controls is None or reactions is None:
        raise VehicleError(f"{vehicle.where}: its JSBSim aircraft has no controls; export it to jsbsim")
    mixer = Element("channel", {"name": "commands of the autopilot"})
    zero = dict(zip(vehicle.inputs, commands.neutral.tolist(), strict=True))
    for name in dict.fromkeys(n for c in commands.outputs for n in c.channels):
        parts = [
            node("product", value(c.channels[name]), prop(c.place))
            for c in commands.outputs
            if name in c.channels
        ]
        mixer.append(
            _set(THRUST if name == THRUST else channel(name), node("sum", value(zero.get(name, 0.0)), *parts))
        )
    ground = vehicle.file.ground_effect
    if ground is not None:
        mixer.append(_set(channel(ground.channel), node("product", prop("position/h-agl-ft"), value(FOOT))))
    # ArduPilot starts an engine by this property, and JSBSim ends a script that sets one which is not there
    new = [
        c.place for c in commands.outputs if c not in commands.surfaces
    ]  # JSBSim itself has those of surfaces
    for i, place in enumerate([*new, "propulsion/engine[0]/set-running"]):
        declared = leaf("property", place)
        declared.set("value", "0.0")
        controls.insert(i, declared)
    first = next((i for i, e in enumerate(controls) if e.tag == "channel"), len(controls))
    controls.insert(first, mixer)
    reactions.extend(_contacts(vehicle))
    return jsbsim_aircraft.document(root)


def _set(place: str, body: Element) -> Element:
    out = component(f"stoop/commanded/{place.rpartition('/')[2]}", body)
    out.append(leaf("output", place))
    return out


def _contacts(vehicle: Vehicle) -> list[Element]:
    """Return an undercarriage that carries the weight: three wheels under wings, four feet under rotors alone."""
    center = jsbsim_aircraft.point(vehicle, "mass.center_of_gravity")
    if "reference.chord" in vehicle.rows:
        chord, track = vehicle.value("reference.chord"), 0.15 * vehicle.value("reference.span")
        kind, down = "BOGEY", chord
        feet = {"nose": (1.5 * chord, 0.0), "left": (-0.3 * chord, -track), "right": (-0.3 * chord, track)}
    else:
        places = [jsbsim_aircraft.point(vehicle, f"rotor.{r}.position") for r in vehicle.file.rotor]
        arm = max(math.hypot(x - center[0], y - center[1]) for x, y, _ in places)
        kind, down = "STRUCTURE", 0.5 * arm
        feet = {
            f"foot-{i}": (0.5 * arm * x, 0.5 * arm * y)
            for i, (x, y) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1)))
        }
    mass = vehicle.value("mass.mass") / len(feet)
    stiffness = mass * vehicle.value("environment.gravity") / SAG
    damping = 2.0 * _DAMPING * math.sqrt(stiffness * mass)
    numbers: dict[str, tuple[float, dict[str, str]]] = {
        "static_friction": (0.8, {}), "dynamic_friction": (0.5, {}), "rolling_friction": (0.02, {}),
        "spring_coeff": (stiffness / POUND_FORCE * FOOT, {"unit": "LBS/FT"}),
        "damping_coeff": (damping / POUND_FORCE * FOOT, {"unit": "LBS/FT/SEC"}), "max_steer": (0.0, {"unit": "DEG"}),
    }  # fmt: skip
    out = []
    for name, (x, y) in feet.items():
        contact = Element("contact", {"type": kind, "name": name})
        contact.append(jsbsim_aircraft.location((center[0] + x, center[1] + y, center[2] + down)))
        for tag, (size, unit) in numbers.items():
            SubElement(contact, tag, unit).text = number(size)
        out.append(contact)
    return out


def servo_table(commands: AutopilotCommands) -> list[tuple[Any, ...]]:
    """Return name, property, deflection at 1000, 1500 and 2000 us, deg, and PWM in steady flight, of each surface."""
    out, rows = [], commands.vehicle.parameter_rows()
    for c in commands.surfaces:
        for control, full in c.full_deflections.items():
            zero = float(commands.vehicle.commanded(control, rows, commands.neutral)[0])
            angles = [math.degrees(zero + n * full) for n in (-1.0, 0.0, 1.0)]
            name = c.name if control == c.name else f"{c.name}: {control}"
            out.append((name, c.place, *angles, round(1500.0 + 500.0 * c.steady)))
    return out
