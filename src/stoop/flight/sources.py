"""Where a group of variables is found: streams and columns in order of trust, as a mapping names them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

from stoop.base.text import nearest
from stoop.base.units import FACTORS, KINDS, ZEROS
from stoop.base.variables import VARIABLES
from stoop.errors import FlightError, LogError
from stoop.flight.frames import Frame, check_frame
from stoop.logs.mapping import TIME_UNITS, factor_of, number_of, only_keys, text_of

MOST: Final = 64  #: names that one pair of braces may stand for
_BRACES: Final = re.compile(r"\{(\d{1,3})\.\.(\d{1,3})\}")
LINE_KEYS: Final = frozenset(
    "stream file column unit scale offset valid stamp stamp_unit frame optional unused instance".split()  # noqa: SIM905
)
_SOURCE: Final = (LINE_KEYS - {"column", "file"}) | {"columns", "variables", "partial"}
GROUP_KEYS: Final = _SOURCE | {"sources", "choose"}

Instance = Literal["first", "most moved"]


@dataclass(frozen=True)
class Source:
    """One stream that can supply a group of variables.

    Attributes
    ----------
    place : file and key, for messages
    variables : names in the registry
    stream : of the recording; empty means the one stream that holds the columns
    columns : one per variable: column -> weight, summed
    factors, offsets : SI value of one and of zero, one per variable
    units : as written, one per variable; empty where it was not
    valid : flags that must be positive for a sample to count, one per variable; empty is none
    stamp : column that holds the time of the measurement [stamp_factor s], empty for that of the stream
    frame : axes that the columns are in, where they are not ours
    instance : which of several instances of the stream is taken
    partial : columns that are not there are left out; otherwise all must be there
    unused : a column that never holds anything but this is left out
    required : its absence is an error
    """

    place: str
    variables: tuple[str, ...]
    stream: str
    columns: tuple[Mapping[str, float], ...]
    factors: tuple[float, ...]
    offsets: tuple[float, ...]
    units: tuple[str, ...]
    valid: tuple[str, ...] = ()
    stamp: str = ""
    stamp_factor: float = 1e-6
    frame: Frame = ()
    instance: Instance = "first"
    partial: bool = False
    unused: float | None = None
    required: bool = False


@dataclass(frozen=True)
class Group:
    """Variables that belong together.

    Attributes
    ----------
    sources : in order of trust
    choose : "fastest": the first that holds values, unless a later one was logged more than twice as fast;
        "first": the first that holds values
    without : variables that others supply
    """

    sources: tuple[Source, ...]
    choose: Literal["fastest", "first"] = "fastest"
    without: frozenset[str] = frozenset()


def read_variable(place: str, name: str, entry: object) -> Group:
    """Read a line of [variables]: one column for one variable."""
    where = f"variables.{name}"
    if not isinstance(entry, dict):
        raise LogError(f'{place}: {where} is not a table; write {name} = {{column = "...", unit = "..."}}')
    only_keys(place, where, entry, LINE_KEYS)
    if name not in VARIABLES:
        raise FlightError(f"{place}: {where} is no variable of stoop; {nearest(name, VARIABLES)}")
    text_of(place, where, entry, "unit")
    if "column" not in entry:
        raise LogError(f'{place}: {where}.column is missing; write column = "..."')
    stream = entry.get("stream", entry.get("file", ""))
    rest = {key: x for key, x in entry.items() if key not in ("column", "file", "stream")}
    table = {**rest, "variables": [name], "columns": [entry["column"]], "stream": stream}
    source = _source(place, where, table)
    return Group((replace(source, required=not entry.get("optional", False)),))


def read_group(place: str, name: str, table: object) -> Group:
    """Read a table [group.NAME]: variables that belong together, and their sources in order of trust."""
    where = f"group.{name}"
    if not isinstance(table, dict):
        raise LogError(f"{place}: {where} is not a table; write variables and sources under [{where}]")
    only_keys(place, where, table, GROUP_KEYS)
    sources = table.get("sources", [{}])
    if not isinstance(sources, list) or not all(isinstance(source, dict) for source in sources):
        raise LogError(f"{place}: {where}.sources is not a list of tables; write sources = [{{...}}, ...]")
    choose = table.get("choose", "fastest")
    if choose not in ("fastest", "first"):
        raise LogError(f'{place}: {where}.choose is unknown; write "fastest" or "first"')
    common = {key: x for key, x in table.items() if key not in ("sources", "choose")}
    found = []
    for i, source in enumerate(sources):
        at = f"{where}.sources[{i}]"
        only_keys(place, at, source, _SOURCE)
        found.append(_source(place, at, {**common, **source}))
    return Group(tuple(found), choose)


def split(name: str, group: Group) -> dict[str, Group]:
    """Return one group per variable where the variables stand in different streams, else the group itself."""
    if not any(_BRACES.search(source.stream) for source in group.sources):
        return {name: group}
    parts: dict[str, Group] = {}
    for source in group.sources:
        streams = _expanded(source.place, source.stream)
        columns = source.columns * len(streams) if len(source.columns) == 1 else source.columns
        if not len(streams) == len(source.variables) == len(columns):
            raise LogError(f"{source.place}: as many streams as variables are needed; count the braces")
        for i, variable in enumerate(source.variables):
            one = _narrowed(replace(source, columns=columns), i, streams[i].removesuffix("/0"))
            before = parts.get(f"{name}.{variable}", Group((), group.choose))
            parts[f"{name}.{variable}"] = replace(before, sources=(*before.sources, one))
    return parts


def _narrowed(source: Source, i: int, stream: str) -> Source:
    lists = {
        key: getattr(source, key)[i : i + 1]
        for key in ("variables", "columns", "factors", "offsets", "units", "valid")
    }
    return replace(source, stream=stream, **lists)


def _source(place: str, where: str, table: Mapping[str, Any]) -> Source:
    at = f"{place}: {where}"
    names = _names(at, table.get("variables"), "variables")
    for name in names:
        if name not in VARIABLES:
            raise FlightError(f"{at}.variables: '{name}' is no variable of stoop; {nearest(name, VARIABLES)}")
    stream = table.get("stream", "")
    columns = _columns(at, table.get("columns"))
    if not isinstance(stream, str) or (len(columns) != len(names) and not _BRACES.search(stream)):
        raise LogError(f"{at}: {len(names)} variables, but {len(columns)} columns; name one for each")
    units = _each(at, "unit", table.get("unit", ""), len(names), str)
    factors, zeros = zip(
        *(_si(place, where, n, str(u)) for n, u in zip(names, units, strict=True)), strict=True
    )
    scales = _each(at, "scale", table.get("scale", 1.0), len(names), float)
    offsets = _each(at, "offset", table.get("offset", 0.0), len(names), float)
    stamp, stamp_factor = _stamp(place, where, table)
    return Source(
        at,
        names,
        stream,
        columns,
        factors=tuple(f * s for f, s in zip(factors, scales, strict=True)),
        offsets=tuple(z + o for z, o in zip(zeros, offsets, strict=True)),
        units=units,
        valid=_each(at, "valid", table.get("valid", ""), len(names), str),
        stamp=stamp,
        stamp_factor=stamp_factor,
        frame=check_frame(at, names, table.get("frame", [])),
        instance=_instance(at, table.get("instance", "first")),
        partial=bool(table.get("partial", False)),
        unused=number_of(place, where, table, "unused", 0.0) if "unused" in table else None,
    )


def _stamp(place: str, where: str, table: Mapping[str, Any]) -> tuple[str, float]:
    unit = table.get("stamp_unit", "us")
    if unit not in TIME_UNITS:
        raise LogError(
            f"{place}: {where}.stamp_unit is no unit of time; write one of {', '.join(TIME_UNITS)}"
        )
    return text_of(place, where, table, "stamp") if "stamp" in table else "", FACTORS[unit]


def _instance(at: str, given: object) -> Instance:
    if given == "first":
        return "first"
    if given == "most moved":
        return "most moved"
    raise LogError(f'{at}.instance is unknown; write "first" or "most moved"')


def _si(place: str, where: str, variable: str, unit: str) -> tuple[float, float]:
    """Return the SI value of one and of zero; a unit of another quantity than the variable's is refused."""
    if not unit:
        return 1.0, 0.0
    factor = factor_of(place, where, variable, unit)
    known = VARIABLES[variable].unit
    if unit != "1" and KINDS[unit] != KINDS[known]:
        same = ", ".join(u for u in FACTORS if KINDS[u] == KINDS[known])
        raise LogError(
            f"{place}: {where}.unit = '{unit}' is {KINDS[unit]}, but {variable} is {KINDS[known]}; "
            f"write one of {same}"
        )
    return factor, ZEROS.get(unit, 0.0)


