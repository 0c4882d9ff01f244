"""ArduPilot's parameters of a vehicle: frame, outputs, airspeeds and throttle, for any simulator.

References
----------
ArduPilot: libraries/SRV_Channel/SRV_Channel.h (SERVOn_FUNCTION), libraries/AP_Motors/AP_MotorsMatrix.cpp (frames),
parameter list (AIRSPEED_*: equivalent airspeed; TRIM_THROTTLE).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from stoop.extend.variables import ARDUPILOT
from stoop_export.autopilot_outputs import FASTEST, SLOWEST, MotorOutput, Spin

PWM: Final = (1000.0, 2000.0)  #: us, ends of the outputs
AZIMUTH_TOLERANCE: Final = 10.0  #: deg, of a rotor from that of its frame
THROTTLE: Final = ARDUPILOT.throttles[0]  #: SERVOn_FUNCTION
SURFACE_FUNCTIONS: Final = {name: function for function, (name, _) in ARDUPILOT.surfaces.items()} | {
    "left aileron": 4,
    "right aileron": 4,
}
_FUNCTIONS: Final = {number: function for function, number in ARDUPILOT.motors.items()}


@dataclass(frozen=True)
class Frame:
    """FRAME_CLASS, FRAME_TYPE (None where no frame is known), and SERVOn_FUNCTION of each rotor."""

    number: int
    kind: int | None
    functions: tuple[int, ...]


def frame(rotors: Sequence[MotorOutput]) -> Frame:
    """Return the frame whose motors stand and turn as these rotors do, in whatever order they are.

    Without one the class is 0, with which ArduPilot does not arm, and the motors are numbered as they come.
    """
    for (number, kind), places in ARDUPILOT.frames.items():
        order = _numbers(rotors, places)
        if order is not None:
            return Frame(number, kind, tuple(_FUNCTIONS[n] for n in order))
    return Frame(0, None, tuple(_FUNCTIONS.get(i + 1, 0) for i in range(len(rotors))))


def _numbers(rotors: Sequence[MotorOutput], places: Sequence[tuple[float, Spin]]) -> tuple[int, ...] | None:
    """Return the number of each rotor in a frame, one to one; None where they do not match."""
    found = []
    for rotor in rotors:
        x, y, _ = rotor.position
        here, upright = math.degrees(math.atan2(y, x)), -rotor.axis[2] > math.hypot(*rotor.axis[:2])
        for n, (azimuth, spin) in enumerate(places, 1):
            apart = abs((here - azimuth + 180.0) % 360.0 - 180.0)  # seen from above, deg
            if upright and rotor.spin == spin and apart <= AZIMUTH_TOLERANCE:
                found.append(n)
    matched = len(rotors) == len(places) and sorted(found) == list(range(1, len(places) + 1))
    return tuple(found) if matched else None


def servo(n: int, function: int, trim: float) -> dict[str, float]:
    """Return the parameters of output `n`, whose pulse in steady flight, or at rest, is `trim`, us."""
    ends = {"FUNCTION": function, "MIN": PWM[0], "MAX": PWM[1], "TRIM": round(trim), "REVERSED": 0}
    return {f"SERVO{n}_{end}": x for end, x in ends.items()}


def pulse(command: float) -> float:
    """Return the pulse, us, of a command of a surface from -1 to 1."""
    return 0.5 * (PWM[0] + PWM[1]) + 0.5 * (PWM[1] - PWM[0]) * min(max(command, -1.0), 1.0)


def cruise(airspeed: float, throttle: float | None) -> dict[str, float]:
    """Return the airspeeds about an equivalent one, m/s, and the throttle of the steady flight, %."""
    ends = {"CRUISE": 1.0, "MIN": SLOWEST, "MAX": FASTEST}
    out: dict[str, float] = {f"AIRSPEED_{end}": round(share * airspeed, 2) for end, share in ends.items()}
    return out if throttle is None else out | {"TRIM_THROTTLE": round(100.0 * throttle)}


def text(parameters: Mapping[str, float]) -> str:
    """Return the parameter file."""
    return "".join(f"{name} {x:g}\n" for name, x in parameters.items())
