"""The mapping of a log, second edition: where each variable of the registry is found, in any kind of log.

A mapping is a TOML file. `[variables]` names one column for one variable; `[group.NAME]` names variables that
belong together and their sources in order of trust. `[calibration]`, `[surface]` and `[mixer]` turn servo
outputs into deflections (`stoop.flight.surfaces`), `[align]` brings clocks together (`stoop.flight.clocks`).
A mapping that says `extends = "px4"` starts from a ready one and overrides what it names.
`docs/flight-files.md` explains every key.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from stoop.base.text import nearest
from stoop.base.units import FACTORS
from stoop.base.variables import EULER, QUATERNION
from stoop.errors import LogError
from stoop.flight.clocks import Alignment, read_alignments
from stoop.flight.sources import Group, read_group, read_variable, split
from stoop.flight.surfaces import Surfaces, read_surfaces
from stoop.logs.mapping import TIME_UNITS, number_of, only_keys, parse_toml, read_toml, text_of

READY: Final[dict[str, str]] = {
    "ulog": "px4",
    "px4-csv": "px4",
    "dataflash": "ardupilot",
    "dataflash-text": "ardupilot",
    "crazyflie": "crazyflie",
}  #: format of a recording -> the mapping that comes with the package
_TABLES: Final = frozenset(
    {"extends", "files", "time", "clock", "variables", "group", "calibration", "surface", "mixer", "align"}
)

_FORMS: Final = (
    (frozenset(EULER), frozenset(QUATERNION)),
    (frozenset({"airspeed_pitot"}), frozenset({"airspeed_equivalent"})),
)


@dataclass(frozen=True)
class Clock:
    """The column that holds the time of a stream.

    Attributes
    ----------
    column : name
    factor : s of one
    offset : s, added
    """

    column: str
    factor: float
    offset: float = 0.0


@dataclass(frozen=True)
class FlightMapping:
    """A whole mapping, with what it extends.

    Attributes
    ----------
    place : file, or name of the ready mapping, for messages
    groups : name -> group, in order of precedence: a variable belongs to the first that supplies it
    clock : of every stream that holds its column; None keeps the clocks of the reader
    clocks : stream -> a clock of its own
    surfaces : calibrations and mixers
    alignments : of clocks that disagree
    files : name -> file beside the log, that is read as well
    """

    place: str
    groups: Mapping[str, Group]
    clock: Clock | None = None
    clocks: Mapping[str, Clock] = field(default_factory=dict)
    surfaces: Surfaces = field(default_factory=Surfaces)
    alignments: tuple[Alignment, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)

    @property
    def streams(self) -> frozenset[str]:
        """Names of the streams it needs, without instance."""
        named = {source.stream for group in self.groups.values() for source in group.sources}
        named |= {name for align in self.alignments for name in (align.stream, align.reference)}
        return frozenset(name.partition("/")[0] for name in named)


@functools.cache
def ready(name: str) -> FlightMapping:
    """Return a mapping that comes with the package.

    Raises
    ------
    LogError
        When there is none of that name.
    """
    if name not in READY.values():
        raise LogError(f"there is no ready mapping '{name}'; {nearest(name, sorted(set(READY.values())))}")
    text = (files("stoop.data") / "mappings" / f"{name}.toml").read_text("utf-8")
    return flight_mapping(name, parse_toml(f"{name}.toml", text.encode()))


def read_flight_mapping(path: Path) -> FlightMapping:
    """Read a mapping of either edition.

    Raises
    ------
    LogError
        When the file is missing, is no TOML, or says something unknown or impossible; names the key and the fix.
    FlightError
        When it names a variable that is not in the registry.
    """
    return flight_mapping(str(path), read_toml(path))


def flight_mapping(place: str, content: Mapping[str, Any]) -> FlightMapping:
    """Return the mapping that a file of this content is; see `read_flight_mapping`."""
    for key in content:
        if key not in _TABLES:
            raise LogError(f"{place}: unknown table '{key}'; a mapping has {', '.join(sorted(_TABLES))}")
    own = _groups(place, content)
    base = ready(text_of(place, "top level", content, "extends")) if "extends" in content else None
    surfaces = read_surfaces(place, content)
    alignments = read_alignments(place, _sub(place, content, "align"))
    if not own and base is None:
        raise LogError(
            f"{place}: it names no variable; add a table [variables], such as p = {{column = "
            '"p", unit = "rad/s"}, or extends = "px4"'
        )
    return FlightMapping(
        place,
        own if base is None else {**own, **_left(base.groups, own)},
        _clock(place, "time", content["time"]) if "time" in content else None,
        {name: _clock(place, f"clock.{name}", x) for name, x in _sub(place, content, "clock").items()},
        surfaces,
        alignments,
        {
            name: text_of(place, "files", table, name)
            for table in [_sub(place, content, "files")]
            for name in table
        },
    )


def _groups(place: str, content: Mapping[str, Any]) -> dict[str, Group]:
    groups = {
        name: read_variable(place, name, entry) for name, entry in _sub(place, content, "variables").items()
    }
    for name, table in _sub(place, content, "group").items():
        groups.update(split(name, read_group(place, name, table)))
    return groups


def _left(base: Mapping[str, Group], own: Mapping[str, Group]) -> dict[str, Group]:
    """Return what a base still supplies: no group of the same name, none of the variables named anew."""
    taken = {name for group in own.values() for source in group.sources for name in source.variables}
    kept = {name: group for name, group in base.items() if name.partition(".")[0] not in own}
    left = {
        name: replace(group, without=group.without | with_other_form(taken)) for name, group in kept.items()
    }
    return {name: group for name, group in left.items() if name not in own}


def with_other_form(taken: Set[str]) -> frozenset[str]:
    """Count the other form of an attitude, or of the pitot's airspeed, as taken too: both would contradict each other."""
    others = [other for forms in _FORMS for form, other in (forms, forms[::-1]) if taken & form]
    return frozenset(taken).union(*others)


def _sub(place: str, content: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    table = content.get(key, {})
    if not isinstance(table, dict):
        raise LogError(f"{place}: {key} is not a table; write [{key}]")
    return table


def _clock(place: str, where: str, table: object) -> Clock:
    if not isinstance(table, dict):
        raise LogError(f'{place}: {where} is not a table; write column = "t", unit = "s" under [{where}]')
    only_keys(place, where, table, frozenset({"column", "unit", "offset"}))
    unit = text_of(place, where, table, "unit")
    if unit not in TIME_UNITS:
        raise LogError(
            f"{place}: {where}.unit = '{unit}' is no unit of time; write one of {', '.join(TIME_UNITS)}"
        )
    offset = number_of(place, where, table, "offset", 0.0)
    return Clock(text_of(place, where, table, "column"), FACTORS[unit], offset)
