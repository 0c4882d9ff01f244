"""Forces and moments about the center of gravity, body axes; a vehicle is the sum of its components.

Of a rotor's speed through the air, v_axial is the part along its axis (positive in climb: air comes through the disc
against the thrust), v_inplane the rest. With x the command or the speed of rotation,

    T = (rho / 1.225) (T0 + T1 x + T2 x^2 - inflow x v_axial + translational |v_inplane|^2)
    H = -(rho / 1.225) (drag x + drag_inflow v_axial) v_inplane

Where the radius of the discs is given, the induced velocity v_i adds to v_axial in both lines. It follows from the
momentum of the thrust (Glauert's hypothesis, A the area of the disc):

    T = 2 rho A v_i sqrt(v_inplane^2 + (v_axial + v_i)^2)

so that one coefficient, inflow, gives both the loss of a climb and the gain of forward flight; translational is the
remainder. From the solution of axial flight, which has a closed form, one step of the fixed point and one of Newton's
method lead within 0.04 m/s of the solution for climbs from -3 to 12 m/s at up to 20 m/s sideways (0.003 m/s rms; a test
holds this).

The terms are those of momentum and blade-element theory to first order in the speed over the tip speed, with
identifiable coefficients. No term divides by a speed, so all holds at hover.

References
----------
Leishman, Principles of Helicopter Aerodynamics, 2nd ed., sections 2.13 (climb), 2.14 (Glauert, Newton's method), 3.5
(forward flight, H-force).
Mahony, Kumar, Corke, Multirotor Aerial Vehicles, IEEE Robotics and Automation Magazine 19(3), 2012 (drag of rotors).
Svacha, Mohta, Kumar, Improving quadrotor trajectory tracking by compensating for aerodynamic effects, ICUAS 2017
(T = k x^2 - k_z x v_z + k_h |v_h|^2).
Cheeseman and Bennett (1955), ARC R&M 3021, eq. (5): T / T_free = 1 / (1 - (R/4z)^2) at constant power in hover.
McCormick, Aerodynamics, Aeronautics and Flight Mechanics, 2nd ed., eq. (7.7): influence (16 z/b)^2 / (1 + (16 z/b)^2)
of the ground on what trailing vortices induce.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import sympy as sp

from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.vehicle import terms
from stoop.vehicle.channels import slope_input
from stoop.vehicle.defaults import COEFFICIENTS, MOMENT_ARMS, SHORTEST_LAG
from stoop.vehicle.schema import Propeller
from stoop.vehicle.symbolic.frames import (
    ZERO,
    Air,
    Numbers,
    Vector,
    add,
    cosine_and_sine,
    cross,
    dot,
    scale,
    subtract,
)
from stoop.vehicle.vehicle import Vehicle

_STILL: Final = 0.05  #: m/s; keeps roots smooth at rest without thrust
_STOPPED: Final = 1e-9  #: rad/s; separates rotors that turn from those at rest
_ONE: Final = sp.Integer(1)


@dataclass(frozen=True)
class Surroundings:
    """Motion, air and inputs that loads depend on."""

    numbers: Numbers
    air: Air
    density: Any
    omega: Vector
    deflections: Mapping[str, Any]  #: rad per control
    channels: Mapping[str, Any]  #: recorded channels
    velocity: Vector = ZERO  #: of the body through the air, m/s
    spins: Mapping[str, Any] = field(default_factory=dict)  #: x per rotor: its command, or rad/s
    spin_rates: Mapping[str, Any] = field(default_factory=dict)  #: per s; empty for rotors without inertia


@dataclass(frozen=True)
class Load:
    """A force, N, and its moment about the center of gravity, N m."""

    force: Vector
    moment: Vector

    def __add__(self, other: Load) -> Load:
        return Load(add(self.force, other.force), add(self.moment, other.moment))


def total(s: Surroundings) -> Load:
    """Return the sum over all components."""
    return aerodynamics(s) + propulsion(s) + rotors(s) + body_resistance(s.numbers, s.velocity, s.omega)


def term_variables(s: Surroundings) -> dict[str, Any]:
    """Return the variables of aerodynamic terms, eq. (1): Delta alpha, beta, rates, speed, controls."""
    actual = s.numbers.vehicle.actual_rates
    flow = terms.values(s.numbers.__getitem__, actual, s.air.V, s.air.alpha, s.air.beta, s.omega)
    return {**flow, **s.deflections}


def aerodynamics(s: Surroundings) -> Load:
    """Return aerodynamic force (the rotation of eq. 2) and moment about the center of gravity."""
    if s.numbers.vehicle.file.reference is None:
        return Load(ZERO, ZERO)
    n, a, known = s.numbers, s.air, term_variables(s)
    c = {c: sp.Integer(0) for c in COEFFICIENTS}  # sums of terms, eq. (1) and those of the file
    for coefficient, group in n.vehicle.terms.items():
        for name, text in group.items():
            c[coefficient] += n[name] * terms.convert(terms.parse(text, known, name), known)
    c["CL"] *= lift_gain(n, s.channels)
    pressure_area = s.density / 2 * n["reference.area"] * a.V2 * a.attached
    drag_and_side = c["CD"] * a.cos_beta + c["CQ"] * a.sin_beta
    x = c["CL"] * a.sin_alpha - drag_and_side * a.cos_alpha
    y = c["CQ"] * a.cos_beta - c["CD"] * a.sin_beta
    z = -c["CL"] * a.cos_alpha - drag_and_side * a.sin_alpha
    force = scale(pressure_area, (x, y, z))
    roll, pitch, yaw = (
        relative_inertia(n.vehicle, n.__getitem__, axis) * n[f"reference.{length}"] * c[name]
        for name, (length, axis) in MOMENT_ARMS.items()
    )
    moment = scale(pressure_area, (roll, pitch, yaw))
    return Load(force, add(moment, cross(n.arm("reference.moment_point"), force)))


def relative_inertia(vehicle: Vehicle, number: Callable[[str], Any], axis: str) -> Any:
    """Return the moment of inertia over that for which moment coefficients about an axis hold; 1 where the file names none.

    A flight shows moments over moments of inertia. Coefficients that hold for a stated inertia are that ratio, so an inertia that
    is only guessed leaves them alone, and their priors do not draw it.
    """
    reference = f"reference.inertia.{axis}"
    return number(f"mass.inertia.{axis}{axis}") / number(reference) if reference in vehicle.rows else 1


def thrust(s: Surroundings) -> Any:
    """Return the thrust, N; a propeller's is a quadratic form in n and V/D, which has no division by a speed."""
    n, file = s.numbers, s.numbers.vehicle.file.propulsion
    if file is None:
        return sp.Integer(0)
    if file.kind == "constant":
        return n["propulsion.thrust"]
    if not isinstance(file, Propeller):
        return n["propulsion.scale"] * s.channels[file.channel]
    speed = _propeller_speed(s, file)
    advance = s.air.V / n["propulsion.diameter"]
    form = n["propulsion.CT0"] * speed**2 + n.get("propulsion.CT1") * speed * advance
    return s.density * n["propulsion.diameter"] ** 4 * (form + n.get("propulsion.CT2") * advance**2)


