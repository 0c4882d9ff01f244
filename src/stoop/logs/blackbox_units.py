"""Fields of a blackbox log -> physical quantities, by the settings in its header.

Body axes of gyro and accelerometer are forward, left, up, as the firmware's attitude filter takes them; mappings turn them.

References
----------
.. [1] Betaflight, blackbox-log-viewer, src/flightlog_fields_presenter.js: units of the fields by version.
.. [2] Betaflight, src/main/blackbox/blackbox.c (loadMainState): scales of gyro, quaternion, set-points and rotor speeds.
.. [3] INAV, src/main/blackbox/blackbox.c: the fields of INAV.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from stoop.base.units import DEGREE

Columns: TypeAlias = dict[str, npt.NDArray[Any]]
DSHOT: Final = (48.0, 2047.0)  #: commands of the digital protocol, from stop to full
PULSES: Final = (1000.0, 2000.0)  #: us, where the header does not say
SLOWEST_PULSE: Final = 500.0  #: us
ACC_1G: Final = 2048.0  #: of most accelerometers, where the header does not say
POLES: Final = 14.0  #: of a motor, where the header does not say
QUATERNION_ONE: Final = 32767.0
MEAN_RADIUS: Final = 6_371_008.8  #: m, of the earth (IUGG)
INAV, BETAFLIGHT, OTHER = "INAV", "Betaflight", ""


@dataclass(frozen=True)
class Settings:
    """The lines of a header."""

    lines: Mapping[str, str]  #: name -> value

    def text(self, name: str) -> str:
        """Return a value as it is written; empty where there is none."""
        return self.lines.get(name, "")[:500]

    def number(self, name: str, place: int = 0) -> float:
        """Return a number of a list; NaN where there is none."""
        parts = self.text(name).split(",")
        try:
            value = float(parts[place]) if place < len(parts) else math.nan
        except ValueError:
            return math.nan
        return value if abs(value) < 1e9 else math.nan

    def numbers(self) -> dict[str, float]:
        """Return all settings that are one number, and those of lists as ``name[k]``."""
        last = {n: text.count(",", 0, 500) for n, text in self.lines.items() if not n.startswith("Field ")}
        found = {f"{n}[{k}]" if m else n: self.number(n, k) for n, m in last.items() for k in range(m + 1)}
        return {name: value for name, value in found.items() if math.isfinite(value)}

    @cached_property
    def firmware(self) -> tuple[str, float]:
        """Name, and major and minor version as one number (4.05 is 4.5)."""
        match = re.match(r"\s*(\w+)[^\d]*(\d{1,4})\.(\d{1,2})", self.text("Firmware revision"))
        if match is None:
            return OTHER, math.nan
        name = {"inav": INAV, "betaflight": BETAFLIGHT}.get(match[1].lower(), OTHER)
        return name, int(match[2]) + int(match[3]) / 100.0

    @property
    def gyro_scale(self) -> float:
        """Return deg/s of one."""
        name = next((x for x in ("gyro_scale", "gyro.scale", "gyroScale") if self.text(x)), "")
        text, scale = self.text(name), 1.0
        if re.fullmatch(r"0x[0-9a-fA-F]{1,8}", text):
            scale = float(struct.unpack(">f", bytes.fromhex(text[2:].rjust(8, "0")))[0])
        elif text:
            scale = self.number(name)
        if not (math.isfinite(scale) and 0.0 < scale < 1e3):
            scale = 1.0
        if scale < 1e-6:  # rad/us, as the first firmwares and exporters have it
            scale *= 1e6 / DEGREE
        return scale

    @property
    def fine(self) -> float:
        """Return 10 where gyro, sticks and set-points were logged ten times as fine."""
        return 10.0 if self.number("blackbox_high_resolution") == 1.0 else 1.0

    @property
    def motor_range(self) -> tuple[float, float]:
        """Commands to a motor from stop to full; (0, 0) where the header does not tell."""
        low, high = (self.number("motorOutput", k) for k in range(2))
        if self.firmware[0] != INAV and is_digital(low, high):
            return DSHOT
        for least, full in ((self.number("minthrottle"), self.number("maxthrottle")), (low, high)):
            if 0.0 <= least < full:
                return least, full
        return 0.0, 0.0


def is_digital(low: float, high: float) -> bool:
    """Return whether commands to motors from idle to their limit, as the firmware counts them, are DSHOT and no pulses."""
    return low < SLOWEST_PULSE or high > PULSES[1]


def physical(raw: Columns, settings: Settings, stream: str) -> tuple[Columns, dict[str, str], list[str]]:
    """Return columns in physical units where the header tells them.

    Parameters
    ----------
    raw : field -> (n,) numbers as logged
    settings : of the same log
    stream : the kind of frames

    Returns
    -------
    columns : field -> (n,) numbers; some are made of several fields
    units : field -> unit, of those that were converted
    assumed : what the header does not tell, as sentences
    """
    if stream == "gps":
        return _position(raw, settings)
    if stream != "main":
        return dict(raw), {}, []
    columns = dict(raw)
    factors, assumed = _factors(raw, settings)
    units: dict[str, str] = {}
    for pattern, factor, unit in factors:
        for name in [name for name in raw if re.fullmatch(pattern, name)]:
            columns[name] = (raw[name] * factor).astype(np.float32)
            units |= {name: unit} if unit else {}
    motors = [name for name in raw if re.fullmatch(r"motor\[\d\]", name)]
    if motors:
        (low, high), told = settings.motor_range, True
        if not low < high:
            full = max(float(np.nanmax(raw[name], initial=0.0)) for name in motors)
            (low, high), told = DSHOT if full > 2000.0 else PULSES, False
        for name in motors:
            share = (raw[name].astype(np.float64) - low) / (high - low)
            columns[name] = np.maximum(share, 0.0).astype(np.float32)  # 0 of DSHOT is a stopped motor
            units[name] = "1"
        if not told:
            assumed.append(f"the range of motors is not stated; {low:g} to {high:g} is assumed")
    if all(f"imuQuaternion[{k}]" in raw for k in range(3)):
        norm = np.sum([np.square(columns[f"imuQuaternion[{k}]"], dtype=np.float64) for k in range(3)], axis=0)
        columns["imuQuaternion[w]"] = np.sqrt(np.maximum(1.0 - norm, 0.0))  # never negative, as it is logged
    for axis in range(3):
        parts = [raw[f"axis{term}[{axis}]"] for term in "PIDFS" if f"axis{term}[{axis}]" in raw]
        if parts:
            columns[f"axisSum[{axis}]"] = np.asarray(np.sum(parts, axis=0), dtype=np.float32)
    return columns, units, assumed


def _factors(raw: Columns, settings: Settings) -> tuple[list[tuple[str, float, str]], list[str]]:
    """Return pattern of names, factor and unit of what is proportional to a quantity; and what the header does not tell."""
    assumed = []
    fine, one, poles = settings.fine, settings.number("acc_1G"), settings.number("motor_poles")
    if not one >= 1.0:
        one = ACC_1G
        assumed += [f"acc_1G is not stated; {one:g} is assumed for 1 g"] if "accSmooth[2]" in raw else []
    if not poles >= 2.0:
        poles = POLES
        assumed += [f"motor_poles is not stated; {poles:g} is assumed"] if "eRPM[0]" in raw else []
    return [
        (r"(gyroADC|gyroUnfilt|gyroRaw2?)\[\d\]", settings.gyro_scale / fine, "deg/s"),
        (r"setpoint\[[012]\]", 1.0 / fine, "deg/s"),
        (r"rcCommand\[\d\]", 1.0 / fine, ""),
        (r"accSmooth\[\d\]", 1.0 / one, "g"),
        (r"eRPM\[\d\]", 200.0 / poles, "rpm"),  # a hundredth of the electrical speed
        (r"vbat(Latest)?", _volts(settings), "V"),
        (r"amperage(Latest)?", 0.01, "A"),
        (r"imuQuaternion\[\d\]", 1.0 / QUATERNION_ONE, ""),
    ], assumed


def _volts(settings: Settings) -> float:
    """Return volts of one of the battery's voltage."""
    name, version = settings.firmware
    if name == BETAFLIGHT and version < 3.01:  # of a converter with 12 bits and 3.3 V
        known = settings.number("vbat_scale")
        return (known if 1.0 <= known <= 255.0 else 110.0) * 330.0 / 4095.0 / 1000.0
    return 0.1 if name == BETAFLIGHT and version < 4.0 else 0.01


