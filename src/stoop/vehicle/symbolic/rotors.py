"""Rotors and the drag of the body that they carry: force and moment about the centre of gravity, body axes.

Of the rotor's speed through the air, v_axial is the part along its axis (climbing is positive: air comes through the
disc against the thrust), v_inplane the rest. With x the command or the speed of rotation,

    T = (rho / 1.225) (T0 + T1 x + T2 x^2 - inflow x v_axial + translational |v_inplane|^2)
    H = -(rho / 1.225) (drag x + drag_inflow v_axial) v_inplane

Where the radius of the discs is given, the air that a disc itself draws through, v_i, joins v_axial in both lines. It
follows from the momentum that the thrust takes (Glauert's hypothesis, A the area of the disc):

    T = 2 rho A v_i sqrt(v_inplane^2 + (v_axial + v_i)^2)

so that one coefficient, inflow, tells both what a climb costs and what forward flight gains; translational is then what
is left. From the solution of axial flight, which has a closed form, one step of the fixed point and one of Newton's
method lead within 0.04 m/s of the solution for climbs from -3 to 12 m/s at up to 20 m/s sideways (0.003 m/s rms; a test
holds this). More steps would only make the equations long.

The terms are those of momentum and blade-element theory to first order in the speed over the tip speed, with
coefficients that a flight can tell. No term divides by a speed, so all holds at hover.

References
----------
Leishman, Principles of Helicopter Aerodynamics, 2nd ed., sections 2.13 (climb), 2.14 (Glauert, Newton's method), 3.5
(forward flight, H-force).
Mahony, Kumar, Corke, Multirotor Aerial Vehicles, IEEE Robotics and Automation Magazine 19(3), 2012 (drag of rotors).
Svacha, Mohta, Kumar, Improving quadrotor trajectory tracking by compensating for aerodynamic effects, ICUAS 2017
(T = k x^2 - k_z x v_z + k_h |v_h|^2).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import sympy as sp

from stoop.vehicle.atmosphere import SEA_LEVEL_DENSITY
from stoop.vehicle.symbolic.component import ZERO, Load, Surroundings
from stoop.vehicle.symbolic.ground_effect import thrust_gain
from stoop.vehicle.symbolic.symbols import Numbers, Vector, add, cross, scale, subtract
from stoop.vehicle.vehicle import slope_input

_STILL: Final = 0.05  #: m/s; keeps roots smooth where no air moves and no thrust is
_STOPPED: Final = 1e-9  #: rad/s; tells rotors that turn from those that stand
_UP: Vector = (sp.Integer(0), sp.Integer(0), sp.Integer(-1))


def commands(n: Numbers, channels: Mapping[str, Any]) -> dict[str, Any]:
    """Return what each rotor is commanded to: x before the lag, never below zero."""
    boost = (
        channels["voltage"] / n["rotors.nominal_voltage"] if "rotors.nominal_voltage" in n else sp.Integer(1)
    )
    out = {}
    for name, rotor in n.vehicle.file.rotor.items():
        raw = n["rotors.gain"] * (channels[rotor.channel] - n["rotors.idle"])
        out[name] = boost * (raw + sp.Abs(raw)) / 2
    return out


def spins(
    n: Numbers, states: Mapping[str, Any], commanded: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return x of each rotor, and the rates of the lag states."""
    if "rotors.lag" not in n:
        return dict(commanded), {}
    now = {name: states[f"{name}.lag"] for name in commanded}
    return now, {name: (commanded[name] - x) / n["rotors.lag"] for name, x in now.items()}


def slopes(n: Numbers, channels: Mapping[str, Any]) -> dict[str, Any]:
    """Return how fast x of each rotor changes where no lag says it: as fast as the recorded channels do."""
    if not n.vehicle.sloped:
        return {}
    nominal = n.get("rotors.nominal_voltage", sp.Integer(1))
    volts, gained = nominal, sp.Integer(0)
    if "rotors.nominal_voltage" in n:
        volts, gained = channels["voltage"], channels[slope_input("voltage")]
    out = {}
    for name, rotor in n.vehicle.file.rotor.items():
        raw = n["rotors.gain"] * (channels[rotor.channel] - n["rotors.idle"])
        turns = (raw + sp.Abs(raw) + _STOPPED) / (2 * sp.Abs(raw) + _STOPPED)  # one, or zero below idle
        faster = n["rotors.gain"] * channels[slope_input(rotor.channel)]
        out[name] = turns * (volts * faster + gained * raw) / nominal
    return out


def _axis(n: Numbers, name: str) -> Vector:
    """Return the unit vector along the thrust of a rotor."""
    if f"rotor.{name}.axis.x" not in n:
        return _UP
    along = n.point(f"rotor.{name}.axis")
    return scale(1 / sp.sqrt(_dot(along, along)), along)


def _dot(a: Vector, b: Vector) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _static(n: Numbers, x: Any) -> Any:
    return n.get("rotors.T0") + n.get("rotors.T1") * x + n.get("rotors.T2") * x * x


