"""Forces and moments of systems of Gazebo as they compute them: AdvancedLiftDrag, MulticopterMotorModel and Hydrodynamics.

`AdvancedLiftDrag` takes the flow at a point of the link, cp, with U the speed in the plane of symmetry, alpha = atan2(w, u) and
beta = atan2(v, u). Lift and drag are normal to and along the flow in that plane, the side force is along y, the moments are about
body axes. Coefficients are sums of constants and of terms linear in the angles, the rates p b/2U, q c/2U, r b/2U and the joint
angles in degrees; the drag has k CL^2 in addition, with k = 1/(pi AR eff). Beyond the stall angle lift and drag are those of a
plate; a sigmoid of width 1/15 rad blends the two.

Until 2026 the pitching moment lost its constant and its slope by alpha: the term of beta replaced them, in place of being added
(gz-sim issue 3695, fixed by pull request 3817). :class:`Wing` has neither, so that it flies alike in both: the slope follows
from the place of cp, and the constant is the effect of a joint that stands at one radian.

`MulticopterMotorModel` turns a commanded speed into thrust by its square after a lag, with a reaction torque in proportion and a
drag along the air in the plane of the rotor, in proportion to the speed of rotation. The flow along the axis has no effect.

`Hydrodynamics`, made for vehicles in water, gives force and moment as a matrix times velocity and rates, and as products with
their magnitudes. It holds what the motors do not: the damping by the flow through rotors, and the drag of the body.

Vectors here are along body axes forward, right, down, about the center of gravity.

References
----------
gz-sim, branches gz-sim8 (Harmonic) at 0b881dba3 and main at 93bbf3ed1: src/systems/advanced_lift_drag/AdvancedLiftDrag.cc,
src/systems/multicopter_motor_model/MulticopterMotorModel.cc, src/systems/hydrodynamics/HydrodynamicsUtils.hh,
src/systems/lift_drag/LiftDrag.cc.
P. Martin, E. Salaun, "The true role of accelerometer feedback in quadrotor control", ICRA 2010 (drag of rotors).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop_export.autopilot_outputs import surface_role

SHARPNESS: Final = 15.0  #: 1/rad, of the sigmoid; the system reads no other
PLATE: Final = (-0.224, -0.115)  #: of the drag of a plate by the aspect ratio
EFFECTS: Final = ("CD", "CY", "CL", "Cell", "Cem", "Cen")  #: of joints; Cell, Cem, Cen are roll, pitch, yaw
CONSTANT_JOINT_ANGLE: Final = 1.0  #: rad, of the joint that gives constant coefficients
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Motor:
    """A rotor or a propeller.

    Attributes
    ----------
    name : str
    channel : str or None
        Recorded channel; None for a constant thrust.
    position, axis : (3,)
        From the center of gravity, m; direction of the thrust.
    spin_sign : 1 for counterclockwise about the axis, -1 for clockwise
    constant : N s2, thrust over the square of the speed of rotation
    moment : m, torque over thrust
    drag : N s2/m, drag over the speed of rotation and that through the air
    lag : s
    speed_gain, offset : rad/s per unit of the channel, rad/s
        Commanded speed = offset + speed_gain * channel.
    idle, full : ends of the channel; at idle and below the motor stands
    inflow : N s2/m, loss of thrust over the speed of rotation and that along the axis; only of blades of LiftDrag
    """

    name: str
    channel: str | None
    position: Vector
    axis: Vector
    spin_sign: int
    constant: float
    moment: float
    drag: float
    lag: float
    speed_gain: float
    offset: float
    idle: float = 0.0
    full: float = 1.0
    inflow: float = 0.0

    @property
    def min_speed(self) -> float:
        """Commanded speed just above idle, rad/s."""
        return max(self.offset + self.speed_gain * self.idle, 0.0) if self.channel is not None else 0.0

    @property
    def max_speed(self) -> float:
        """Commanded speed at full command, rad/s; a constant thrust is half of the full one."""
        return (
            self.offset + self.speed_gain * self.full
            if self.channel is not None
            else math.sqrt(2.0) * self.offset
        )

    def command(self, inputs: Mapping[str, float]) -> float:
        """Return the commanded speed for recorded channels, rad/s."""
        if self.channel is None:
            return self.offset
        x = inputs[self.channel]
        return max(self.offset + self.speed_gain * x, 0.0) if x > self.idle else 0.0


@dataclass(frozen=True, eq=False)
class Damping:
    """Loads by velocity and rates about the center of gravity, SI.

    Attributes
    ----------
    linear : (6, 6)
    quadratic : (6,), by each motion times its magnitude
    sideslip : (6,), by v times the magnitude of u
    """

    linear: FloatArray
    quadratic: FloatArray
    sideslip: FloatArray


@dataclass(frozen=True)
class Surface:
    """A joint that carries a surface; its angle is gain * (channel - neutral) after a lag. Without a channel it stands at 1 rad.

    `effects` are the changes of :data:`EFFECTS` per degree.
    """

    name: str
    channel: str | None
    gain: float
    neutral: float
    lag: float
    limit: float
    effects: Mapping[str, float]

    def command(self, inputs: Mapping[str, float]) -> float:
        """Return the commanded angle for recorded channels, rad."""
        return (
            CONSTANT_JOINT_ANGLE
            if self.channel is None
            else self.gain * (inputs[self.channel] - self.neutral)
        )


@dataclass(frozen=True)
class Wing:
    """The whole aircraft as one body of AdvancedLiftDrag.

    `cp` is from the center of gravity, m, forward, right, down; `coefficients` are by the names of the system, absent ones zero.
    """

    coefficients: Mapping[str, float]
    cp: Vector
    area: float
    aspect_ratio: float
    chord: float
    efficiency: float
    density: float
    alpha_stall: float
    surfaces: tuple[Surface, ...]

    @property
    def span(self) -> float:
        """Span as the system computes it, m."""
        return math.sqrt(self.area * self.aspect_ratio)

    @property
    def moved(self) -> tuple[Surface, ...]:
        """Joints that a channel moves."""
        return tuple(s for s in self.surfaces if s.channel is not None)

    def authority(self, surface: Surface) -> dict[str, float]:
        """Return the roll, pitch and yaw moments of a joint over the largest of all joints, with their signs."""
        names = EFFECTS[3:]
        largest = {n: max((abs(s.effects.get(n, 0.0)) for s in self.moved), default=0.0) for n in names}
        return {n: surface.effects.get(n, 0.0) / (largest[n] or 1.0) for n in names}

    def role(self, surface: Surface) -> tuple[str, float]:
        """Return what a joint is to an autopilot, and the sign of the angle that turns the nose up, or else right."""
        return surface_role(*self.authority(surface).values())


@dataclass(frozen=True)
class Blades:
    """The two blades of LiftDrag that stand for a motor where nothing else turns a speed of rotation into thrust.

    A blade at a radius r has lift by cla a0 and drag by cda a0 at rest, so that thrust = rho r^2 area cla a0 omega^2 and
    torque = thrust r cda / cla. Climb takes from its angle of attack, and the air in its plane adds to its drag on one side.
    """

    radius: float
    angle: float
    area: float
    lift: float
    drag: float
    density: float

    @classmethod
    def of(cls, motor: Motor, radius: float, angle: float, density: float, lift: float = 5.0) -> Blades:
        """Return the blades at a radius, m, and an angle of attack, rad, that give the thrust and the torque of a motor."""
        area = motor.constant / (density * radius**2 * lift * angle)
        return cls(radius, angle, area, lift, lift * motor.moment / radius, density)

    def motor(self, motor: Motor) -> Motor:
        """Return the motor as these blades are one, to first order about rest; its speed follows at once."""
        inflow = motor.constant / (self.radius * self.angle) * (1.0 + self.drag * self.angle / self.lift)
        drag = motor.constant * motor.moment / self.radius**2
        return replace(motor, drag=drag, inflow=inflow, lag=0.0)


def cross(a: Sequence[float], b: Sequence[float]) -> Vector:
    """Return a x b of plain numbers, which are faster than small arrays."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def damping_loads(damping: Damping, velocity: Sequence[float], rates: Sequence[float]) -> FloatArray:
    """Return force, N, and moment, N m, (6,) by velocity, m/s, and rates, rad/s."""
    motion = np.array([*velocity, *rates])
    squares = damping.quadratic * np.abs(motion) * motion + damping.sideslip * motion[1] * abs(motion[0])
    return np.asarray(damping.linear @ motion + squares)


