"""The set-up of an autopilot, read from the parameters in its log: which output moves which surface, and where motors stand.

Surfaces count positive as both autopilots count them: trailing edge up, of a vertical surface to the right; a command of
one is the full throw. A share is the part that a surface takes of the moment about an axis, nose up, right wing down and
nose right positive.

References
----------
.. [1] PX4, src/modules/control_allocator/module.yaml: CA_*, and the conventions of signs of its rules
.. [2] PX4, src/lib/mixer_module: PWM_MAIN_FUNCn, 101 is motor 1, 201 is servo 1
.. [3] ArduPilot, libraries/SRV_Channel/SRV_Channel.h, ArduPlane/servos.cpp (channel_function_mixer, flaperon_update)
.. [4] ArduPilot, libraries/AP_Motors/AP_MotorsMatrix.cpp (angles clockwise from the nose, and turning)
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

from stoop.extend import variables
from stoop_draft.mapping_draft import RANGES

Point = tuple[float, float, float]
Spin = Literal["ccw", "cw"]
UP: Final[Point] = (0.0, 0.0, -1.0)
PULSE_RANGE: Final = (500.0, 2500.0)  #: us, that a servo or a motor controller may understand
DEFAULT_PULSES: Final = (1000.0, 1500.0, 2000.0)  #: us, ends and middle
MAX_POSITION: Final = 20.0  #: m
MIN_MOMENT: Final = 1e-3  #: of a share; less turns nothing
PX4_OTHERS: Final = {
    9: "left flap", 10: "right flap", 11: "airbrake", 16: "steering wheel", 17: "left spoiler", 18: "right spoiler",
}  # fmt: skip
ARDUPILOT_OTHERS: Final = {2: "flap", 3: "flap", 26: "steering wheel", 110: "airbrake"}


@dataclass(frozen=True)
class Scale:
    """How a channel becomes a command: (x - zero) / unit; a reversed output has a negative unit."""

    zero: float = 0.0
    unit: float = 1.0


@dataclass(frozen=True)
class Surface:
    """An output that moves a surface."""

    name: str  #: as the autopilot calls it
    shares: Point  #: of roll, pitch and yaw
    channels: Mapping[str, Scale]  #: by which a log may hold it


@dataclass(frozen=True)
class Motor:
    """An output that drives a motor."""

    number: int
    channels: Mapping[str, Scale]
    position: Point | None = None  #: m, from the center of gravity as the autopilot knows it
    axis: Point = UP  #: direction of the thrust
    spin: Spin | None = None

    @property
    def lifts(self) -> bool:
        """Whether it pushes up, not forward."""
        return -self.axis[2] > abs(self.axis[0])


@dataclass(frozen=True)
class Setup:
    """What the parameters say of outputs."""

    autopilot: str = ""  #: "PX4", "ArduPilot" or ""
    surfaces: tuple[Surface, ...] = ()
    rotors: tuple[Motor, ...] = ()  #: that lift
    pushers: tuple[Motor, ...] = ()
    others: Mapping[str, str] = field(default_factory=dict)  #: channel -> use: flaps, tilts, brakes

    def tail(self) -> str:
        """Return the template that the surfaces ask for; empty where there are none."""
        names = " ".join(surface.name for surface in self.surfaces)
        known = {"V-tail": "v-tail", "A-tail": "v-tail", "elevon": "flying-wing", "elevator": "conventional"}
        return next((template for word, template in known.items() if word in names), "")


def read_setup(parameters: Mapping[str, float], moving: Collection[str] = ()) -> Setup:
    """Read the set-up of an autopilot.

    Parameters
    ----------
    parameters : of the log; what is not finite or impossible counts as not there
    moving : channels of the log that are not still; they show whether PX4's pulses are those of MAIN or of AUX
    """
    if any(name.startswith("CA_") for name in parameters):
        return _px4(parameters, moving)
    if "SERVO1_FUNCTION" in parameters:
        return _ardupilot(parameters)
    return Setup()


def _number(parameters: Mapping[str, float], name: str, default: float = 0.0, most: float = 1e4) -> float:
    value = float(parameters.get(name, default))
    return value if math.isfinite(value) and abs(value) <= most else default


def _whole(parameters: Mapping[str, float], name: str, default: int = 0) -> int:
    return round(_number(parameters, name, float(default)))


def _pulses(
    parameters: Mapping[str, float], low: str, high: str, middle: str = ""
) -> tuple[float, float, float]:
    """Return ends and middle of a pulse in us, those that are usual where the parameters hold none."""
    least, most = (_number(parameters, name, math.nan) for name in (low, high))
    if not PULSE_RANGE[0] <= least < most <= PULSE_RANGE[1]:
        return DEFAULT_PULSES
    center = _number(parameters, middle, math.nan)
    return least, center if least < center < most else 0.5 * (least + most), most


def _px4(parameters: Mapping[str, float], moving: Collection[str]) -> Setup:
    outputs = _px4_outputs(parameters, moving)
    surfaces, others = list[Surface](), dict[str, str]()
    for i in range(min(_whole(parameters, "CA_SV_CS_COUNT"), len(variables.FAMILIES["servo"]))):
        kind = _whole(parameters, f"CA_SV_CS{i}_TYPE")
        channels = {f"servo_{i + 1}": Scale(), **outputs.get(201 + i, {})}
        if kind in PX4_OTHERS:
            others |= dict.fromkeys(channels, PX4_OTHERS[kind])
        if kind not in variables.PX4.surfaces:
            continue
        name, usual = variables.PX4.surfaces[kind]
        given = tuple(_number(parameters, f"CA_SV_CS{i}_TRQ_{axis}", 0.0, 10.0) for axis in "RPY")
        # a surface of a known kind turns about its own axes; what else is set there makes up for adverse yaw
        known = any(usual)
        kept = [g if not known or abs(u) > 0.0 else 0.0 for g, u in zip(given, usual, strict=True)]
        roll, pitch, yaw = kept if any(abs(x) > MIN_MOMENT for x in kept) else usual
        surfaces.append(Surface(name, (roll, pitch, yaw), channels))
    motors = [
        _px4_motor(parameters, i, outputs.get(101 + i, {}))
        for i in range(min(_whole(parameters, "CA_ROTOR_COUNT"), len(variables.FAMILIES["motor"])))
    ]
    rotors = tuple(m for m in motors if m.lifts) if _whole(parameters, "CA_AIRFRAME") != 1 else ()
    pushers = tuple(m for m in motors if m not in rotors)
    return Setup("PX4", tuple(surfaces), rotors, pushers, others)


def _px4_motor(parameters: Mapping[str, float], i: int, pulses: Mapping[str, Scale]) -> Motor:
    x, y, z = (_number(parameters, f"CA_ROTOR{i}_P{axis}", 0.0, MAX_POSITION) for axis in "XYZ")
    forward, right, down = (
        _number(parameters, f"CA_ROTOR{i}_A{axis}", default, 100.0)
        for axis, default in zip("XYZ", UP, strict=True)
    )
    axis = (forward, right, down) if math.hypot(forward, right, down) > MIN_MOMENT else UP
    spin: Spin = "ccw" if _number(parameters, f"CA_ROTOR{i}_KM", 0.05) >= 0.0 else "cw"
    return Motor(i + 1, {f"motor_{i + 1}": Scale(), **pulses}, (x, y, z), axis, spin)


def _px4_outputs(parameters: Mapping[str, float], moving: Collection[str]) -> dict[int, dict[str, Scale]]:
    """Return function -> the pulse that has it, of MAIN or AUX, whichever has a function for more of the moving pulses."""
    best: dict[int, dict[str, Scale]] = {}
    most = -1
    for group in ("MAIN", "AUX"):
        head, found, matches = f"PWM_{group}", dict[int, dict[str, Scale]](), 0
        reversed_bits = _whole(parameters, f"{head}_REV")
        for n, pulse in enumerate(variables.FAMILIES["pwm"], 1):
            function = _whole(parameters, f"{head}_FUNC{n}")
            low, middle, high = _pulses(parameters, f"{head}_MIN{n}", f"{head}_MAX{n}")
            back = bool(max(reversed_bits, 0) >> (n - 1) & 1)
            if 101 <= function < 101 + len(variables.FAMILIES["motor"]):
                found[function] = {pulse: Scale(high, low - high) if back else Scale(low, high - low)}
            elif 201 <= function < 201 + len(variables.FAMILIES["servo"]):
                half = 0.5 * (high - low)
                found[function] = {pulse: Scale(middle, -half if back else half)}
            else:
                continue
            matches += pulse in moving
        if matches > most and found:
            best, most = found, matches
    return best


def _ardupilot(parameters: Mapping[str, float]) -> Setup:
    surfaces, others = list[Surface](), dict[str, str]()
    pushers, motors = list[Motor](), dict[int, Mapping[str, Scale]]()
    for n, pulse in enumerate(variables.FAMILIES["pwm"], 1):
        head = f"SERVO{n}"
        function = _whole(parameters, f"{head}_FUNCTION")
        low, middle, high = _pulses(parameters, f"{head}_MIN", f"{head}_MAX", f"{head}_TRIM")
        sign = -1.0 if _number(parameters, f"{head}_REVERSED") > 0.5 else 1.0
        if function in variables.ARDUPILOT.surfaces:
            name, shares = variables.ARDUPILOT.surfaces[function]
            surfaces.append(Surface(name, shares, {pulse: Scale(middle, sign * 0.5 * (high - low))}))
        elif function in ARDUPILOT_OTHERS:
            others[pulse] = ARDUPILOT_OTHERS[function]
        elif function in variables.ARDUPILOT.throttles:
            scale = Scale(low, high - low) if sign > 0.0 else Scale(high, low - high)
            pushers.append(Motor(len(pushers) + 1, {pulse: scale}, axis=(1.0, 0.0, 0.0)))
        elif function in variables.ARDUPILOT.motors:
            number = variables.ARDUPILOT.motors[function]
            for first, last in RANGES:
                if PULSE_RANGE[0] <= _number(parameters, first) < _number(parameters, last) <= PULSE_RANGE[1]:
                    low, high = parameters[first], parameters[last]
            motors[number] = {f"motor_{number}": Scale(), pulse: Scale(low, high - low)}
    heads = ("Q_FRAME", "FRAME") if _number(parameters, "Q_ENABLE") > 0.0 else ("FRAME", "Q_FRAME")
    frame = next((h for h in heads if f"{h}_CLASS" in parameters), "FRAME")
    places = variables.ARDUPILOT.frames.get(
        (_whole(parameters, f"{frame}_CLASS"), _whole(parameters, f"{frame}_TYPE")), ()
    )
    rotors = []
    for number, channels in sorted(motors.items()):
        if number <= len(places):
            angle, spin = math.radians(places[number - 1][0]), places[number - 1][1]
            place = (0.5 * math.cos(angle), 0.5 * math.sin(angle), 0.0)  # of a frame of one meter
            rotors.append(Motor(number, channels, place, UP, spin))
        else:
            rotors.append(Motor(number, channels))
    return Setup("ArduPilot", tuple(surfaces), tuple(rotors), tuple(pushers), others)
