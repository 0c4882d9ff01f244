"""What to change in a mapping when the data contradict it: impossible sizes, lost signs, swapped axes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.units import FACTORS
from stoop.base.variables import VARIABLES
from stoop.flight.channels import Channels
from stoop.flight.faults import Fault, described
from stoop.flight.guilty import declared
from stoop.flight.mapping import READY
from stoop.flight.motion import Told, contradictions

LEAST: Final = 20  #: samples that say anything
FORCE: Final = ("ax", "ay", "az")
ALIKE: Final = 4.0  #: ratio of the noise of axes of one sensor and one unit
BAND: Final = 2.0  #: a ratio of noise this close to that of two units is taken for it


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
    **{
        name: Range(0.0, 400.0, (("cm/s", 1e2), ("mm/s", 1e3)))
        for name in ("airspeed_pitot", "airspeed_equivalent", "V", "vn", "ve", "vd")
    },
    "altitude": Range(0.0, 2.0e4, (("cm", 1e2), ("mm", 1e3))),
    **{f"rotor_{n}": Range(0.0, 6.0e3, (("rpm", 9.549),)) for n in range(1, 17)},
    **{f"pwm_{n}": Range(400.0, 3000.0, (("s", 1e-6), ("ms", 1e-3))) for n in range(1, 17)},
    **{f"motor_{n}": Range(0.0, 1.5, (("percent", 1e2),)) for n in range(1, 17)},
    **{f"servo_{n}": Range(0.0, 1.5, (("percent", 1e2),)) for n in range(1, 17)},
    "throttle": Range(0.0, 1.5, (("percent", 1e2),)),
    "control_throttle": Range(0.0, 1.5, (("percent", 1e2),)),
}  #: registry variable -> what its median size can be while it is in use


def unit_faults(channels: Sequence[Channels], places: Mapping[str, str]) -> list[Fault]:
    """Look for channels whose size no flight can have, or not beside their siblings, and name the unit that explains it.

    Parameters
    ----------
    channels : as recorded, SI by the mapping
    places : variable -> file and key of the mapping
    """
    found, declared_units = [], _declared(places)
    for group in channels:
        units = {name: unit for name in group.values if (unit := declared_units.get(name, ""))}
        told = list(_impossible(group, places, units)) or list(_odd_force(group, places, units))
        for name, size, words in told:
            found.append(
                described("wrong unit", name, size, float(group.time[0]), float(group.time[-1]), words)
            )
    return sorted(found, key=lambda fault: list(VARIABLES).index(fault.variable))


def _declared(places: Mapping[str, str]) -> dict[str, str]:
    """Return the unit of every variable that mappings of the user's name, empty where they say none; a file is read once."""
    own = {name: place.rpartition(": ")[0] for name, place in places.items() if is_own(place)}
    units = {file: declared(file) for file in set(own.values())}
    return {name: units[file].get(name, "") for name, file in own.items()}


def _impossible(
    group: Channels, places: Mapping[str, str], units: Mapping[str, str]
) -> Iterator[tuple[str, float, str]]:
    for name in RANGES.keys() & group.values.keys():
        size, known = _size(name, group), RANGES[name]
        if size and not known.low <= size <= known.high:
            alike = _alike(name, group, units)
            at = _at(places.get(name, "")) + (f", and for {' and '.join(alike)}" if alike else "")
            yield name, size, _words(name, size, known, units.get(name, ""), at)


def _alike(name: str, group: Channels, units: Mapping[str, str]) -> list[str]:
    """Return what shares a wrong unit: siblings of the vertical force that are said to be in it and scatter as it does."""
    if name != "az" or name not in units:
        return []
    own = _scatter(group.values[name])
    others = [n for n in FORCE if n != name and units.get(n) == units[name]]
    return [n for n in others if own / ALIKE < _scatter(group.values[n]) < own * ALIKE]


def _odd_force(
    group: Channels, places: Mapping[str, str], units: Mapping[str, str]
) -> Iterator[tuple[str, float, str]]:
    """Tell an axis of the specific force with another unit than its siblings, if it scatters by as much more or less."""
    if not set(FORCE) <= units.keys() or not {units[n] for n in FORCE} <= FACTORS.keys():
        return
    for name in FORCE:
        one, two = (n for n in FORCE if n != name)
        other = 0.5 * (_scatter(group.values[one]) + _scatter(group.values[two]))
        ratio = _scatter(group.values[name]) / other if other > 0.0 else 0.0
        meant = _unit_of_siblings(units[name], units[one], units[two], ratio)
        if units[name] == units[one] == units[two] and name == "az" and _weightless(group.values[name]):
            meant = "g" if 1.0 / BAND < ratio * FACTORS["g"] / FACTORS[units[name]] < BAND else ""
        if meant:
            words = (
                f"{name} is mapped as {units[name]}, {one} as {units[one]} and {two} as {units[two]}, and {name} scatters "
                f'{ratio:.3g} times as much as they do: write unit = "{meant}"{_at(places[name])}'
            )
            yield name, ratio, words