def _propeller_speed(s: Surroundings, file: Propeller) -> Any:
    """Return the speed of the propeller, rev/s; never below zero."""
    raw = s.numbers["propulsion.speed_gain"] * (s.channels[file.channel] - s.numbers["propulsion.idle"])
    return (raw + sp.Abs(raw)) / 2


def propulsion(s: Surroundings) -> Load:
    """Return thrust along its line, and the gyroscopic moment of a propeller with a moment of inertia."""
    n, magnitude, file = s.numbers, thrust(s), s.numbers.vehicle.file.propulsion
    if magnitude == 0:
        return Load(ZERO, ZERO)
    line: Vector = (sp.Integer(1), sp.Integer(0), sp.Integer(0))
    if "propulsion.pitch" in n:
        cosine, sine = cosine_and_sine(n["propulsion.pitch"])
        line = (cosine, sp.Integer(0), -sine)
    force = scale(magnitude, line)
    moment = cross(n.arm("propulsion.position"), force)
    if isinstance(file, Propeller) and file.inertia is not None:
        momentum = scale(2 * math.pi * n["propulsion.inertia"] * _propeller_speed(s, file), line)
        moment = subtract(moment, cross(s.omega, momentum))
    return Load(force, moment)


def rotor_commands(n: Numbers, channels: Mapping[str, Any]) -> dict[str, Any]:
    """Return the commanded x of each rotor, before the lag; never below zero."""
    boost = channels["voltage"] / n["rotors.nominal_voltage"] if "rotors.nominal_voltage" in n else _ONE
    out = {}
    for name, rotor in n.vehicle.file.rotor.items():
        raw = n["rotors.gain"] * (channels[rotor.channel] - n["rotors.idle"])
        out[name] = boost * (raw + sp.Abs(raw)) / 2
    return out


