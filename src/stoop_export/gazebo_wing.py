"""The wing of Gazebo: coefficients of AdvancedLiftDrag, matched to first order about a steady flight on wings.

What motors and damping leave of the loads is taken as a function of the flow at cp, the rates and the joint angles at constant
U, made nondimensional as Gazebo does, and differentiated by central differences. The drag over the flown angles of attack is
fitted by CD0 + k CL^2 through that of the steady flight. cp lies where the pitching moment has no slope by alpha.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop import Vehicle
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import SimulationError
from stoop.extend.motion import Trim
from stoop.extend.vehicles import terms
from stoop_export.agreement import body_loads
from stoop_export.autopilot_outputs import FULL_DEFLECTION, full_deflection
from stoop_export.gazebo_plugins import (
    CONSTANT_JOINT_ANGLE,
    EFFECTS,
    Damping,
    Motor,
    Surface,
    Vector,
    Wing,
    damping_loads,
    motor_loads,
)

STALL_MARGIN: Final = 0.9  #: rad from the flown angles of attack to the stall; the sigmoid is then below 2e-6
DEFAULT_ALPHA_RANGE: Final = 0.1  #: rad, of angles of attack about a steady flight that is all that is known
ROUNDING: Final = 1e-9  #: of coefficients; smaller ones are errors of the differences
STEP: Final = 1e-4  #: of central differences; rad, and 1 of nondimensional rates
_FLOW: Final = ("a", "b", "p", "q", "r")


def settled_loads(
    vehicle: Vehicle, point: Trim, inputs: FloatArray, moved: Mapping[str, FloatArray] | None = None,
    changes: Mapping[str, float] | None = None,
) -> FloatArray:  # fmt: skip
    """Return the loads (6, B) of a steady flight with other inputs (n_u, B), lags settled, states moved, numbers changed."""
    rows = vehicle.parameter_rows({**point.changes, **(changes or {})}, inputs.shape[1])
    states = vehicle.initial_states(point.start, rows, inputs)
    for name, values in (moved or {}).items():
        states[vehicle.states.index(name)] = values
    return body_loads(vehicle, rows, states, inputs)


def vector(x: FloatArray) -> Vector:
    """Return an array (3,) as plain numbers."""
    a, b, c = (float(v) + 0.0 for v in x)
    return a, b, c


def _joints(vehicle: Vehicle) -> tuple[Surface, ...]:
    """Return a joint per channel of the surfaces, its effects still open."""
    neutral, out = vehicle.neutral_inputs(), list[Surface]()
    channels = dict.fromkeys(c for name in vehicle.controls for c in vehicle.channels_of(name))
    for channel in channels:
        users = [c for c in vehicle.controls if channel in vehicle.channels_of(c)]
        gains = [vehicle.value(f"controls.{c}.mix.{channel}", 1.0) for c in users]
        gain = max(map(abs, gains))
        lag = float(np.mean([vehicle.value(f"controls.{c}.lag", 0.0) for c in users]))
        middle = float(neutral[vehicle.inputs.index(channel)])
        limit = abs(full_deflection(channel, gain, middle) or FULL_DEFLECTION)
        out.append(Surface(f"servo_{len(out)}", channel, gain, middle, max(lag, 0.0), limit, {}))
    return tuple(out)


@dataclass(frozen=True, eq=False)
class _Body:
    """What motors and damping leave of the loads, as coefficients of Gazebo by the flow at a point cp."""

    vehicle: Vehicle
    cruise: Trim
    motors: tuple[Motor, ...]
    damping: Damping | None
    joints: tuple[Surface, ...]
    U: float
    density: float

    def coefficients(self, cp: FloatArray, flow: FloatArray, joints: FloatArray) -> FloatArray:
        """Return :data:`EFFECTS` (6, B) for alpha, beta and nondimensional rates (5, B) and joint angles (n, B), rad."""
        vehicle, count = self.vehicle, flow.shape[1]
        alpha, beta, *rates = flow
        area, span, chord = (vehicle.value(f"reference.{n}") for n in ("area", "span", "chord"))
        omega = (
            np.array(rates)
            * np.array([2.0 * self.U / span, 2.0 * self.U / chord, 2.0 * self.U / span])[:, None]
        )
        u, w = self.U * np.cos(alpha), self.U * np.sin(alpha)
        velocity = np.array([u, u * np.tan(beta), w]) - np.cross(omega, cp[:, None], axis=0)
        inputs = np.repeat(self.cruise.inputs[:, None], count, axis=1)
        for joint, angle in zip(self.joints, joints, strict=True):
            inputs[vehicle.inputs.index(joint.channel)] = joint.neutral + angle / joint.gain
        moved = dict(zip("uvwpqr", [*velocity, *omega], strict=True))
        found = settled_loads(vehicle, self.cruise, inputs, moved)
        speeds = [m.command(dict(zip(vehicle.inputs, self.cruise.inputs, strict=True))) for m in self.motors]
        for i in range(count):
            motion = velocity[:, i].tolist(), omega[:, i].tolist()
            found[:, i] -= motor_loads(self.motors, speeds, *motion)
            if self.damping is not None:
                found[:, i] -= damping_loads(self.damping, *motion)
        moment = found[3:] - np.cross(cp[:, None], found[:3], axis=0)
        X, Y, Z = found[:3] / (0.5 * self.density * self.U**2 * area)
        roll, pitch, yaw = moment / (0.5 * self.density * self.U**2 * area)
        cosine, sine = np.cos(alpha), np.sin(alpha)
        drag, lift = -X * cosine - Z * sine, X * sine - Z * cosine
        return np.array([drag, Y, lift, roll / span, pitch / chord, yaw / span])


def wing_of(
    vehicle: Vehicle,
    cruise: Trim,
    motors: tuple[Motor, ...],
    damping: Damping | None,
    alphas: tuple[float, float] | None,
) -> Wing:
    """Return the wing: coefficients at the steady flight, drag over a range of angles of attack."""
    rows = vehicle.parameter_rows(cruise.changes)
    begin = vehicle.initial_states(cruise.start, rows, cruise.inputs)[:, 0]
    u, v, w = (float(begin[vehicle.states.index(a)]) for a in "uvw")
    flow = np.array([math.atan2(w, u), math.atan2(v, u), 0.0, 0.0, 0.0])
    density = cruise.density(vehicle)
    joints = _joints(vehicle)
    body = _Body(vehicle, cruise, motors, damping, joints, math.hypot(u, w), density)
    stand = {j.channel: float(cruise.inputs[vehicle.inputs.index(j.channel or "")]) for j in joints}
    angles = np.array([j.gain * (stand[j.channel] - j.neutral) for j in joints])
    point = np.concatenate([flow, angles])

    def slopes(cp: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return coefficients (6,) at the steady flight and their derivatives (6, 5 + n) by flow and joints."""
        steps = STEP * np.hstack([np.zeros((len(point), 1)), np.eye(len(point)), -np.eye(len(point))])
        at = point[:, None] + steps
        found = body.coefficients(cp, at[:5], at[5:])
        count = len(point)
        return found[:, 0], (found[:, 1 : count + 1] - found[:, count + 1 :]) / (2.0 * STEP)

    chord, area = vehicle.value("reference.chord"), vehicle.value("reference.area")
    value, by = slopes(np.zeros(3))
    # The slope of the normal force, whose place makes the pitching moment by alpha.
    normal = (
        by[2, 0] * math.cos(flow[0])
        + by[0, 0] * math.sin(flow[0])
        + (value[0] * math.cos(flow[0]) - value[2] * math.sin(flow[0]))
    )
    if not normal > 0.0:
        raise SimulationError(
            f"{vehicle.where}: lift falls with alpha at the steady flight; choose a higher --airspeed"
        )
    cp = np.array([chord * by[4, 0] / normal, 0.0, 0.0])
    value, by = slopes(cp)
    constant = value - by @ point
    low, high = alphas or (flow[0] - DEFAULT_ALPHA_RANGE, flow[0] + DEFAULT_ALPHA_RANGE)
    grid = np.repeat(point[:, None], 41, axis=1)
    grid[0] = np.linspace(min(low, flow[0] - 0.02), max(high, flow[0] + 0.02), 41)
    polar = body.coefficients(cp, grid[:5], grid[5:])
    squares = polar[2] ** 2 - value[2] ** 2
    k = float(squares @ (polar[0] - value[0]) / (squares @ squares))
    k = math.copysign(max(abs(k), 1e-9), k)
    ratio = vehicle.value("reference.span") ** 2 / area
    drag = by[0, 5:] - 2.0 * k * value[2] * by[2, 5:]
    out = {"CL0": constant[2], "CD0": value[0] - k * value[2] ** 2 - drag @ angles}
    for row, name in enumerate(EFFECTS):
        letters = _FLOW if name not in ("CD", "Cem") else _FLOW[2:] if name == "CD" else _FLOW[1:]
        out |= {f"{name}{letter}": by[row, _FLOW.index(letter)] for letter in letters}
    effects = [dict(zip(EFFECTS, by[:, 5 + i].tolist(), strict=True)) for i in range(len(joints))]
    surfaces = [
        Surface(j.name, j.channel, j.gain, j.neutral, j.lag, j.limit,
                {n: math.radians(x) for n, x in {**e, "CD": float(drag[i])}.items()})
        for i, (j, e) in enumerate(zip(joints, effects, strict=True))
    ]  # fmt: skip
    held = {
        n: math.radians(float(x)) / CONSTANT_JOINT_ANGLE
        for n, x in zip(EFFECTS, constant, strict=True)
        if n not in ("CD", "CL")
    }
    surfaces.append(Surface("constants", None, 1.0, 0.0, 0.0, 2.0 * CONSTANT_JOINT_ANGLE, held))
    stall = float(max(abs(low), abs(high), abs(flow[0]))) + STALL_MARGIN
    numbers = {name: float(x) if abs(x) > ROUNDING else 0.0 for name, x in out.items()}
    efficiency = 1.0 / (math.pi * ratio * k)
    return Wing(numbers, vector(cp), area, ratio, chord, efficiency, density, stall, tuple(surfaces))


