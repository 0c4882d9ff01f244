"""Folders to copy into ArduPilot or PX4, whose simulations in the loop then fly a vehicle in JSBSim.

ArduPilot's backend writes four commands over a socket and makes script, start and output by itself: it needs the aircraft, and
parameters. PX4's bridge takes sixteen outputs from a configuration to properties of the model, and needs a start and an airframe.

References
----------
ArduPilot, libraries/SITL/SIM_JSBSim.cpp (commit 06065815), Tools/autotest/default_params/plane-jsbsim.parm (0262d25a): commands,
start on the ground, and servos that are reversed by default. ardupilot.org/dev/docs/sitl-with-jsbsim.html: where models lie.
Auterion/px4-jsbsim-bridge (f88764b0): src/jsbsim_bridge.cpp, src/actuator_plugin.cpp, include/sensor_*_plugin.h.
PX4-Autopilot: Tools/simulation/jsbsim/sitl_run.sh (1abe35c2), src/modules/control_allocator/module.yaml (00f285ea) and
ActuatorEffectivenessRotors.cpp (25ab311a), airframes 1036_jsbsim_malolo and 10043_sihsim_standard_vtol (000f5fdb).
"""

from __future__ import annotations

import math
import re
from abc import abstractmethod
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Final
from xml.etree.ElementTree import Element, SubElement

from stoop import Vehicle
from stoop.extend.errors import VehicleError
from stoop.extend.text import printable
from stoop_export import ardupilot_parameters, px4_airframe
from stoop_export.ardupilot_parameters import PWM
from stoop_export.autopilot_outputs import MotorOutput, SurfaceOutput, ThrustCurve, equivalent_airspeed
from stoop_export.exporter import Exported, Exporter, encoded, installed, written
from stoop_export.jsbsim import NOT_FLOWN
from stoop_export.jsbsim_aircraft import document, flat_planet, point
from stoop_export.jsbsim_flight import (
    PLANET,
    Host,
    Record,
    file_name,
    frames_per_sample,
    jsbsim_readings,
    own_readings,
    relative_differences,
)
from stoop_export.jsbsim_model import leaf, number
from stoop_export.reference_flight import reference_record
from stoop_export.sitl import AXES, AutopilotCommands, Command, aircraft, autopilot_commands, servo_table

OUTPUTS: Final = 16  #: of PX4's bridge
MOTORS: Final = 8  #: of PX4's control allocation before release 1.15
_BRIDGE: Final = "Tools/simulation/jsbsim/jsbsim_bridge"
_AIRFRAMES: Final = "ROMFS/px4fmu_common/init.d-posix/airframes"
_SERVOS: Final = {"aileron": (1, 4), "elevator": (2, 19), "throttle": (3, 70), "rudder": (4, 21)}
"""Output and function of ArduPilot's servos."""


def ardupilot(commands: AutopilotCommands) -> tuple[dict[str, str], str]:
    """Return the files for ArduPilot's JSBSim backend, and the place of the aircraft.

    Raises
    ------
    VehicleError
        A vehicle without surfaces: the backend commands no rotors.
    """
    vehicle = commands.vehicle
    if not commands.surfaces:
        raise VehicleError(
            f"{vehicle.where}: ArduPilot's JSBSim backend sets aileron, elevator, rudder and throttle, and no rotors; export to "
            "px4-jsbsim, or fly the model of --to jsbsim by ArduPilot's JSON backend"
        )
    # ArduPilot mixes where these words stand in the name of a model
    name = re.sub("(?i)elevon|vtail", lambda m: f"{m[0][0]}-{m[0][1:]}", file_name(vehicle.name))
    trims = {c.name: ardupilot_parameters.pulse(c.steady) for c in commands.surfaces}
    parameters: dict[str, float] = {}
    for command, (output, purpose) in _SERVOS.items():
        rest = PWM[0] if command == "throttle" else ardupilot_parameters.pulse(0.0)
        parameters |= ardupilot_parameters.servo(output, purpose, trims.get(command, rest))
    parameters |= ardupilot_parameters.cruise(*_cruise(commands))
    base = "Tools/autotest"
    place = f"{base}/aircraft/{name}/{name}.xml"
    start = (
        f"cp -r Tools YOUR/ardupilot/\nsim_vehicle.py -v ArduPlane -f jsbsim:{name} "
        f"--add-param-file=Tools/autotest/aircraft/{name}/{name}.parm --console --map"
    )
    notes = [
        "JSBSim must be in PATH. ArduPilot writes aircraft/NAME/reset.xml and the script itself: the model starts on its wheels.",
        "Servo outputs are 1 aileron, 2 elevator, 3 throttle, 4 rudder, not reversed: ArduPilot's own defaults for JSBSim "
        "reverse 2 and 4, the parameter file sets them back.",
    ]
    if commands.rotors:
        notes.append(
            "The backend commands no rotors: those of this vehicle stand still. px4-jsbsim flies them."
        )
    outputs = [(f"SERVO{_SERVOS[c.name][0]}", c) for c in commands.outputs if c.name in _SERVOS]
    return {
        place: aircraft(commands),
        place.replace(".xml", ".parm"): ardupilot_parameters.text(parameters),
        "README.md": _readme(commands, "ArduPilot", start, notes, outputs),
    }, place


