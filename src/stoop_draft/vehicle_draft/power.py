"""Propellers and rotors from the motor channels of a log: which channel, how fast they turn, how much they lift."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np

from stoop import Flight, load_vehicle
from stoop.extend.flights import FLYING
from stoop.extend.units import STANDARD_GRAVITY
from stoop.extend.variables import FAMILIES
from stoop_draft.vehicle_draft.apriori import Apriori
from stoop_draft.vehicle_draft.autopilot import DEFAULT_PULSES, Motor, Point, Scale, Setup, Spin
from stoop_draft.vehicle_draft.controls import ENOUGH, recorded
from stoop_draft.vehicle_draft.steady import Steady

ENGINES: Final = ("electric", "piston", "jet", "none")
FRAMES_BY_COUNT: Final = {4: "quad-x", 6: "hexa-x", 8: "octo-x"}


@dataclass(frozen=True)
class Usual:
    """Usual sizes of propellers and rotors of small vehicles, fitted by eye to the built-in vehicles and the examples."""

    #: m of a propeller over the cube root of kg: 0.40 m of 8.5 kg, 0.30 m of 5 kg, 0.5 m of 13.5 kg
    diameter: float = 0.19
    #: and standard deviation; UIUC propeller data site, pitch over diameter 0.5 to 0.8
    CT0: tuple[float, float] = (0.10, 0.06)
    CT1: tuple[float, float] = (-0.10, 0.06)
    CT2: tuple[float, float] = (0.0, 0.1)  #: of engines too whose thrust is not by the square of the throttle
    lift_over_drag: float = 8.0  #: of the whole airplane, within a factor of two
    throttle: float = 0.6  #: in steady flight, where there is no log
    jet: float = 0.4  #: static thrust over weight
    #: diameter over the distance between neighbors: 0.72 to 0.95 of the built-in vehicles
    rotor: float = 0.85
    #: largest distance between the rotors of a quadplane over its span, as of the built-in one
    frame: float = 0.47
    flat: float = 1.1  #: drag coefficient of a wing in the flow from below
    linear: float = 0.3  #: share of T1 in the thrust at full command
    hover: float = 0.6  #: command, where there is no log
    lag: float = 0.05  #: s; published vehicles with propellers of 0.05 to 0.38 m have 0.005 to 0.08, whatever the diameter
    torque: float = 0.02  #: m of torque over thrust; likewise 0.006 to 0.034
    inflow: float = 0.028  #: s/m, over the thrust at full command
    drag: float = 0.009  #: s/m, likewise
    body: float = 0.0125  #: N s2/m2 per kg: quadratic drag of the body
    spread: float = 0.5  #: standard deviation over the value, of most of these
    #: of the share of T1, of inflow and drag, which published vehicles of 0.04 to 1.4 kg have from none to four times that
    wide: float = 1.5
    carried: float = 0.1  #: of the thrust that carries the weight at hover
    level: float = 1.0  #: of T2 beside a T1, which carry it together
    voltage_average: float = 30.0  #: s; the sag under load is part of the thrust law


USUAL: Final = Usual()
_ORIGIN: Final[Point] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Drive:
    """A channel that drives a motor: zero at standstill, one at full power; of a speed, rad/s."""

    channel: str
    scale: Scale
    comment: str = ""


@dataclass(frozen=True)
class Rotor:
    """A rotor of the file."""

    channel: str
    position: Point
    spin: Spin
    axis: Point | None = None


@dataclass(frozen=True)
class Lift:
    """Rotors of a vehicle."""

    rotors: tuple[Rotor, ...]
    scale: Scale
    source: str  #: of positions, in words
    guessed: bool

    @property
    def speed(self) -> bool:
        """Whether the channels are speeds of rotation."""
        return self.rotors[0].channel.startswith("rotor_")

    def size(self) -> float:
        """Return the largest distance between rotors, m."""
        return max((math.dist(a.position, b.position) for a, b in combinations(self.rotors, 2)), default=0.0)

    def diameter(self) -> float:
        """Return the usual diameter of rotors at these distances, m."""
        gaps = (math.dist(a.position, b.position) for a, b in combinations(self.rotors, 2))
        return USUAL.rotor * min((g for g in gaps if g > 0.05 * self.size()), default=0.3)

    def scaled(self, size: float) -> Lift:
        """Return them with another largest distance."""
        factor = size / self.size() if self.size() > 0.0 else 1.0
        places = [(x * factor, y * factor, z * factor) for x, y, z in (r.position for r in self.rotors)]
        rotors = (replace(r, position=place) for r, place in zip(self.rotors, places, strict=True))
        return replace(self, rotors=tuple(rotors))


def command(flight: Flight, drive: Drive) -> np.ndarray:
    """Return the command (n,) of a channel."""
    return np.asarray((flight.column(drive.channel) - drive.scale.zero) / drive.scale.unit)


def find_drive(flight: Flight, setup: Setup, lifting: Sequence[str] = ()) -> Drive | None:
    """Return what drives the propeller: of the channels that were logged fast enough the first; None where none ran.

    Parameters
    ----------
    flight : Flight
    setup : Setup
    lifting : sequence of str
        Channels of rotors that lift, which push nothing.
    """
    says = f"by {setup.autopilot}'s parameters"
    options = [Drive("thrust", Scale(), "the recorded thrust, N")]
    options += [Drive(n, s, says) for m in setup.pushers for n, s in m.channels.items()]
    options += [Drive("rotor_1", Scale(), "the recorded speed")] if not lifting else []
    if not (lifting and setup.pushers):
        options += [Drive(n, Scale(), "the recorded command") for n in ("throttle", "control_throttle")]
    if not setup.pushers:
        options += [Drive(n, Scale(), "the recorded command") for n in FAMILIES["motor"]]
    there = [
        o
        for o in options
        if o.channel not in lifting
        and o.channel in flight.names
        and float(np.nanmax(np.append(command(flight, o), 0.0))) > FLYING.command
    ]
    rates = {o.channel: flight.sources[o.channel].rate for o in there}
    return next((o for o in there if rates[o.channel] >= ENOUGH * max(rates.values())), None)


def speed_gain(mass: float, diameter: float, drive: Drive, steady: Steady) -> tuple[float, str]:
    """Return revolutions per second at full command, and how it was found.

    In steady flight thrust balances drag: the speed is the n that solves rho D^4 (CT0 n^2 + CT1 n V/D) = m g / (L/D).
    """
    airspeed = steady.airspeed()[0]
    level = USUAL.throttle
    for flight, mask in zip(steady.flights, steady.masks, strict=True):
        if drive.channel in flight.names:
            x = command(flight, drive)[mask]
            x = x[x > 0.1]  # with power
            level = float(np.median(x)) if x.size else level
            break
    density, _ = steady.density()
    if not math.isfinite(airspeed):
        airspeed = 0.0
    linear = USUAL.CT1[0] * airspeed / diameter
    load = mass * STANDARD_GRAVITY / USUAL.lift_over_drag / (density * diameter**4)
    n = (math.sqrt(linear**2 + 4.0 * USUAL.CT0[0] * load) - linear) / (2.0 * USUAL.CT0[0])
    said = f"from L/D of {USUAL.lift_over_drag:g} at a command of {level:.2f}"
    return n / level, said


def find_rotors(flight: Flight | None, setup: Setup, template: str, span: float | None) -> Lift | None:
    """Return the rotors that lift a vehicle; None where there are none.

    Positions are those of the parameters, else of the built-in vehicle with as many rotors, of the size that is given.

    Parameters
    ----------
    flight : Flight, optional
    setup : Setup
        Of the autopilot.
    template : str
    span : float, optional
        Largest distance between motors, m; of a quadplane the span of the wing, which only the built-in one takes its
        size from.
    """
    count = {"quad": 4, "quadplane": 4, "hexa": 6, "octo": 8}.get(template, 0)
    named = [m for m in setup.rotors if m.position is not None and m.spin is not None]
    known = len({m.position for m in named}) > 2
    like = "quadplane" if template == "quadplane" else FRAMES_BY_COUNT.get(count, "")
    lift = _of_setup(flight, named, setup.autopilot) if known else _of_template(flight, count, like)
    if lift is None or span is None:
        return lift
    if template != "quadplane":
        return lift.scaled(span)
    return lift if known and setup.autopilot == "PX4" else lift.scaled(USUAL.frame * span)


def _of_setup(flight: Flight | None, motors: Sequence[Motor], autopilot: str) -> Lift:
    kinds = ("motor_", "pwm_")
    options: list[tuple[float, str]] = []
    for kind in kinds if flight is not None else ():
        names = [n for m in motors for n in m.channels if n.startswith(kind)]
        if flight is not None and len(names) == len(motors) and all(recorded(flight, n) for n in names):
            options.append((min(flight.sources[n].rate for n in names), kind))
    if flight is not None and all(recorded(flight, f"rotor_{m.number}") for m in motors):
        options.insert(0, (min(flight.sources[f"rotor_{m.number}"].rate for m in motors), "rotor_"))
    fastest = max((rate for rate, _ in options), default=0.0)
    kind = next((kind for rate, kind in options if rate >= ENOUGH * fastest), "motor_")
    scale, rotors = Scale(), []
    for motor in motors:
        channel = next((n for n in motor.channels if n.startswith(kind)), f"{kind}{motor.number}")
        scale = motor.channels.get(channel, Scale())
        tilted = None if math.hypot(*motor.axis[:2]) < 1e-3 else motor.axis
        rotors.append(Rotor(channel, motor.position or _ORIGIN, motor.spin or "ccw", tilted))
    lift = Lift(tuple(rotors), scale, f"positions and turning by {autopilot}'s parameters", False)
    x, y, z = (sum(r.position[k] for r in rotors) / len(rotors) for k in range(3))
    if autopilot == "PX4" and math.hypot(x, y) > 0.2 * lift.size():  # not from the center of gravity
        moved = [
            replace(r, position=(r.position[0] - x, r.position[1] - y, r.position[2] - z)) for r in rotors
        ]
        return replace(lift, rotors=tuple(moved))
    return lift


def _of_template(flight: Flight | None, count: int, name: str) -> Lift | None:
    channels, scale = [f"motor_{n}" for n in range(1, count + 1)], Scale()
    if flight is not None:
        channels, scale = running_rotors(flight)
        channels = channels[:count]
    if not name or len(channels) != count:
        return None
    like = load_vehicle(name)
    rotors = []
    for channel, (own, rotor) in zip(channels, like.file.rotor.items(), strict=True):
        x, y, z = (like.value(f"rotor.{own}.position.{axis}") for axis in "xyz")
        rotors.append(Rotor(channel, (x, y, z), rotor.spin))
    return Lift(
        tuple(rotors), scale, f"positions and turning as in {name}: CHECK the order of the motors", True
    )


def running_rotors(flight: Flight) -> tuple[list[str], Scale]:
    """Return the channels of motors that run in flight, and their scale."""
    for kind in ("motor", "rotor"):
        run = [n for n in FAMILIES[kind] if n in flight.names and _mean_in_flight(flight, n) > FLYING.command]
        if len(run) > FLYING.rotors:
            return run, Scale()
    names = [n for n in flight.rotor_pulses() if n in FAMILIES["pwm"]]
    return names, Scale(DEFAULT_PULSES[0], DEFAULT_PULSES[2] - DEFAULT_PULSES[0])


def _mean_in_flight(flight: Flight, name: str) -> float:
    x = flight.column(name)[flight.flying()]
    x = x[np.isfinite(x)]
    return float(np.mean(x)) if x.size else 0.0


def hover_level(lift: Lift, steady: Steady) -> tuple[float, str]:
    """Return the x of the rotors at hover, and where it is from."""
    levels = [steady.median(r.channel) for r in lift.rotors]
    known = [x for x in levels if math.isfinite(x)]
    if not known:
        return (USUAL.hover, "assumed")
    level = (float(np.median(known)) - lift.scale.zero) / lift.scale.unit
    return (level, "the log's hover") if level > FLYING.command else (USUAL.hover, "assumed")


def thrust_law(lift: Lift, mass: float, level: float) -> dict[str, Apriori]:
    """Return what the rotors of a draft have of thrust, drag and torque, such that they carry the weight at a command.

    Where speeds were recorded the weight at hover gives the thrust; of commands it is unknown how much of it is linear in them.
    """
    share, usual = mass * STANDARD_GRAVITY / len(lift.rotors), "usual of small propellers"
    if lift.speed:
        full, per_x = 2.0 * share, 1.0 / (level * math.sqrt(2.0))
        law = {"T2": (share / level**2, USUAL.carried, "weight over the number of rotors at hover")}
    else:
        full, per_x = share / (USUAL.linear * level + (1.0 - USUAL.linear) * level**2), 1.0
        law = {
            "T1": (USUAL.linear * full, USUAL.wide, "usual share of the thrust at full command"),
            "T2": ((1.0 - USUAL.linear) * full, USUAL.level, "with T1 it carries the weight at hover"),
        }
    law |= {
        "inflow": (USUAL.inflow * full * per_x, USUAL.wide, f"{usual}: thrust lost in a climb"),
        "drag": (USUAL.drag * full * per_x, USUAL.wide, usual),
        "torque_ratio": (USUAL.torque, USUAL.spread, usual),
    }
    if not lift.speed:
        law["lag"] = (USUAL.lag, USUAL.spread, usual)
    return {name: Apriori(value, part * value, source) for name, (value, part, source) in law.items()}
