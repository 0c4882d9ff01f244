"""The equations of a vehicle in SymPy, from which kernel, derivatives and LaTeX are printed.

Reduced models follow by substitution in the same equations: of constants, or, where a record supplies the states that they
leave out, of inputs (equation decoupling; Jategaonkar, Flight Vehicle System Identification, 2nd ed., section 9.5).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import sympy as sp

from stoop.base.variables import EULER
from stoop.kernels import SymbolicModel
from stoop.vehicle.atmosphere import polynomial_density
from stoop.vehicle.channels import AIR_FRAME, GROUND_FRAME, RIGID_STATES, Frame, motion_input, slope_input
from stoop.vehicle.symbolic import frames
from stoop.vehicle.symbolic.forces import Surroundings, lagged, spins, total
from stoop.vehicle.symbolic.frames import Air, Attitude, Numbers, Quaternion, Vector, add, cross, scale
from stoop.vehicle.symbolic.latex import equations
from stoop.vehicle.vehicle import Vehicle

_ZERO_STATES = {"full": (), "longitudinal": ("v", "p", "r", "e1", "e3"), "lateral": ("q",)}
_CONSTANT_STATES = {"full": (), "longitudinal": (), "lateral": ("u", "w", "q", "h")}


def _flow_angles(n: Numbers, s: Surroundings, e: Quaternion, velocity: Vector) -> dict[str, Any]:
    return frames.air_data(n, e, s.velocity, s.omega, s.air.V)


def _ground_velocity(n: Numbers, s: Surroundings, e: Quaternion, velocity: Vector) -> dict[str, Any]:
    return dict(zip(("vn", "ve", "vd"), frames.over_ground(e, velocity), strict=True))


@dataclass(frozen=True)
class _FrameEquations:
    """Equations that depend on the frame of the observations."""

    air: Callable[[Vector], Air]
    gust: Callable[[Quaternion, Vector], Vector]  #: from its own axes to those of the body
    observed: Callable[[Numbers, Surroundings, Quaternion, Vector], dict[str, Any]]  #: velocity, by channel


_FRAMES: dict[Frame, _FrameEquations] = {
    AIR_FRAME: _FrameEquations(frames.air, lambda _, gust: gust, _flow_angles),
    GROUND_FRAME: _FrameEquations(frames.slow_air, frames.to_body, _ground_velocity),
}


def build_model(vehicle: Vehicle) -> SymbolicModel:
    """Return the equations of a vehicle, reduced as its file says.

    The longitudinal model sets v = p = r = phi = psi = 0; the lateral one keeps u, w, h at their initial values and q
    at zero. What the vehicle takes from a record is an input instead, and h follows.
    """
    n = Numbers(vehicle)
    u = {c: sp.Symbol(f"input {c}", real=True) for c in vehicle.inputs}
    names = dict.fromkeys((*RIGID_STATES, *vehicle.states))
    x = {s: u.get(motion_input(s), sp.Symbol(f"state {s}", real=True)) for s in names}
    rates, outputs = _motion(n, x, u)
    zero = {x[s]: sp.Integer(0) for s in _ZERO_STATES[vehicle.reduce] if motion_input(s) not in u}
    constant = () if vehicle.motion else _CONSTANT_STATES[vehicle.reduce]
    move = {name: sp.Symbol(f"move {name}", real=True) for name in vehicle.moves}
    return SymbolicModel(
        states=tuple(x[s] for s in vehicle.states),
        inputs=tuple(u[c] for c in vehicle.inputs),
        held=tuple(vehicle.inputs.index(slope_input(c)) for c in vehicle.sloped),
        parameters=n.symbols,
        derivatives=tuple(sp.Integer(0) if s in constant else rates[s].subs(zero) for s in vehicle.states),
        outputs=tuple(sp.sympify(outputs[c]).subs(zero) for c in vehicle.outputs),
        output_names=vehicle.outputs,
        wrapped=tuple(c in ("phi", "psi") for c in vehicle.outputs),
        moves=tuple(move.values()),
        moved=_retraction(vehicle, {s: x[s].subs(zero) for s in vehicle.states}, move),
        latex=equations(vehicle),
    )


def airflow(vehicle: Vehicle, velocity: Vector) -> Air:
    """Return the motion through the air of a vehicle, for a velocity along its axes, as its equations have it."""
    return _FRAMES[vehicle.frame].air(velocity)


def flow_angles() -> SymbolicModel:
    """Return airspeed, angle of attack and sideslip as readings of the velocity along the body axes."""
    velocity = sp.symbols("u v w", real=True)
    flow = frames.air(velocity)
    return _readings(velocity, {"V": flow.V, "alpha": flow.alpha, "beta": flow.beta})


def euler_angles() -> SymbolicModel:
    """Return the Euler angles as readings of the quaternion."""
    quaternion = sp.symbols("e0 e1 e2 e3", real=True)
    turned = frames.attitude(quaternion)
    return _readings(quaternion, {"phi": turned.phi, "theta": turned.theta, "psi": turned.psi})


def _readings(states: tuple[Any, ...], outputs: Mapping[str, Any]) -> SymbolicModel:
    return SymbolicModel(states, (), (), (), tuple(outputs.values()), tuple(outputs), (False,) * len(outputs))


def _motion(n: Numbers, x: Mapping[str, Any], u: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the rates of the states and the readings of the instruments, eqs. (1) and (2)."""
    vehicle, frame = n.vehicle, _FRAMES[n.vehicle.frame]
    velocity: Vector = (x["u"], x["v"], x["w"])
    omega: Vector = (x["p"], x["q"], x["r"])
    e = (x["e0"], x["e1"], x["e2"], x["e3"])
    flight = velocity
    if vehicle.gusts:
        flight = frames.subtract(velocity, frame.gust(e, frames.gust(n, x)))
    turned, turn = _attitude(n.vehicle, e, u, omega)
    choice = vehicle.file.environment.density
    if choice == "log":
        density = u["density"]
    else:
        density = polynomial_density(x["h"]) if choice == "standard" else n["environment.density"]
    deflections, lag_rates = _deflections(n, x, u)
    spin, spin_rates, rotor_lag_rates = spins(n, x, u)
    s = Surroundings(n, airflow(vehicle, flight), density, omega, deflections, u, flight, spin, spin_rates)
    load = total(s)

    # Newton and Euler for a rigid body of constant mass, flat Earth
    specific = scale(1 / n["mass.mass"], load.force)
    acceleration = frames.body_acceleration(specific, n["environment.gravity"], turned.down, velocity, omega)
    omega_rate = _angular_acceleration(n, load.moment, omega)
    climb = -sum(d * v for d, v in zip(turned.down, velocity, strict=True))
    rigid = [*acceleration, *omega_rate, *frames.quaternion_rate(e, turn), climb]
    rates = dict(zip(RIGID_STATES, rigid, strict=True)) | lag_rates | rotor_lag_rates
    rates |= frames.gust_rates(n, x, u)
    placed = vehicle.positions
    rates |= dict(zip(placed, frames.over_ground(e, velocity), strict=True)) if placed else {}
    observed = frame.observed(n, s, e, velocity) | {c: x[c] for c in placed}
    return rates, readings(n, observed, turned, specific, omega, omega_rate)