def px4(commands: AutopilotCommands) -> tuple[dict[str, str], str]:
    """Return the files for PX4's JSBSim bridge, and the place of the aircraft.

    Raises
    ------
    VehicleError
        More outputs or motors than the bridge and the control allocation have.
    """
    vehicle, name = commands.vehicle, file_name(commands.vehicle.name).replace("-", "_")
    motors = [c for c in commands.outputs if c not in commands.surfaces]
    if len(motors) > MOTORS or len(commands.outputs) > OUTPUTS:
        raise VehicleError(
            f"{vehicle.where}: PX4 allocates {MOTORS} motors and its JSBSim bridge has {OUTPUTS} outputs, this vehicle needs "
            f"{len(motors)} and {len(commands.outputs)}; fly the model of --to jsbsim"
        )
    config = Element("model", {"name": name})
    SubElement(SubElement(config, "mavlink_interface"), "tcp_port").text = "4560"
    sensors = ["imu", "gps", "barometer", "magnetometer", *(["airspeed"] if commands.surfaces else [])]
    SubElement(config, "sensors").extend(Element(s) for s in sensors)
    actuators = SubElement(config, "actuators")
    for i, command in enumerate(commands.outputs):
        made = SubElement(actuators, "channel", {"name": command.name})
        made.extend([leaf("index", str(i)), leaf("scale", "1"), leaf("property", command.place)])
    kind = px4_airframe.airframe_kind(vehicle.where, bool(commands.rotors), bool(commands.surfaces))
    outputs = [_motor(commands, command) for command in motors]
    parameters = px4_airframe.allocation(kind, outputs, [_surface(c) for c in commands.surfaces])
    functions = [101 + i for i in range(len(motors))] + [201 + i for i in range(len(commands.surfaces))]
    parameters |= {f"PWM_MAIN_FUNC{n}": function for n, function in enumerate(functions, 1)}
    if commands.rotors:
        parameters |= px4_airframe.hover(_thrust_curve(commands))
    if commands.surfaces:
        parameters |= px4_airframe.cruise(*_cruise(commands))
        parameters |= {} if commands.rotors else {"RWTO_TKOFF": 1}
    label = f"{px4_airframe.airframe_number(name)}_jsbsim_{name}"
    place = f"{_BRIDGE}/models/{name}/{name}.xml"
    start = (
        f"cp -r Tools ROMFS YOUR/PX4-Autopilot/ && cd YOUR/PX4-Autopilot\n"
        f"sed -i 's/px4_add_romfs_files(/&\\n\\t{label}/' {_AIRFRAMES}/CMakeLists.txt\n"
        f"make px4_sitl_default && cmake --build build/px4_sitl_default --target jsbsim_bridge\n"
        f"B=build/px4_sitl_default; mkdir -p $B/rootfs\n"
        f"HEADLESS=1 $B/build_jsbsim_bridge/jsbsim_bridge {name} -s $PWD/{_BRIDGE}/scene/{name}.xml &\n"
        f"(cd $B/rootfs && PX4_SIM_MODEL=jsbsim_{name} ../bin/px4 ../etc)"
    )
    notes = [
        "PX4's own sitl_run.sh starts the models that it lists only; these lines do what it does.",
        "The bridge runs JSBSim at 250 steps a second and starts on the ground; its scale factors are whole numbers, so that the "
        "model scales the commands.",
    ]
    wires = [(f"PWM_MAIN_FUNC{i + 1}", c) for i, c in enumerate(commands.outputs)]
    return {
        place: aircraft(commands),
        f"{_BRIDGE}/configs/{name}.xml": document(config),
        f"{_BRIDGE}/scene/{name}.xml": _scene(vehicle),
        f"{_AIRFRAMES}/{label}": px4_airframe.airframe(vehicle.name, kind, parameters),
        "README.md": _readme(commands, "PX4", start, notes, wires),
    }, place