def _position(raw: Columns, settings: Settings) -> tuple[Columns, dict[str, str], list[str]]:
    """Return GPS fields, latitude and longitude in deg, with the way from the first fix and the velocity over ground."""
    columns, units = dict(raw), dict[str, str]()
    name, version = settings.firmware
    if "GPS_altitude" in raw:
        step = 0.1 if name == BETAFLIGHT and version >= 4.0 else 1.0
        columns["GPS_altitude"], units["GPS_altitude"] = raw["GPS_altitude"] * step, "m"
    if {"GPS_coord[0]", "GPS_coord[1]"} <= raw.keys():
        latitude, longitude = (raw[f"GPS_coord[{k}]"] * 1e-7 for k in range(2))
        columns["GPS_coord[0]"], columns["GPS_coord[1]"] = latitude, longitude
        units |= {"GPS_coord[0]": "deg", "GPS_coord[1]": "deg"}
        fixes = np.flatnonzero((latitude != 0.0) | (longitude != 0.0))
        if fixes.size:
            at = fixes[0]
            fixed = (latitude != 0.0) | (longitude != 0.0)
            arc = MEAN_RADIUS * DEGREE
            turn = (longitude - longitude[at] + 180.0) % 360.0 - 180.0
            east = arc * math.cos(float(latitude[at]) * DEGREE) * turn
            columns["GPS_north"] = np.where(fixed, arc * (latitude - latitude[at]), np.nan)
            columns["GPS_east"] = np.where(fixed, east, np.nan)
            units |= {"GPS_north": "m", "GPS_east": "m"}
    if {"GPS_speed", "GPS_ground_course"} <= raw.keys() and "GPS_velned[0]" not in raw:
        course = raw["GPS_ground_course"] * (0.1 * DEGREE)
        speed = raw["GPS_speed"].astype(np.float64)
        columns["GPS_velned[0]"], columns["GPS_velned[1]"] = speed * np.cos(course), speed * np.sin(course)
    return columns, units, []
