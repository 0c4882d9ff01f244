"""The laws by firmware and kind of vehicle, and which of them the parameters of a log belong to."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from stoop.control_laws import ardupilot, px4
from stoop.control_laws.rate_law import AXES, RateLaw
from stoop.errors import StoopError


@dataclass(frozen=True)
class Firmware:
    """A law: what flies by it, a parameter by which it is known, and the law about an axis from parameters."""

    title: str
    known_by: str
    law: Callable[[Mapping[str, float], str], RateLaw]
    axes: tuple[str, ...] = AXES
    airspeed_ratio: Callable[[Mapping[str, float], float], float] | None = (
        None  #: of calibrated airspeed, m/s
    )


LAWS: Final = (
    Firmware("PX4 multicopter", "MC_ROLLRATE_P", px4.multicopter),
    Firmware("PX4 fixed wing", "FW_RR_P", px4.fixed_wing, airspeed_ratio=px4.airspeed_ratio),
    Firmware("ArduCopter", "ATC_RAT_RLL_P", ardupilot.copter),
    Firmware("ArduPlane", "RLL_RATE_P", ardupilot.plane, airspeed_ratio=ardupilot.airspeed_ratio),
    Firmware(
        "ArduPlane before 4.1", "RLL2SRV_P", ardupilot.old_plane, ("roll", "pitch"), ardupilot.airspeed_ratio
    ),
)


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
            f"control laws: the log has no parameters of an autopilot that is known (none of {known}); take gains from a file"
        )
    return found
