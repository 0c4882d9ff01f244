"""What to change in a mapping when the data contradict it: impossible sizes, lost signs, swapped axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.flight.channels import Channels
from stoop.flight.faults import Fault
from stoop.flight.mapping import READY
from stoop.flight.variables import VARIABLES

LEAST: Final = 20  #: samples that say anything


@dataclass(frozen=True)
class Range:
    """Sizes that a variable has in flight.

    Attributes
    ----------
    low, high : SI; between them lies the median of the sizes, in any flight
    units : others that logs use, and how many of them make one of ours
    """

    low: float
    high: float
    units: tuple[tuple[str, float], ...]


RANGES: Final = {
    "az": Range(2.0, 60.0, (("g", 1 / 9.80665), ("mg", 1e3 / 9.80665), ("cm/s2", 1e2), ("mm/s2", 1e3))),
    "voltage": Range(2.0, 900.0, (("mV", 1e3),)),
    "pressure": Range(1.0e4, 1.2e5, (("hPa", 1e-2), ("kPa", 1e-3))),
    "temperature": Range(180.0, 340.0, (("degC", 0.0),)),
    "density": Range(0.2, 1.6, ()),
    "airspeed_pitot": Range(0.0, 400.0, (("cm/s", 1e2), ("mm/s", 1e3))),
    "V": Range(0.0, 400.0, (("cm/s", 1e2), ("mm/s", 1e3))),
    **{name: Range(0.0, 400.0, (("cm/s", 1e2), ("mm/s", 1e3))) for name in ("vn", "ve", "vd")},
    "altitude": Range(0.0, 2.0e4, (("cm", 1e2), ("mm", 1e3))),
    **{f"rotor_{n}": Range(0.0, 6.0e3, (("rpm", 9.549),)) for n in range(1, 17)},
    **{f"pwm_{n}": Range(400.0, 3000.0, (("s", 1e-6), ("ms", 1e-3))) for n in range(1, 17)},
    **{f"motor_{n}": Range(0.0, 1.5, (("percent", 1e2),)) for n in range(1, 17)},
    **{f"servo_{n}": Range(0.0, 1.5, (("percent", 1e2),)) for n in range(1, 17)},
    "throttle": Range(0.0, 1.5, (("percent", 1e2),)),
    "control_throttle": Range(0.0, 1.5, (("percent", 1e2),)),
}  #: registry variable -> what its median size can be while it is in use


def unit_faults(channels: Sequence[Channels], places: Mapping[str, str]) -> list[Fault]:
    """Look for channels whose size no flight can have, and name the unit that would explain it.

    Parameters
    ----------
    channels : as recorded, SI by the mapping
    places : variable -> file and key of the mapping
    """
    found = []
    for group in channels:
        for name in RANGES.keys() & group.values.keys():
            size = _size(name, group)
            known = RANGES[name]
            if size and not known.low <= size <= known.high:
                at = (float(group.time[0]), float(group.time[-1]))
                words = _words(name, size, known, places.get(name, ""))
                found.append(Fault("wrong unit", name, size, *at, words))
    return sorted(found, key=lambda fault: list(VARIABLES).index(fault.variable))


def _size(name: str, group: Channels) -> float:
    """Return the median size of a channel, of the whole specific force where it is one; zeros do not count."""
    parts = ("ax", "ay", "az") if name == "az" and {"ax", "ay"} <= group.values.keys() else (name,)
    x = np.sqrt(sum((group.values[part] ** 2 for part in parts), np.zeros(group.time.size)))
    seen = x[np.isfinite(x) & (x > 0.0)]
    return float(np.median(seen)) if seen.size >= LEAST else 0.0


def _words(name: str, size: float, known: Range, place: str) -> str:
    unit = VARIABLES[name].unit
    what = "the specific force" if name == "az" else name
    meant = next((u for u, many in known.units if many and known.low <= size / many <= known.high), "")
    if name == "temperature" and size < 100.0:
        meant = "degC"
    fix = f"its column looks like {meant}: " if meant else "its column holds something else: "
    line = f'unit = "{meant}"' if meant else "another column"
    return f"{what} is {size:.3g} {unit} in the median, which no flight has; {fix}write {line}{_at(place)}"


def _at(place: str) -> str:
    file, _, key = place.rpartition(": ")
    return f" for {key} in {file}" if is_own(place) else " for it in a mapping"


def is_own(place: str) -> bool:
    """Tell whether a place is in a file of the user's, not in a mapping of the package."""
    return place.partition(": ")[0] not in {"", *READY.values()}


def advised(faults: Sequence[Fault], places: Mapping[str, str]) -> list[Fault]:
    """Add to each fault which line of the mapping would mend it, where one would."""
    return [replace(fault, message=fault.message + _line(fault, places)) for fault in faults]


def _line(fault: Fault, places: Mapping[str, str]) -> str:
    at = _at(places.get(fault.variable, ""))
    if not is_own(places.get(fault.variable, "")) or fault.kind not in ("inconsistent", "wrong sign"):
        return ""
    if "the sign of one of them" in fault.message:
        return f"; if it is {fault.variable}'s, write scale = -1{at}"
    for unit in ("rad/s", "deg/s"):
        if fault.message.endswith(f"is in {unit}"):
            return f'; write unit = "{unit}"{at}'
    if "axes are swapped" in fault.message:
        return f"; exchange the columns{at}"
    return f": there is the line{at}" if fault.kind == "wrong sign" else f"; look at the column and unit{at}"
