"""What a log says of itself: the autopilot's serial number, its firmware, when it flew, and how often it had been started.

PX4: ``sys_uuid``, ``ver_sw``, UTC of the receiver. ArduPilot: the board and firmware of its messages, weeks and milliseconds of
GPS. Blackbox: name of the craft, firmware, date. ROS bags: date. Other logs say nothing.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.extend.errors import StoopError
from stoop.extend.recordings import Recording
from stoop_fleet.parts import day, moment

CLOCKS: Final = frozenset({"vehicle_gps_position", "sensor_gps", "GPS"})  #: streams that tell the date
BOARD: Final = re.compile(r"^\S.*((?: [0-9A-F]{8}){3})$", re.MULTILINE)  #: ArduPilot's line of the board
COUNTERS: Final = ("COM_FLIGHT_UUID", "STAT_BOOTCNT")  #: parameters that grow with every flight or start
GPS_EPOCH: Final = 315964800.0  #: s since 1970
LEAP: Final = (
    18.0  #: s, GPS before UTC since 2017; one second less or more before does not change the order of flights
)
WEEK: Final = 604800.0  #: s
EARLIEST: Final = 946684800.0  #: s, the year 2000; a clock that was never set shows an earlier date


@dataclass(frozen=True)
class Header:
    """What a log says of itself; what it does not say is empty or None.

    Attributes
    ----------
    vehicle : serial number of the autopilot, or name of the craft
    software : firmware that flew
    zero : s since 1970, UTC, at which the log's own clock is zero
    count : of flights or starts of this autopilot before
    """

    vehicle: str = ""
    software: str = ""
    zero: float | None = None
    count: float | None = None


@dataclass(frozen=True)
class Dated:
    """When a flight was, by its log."""

    flight: str
    vehicle: str
    begin: float  #: s since 1970
    end: float
    count: float  #: as of `Header`; NaN where it is not known


def header(recording: Recording) -> Header:
    """Return what a recording says of itself."""
    info = recording.info
    board = BOARD.search(info.get("messages", ""))
    vehicle = info.get("sys_uuid") or (board[1].replace(" ", "") if board else info.get("craft", ""))
    counts = [recording.parameters[name] for name in COUNTERS if name in recording.parameters]
    return Header(vehicle, _software(info), next(_zeros(recording), None), next(iter(counts), None))


def _software(info: Mapping[str, str]) -> str:
    """Return the firmware: PX4's release, where it states one, and the beginning of its commit, or the text of others."""
    if not (commit := info.get("ver_sw", "")):
        return info.get("firmware", "")
    release = info.get("ver_sw_release", "")
    numbers = int(release).to_bytes(4, "big")[:3] if release.isdigit() and int(release) < 2**32 else b""
    return " ".join(filter(None, (".".join(map(str, numbers)), commit[:8])))


def _zeros(recording: Recording) -> Iterator[float]:
    """Yield when the log's own clock was zero, by every source that tells it."""
    for name, stream in recording.streams.items():
        columns, kind = stream.columns, name.partition("/")[0]
        if "time_utc_usec" in columns:
            utc = 1e-6 * columns["time_utc_usec"]
        elif kind == "GPS" and {"GWk", "GMS"} <= columns.keys():
            utc = GPS_EPOCH + WEEK * columns["GWk"] + 1e-3 * columns["GMS"] - LEAP
        else:
            continue
        if (known := np.isfinite(utc) & (utc > EARLIEST)).any():
            yield float(np.median(utc[known] - stream.time[known]))
    text = recording.info.get("start", "")
    if found := re.match(r"([0-9.]+) s after 1970$", text):
        yield float(found[1])
    elif text:
        begin = min((float(stream.time[0]) for stream in recording.streams.values()), default=np.nan)
        with suppress(StoopError, OverflowError):  # no date
            if (start := moment("start", text)) > EARLIEST:
                yield start - begin


def contradictions(flights: Iterable[Dated], fresh: Container[str]) -> dict[str, str]:
    """Return the fresh flights whose logs contradict others about vehicle and time, with the reason of each.

    Other flights are believed. A clock that was not set shows too early a date: the count is above that of the next flight,
    while none before is. Of a count that was reset, the flight before is above the next one, too.
    """
    of_vehicle: dict[str, list[Dated]] = defaultdict(list)
    for one in flights:
        of_vehicle[one.vehicle].append(one)
    out = {}
    for vehicle, several in of_vehicle.items():
        own = sorted(several, key=lambda one: (one.begin, one.flight))
        for i, one in enumerate(own):
            for other in own[i + 1 :]:
                if other.begin >= one.end:
                    break
                for this, that in ((one, other), (other, one)):
                    out[this.flight] = (
                        f"{vehicle} flies in {that.flight}, too, at this time; name the vehicles in --flights"
                    )
        counted = [one for one in own if np.isfinite(one.count) and one.flight not in out]
        counts = np.array([-np.inf, *(one.count for one in counted), np.nan])
        before, count, after = counts[:-2], counts[1:-1], counts[2:]
        for i in np.flatnonzero((count > after) & (before <= after)).tolist():
            out[counted[i].flight] = (
                f"dated {day(counted[i].begin)}, which its count of starts or flights ({count[i]:g}) contradicts; "
                "write its time in --flights"
            )
    return {flight: reason for flight, reason in out.items() if flight in fresh}