def _attitude(
    vehicle: Vehicle, e: Quaternion, u: Mapping[str, Any], omega: Vector
) -> tuple[Attitude, Vector]:
    """Return the attitude, and the rates about the body axes that turn the quaternion.

    Where motion is measured, the quaternion holds the modeled angles only, the held ones at zero: sine and cosine of these
    are inputs. It turns as its own angles change.
    """
    own = frames.attitude(e)
    if not vehicle.motion:
        return own, omega
    cosine = own.down[2]  # of phi without theta, or of theta without phi
    sines = {"phi": (own.down[1], cosine), "theta": (-own.down[0], cosine)}
    level, held = (sp.Integer(0), sp.Integer(1)), set(sines) - set(vehicle.modeled_angles)
    modeled = {a: level if a in held else pair for a, pair in sines.items()}
    whole = {
        a: (u.get(motion_input(f"sin_{a}"), modeled[a][0]), u.get(motion_input(f"cos_{a}"), modeled[a][1]))
        for a in sines
    }
    (sin_phi, cos_phi), (sin_theta, cos_theta) = whole["phi"], whole["theta"]
    down = (-sin_theta, sin_phi * cos_theta, cos_phi * cos_theta)
    rates = frames.euler_rates(omega, *whole.values())
    turning = zip(EULER, rates, strict=True)
    kept = [rate if a in vehicle.modeled_angles else sp.Integer(0) for a, rate in turning]
    return Attitude(down, own.phi, own.theta, own.psi), frames.body_rates(kept, *modeled.values())