def lagged(position: Any, command: Any, lag: Any) -> tuple[Any, Any]:
    """Return what a first-order lag makes of a command, and the rate of its state, `position`.

    A lag shorter than T = `SHORTEST_LAG` is taken as (1 + a s) / (1 + (a + lag) s) with a = (T - lag)^2 / 2T: nothing for no
    lag, the same to first order in s, smooth in the lag, and not faster than the integration, whose steps a lag of zero has not.
    """
    short = (SHORTEST_LAG - lag + sp.Abs(SHORTEST_LAG - lag)) / 2
    ahead = short * short / (2 * SHORTEST_LAG)
    behind = command - position
    return position + ahead / (ahead + lag) * behind, behind / (ahead + lag)


def spins(
    n: Numbers, states: Mapping[str, Any], channels: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Return x of each rotor, its rate where that acts on the body, and the rates of the lag states.

    Without a lag the rate is that of the recorded channels.
    """
    commands = rotor_commands(n, channels)
    if "rotors.lag" in n:
        moved = {r: lagged(states[f"{r}.lag"], x, n["rotors.lag"]) for r, x in commands.items()}
        rates = {name: rate for name, (_, rate) in moved.items()}
        lags = {f"{name}.lag": x for name, x in rates.items()}
        return {name: x for name, (x, _) in moved.items()}, rates, lags
    rates = {}
    if n.vehicle.sloped:
        nominal = n.get("rotors.nominal_voltage", _ONE)
        volts, volts_rate = nominal, sp.Integer(0)
        if "rotors.nominal_voltage" in n:
            volts, volts_rate = channels["voltage"], channels[slope_input("voltage")]
        for name, rotor in n.vehicle.file.rotor.items():
            raw = n["rotors.gain"] * (channels[rotor.channel] - n["rotors.idle"])
            turns = (raw + sp.Abs(raw) + _STOPPED) / (2 * sp.Abs(raw) + _STOPPED)  # one, or zero below idle
            raw_rate = n["rotors.gain"] * channels[slope_input(rotor.channel)]
            rates[name] = turns * (volts * raw_rate + volts_rate * raw) / nominal
    return commands, rates, {}


def _static_thrust(n: Numbers, x: Any) -> Any:
    return n.get("rotors.T0") + n.get("rotors.T1") * x + n.get("rotors.T2") * x * x


def _through(n: Numbers, factor: Any, x: Any, axial: Any, inplane2: Any) -> Any:
    """Return the speed of the air through a disc, m/s: climb and induced velocity."""
    if "rotors.radius" not in n:
        return axial
    area = 2 * math.pi * SEA_LEVEL_DENSITY * n["rotors.radius"] ** 2
    given = factor * (_static_thrust(n, x) + n.get("rotors.translational") * inplane2) / area
    lost = factor * n.get("rotors.inflow") * x / area
    climbing = sp.sqrt((axial - lost) ** 2 / 4 + (given + sp.Abs(given)) / 2 + _STILL**2) + (axial - lost) / 2
    induced = (given - lost * axial) / (sp.sqrt(inplane2 + climbing**2 + _STILL**2) + lost)
    through = axial + induced
    speed = sp.sqrt(inplane2 + through**2 + _STILL**2)
    missing = induced * speed - given + lost * through
    return through - missing / (speed + induced * through / speed + lost)


def blade_loads(
    n: Numbers, name: str, x: Any, through: Any, inplane2: Any, density_ratio: Any
) -> tuple[Any, Any, Any]:
    """Return thrust, N, in-plane force over the in-plane speed, N s/m, and torque, N m, of one rotor.

    `through` is the speed of the air through the disc along the axis, m/s, `inplane2` the square of that in its plane.
    """
    load = _static_thrust(n, x) - n.get("rotors.inflow") * x * through
    load += n.get("rotors.translational") * inplane2
    if "rotors.torque_ratio" in n:
        torque = n["rotors.torque_ratio"] * load
    else:
        torque = n.get("rotors.Q0") + n.get("rotors.Q1") * x + n.get("rotors.Q2") * x * x
    factor = n.get(f"rotor.{name}.factor", _ONE) * density_ratio
    drag = n.get("rotors.drag") * x + n.get("rotors.drag_inflow") * through
    return factor * load, factor * drag, n.get(f"rotor.{name}.torque_factor", _ONE) * factor * torque


def rotors(s: Surroundings) -> Load:
    """Return the sum over all rotors."""
    n, out = s.numbers, Load(ZERO, ZERO)
    for name, rotor in n.vehicle.file.rotor.items():
        x, axis = s.spins[name], (sp.Integer(0), sp.Integer(0), sp.Integer(-1))
        if f"rotor.{name}.axis.x" in n:
            along = n.point(f"rotor.{name}.axis")
            axis = scale(1 / sp.sqrt(dot(along, along)), along)
        turns = 1 if rotor.spin == "ccw" else -1  # about its axis by the right hand
        arm = n.arm(f"rotor.{name}.position")
        velocity = add(s.velocity, cross(s.omega, arm))
        axial = dot(axis, velocity)
        inplane = subtract(velocity, scale(axial, axis))
        inplane2 = dot(inplane, inplane)
        through = _through(n, n.get(f"rotor.{name}.factor", _ONE), x, axial, inplane2)
        lift, drag, torque = blade_loads(n, name, x, through, inplane2, s.density / SEA_LEVEL_DENSITY)
        force = subtract(scale(lift * thrust_gain(n, s.channels), axis), scale(drag, inplane))
        moment = add(cross(arm, force), scale(-turns * torque, axis))
        if "rotors.inertia" in n:  # reaction to spin-up, and the gyroscopic moment
            about = scale(turns, axis)
            momentum = scale(n["rotors.inertia"] * x, about)
            gained = scale(n["rotors.inertia"] * s.spin_rates.get(name, sp.Integer(0)), about)
            moment = add(moment, scale(sp.Integer(-1), add(gained, cross(s.omega, momentum))))
        out = out + Load(force, moment)
    return out


def body_resistance(n: Numbers, velocity: Vector, omega: Vector) -> Load:
    """Return -(linear v + quadratic |v| v) and -(rotation omega), each per body axis."""
    parts = ("linear", "quadratic", "rotation")
    linear, quadratic, rotation = (n.point(f"body_drag.{part}") for part in parts)
    x, y, z = (-(a * v + b * sp.Abs(v) * v) for a, b, v in zip(linear, quadratic, velocity, strict=True))
    p, q, r = (-c * w for c, w in zip(rotation, omega, strict=True))
    return Load((x, y, z), (p, q, r))


def thrust_gain(n: Numbers, channels: Mapping[str, Any]) -> Any:
    """Return thrust over that out of ground effect, bounded as the height goes to zero."""
    table = n.vehicle.file.ground_effect
    if table is None or table.rotor is None:
        return _ONE
    radius = n["ground_effect.radius" if table.radius is not None else "rotors.radius"]
    quarter2 = (radius / 4) ** 2
    return 1 + n["ground_effect.rotor"] * quarter2 / (channels[table.channel] ** 2 + quarter2)


def lift_gain(n: Numbers, channels: Mapping[str, Any]) -> Any:
    """Return CL over that out of ground effect."""
    table = n.vehicle.file.ground_effect
    if table is None or table.lift is None:
        return _ONE
    return 1 + n["ground_effect.lift"] / (1 + (16 * channels[table.channel] / n["reference.span"]) ** 2)