def motor_loads(
    motors: Sequence[Motor], speeds: Sequence[float], velocity: Sequence[float], rates: Sequence[float]
) -> FloatArray:
    """Return force, N, and moment, N m, (6,) of motors at speeds of rotation, rad/s, by velocity, m/s, and rates, rad/s."""
    out = np.zeros(6)
    for motor, speed in zip(motors, speeds, strict=True):
        n, arm = motor.axis, motor.position
        turned = cross(rates, arm)
        local = [v + t for v, t in zip(velocity, turned, strict=True)]
        along = sum(a * b for a, b in zip(local, n, strict=True))
        thrust = motor.constant * speed * speed - motor.inflow * speed * along
        drag = motor.drag * speed
        force = [thrust * a - drag * (v - along * a) for a, v in zip(n, local, strict=True)]
        torque = -motor.spin_sign * motor.moment * thrust
        moment = [a + torque * b for a, b in zip(cross(arm, force), n, strict=True)]
        out += (*force, *moment)
    return out


def blending(wing: Wing, alpha: float) -> float:
    """Return the share of the stalled wing."""
    rising, falling = (math.exp(-SHARPNESS * (s * alpha - wing.alpha_stall)) for s in (1.0, -1.0))
    return (1.0 + rising + falling) / ((1.0 + rising) * (1.0 + falling))