def _unit_of_siblings(own: str, one: str, two: str, ratio: float) -> str:
    """Return the unit of two axes where the third is said to have another, and scatters by the factor between them."""
    if one != two or own == one:
        return ""
    return one if 1.0 / BAND < ratio * FACTORS[one] / FACTORS[own] < BAND else ""


def _weightless(x: FloatArray) -> bool:
    return abs(float(np.nanmedian(x))) < RANGES["az"].low if np.isfinite(x).any() else False


def _scatter(x: FloatArray) -> float:
    """Return the median size of the second differences: noise of the sensor, whatever the vehicle does."""
    jumps = np.abs(np.diff(x[np.isfinite(x)], 2))
    return float(np.median(jumps)) if jumps.size >= LEAST else 0.0


def _size(name: str, group: Channels) -> float:
    """Return the median size of a channel, of the whole specific force where it is one; zeros do not count."""
    parts = ("ax", "ay", "az") if name == "az" and {"ax", "ay"} <= group.values.keys() else (name,)
    x = np.sqrt(sum((group.values[part] ** 2 for part in parts), np.zeros(group.time.size)))
    seen = x[np.isfinite(x) & (x > 0.0)]
    return float(np.median(seen)) if seen.size >= LEAST else 0.0


def _words(name: str, size: float, known: Range, said: str, at: str) -> str:
    unit = VARIABLES[name].unit
    what = "the specific force" if name == "az" else name
    plain = [(unit, FACTORS[said])] if FACTORS.get(said, 1.0) != 1.0 else []  # as if no unit had been said
    meant = next(
        (u for u, many in (*plain, *known.units) if many and known.low <= size / many <= known.high), ""
    )
    if name == "temperature" and size < 100.0:
        meant = "degC"
    fix = f"its column looks like {meant}: " if meant else "its column holds something else: "
    line = f'unit = "{meant}"' if meant else "another column"
    if name.startswith("motor_") and 700.0 <= size <= 2500.0:
        fix = "its column looks like pulses in us: "
        line = f"scale = 0.001 and offset = -1 (of 1000 to 2000 us), or call it pwm_{name[6:]} (stoop map drafts both),"
    shown = f"{size:.3g}" if unit == "1" else f"{size:.3g} {unit}"
    return f"{what} is {shown} in the median, which no flight has; {fix}write {line}{at}"


def _at(place: str) -> str:
    file, _, key = place.rpartition(": ")
    return f" for {key} in {file}" if is_own(place) else " for it in a mapping"


def is_own(place: str) -> bool:
    """Tell whether a place is in a file of the user's, not in a mapping of the package."""
    return place.partition(": ")[0] not in {"", *READY.values()}


def motion_faults(
    time: FloatArray, data: Mapping[str, FloatArray], rate: float, places: Mapping[str, str]
) -> tuple[list[Fault], Mapping[str, FloatArray]]:
    """Look for lines of a user's mapping that the other channels contradict; return them, and the columns mended.

    Parameters
    ----------
    time : (n,) s
    data : variable -> (n,), gridded
    rate : Hz
    places : variable -> file and key of the mapping
    """
    own = _declared(places)
    if not own:
        return [], data
    found, mended = contradictions(data, rate, own)
    span = float(time[0]), float(time[-1])
    return [
        described(
            "inconsistent", told[0].change.names[0], told[0].evidence, *span, _contradiction(told, places)
        )
        for told in found
    ], mended


def _contradiction(told: Sequence[Told], places: Mapping[str, str]) -> str:
    words = ", or ".join(one.change.words for one in told)
    lines = ", or ".join(f"{one.change.fix}{_lines(one.change.names, places)}" for one in told)
    open_ = "; no other channel tells which" if len(told) > 1 else ""
    return f"other channels contradict: {words}{open_}; {lines}"


def _lines(names: Sequence[str], places: Mapping[str, str]) -> str:
    keys = [places[name].rpartition(": ") for name in names]
    return f" for {' and '.join(key for *_, key in keys)} in {keys[0][0]}"


def advised(faults: Sequence[Fault], places: Mapping[str, str]) -> list[Fault]:
    """Add to each fault which line of the mapping would mend it, where one would."""
    return [replace(fault, notice=_with_line(fault, places)) for fault in faults]


def _with_line(fault: Fault, places: Mapping[str, str]) -> Notice:
    line = _line(fault, places)
    return notice("described-fault", fault.variable, text=fault.message + line) if line else fault.notice


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
