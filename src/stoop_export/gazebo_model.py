"""A vehicle in the terms of Gazebo's systems, matched to first order about its steady flights: in hover and on wings.

Motors come first. The load of one rotor is the difference that its command makes to the loads of the vehicle, by the kernel. The
commanded speed is linear in the channel, such that thrust and its slope at the steady flight are those of the vehicle. The
thrust of a propeller falls with the airspeed V, which MulticopterMotorModel does not know: with T(V) = T_m + a V^2, and T and its
slope those of the vehicle, T_m is given to the motor, and a V^2, which is a drag, to the wing.

What remains in hover by velocity and rates is damping: to first order as a matrix, body drag as its squares. What remains of the
loads at the steady flight on wings is the wing's; that by the sideslip is written as damping by v |u| where there are rotors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop import Vehicle, trim
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import SimulationError
from stoop.extend.motion import Trim
from stoop.extend.vehicles import full_command
from stoop_export.autopilot_outputs import check_rotor_channels
from stoop_export.gazebo_plugins import Blades, Damping, Motor, Surface, Wing, damping_loads, motor_loads
from stoop_export.gazebo_wing import STEP, settled_loads, sideslip_loads, vector, wing_of
from stoop_export.matlab import identifier

NOMINAL_SPEED: Final = 1000.0  #: rad/s at full command, of motors whose flight shows commands only
BLADE_STATION: Final = 0.7  #: of the radius of a rotor, where its blades of LiftDrag are
ROTOR_ANGLE: Final = 0.3  #: rad, angle of attack of blades at rest
PROPELLER_ANGLE: Final = 1.0  #: rad, the same of a propeller
PROPELLER_LOSS: Final = 0.01  #: of its thrust, at the reference airspeed
UNSUPPORTED: Final = {
    "rotors.translational": 0.0, "rotors.drag_inflow": 0.0, "rotors.inertia": 0.0, "propulsion.inertia": 0.0,
    "ground_effect.rotor": 0.0,
}  # fmt: skip
"""Numbers of rotors and propellers that Gazebo does not have, and values at which they do nothing."""


@dataclass(frozen=True, eq=False)
class GazeboModel:
    """A vehicle in the terms of Gazebo.

    Attributes
    ----------
    name : str
        Of the model, as of a topic.
    vehicle : Vehicle
    mass : kg
    inertia : (3, 3), kg m2, tensor about the center of gravity, axes forward, right, down
    motors : rotors in the order of the file, then the propeller
    blades : of the motors, if they are blades
    damping : None for a vehicle without rotors
    wing : None for a vehicle without wings
    hover, cruise : the steady flights it is matched at
    """

    name: str
    vehicle: Vehicle
    mass: float
    inertia: FloatArray
    motors: tuple[Motor, ...]
    blades: tuple[Blades, ...]
    damping: Damping | None
    wing: Wing | None
    hover: Trim | None
    cruise: Trim | None

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """Joints of the wing."""
        return () if self.wing is None else self.wing.surfaces


def gazebo_model(
    vehicle: Vehicle, point: Trim, alphas: tuple[float, float] | None = None, blades: bool = False
) -> GazeboModel:
    """Return a vehicle in the terms of Gazebo.

    Parameters
    ----------
    vehicle : Vehicle
        With the full equations.
    point : Trim
        Of the condition that is asked for: on wings if the vehicle has some and an airspeed is given. A quadplane's other steady
        flight is found here.
    alphas : (2,), rad, optional
        Range of the angles of attack that were flown.
    blades : bool
        Whether motors are blades of LiftDrag, as ArduPilot's plugin needs them, in place of MulticopterMotorModel.

    Raises
    ------
    SimulationError
        Gazebo's systems cannot hold the vehicle, or it has no steady flight.
    VehicleError
        Rotors share a channel.
    """
    if vehicle.reduce != "full" or vehicle.motion:
        raise SimulationError(
            f'{vehicle.where}: Gazebo needs the full equations of motion; set model.reduce = "full"'
        )
    if vehicle.sloped:
        raise SimulationError(
            f"{vehicle.where}: the reaction to the spin-up of rotors without a lag needs slopes of channels; give rotors.lag"
        )
    check_rotor_channels(vehicle)
    altitude, on_wings = point.start["h"], point.on_wings
    density = float(point.inputs[vehicle.inputs.index("density")]) if "density" in vehicle.inputs else None
    hover = cruise = None
    if vehicle.rotors:
        hover = trim(vehicle, None, altitude, density=density) if on_wings else point
    if vehicle.file.reference is not None:
        speed = vehicle.value("reference.airspeed")
        cruise = point if on_wings else trim(vehicle, speed, altitude, density=density)
    motors = rotor_motors(vehicle, hover) if hover is not None else ()
    if cruise is not None:
        motors = (*motors, *_propeller(vehicle, cruise))
    made = [blades_of(vehicle, m, point) for m in motors] if blades else []
    motors = tuple(b.motor(m) for b, m in zip(made, motors, strict=True)) if blades else motors
    damping = None if hover is None else _damping(vehicle, hover, motors)
    wing = None if cruise is None else wing_of(vehicle, cruise, motors, damping, alphas)
    if damping is not None and wing is not None and cruise is not None:
        # A sideslip from -180 to 180 degrees makes large forces where rotors fly backward; v |u| is the same on wings.
        damping = replace(damping, sideslip=sideslip_loads(wing))
        wing = wing_of(vehicle, cruise, motors, damping, alphas)
    mass, inertia = vehicle.value("mass.mass"), vehicle.inertia_tensor()
    return GazeboModel(
        identifier(vehicle.name), vehicle, mass, inertia, motors, tuple(made), damping, wing, hover, cruise
    )


def _slope(values: FloatArray, step: float) -> float:
    """Return the central difference of values (3,): at a point, a step above, a step below."""
    return float(values[1] - values[2]) / (2.0 * step)


def blades_of(vehicle: Vehicle, motor: Motor, point: Trim) -> Blades:
    """Return the blades of a motor; those of a propeller are so far out that the airspeed takes 1 % of the thrust."""
    density = point.density(vehicle)
    if motor.name not in vehicle.rotors:
        radius = vehicle.value("reference.airspeed") / (PROPELLER_LOSS * motor.max_speed * PROPELLER_ANGLE)
        return Blades.of(motor, radius, PROPELLER_ANGLE, density)
    radius = vehicle.value("rotors.radius", 0.0) or 0.4 * math.hypot(*motor.position[:2]) or 0.1
    return Blades.of(motor, BLADE_STATION * radius, ROTOR_ANGLE, density)


def _motor(
    name: str, vehicle: Vehicle, channel: str, thrust: float, slope: float, at: float, idle: float
) -> tuple[float, ...]:
    """Return constant, speed_gain, offset and full command of a motor by its thrust, N, and slope at a value of its channel."""
    if not (thrust > 0.0 and slope > 0.0):
        raise SimulationError(
            f"{vehicle.where}: {name} has a thrust of {thrust:.3g} N with a slope of {slope:.3g} at the steady flight, which "
            "MulticopterMotorModel cannot match; give a faster or a level flight (--airspeed, --climb-angle)"
        )
    behind = 2.0 * thrust / slope  # of the channel, from where the thrust would vanish
    full = full_command(channel) or max(2.0 * at - idle, at)
    gain = vehicle.value("rotors.gain", 1.0)
    by_speed = name in vehicle.rotors and vehicle.drive == "speed"
    speed_gain = gain if by_speed else NOMINAL_SPEED / (full - at + behind)
    omega = speed_gain * behind
    return thrust / omega**2, speed_gain, omega - speed_gain * at, full


def rotor_motors(vehicle: Vehicle, hover: Trim) -> tuple[Motor, ...]:
    """Return the rotors, each by the difference that its command makes in hover."""
    out = []
    lag = max(vehicle.value("rotors.lag", 0.0), 0.0)
    idle = vehicle.value("rotors.idle", 0.0)
    for name, rotor in vehicle.file.rotor.items():
        column = vehicle.inputs.index(rotor.channel)
        at, step = float(hover.inputs[column]), 1e-4 * float(hover.inputs[column] - idle)
        inputs = np.repeat(hover.inputs[:, None], 6, axis=1)
        inputs[column] = [at, at + step, at - step, idle, at, idle]
        speed = STEP + np.zeros(6)
        speed[:4] = 0.0
        # the last two drift forward and right, for the drag
        moved = {axis: hover.start.get(axis, 0.0) + speed for axis in "uv"}
        found = settled_loads(vehicle, hover, inputs, moved)
        n = np.array([vehicle.value(f"rotor.{name}.axis.{a}", 0.0) for a in "xyz"])
        n = n / np.linalg.norm(n) if n.any() else np.array([0.0, 0.0, -1.0])
        position = arm(vehicle, f"rotor.{name}.position")
        alone = found[:, :3] - found[:, 3:4]
        thrust = n @ alone[:3]
        spin_sign = 1 if rotor.spin == "ccw" else -1
        torque = -spin_sign * float(n @ (alone[3:, 0] - np.cross(position, alone[:3, 0])))
        constant, speed_gain, offset, full = _motor(
            name, vehicle, rotor.channel, float(thrust[0]), _slope(thrust, step), at, idle
        )
        omega = offset + speed_gain * at
        sideways = (found[:3, 4] - found[:3, 5]) - alone[:3, 0]  # of a velocity of STEP along x and y
        across = np.array([STEP, STEP, 0.0])
        across -= n * (n @ across)
        drag = -float(sideways @ across) / float(across @ across) / omega
        out.append(
            Motor(name, rotor.channel, vector(position), vector(n), spin_sign, constant, torque / float(thrust[0]),
                  drag, lag, speed_gain, offset, idle, full)
        )  # fmt: skip
    return tuple(out)


def _propeller(vehicle: Vehicle, cruise: Trim) -> tuple[Motor, ...]:
    """Return the propeller by its thrust at the steady flight on wings, its fall with the airspeed left to the wing."""
    file = vehicle.file.propulsion
    if file is None:
        return ()
    position, pitch = arm(vehicle, "propulsion.position"), vehicle.value("propulsion.pitch", 0.0)
    n = np.array([math.cos(pitch), 0.0, -math.sin(pitch)])
    names = ("thrust", "scale", "CT0", "CT1", "CT2")
    off = {f"propulsion.{k}": 0.0 for k in names if f"propulsion.{k}" in vehicle.rows}
    speed, step = cruise.start["V"], 1e-4 * cruise.start["V"]
    inputs = np.repeat(cruise.inputs[:, None], 5, axis=1)
    at, idle, channel_step = 1.0, 0.0, 0.0
    channel = None if file.kind == "constant" else file.channel
    if channel is not None:
        at, idle = float(cruise.inputs[vehicle.inputs.index(channel)]), vehicle.value("propulsion.idle", 0.0)
        channel_step = 1e-4 * max(abs(at), 1e-3)
        inputs[vehicle.inputs.index(channel), 3:] = [at + channel_step, at - channel_step]
    faster = 1.0 + np.array([0.0, step, -step, 0.0, 0.0]) / speed
    begin = vehicle.initial_states(cruise.start, vehicle.parameter_rows(cruise.changes), cruise.inputs)
    moved = {a: begin[vehicle.states.index(a), 0] * faster for a in "uvw"}
    thrust = n @ (
        settled_loads(vehicle, cruise, inputs, moved) - settled_loads(vehicle, cruise, inputs, moved, off)
    )[:3]  # fmt: skip
    own = float(thrust[0]) - 0.5 * speed * _slope(thrust[:3], step)
    if channel is None:  # full thrust is set to twice that of the steady flight
        if not own > 0.0:
            raise SimulationError(f"{vehicle.where}: no thrust at the steady flight; give a level one")
        offset = NOMINAL_SPEED / math.sqrt(2.0)
        constant, speed_gain, full = own / offset**2, 0.0, 1.0
    else:
        slope = _slope(thrust[[0, 3, 4]], channel_step)
        constant, speed_gain, offset, full = _motor("the propeller", vehicle, channel, own, slope, at, idle)
    place, along = vector(position), vector(n)
    return (
        Motor("propeller", channel, place, along, 1, constant, 0.0, 0.0, 0.0, speed_gain, offset, idle, full),
    )  # fmt: skip


def _damping(vehicle: Vehicle, hover: Trim, motors: tuple[Motor, ...]) -> Damping:
    """Return what velocity and rates make in hover beyond the motors: derivatives, and the squares of the body drag."""
    names, step = ("u", "v", "w", "p", "q", "r"), 1e-3
    motion = np.array([hover.start.get(n, 0.0) for n in names])[:, None]
    motion = motion + step * np.hstack([np.eye(6), -np.eye(6)])
    found = settled_loads(
        vehicle, hover, np.repeat(hover.inputs[:, None], 12, axis=1), dict(zip(names, motion, strict=True))
    )
    known = dict(zip(vehicle.inputs, hover.inputs.tolist(), strict=True))
    speeds = [m.command(known) for m in motors]
    squares = [-vehicle.value(f"body_drag.quadratic.{a}", 0.0) for a in "xyz"]
    held = Damping(np.zeros((6, 6)), np.array([*squares, 0.0, 0.0, 0.0]), np.zeros(6))
    for i, column in enumerate(motion.T.tolist()):
        found[:, i] -= motor_loads(motors, speeds, column[:3], column[3:])
        found[:, i] -= damping_loads(held, column[:3], column[3:])
    return replace(held, linear=(found[:, :6] - found[:, 6:]) / (2.0 * step))


def arm(vehicle: Vehicle, name: str) -> FloatArray:
    """Return a point of the file from the center of gravity, m; zero where the file has none."""
    if f"{name}.x" not in vehicle.rows:
        return np.zeros(3)
    return np.array(
        [vehicle.value(f"{name}.{a}") - vehicle.value(f"mass.center_of_gravity.{a}", 0.0) for a in "xyz"]
    )


def unsupported_rotor_numbers(vehicle: Vehicle) -> dict[str, float]:
    """Return numbers of what MulticopterMotorModel leaves out, and the values at which they do nothing."""
    return {name: end for name, end in UNSUPPORTED.items() if vehicle.value(name, 0.0) != 0.0}