def _cruise(commands: AutopilotCommands) -> tuple[float, float | None]:
    """Return the equivalent airspeed of the cruise, m/s, and its throttle; NaN without a steady flight on wings."""
    airspeed = math.nan if commands.wings is None else equivalent_airspeed(commands.vehicle, commands.wings)
    return airspeed, None if commands.throttle is None else commands.throttle.steady


def _motor(commands: AutopilotCommands, command: Command) -> MotorOutput:
    """Return a motor from the center of gravity; the throttle is a propeller that pushes forward."""
    vehicle = commands.vehicle
    rotor, center = vehicle.file.rotor.get(command.name), point(vehicle, "mass.center_of_gravity")
    at = point(vehicle, "propulsion.position" if rotor is None else f"rotor.{command.name}.position")
    x, y, z = (p - c for p, c in zip(at, center, strict=True))
    if rotor is None:
        return MotorOutput((x, y, z), (1.0, 0.0, 0.0), 0.0, "ccw", lifts=False)
    axis = (0.0, 0.0, -1.0)
    if f"rotor.{command.name}.axis.x" in vehicle.rows:
        axis = point(vehicle, f"rotor.{command.name}.axis")
    return MotorOutput((x, y, z), axis, _torque_ratio(commands, command), rotor.spin, lifts=True)


def _surface(command: Command) -> SurfaceOutput:
    """Return the surface of an axis, whose positive command turns the vehicle in the positive direction."""
    roll, pitch, yaw = (float(name == command.name) for name in AXES)
    return SurfaceOutput(command.name, (roll, pitch, yaw), command.steady)


def _thrust_curve(commands: AutopilotCommands) -> ThrustCurve:
    full = _full_speed(commands, commands.rotors[0])
    linear, square = (commands.vehicle.value(f"rotors.T{i}", 0.0) * full**i for i in (1, 2))
    return ThrustCurve(linear, square, commands.rotors[0].steady)


def _full_speed(commands: AutopilotCommands, command: Command) -> float:
    """Return x of a rotor at full command."""
    vehicle = commands.vehicle
    inputs = commands.neutral.copy()
    for name, span in command.channels.items():
        inputs[vehicle.inputs.index(name)] += span
    return float(vehicle.commanded(command.name, vehicle.parameter_rows(), inputs)[0])


def _torque_ratio(commands: AutopilotCommands, command: Command) -> float:
    """Return torque over thrust of a rotor in hover, m."""
    n, x = commands.vehicle.value, command.steady * _full_speed(commands, command)
    ratio = n("rotors.torque_ratio", math.nan)
    if math.isnan(ratio):
        thrust = sum(n(f"rotors.T{i}", 0.0) * x**i for i in range(3))
        ratio = sum(n(f"rotors.Q{i}", 0.0) * x**i for i in range(3)) / thrust
    return ratio * n(f"rotor.{command.name}.torque_factor", 1.0)


def _scene(vehicle: Vehicle) -> str:
    """Return a start on the ground, level and at rest, at PX4's usual place."""
    out = Element("initialize", {"name": "ground"})
    numbers: Mapping[str, tuple[float, str]] = {
        "latitude": (47.397742, "DEG"), "longitude": (8.545594, "DEG"), "elevation": (488.0, "M"),
        "altitude": (1.5, "M"), "vt": (0.0, "FT/SEC"), "psi": (0.0, "DEG"), "theta": (0.0, "DEG"), "phi": (0.0, "DEG"),
    }  # fmt: skip
    for tag, (x, unit) in numbers.items():
        place = SubElement(out, tag, {"unit": unit})
        if tag == "latitude":
            place.set("type", "geodetic")
        place.text = number(x)
    return document(out)