def sideslip_loads(wing: Wing) -> FloatArray:
    """Return the loads (6,) about the center of gravity over v |u| that a wing has by the sideslip, to first order."""
    c, half = wing.coefficients, 0.5 * wing.density * wing.area
    roll, yaw = wing.span * c["Cellb"], wing.span * c["Cenb"] + wing.cp[0] * c["CYb"]
    return half * np.array([0.0, c["CYb"], 0.0, roll, 0.0, yaw])


def unsupported_wing_terms(vehicle: Vehicle) -> dict[str, float]:
    """Return coefficients of terms that AdvancedLiftDrag holds to first order only, or not at all, and zero for each.

    It holds constants, what is linear in angles, rates and controls, and of the drag what depends on alpha alone.
    """
    out = {"ground_effect.lift": 0.0} if vehicle.value("ground_effect.lift", 0.0) != 0.0 else {}
    linear = {*terms.STATE_VARIABLES, *vehicle.controls} - {"V"}
    for coefficient, group in vehicle.terms.items():
        for name, text in group.items():
            tree = terms.parse(text, {*terms.STATE_VARIABLES, *vehicle.controls}, vehicle.where)
            by = terms.variables(tree)
            held = not by or text.strip() in linear or (coefficient == "CD" and by == {"alpha"})
            if not held and vehicle.value(name) != 0.0:
                out[name] = 0.0
    return out