def wing_loads(
    wing: Wing, angles: Sequence[float], velocity: Sequence[float], rates: Sequence[float]
) -> FloatArray:
    """Return force, N, and moment, N m, (6,) by joint angles, rad, velocity of the center of gravity, m/s, and rates, rad/s."""
    c, cp, span = wing.coefficients, wing.cp, wing.span
    u, v, w = (a + b for a, b in zip(velocity, cross(rates, cp), strict=True))
    U = math.hypot(u, w)
    if U <= 1e-9:
        return np.zeros(6)
    alpha, beta, cosine, sine = math.atan2(w, u), math.atan2(v, u), u / U, w / U
    p, q, r = (x * length / (2.0 * U) for x, length in zip(rates, (span, wing.chord, span), strict=True))

    def summed(name: str, *by: float) -> float:
        terms = zip(("a", "b", "p", "q", "r"), by, strict=True)
        return sum(c.get(f"{name}{letter}", 0.0) * x for letter, x in terms)

    moved = {
        name: sum(
            math.degrees(angle) * s.effects.get(name, 0.0)
            for s, angle in zip(wing.surfaces, angles, strict=True)
        )
        for name in EFFECTS
    }
    stalled = blending(wing, alpha)
    plate = 2.0 * math.copysign(sine * sine, alpha) * cosine
    lift = (1.0 - stalled) * (c["CL0"] + c["CLa"] * alpha) + stalled * plate
    lift += c.get("CLb", 0.0) * beta + moved["CL"]
    flat = 2.0 / (1.0 + math.exp(PLATE[0] + PLATE[1] * max(wing.aspect_ratio, 1.0 / wing.aspect_ratio)))
    induced = lift * lift / (math.pi * wing.aspect_ratio * wing.efficiency)
    drag = (1.0 - stalled) * (c["CD0"] + induced) + stalled * flat * sine * sine
    CL = lift + summed("CL", 0.0, 0.0, p, q, r)
    CD = drag + moved["CD"] + summed("CD", 0.0, 0.0, p, q, r)
    CY, roll, yaw = (summed(n, alpha, beta, p, q, r) + moved[n] for n in ("CY", "Cell", "Cen"))
    pitch = summed("Cem", 0.0, beta, p, q, r) + moved["Cem"]
    pressure_area = 0.5 * wing.density * U * U * wing.area
    force = (
        pressure_area * (CL * sine - CD * cosine),
        pressure_area * CY,
        pressure_area * (-CL * cosine - CD * sine),
    )
    arms = zip((span * roll, wing.chord * pitch, span * yaw), cross(cp, force), strict=True)
    return np.array([*force, *(pressure_area * m + t for m, t in arms)])