def _readme(
    commands: AutopilotCommands, title: str, start: str, notes: list[str], wires: list[tuple[str, Command]]
) -> str:
    """Return the page of a folder: how to start it, what is commanded, and what was assumed."""

    def table(head: list[str], rows: list[tuple[Any, ...]]) -> list[str]:
        cells = [[f"{x:.4g}" if isinstance(x, float) else str(x) for x in row] for row in rows]
        return ["| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *cells)] + [""]

    shown = re.sub(r"([\\`*_\[\]<>&|#])", r"\\\1", printable(commands.vehicle.name))
    lines = [f"# {shown} in JSBSim under {title}", "", "```console", *start.split("\n"), "```", ""]
    lines += table(
        ["output", "command", "property", "steady value"],
        [(o, c.name, f"`{c.place}`", c.steady) for o, c in wires],
    )
    if commands.surfaces:
        head = ["surface", "property", "at 1000 us, deg", "at 1500 us, deg", "at 2000 us, deg", "steady, us"]
        lines += table(head, servo_table(commands))
    lines += [f"- {n}" for n in (*notes, *assumptions(commands))]
    return "\n".join(lines) + "\n"


def assumptions(commands: AutopilotCommands) -> list[str]:
    """Return what was assumed and what is not commanded, as sentences."""
    out = [f"Assumed: {text}." for text in commands.assumed]
    out.append("Assumed: the undercarriage, which no flight shows; edit ground_reactions.")
    if commands.uncommanded:
        out.append(
            f"Not commanded, at their neutral points: {', '.join(commands.uncommanded)}; set their channels."
        )
    return out


class AutopilotFolder(Exporter):
    """The folder of an autopilot: its name, the rate of its JSBSim, Hz, and whether it commands rotors."""

    title: ClassVar[str]
    rate: ClassVar[float]
    rotors: ClassVar[bool]

    @abstractmethod
    def folder(self) -> tuple[dict[str, str], str]:
        """Return the files by place, and which of them is the aircraft."""

    @cached_property
    def commands(self) -> AutopilotCommands:
        """The autopilot's commands to the vehicle."""
        model, condition = self.model, self.condition
        return autopilot_commands(
            self.vehicle, condition.airspeed, model.altitude_of(condition), model.density
        )

    @cached_property
    def made(self) -> tuple[dict[str, str], str]:
        """The files by place, and which of them is the aircraft."""
        return self.folder()

    def files(self) -> Exported:
        """Return the folder, and what was assumed."""
        notes = (*self.model.unidentified, *assumptions(self.commands))
        return Exported(encoded(self.made[0]), "README.md", notes)

    def fly(self, made: Exported) -> Exported:
        """Fly on wings and on rotors, exactly and as the autopilot runs JSBSim."""
        if not installed("jsbsim"):
            return made.with_notes([NOT_FLOWN])
        texts, aircraft = self.made
        vehicle, name = self.commands.vehicle, Path(aircraft).stem
        planet = flat_planet(vehicle.value("environment.gravity"))
        points = (self.commands.wings, self.commands.hover if self.rotors else None)
        records = [None if point is None else reference_record(vehicle, point) for point in points]
        with written({f"aircraft/{name}/{name}.xml": texts[aircraft], PLANET: planet}) as root:
            return made.with_notes(
                [self._agreement(root, name, record) for record in records if record is not None]
            )

    def _agreement(self, root: Path, name: str, record: Record) -> str:
        """Fly a record exactly and as the autopilot runs JSBSim; return how the flights agree."""
        settings = self.commands.settings
        hosts = ((root / PLANET, Host(to_commands=settings)), (None, Host(self.rate, {}, settings)))
        own = own_readings(record)
        flown = (jsbsim_readings(root, name, record, place, host) for place, host in hosts)
        exact, theirs = (max(relative_differences(record.vehicle.outputs, own, y).values()) for y in flown)
        steps = frames_per_sample(record.dt, self.rate) / record.dt
        return (
            f"{record.title}, by the properties that {self.title} writes: JSBSim within {exact:.1e} of each channel's "
            f"maximum; with {steps:g} steps per second ({self.title} takes {self.rate:g}), Euler's method for rotation and "
            f"the round Earth {theirs:.1e}."
        )


class ArduPilotJSBSim(AutopilotFolder):
    """ArduPilot's JSBSim backend."""

    title, rate, rotors = "ArduPilot", 1200.0, False

    def folder(self) -> tuple[dict[str, str], str]:
        """Return the files by place, and which of them is the aircraft."""
        return ardupilot(self.commands)


class PX4JSBSim(AutopilotFolder):
    """PX4's JSBSim bridge."""

    title, rate, rotors = "PX4", 250.0, True

    def folder(self) -> tuple[dict[str, str], str]:
        """Return the files by place, and which of them is the aircraft."""
        return px4(self.commands)