def _through(n: Numbers, factor: Any, x: Any, axial: Any, inplane2: Any) -> Any:
    """Return the speed of the air through a disc, m/s: that of the climb, and what the disc draws."""
    if "rotors.radius" not in n:
        return axial
    area = 2 * math.pi * SEA_LEVEL_DENSITY * n["rotors.radius"] ** 2
    given = factor * (_static(n, x) + n.get("rotors.translational") * inplane2) / area
    lost = factor * n.get("rotors.inflow") * x / area
    climbing = sp.sqrt((axial - lost) ** 2 / 4 + (given + sp.Abs(given)) / 2 + _STILL**2) + (axial - lost) / 2
    drawn = (given - lost * axial) / (sp.sqrt(inplane2 + climbing**2 + _STILL**2) + lost)
    through = axial + drawn
    speed = sp.sqrt(inplane2 + through**2 + _STILL**2)
    missing = drawn * speed - given + lost * through
    return through - missing / (speed + drawn * through / speed + lost)


def blade_loads(
    n: Numbers, name: str, x: Any, through: Any, inplane2: Any, density_ratio: Any
) -> tuple[Any, Any, Any]:
    """Return thrust, N, in-plane force over the in-plane speed, N s/m, and torque, N m, of one rotor.

    Parameters
    ----------
    x : command, or speed of rotation in rad/s
    through : speed of the air through the disc along the axis, m/s
    inplane2 : square of the speed in the plane of the disc, m2/s2
    density_ratio : density over that at sea level
    """
    thrust = _static(n, x) - n.get("rotors.inflow") * x * through + n.get("rotors.translational") * inplane2
    if "rotors.torque_ratio" in n:
        torque = n["rotors.torque_ratio"] * thrust
    else:
        torque = n.get("rotors.Q0") + n.get("rotors.Q1") * x + n.get("rotors.Q2") * x * x
    thickness = n.get(f"rotor.{name}.factor", sp.Integer(1)) * density_ratio
    drag = n.get("rotors.drag") * x + n.get("rotors.drag_inflow") * through
    return (
        thickness * thrust,
        thickness * drag,
        n.get(f"rotor.{name}.torque_factor", sp.Integer(1)) * thickness * torque,
    )


def _one(s: Surroundings, name: str) -> Load:
    """Return the load of one rotor."""
    n, x, axis = s.numbers, s.spins[name], _axis(s.numbers, name)
    arm, turns = n.arm(f"rotor.{name}.position"), _turns(s, name)
    velocity = add(s.velocity, cross(s.omega, arm))
    axial = _dot(axis, velocity)
    inplane = subtract(velocity, scale(axial, axis))
    factor = n.get(f"rotor.{name}.factor", sp.Integer(1))
    inplane2 = _dot(inplane, inplane)
    through = _through(n, factor, x, axial, inplane2)
    thrust, drag, torque = blade_loads(n, name, x, through, inplane2, s.density / SEA_LEVEL_DENSITY)
    force = subtract(scale(thrust * thrust_gain(n, s.channels), axis), scale(drag, inplane))
    moment = add(cross(arm, force), scale(-turns * torque, axis))
    return Load(force, add(moment, _reaction(s, name, scale(turns, axis))))


def _turns(s: Surroundings, name: str) -> int:
    """Return +1 for a rotor that turns about its axis by the right hand (counterclockwise from its tip)."""
    return 1 if s.numbers.vehicle.file.rotor[name].spin == "ccw" else -1


def _reaction(s: Surroundings, name: str, about: Vector) -> Vector:
    """Return what changes of the rotor's angular momentum take from the body: spin-up and gyroscopic moment, N m."""
    n = s.numbers
    if "rotors.inertia" not in n:
        return ZERO
    momentum = scale(n["rotors.inertia"] * s.spins[name], about)
    gained = scale(n["rotors.inertia"] * s.spin_rates.get(name, sp.Integer(0)), about)
    return scale(sp.Integer(-1), add(gained, cross(s.omega, momentum)))


def rotors(s: Surroundings) -> Load:
    """Return the sum over all rotors."""
    total = Load(ZERO, ZERO)
    for name in s.numbers.vehicle.rotors:
        total = total + _one(s, name)
    return total


def body_drag(s: Surroundings) -> Load:
    """Return what opposes the motion of the body through the air, each axis for itself."""
    return body_resistance(s.numbers, s.velocity, s.omega)


def body_resistance(n: Numbers, velocity: Vector, omega: Vector) -> Load:
    """Return -(linear v + quadratic |v| v) and -(rotation omega), each per body axis."""
    linear, quadratic, turning = (
        n.point(f"body_drag.{part}") for part in ("linear", "quadratic", "rotation")
    )
    x, y, z = (-(a * v + b * sp.Abs(v) * v) for a, b, v in zip(linear, quadratic, velocity, strict=True))
    p, q, r = (-c * w for c, w in zip(turning, omega, strict=True))
    return Load((x, y, z), (p, q, r))
