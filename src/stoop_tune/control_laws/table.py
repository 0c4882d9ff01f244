"""The laws by firmware and kind of vehicle, and which of them the parameters of a log belong to."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

from stoop.extend.arrays import FloatArray
from stoop.extend.errors import StoopError
from stoop_tune.control_laws import ardupilot, betaflight, crazyflie, px4
from stoop_tune.control_laws.parameters import COMMANDS
from stoop_tune.control_laws.rate_law import AXES, RateLaw

PID: Final = {term: term for term in ("P", "I", "D")}
PID_FF: Final = {**PID, "FF": "FF"}
PARM: Final = ("gains.parm", "{name},{value:.9g}\n")
DIGITS: Final = 4  #: of a gain


def rounded(value: float) -> float:
    """Return a gain as it is written."""
    return float(f"{value:.{DIGITS}g}")


@dataclass(frozen=True)
class Firmware:
    """A law about each axis with the attitude loop before it, and a parameter by which it is known."""

    title: str
    known_by: str
    rotors: bool
    law: Callable[[Mapping[str, float], str], RateLaw]
    attitude_gain: Callable[[Mapping[str, float], str], float] = lambda *_: 0.0
    axes: tuple[str, ...] = AXES
    #: of calibrated airspeed, m/s
    airspeed_ratio: Callable[[Mapping[str, float], float], float] = lambda *_: 1.0
    #: from setpoint and Euler angle to the setpoint of the rate, where that is more than a gain
    attitude: Callable[[Mapping[str, float], str], RateLaw] | None = None
    #: whether rates are flown without it, and judged so
    by_rates: bool = False
    #: of rotors, by parameters, positions and turning
    mixing: Callable[[Mapping[str, float], FloatArray, FloatArray], FloatArray] | None = None
    #: change of a motor's command over that of its thrust setpoint, by parameters and command in hover
    thrust_slope: Callable[[Mapping[str, float], float], float] | None = None
    #: change of a motor's pulse, us, over that of its command, by parameters
    pulse: Callable[[Mapping[str, float]], float] = lambda _: 1000.0
    #: axis -> parameter without which it has no loop
    enabled_by: Mapping[str, str] = field(default_factory=dict)
    #: axis -> pattern of the parameters that set the gains of its rate loop, term -> what stands in it
    patterns: Mapping[str, str] = field(default_factory=dict)
    terms: Mapping[str, str] = field(default_factory=dict)
    #: axis -> parameter that is D at rest, where it is above zero and below D
    resting: Mapping[str, str] = field(default_factory=dict)
    largest: float = math.inf  #: gain
    #: gain that the firmware takes for one that is proposed
    settable: Callable[[float], float] = rounded
    #: name of a file of parameters in the autopilot's own form, and a line of it
    file: tuple[str, str] = ("gains.params", "1\t1\t{name}\t{value:.9g}\t9\n")

    #: parameter -> what it is called in that file, where that is another name
    written: Mapping[str, str] = field(default_factory=dict)

    def gains(self, axis: str, parameters: Mapping[str, float]) -> dict[str, str]:
        """Return the parameters that set the gains of the rate loop about an axis, by term; none where they are not tuned."""
        named = {t: self.patterns[axis].format(n) for t, n in self.terms.items()}
        resting, full = self.resting.get(axis, ""), parameters.get(named.get("D", ""), 0.0)
        return named | ({"D": resting} if 0.0 < parameters.get(resting, 0.0) < full else {})

    def attitude_loop(self, parameters: Mapping[str, float], axis: str) -> RateLaw | float:
        """Return the attitude loop about an axis, its law or its gain, 1/s; zero where rates are flown without it."""
        if self.attitude is None or self.by_rates:
            return self.attitude_gain(parameters, axis)
        return self.attitude(parameters, axis)

    def line(self, name: str, value: float) -> str:
        """Return a parameter as a line of a file."""
        return self.file[1].format(name=self.written.get(name, name), value=value)


LAWS: Final = (
    Firmware(
        "PX4 multicopter", "MC_ROLLRATE_P", True, px4.multicopter, px4.multicopter_attitude,
        mixing=px4.mixing, pulse=px4.pulse, patterns={a: own[0] for a, own in px4.ROTORS.items()}, terms=PID,
    ),
    Firmware(
        "PX4 fixed wing", "FW_RR_P", False, px4.fixed_wing, px4.fixed_wing_attitude,
        airspeed_ratio=px4.airspeed_ratio, patterns={a: own[0] for a, own in px4.WING.items()}, terms=PID_FF,
    ),
    Firmware(
        "ArduCopter", "ATC_RAT_RLL_P", True, ardupilot.copter, ardupilot.copter_attitude,
        mixing=ardupilot.mixing, pulse=ardupilot.pulse, patterns=ardupilot.COPTER, terms=PID, file=PARM,
    ),
    Firmware(
        "ArduPlane", "RLL_RATE_P", False, ardupilot.plane, ardupilot.plane_attitude,
        airspeed_ratio=ardupilot.airspeed_ratio, patterns=ardupilot.PLANE, terms=PID_FF, file=PARM,
        enabled_by={"yaw": "YAW_RATE_ENABLE"},
    ),
    Firmware(
        "ArduPlane before 4.1", "RLL2SRV_P", False, ardupilot.old_plane, ardupilot.plane_attitude, ("roll", "pitch"),
        ardupilot.airspeed_ratio,
    ),
    Firmware(
        "Betaflight", "pidsum_limit", True, betaflight.rate_pid, attitude=betaflight.level, by_rates=True,
        mixing=betaflight.mixing, thrust_slope=betaflight.thrust_slope, patterns={a: f"{a}PID[{{}}]" for a in AXES},
        terms={"P": "0", "I": "1", "D": "2"}, resting={a: f"d_min[{k}]" for k, a in enumerate(AXES)},
        largest=betaflight.LARGEST, settable=betaflight.settable, file=("gains.config", "set {name} = {value:.0f}\n"),
        written={name: command for command, name in COMMANDS.items()},
    ),
    Firmware(
        "Crazyflie", "pid_rate.roll_kp", True, crazyflie.cascade, attitude=crazyflie.attitude,
        mixing=crazyflie.mixing, patterns={a: f"pid_rate.{a}_k{{}}" for a in AXES}, terms={t: t.lower() for t in PID}, file=PARM,
    ),
)  # fmt: skip


def firmwares(parameters: Mapping[str, float]) -> tuple[Firmware, ...]:
    """Return the laws that parameters are of: two for a vehicle that hovers and flies on wings.

    Raises
    ------
    StoopError
        There are none.
    """
    found = tuple(one for one in LAWS if one.known_by in parameters)
    if not found:
        known = ", ".join(one.known_by for one in LAWS)
        raise StoopError(
            f"control laws: there are no parameters of an autopilot that is known (none of {known} with a number); take "
            "them from a log of this vehicle, or from its ground station"
        )
    return found


def titles_of(parameters: Mapping[str, float]) -> list[str]:
    """Return the titles of the laws that parameters are of."""
    return [one.title for one in LAWS if one.known_by in parameters]


def firmware_of(parameters: Mapping[str, float], rotors: bool) -> Firmware:
    """Return the law of parameters for a vehicle that flies on rotors, or on wings.

    Raises
    ------
    StoopError
        The parameters are of none, or of the other kind of vehicle.
    """
    known = firmwares(parameters)
    fitting = [one for one in known if one.rotors == rotors]
    if len({one.title.split()[0] for one in fitting}) > 1:
        both = " and of ".join(one.title for one in fitting)
        raise StoopError(f"control laws: the parameters are those of {both}: give those of one autopilot")
    if fitting:
        return fitting[0]
    kind = "on rotors" if rotors else "on wings"
    raise StoopError(
        f"control laws: the parameters are those of {known[0].title}, but the vehicle flies {kind}: take its own log"
    )
