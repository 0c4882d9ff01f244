"""Start-up files of PX4 and ArduPilot for a vehicle in Gazebo: geometry of motors and surfaces, functions and ends of outputs.

PX4 maps an output from 0 to 1 to speeds of rotation between SIM_GZ_EC_MIN and _MAX, and one from -1 to 1 to angles between
SIM_GZ_SV_MINA and _MAXA, so that both hold the map from channels of :class:`stoop_export.gazebo_plugins.Motor`.

References
----------
PX4-Autopilot: src/modules/simulation/gz_bridge/module.yaml, airframes 4004_gz_standard_vtol and 4008_gz_advanced_plane.
"""

from __future__ import annotations

import math
from typing import Final

from stoop.extend.errors import VehicleError
from stoop.extend.motion import Trim
from stoop_export import ardupilot_parameters as ardupilot
from stoop_export import px4_airframe
from stoop_export.autopilot_outputs import MotorOutput, SurfaceOutput, ThrustCurve, equivalent_airspeed
from stoop_export.gazebo_model import GazeboModel
from stoop_export.gazebo_plugins import Motor

ESCS: Final = 8  #: outputs SIM_GZ_EC of PX4
SERVOS: Final = 8  #: outputs SIM_GZ_SV of PX4
UNKNOWN_FRAME: Final = (
    "ArduPilot has no frame with rotors at these azimuths that turn so: {0}FRAME_CLASS is 0, with which it does not arm. Set "
    "{0}FRAME_CLASS, {0}FRAME_TYPE and the SERVOn_FUNCTION of the motors, or move them by a script (class 15)."
)


def motor_outputs(made: GazeboModel) -> list[MotorOutput]:
    """Return the motors, rotors first."""
    return [
        MotorOutput(
            m.position, m.axis, m.moment, "ccw" if m.spin_sign > 0 else "cw", m.name in made.vehicle.rotors
        )
        for m in made.motors
    ]


def surface_outputs(made: GazeboModel) -> list[SurfaceOutput]:
    """Return the surfaces; an output of 1 is the joint's upper end."""
    if made.wing is None or made.cruise is None:
        return []
    known = _channels(made, made.cruise)
    out = []
    for surface in made.wing.moved:
        roll, pitch, yaw = made.wing.authority(surface).values()
        role, sign = made.wing.role(surface)
        if role == "aileron":  # one whose positive output rolls left is PX4's left one
            role = "left aileron" if sign < 0.0 else "right aileron"
        trim = min(max(surface.command(known) / surface.limit, -1.0), 1.0)
        out.append(SurfaceOutput(role, (roll, pitch, yaw), trim, sign))
    return out


def thrust_curve(made: GazeboModel) -> ThrustCurve | None:
    """Return the thrust of the first rotor, which goes by the square of a speed that is linear in the output."""
    if made.hover is None:
        return None
    motor = made.motors[0]
    span = motor.max_speed - motor.min_speed
    return ThrustCurve(2.0 * motor.min_speed * span, span**2, _output(motor, made, made.hover))


def throttle(made: GazeboModel) -> float | None:
    """Return the output of the propeller in steady flight on wings, from 0 to 1; None without one."""
    if made.cruise is None:
        return None
    outputs = [_output(m, made, made.cruise) for m in made.motors if m.name not in made.vehicle.rotors]
    return outputs[0] if outputs else None


def _channels(made: GazeboModel, point: Trim) -> dict[str, float]:
    return dict(zip(made.vehicle.inputs, point.inputs.tolist(), strict=True))


def _output(motor: Motor, made: GazeboModel, point: Trim) -> float:
    speed = motor.command(_channels(made, point))
    return min(max((speed - motor.min_speed) / (motor.max_speed - motor.min_speed), 0.0), 1.0)


def airframe(made: GazeboModel) -> str:
    """Return the start-up file of PX4: geometry of motors and surfaces, and ranges of the outputs.

    Raises
    ------
    VehicleError
        More motors or surfaces than PX4's bridge to Gazebo has outputs; or none.
    """
    motors, surfaces = motor_outputs(made), surface_outputs(made)
    if len(motors) > ESCS or len(surfaces) > SERVOS:
        raise VehicleError(
            f"{made.vehicle.where}: PX4's bridge to Gazebo has outputs for {ESCS} motors and {SERVOS} surfaces, this vehicle "
            f"needs {len(motors)} and {len(surfaces)}"
        )
    kind = px4_airframe.airframe_kind(made.vehicle.where, made.hover is not None, bool(surfaces))
    sets = {"SIM_GZ_EN": 1.0, **px4_airframe.allocation(kind, motors, surfaces)}
    curve = thrust_curve(made)
    if curve is not None:
        sets |= px4_airframe.hover(curve)
    if made.cruise is not None and surfaces:
        sets |= px4_airframe.cruise(equivalent_airspeed(made.vehicle, made.cruise), throttle(made))
    for i, m in enumerate(made.motors):
        sets |= {f"SIM_GZ_EC_FUNC{i + 1}": 101 + i, f"SIM_GZ_EC_MIN{i + 1}": round(m.min_speed)}
        sets[f"SIM_GZ_EC_MAX{i + 1}"] = round(m.max_speed)
    for i, surface in enumerate(made.wing.moved if made.wing is not None else ()):
        angle, n = round(math.degrees(surface.limit), 1), i + 1
        sets |= {f"SIM_GZ_SV_FUNC{n}": 201 + i, f"SIM_GZ_SV_MAXA{n}": angle, f"SIM_GZ_SV_MINA{n}": -angle}
    shell = ["PX4_SIMULATOR=${PX4_SIMULATOR:=gz}", "PX4_GZ_WORLD=${PX4_GZ_WORLD:=default}"]
    return px4_airframe.airframe(
        made.vehicle.name, kind, sets, [*shell, f"PX4_SIM_MODEL=${{PX4_SIM_MODEL:={made.name}}}"]
    )


def _frame(made: GazeboModel) -> ardupilot.Frame:
    return ardupilot.frame([m for m in motor_outputs(made) if m.lifts])


def _prefix(made: GazeboModel) -> str:
    return "Q_" if made.wing is not None and made.wing.moved else ""


def notes(made: GazeboModel) -> list[str]:
    """Return what a user has to set in ArduPilot."""
    unknown = made.hover is not None and _frame(made).kind is None
    return [UNKNOWN_FRAME.format(_prefix(made))] if unknown else []


def parameters(made: GazeboModel) -> str:
    """Return ArduPilot's parameters: frame, functions and ends of the outputs, airspeeds and throttle."""
    sets: dict[str, float] = {}
    frame, prefix = _frame(made), _prefix(made)
    if made.hover is not None:
        sets |= {"Q_ENABLE": 1} if prefix else {}
        sets[f"{prefix}FRAME_CLASS"] = frame.number
        sets |= {} if frame.kind is None else {f"{prefix}FRAME_TYPE": frame.kind}
    if made.cruise is not None and made.wing is not None:
        sets |= ardupilot.cruise(equivalent_airspeed(made.vehicle, made.cruise), throttle(made))
    pushers = len(made.motors) - len(frame.functions)
    functions = [*frame.functions, *[ardupilot.THROTTLE] * pushers]
    trims = [ardupilot.PWM[0]] * len(functions)
    for surface in surface_outputs(made):
        functions.append(ardupilot.SURFACE_FUNCTIONS[surface.role])
        trims.append(ardupilot.pulse(surface.sign * surface.trim))
    for n, (function, trim) in enumerate(zip(functions, trims, strict=True), 1):
        sets |= ardupilot.servo(n, function, trim)
    return ardupilot.text(sets)