def _names(at: str, given: object, key: str) -> tuple[str, ...]:
    """Return the texts of a list, or of one text, with braces written out."""
    texts = [given] if isinstance(given, str) else given
    if not isinstance(texts, list) or not texts or not all(isinstance(text, str) and text for text in texts):
        raise LogError(f'{at}.{key} is missing or no list of texts; write {key} = ["...", "..."]')
    return tuple(name for text in texts for name in _expanded(at, text))


def _expanded(at: str, text: str) -> list[str]:
    """Write out braces as a shell does: a{1..3} is a1, a2, a3."""
    found = _BRACES.search(text)
    if not found:
        return [text]
    first, last = (int(part) for part in found.groups())
    if not 0 <= last - first < MOST:
        raise LogError(f"{at}: '{text}' stands for nothing, or for more than {MOST}; write {{first..last}}")
    return [text[: found.start()] + str(n) + text[found.end() :] for n in range(first, last + 1)]


def _columns(at: str, given: object) -> tuple[Mapping[str, float], ...]:
    """Return column -> weight for each variable; a text means that column alone."""
    parts: Sequence[object] = given if isinstance(given, list) else [given]
    found: list[Mapping[str, float]] = []
    for part in parts:
        if isinstance(part, dict):
            if not part:
                raise LogError(f"{at}.columns: a sum of no columns; name one")
            found.append({name: number_of(at, "columns", part, name, 1.0) for name in part})
        else:
            found += [{name: 1.0} for name in _names(at, part, "columns")]
    return tuple(found)


def _each(at: str, key: str, given: Any, size: int, kind: type) -> tuple[Any, ...]:
    """Return one for each variable: the one that was given, or those of a list."""
    parts = given if isinstance(given, list) else [given] * size
    if len(parts) != size:
        raise LogError(f"{at}.{key}: {len(parts)} for {size} variables; give one, or as many as variables")
    if kind is float:
        return tuple(number_of(at, key, {key: part}, key, 0.0) for part in parts)
    if not all(isinstance(part, str) for part in parts):
        raise LogError(f'{at}.{key} is no text; write {key} = "..."')
    return tuple(parts)