def readings(
    n: Numbers,
    observed: Mapping[str, Any],
    turned: Attitude,
    specific: Vector,
    omega: Vector,
    omega_rate: Vector,
) -> dict[str, Any]:
    """Return the readings of the instruments, eq. (2) with positions, alignment, scales and biases.

    `observed` is the velocity by channel, `specific` the specific force at the center of gravity, m/s2.
    """
    arm = n.arm("sensors.accelerometer_position")
    if arm != (0, 0, 0):
        specific = add(specific, add(cross(omega_rate, arm), cross(omega, cross(omega, arm))))
    truth = {
        **observed,
        **dict(zip("pqr", frames.along_imu(n, omega), strict=True)),
        "phi": turned.phi,
        "theta": turned.theta,
        "psi": turned.psi,
        **dict(zip(("ax", "ay", "az"), frames.along_imu(n, specific), strict=True)),
    }
    return {c: n.get(f"sensors.{c}.scale", 1) * t + n[f"sensors.{c}.bias"] for c, t in truth.items()}


def _deflections(
    n: Numbers, x: Mapping[str, Any], u: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the deflection of each control, rad (calibration, mixer and lag), and the rates of the lag states."""
    deflections, rates = {}, {}
    for control in n.vehicle.controls:
        base, mix = f"controls.{control}", n.vehicle.file.controls[control].mix
        mixed = u.get(control)
        if mix is not None:
            mixed = sum(n[f"{base}.mix.{c}"] * (u[c] - n.get(f"{base}.center.{c}")) for c in mix)
        deflections[control] = mixed + n.get(f"{base}.offset")
        lag = f"{control}.lag"
        if lag in x:
            deflections[control], rates[lag] = lagged(x[lag], deflections[control], n[f"{base}.lag"])
    return deflections, rates


def _angular_acceleration(n: Numbers, moment: Vector, omega: Vector) -> Vector:
    """Return I^-1 (M - omega x I omega), rad/s2, as a quadratic form in the rates.

    The coefficients of the quadratic form depend on the inertia alone, so the compiler takes them out of the time loop.
    """
    axes = ("xx", "yy", "zz", "xz", "xy", "yz")
    xx, yy, zz, xz, xy, yz = (n.get(f"mass.inertia.{a}") for a in axes)
    inertia = sp.Matrix([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])
    gyroscopic = inertia.adjugate() * sp.Matrix(omega).cross(inertia * sp.Matrix(omega))
    quadratic = []
    for row in gyroscopic:
        out = sp.Integer(0)
        for powers, coefficient in sp.Poly(sp.expand(row), *omega).terms():
            product = sp.Mul(*(w**k for w, k in zip(omega, powers, strict=True)))
            out += (coefficient / inertia.det()) * product
        quadratic.append(out)
    driven = (inertia.adjugate() / inertia.det()) * sp.Matrix(moment)
    return driven[0] - quadratic[0], driven[1] - quadratic[1], driven[2] - quadratic[2]


def _retraction(vehicle: Vehicle, states: Mapping[str, Any], moves: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return every state after a small correction by a filter.

    The attitude is corrected by three small rotations about the body axes (e + e x delta / 2, then back to unit length),
    which does not depend on the heading; other states by addition. Altitude is not corrected, because next to nothing
    that is measured depends on it; nor are the states that a reduced model keeps constant.
    """
    zero = sp.Integer(0)
    e = (states.get("e0", zero), states.get("e1", zero), states.get("e2", zero), states.get("e3", zero))
    turn = tuple(moves.get(f"turn {axis}", zero) for axis in EULER)
    if vehicle.motion and "psi" in vehicle.modeled_angles:  # about the vertical, so that theta stays zero
        down = frames.attitude(e).down
        turn = (turn[0], down[1] * turn[2], down[2] * turn[2])
    turned = [a + b for a, b in zip(e, frames.quaternion_rate(e, turn), strict=True)]
    length2 = sum((a * a for a in turned), zero)
    after = {f"e{i}": a * (sp.Rational(3, 2) - length2 / 2) for i, a in enumerate(turned)}
    after |= {name: states[name] + moves[name] for name in moves if name in states}
    return tuple(after.get(name, states[name]) for name in vehicle.states)
