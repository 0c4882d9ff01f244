"""A flight as a blackbox log of Betaflight: whole numbers, at the resolution that the firmware logs."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stoop import Flight
from stoop.extend.arrays import FloatArray
from stoop.extend.flights import FlightMapping
from stoop.extend.variables import VARIABLES
from stoop_plan import blackbox_bytes as blackbox
from stoop_plan.blackbox_bytes import Field, Rows, blackbox_bytes
from stoop_plan.log_bytes import MICROSECOND
from stoop_plan.log_columns import Columns, MappingFile, lay_out

FINE: Final = 10.0  #: of gyro: blackbox_high_resolution is on
ONE_G: Final = 2048.0
GPS_PERIOD: Final = 0.1  #: s
HOME: Final = (474_000_000, 85_000_000)  #: 1e-7 deg of latitude and longitude, of the origin
MOST: Final = 2**31 - 1
DSHOT: Final = (48.0, 2047.0)  #: commands of the digital protocol, from stop to full
POLES: Final = 14.0  #: of a motor
QUATERNION_ONE: Final = 32767.0
MEAN_RADIUS: Final = 6_371_008.8  #: m, of the earth (IUGG)
RESOLUTION: Final = 10**8  #: the largest number of a field that stoop adds


def _numbered(name: str, count: int) -> tuple[str, ...]:
    return tuple(f"{name}[{k}]" for k in range(count))


QUATERNION_FIELDS: Final = _numbered("imuQuaternion", 3)
SCALES: Final = {
    "vbatLatest": 100.0, "amperageLatest": 100.0, "baroAlt": 1.0, "AirSpeed": 1.0,
    **dict.fromkeys(_numbered("gyroADC", 3), FINE), **dict.fromkeys(_numbered("accSmooth", 3), ONE_G),
    **dict.fromkeys(QUATERNION_FIELDS, QUATERNION_ONE), **dict.fromkeys(_numbered("motor", 8), DSHOT[1] - DSHOT[0]),
    **dict.fromkeys(_numbered("servo", 8), 1.0), **dict.fromkeys(_numbered("eRPM", 8), POLES / 200.0),
}  #: field of main frames, in their order -> what is logged of one  # fmt: skip
GPS_FIELDS: Final = ("GPS_altitude", *_numbered("GPS_velned", 3), "GPS_north", "GPS_east")
_GROUP: Final = (blackbox.ZERO, blackbox.SIGNED_VB, blackbox.PREVIOUS, blackbox.TAG8_8SVB)
_SMOOTH: Final = (blackbox.ZERO, blackbox.SIGNED_VB, blackbox.AVERAGE_2, blackbox.SIGNED_VB)


def betaflight_log(flight: Flight) -> tuple[bytes, str]:
    """Return a blackbox log and its mapping.

    A missing value is the one before it, as a firmware logs the last reading; rows without any value are a gap. Position and
    velocity are GPS frames, ten a second. What the firmware has no field for is a field "sim.NAME", in steps of a power of ten.
    """
    wanted = {"main": ("imuQuaternion[w]", *SCALES), "gps": GPS_FIELDS}
    (streams, unmapped), time = lay_out(flight, FlightMapping.ready("betaflight"), wanted), flight.time
    mapping, main = MappingFile("betaflight"), streams.get("main", {})
    kept = np.flatnonzero(
        np.any([np.isfinite(x) for x in (*main.values(), *unmapped.values())] or [[]], axis=0)
    )
    if not main and not unmapped:
        kept = np.arange(time.size)
    numbers: dict[str, npt.NDArray[np.int64]] = {}
    if "imuQuaternion[w]" in main:  # either sign is the same attitude; w is never negative in a log
        sign = np.where(main["imuQuaternion[w]"] < 0.0, -1.0, 1.0)
        main |= {name: main[name] * sign for name in QUATERNION_FIELDS}
    for name, scale in SCALES.items():
        if name in main:
            numbers[name] = _whole(scale * main[name][kept])
    for name in [name for name in numbers if name.startswith("motor")]:
        numbers[name] = np.clip(numbers[name] + round(DSHOT[0]), round(DSHOT[0]), round(DSHOT[1]))
    extra = {}
    for name, x in unmapped.items():
        largest = float(np.max(np.abs(x[np.isfinite(x)]), initial=1e-30))
        power = math.floor(math.log10(RESOLUTION / largest)) if largest < 1e300 else -300
        extra[f"sim.{name}"] = _whole(x[kept] * 10.0 ** min(power, 9))
        step = f", scale = {10.0 ** -min(power, 9):g}"
        mapping.add(name, f"sim.{name}", VARIABLES[name].unit, "main", step)
    period = float(np.median(np.diff(time))) if time.size > 1 else 1.0
    stamps = np.rint(time[kept] / MICROSECOND).astype(np.int64)
    clock = {"loopIteration": np.rint((time[kept] - time[0]) / period).astype(np.int64), "time": stamps}
    if kept.size and np.any(np.diff(clock["loopIteration"]) < 1):
        clock["loopIteration"] = np.arange(kept.size)
    reference = int(numbers["vbatLatest"][0]) if numbers.get("vbatLatest", np.zeros(0)).size else 0
    settings = {
        "Firmware type": "Cleanflight", "Firmware revision": "Betaflight 4.5.0 (simulated by stoop)",
        "minthrottle": 1000, "maxthrottle": 2000, "gyro_scale": "0x3f800000", "acc_1G": int(ONE_G),
        "motorOutput": f"{DSHOT[0]:.0f},{DSHOT[1]:.0f}", "vbatref": reference, "blackbox_high_resolution": 1,
        "motor_poles": int(POLES),
    }  # fmt: skip
    values = {**clock, **numbers, **extra}
    fields = [
        Field("loopIteration", False, blackbox.ZERO, blackbox.UNSIGNED_VB, blackbox.INC, blackbox.NULL),
        Field("time", False, blackbox.ZERO, blackbox.UNSIGNED_VB, blackbox.STRAIGHT_LINE, blackbox.SIGNED_VB),
        *(_field(name) for name in (*numbers, *extra)),
    ]
    return blackbox_bytes(fields, values, settings, _gps(streams.get("gps", {}), time, kept)), mapping.text()


def _field(name: str) -> Field:
    """Return a field as Betaflight defines it."""
    if name == "vbatLatest":
        return Field(name, False, blackbox.VBATREF, blackbox.NEG_14BIT, blackbox.PREVIOUS, blackbox.TAG8_8SVB)
    if name in ("amperageLatest", "baroAlt", "AirSpeed"):
        return Field(name, True, *_GROUP)
    if name == "motor[0]":
        return Field(name, False, blackbox.MINMOTOR, blackbox.UNSIGNED_VB, blackbox.AVERAGE_2)
    if name.startswith("motor"):
        return Field(name, False, blackbox.MOTOR_0, blackbox.SIGNED_VB, blackbox.AVERAGE_2)
    if name.startswith("servo"):
        return Field(name, False, blackbox.P_1500, blackbox.SIGNED_VB, blackbox.AVERAGE_2)
    if name.startswith("eRPM"):
        return Field(name, False, blackbox.ZERO, blackbox.UNSIGNED_VB, blackbox.PREVIOUS)
    return Field(name, True, *_SMOOTH)


def _whole(x: FloatArray) -> npt.NDArray[np.int64]:
    """Return whole numbers (n,) of 32 bits; a missing one is the one before it, or the first there is."""
    there = np.flatnonzero(np.isfinite(x))
    if not there.size:
        return np.zeros(x.size, np.int64)
    last = there[np.maximum(np.searchsorted(there, np.arange(x.size), side="right") - 1, 0)]
    return np.rint(np.clip(x[last], -MOST, MOST)).astype(np.int64)


def _gps(columns: Columns, time: FloatArray, kept: npt.NDArray[np.intp]) -> dict[str, Rows]:
    """Return the frames of GPS and home; none where there is neither position nor velocity."""
    if not columns or not kept.size:
        return {}
    ticks = np.floor((time[kept] - time[0]) / GPS_PERIOD + 1e-6)
    new = np.flatnonzero(np.diff(ticks, prepend=-1.0) > 0.0)
    fixes = kept[new]
    good = np.all([np.isfinite(x[fixes]) for x in columns.values()], axis=0)
    new, fixes = new[good], fixes[good]
    arc = MEAN_RADIUS * math.radians(1.0) * 1e-7
    across = arc * math.cos(math.radians(HOME[0] * 1e-7))
    nothing = np.zeros(fixes.size)
    at = {name: columns[name][fixes] if name in columns else nothing for name in GPS_FIELDS}
    values: dict[str, npt.NDArray[Any]] = {
        "GPS_numSat": np.full(fixes.size, 12),
        "GPS_altitude": _whole(10.0 * at["GPS_altitude"]),
        "GPS_coord[0]": _whole(HOME[0] + at["GPS_north"] / arc),
        "GPS_coord[1]": _whole(HOME[1] + at["GPS_east"] / across),
        **{name: _whole(at[name]) for name in _numbered("GPS_velned", 3)},
    }
    places = () if "GPS_north" not in columns else _numbered("GPS_coord", 2)
    listed = [Field("GPS_numSat", False, encoding=blackbox.UNSIGNED_VB)]
    listed += [Field(name, True, blackbox.HOME_COORD) for name in places]
    listed += [Field(name) for name in GPS_FIELDS if name in columns and name in values]
    home = {"GPS_home[0]": np.array([HOME[0]]), "GPS_home[1]": np.array([HOME[1]])}
    return {
        "H": Rows([Field(name) for name in home], np.zeros(1, np.intp), home),
        "G": Rows(listed, new, values),
    }
