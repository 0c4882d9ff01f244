"""A mapping: where each variable of the registry is found in a log, of any kind.

The TOML file, table by table, as pydantic models, and what it says as sources with SI factors. `[variables]` names one
column for one variable; `[group.NAME]` names variables that belong together and their sources in order of trust. A
mapping that says `extends = "px4"` starts from a ready one and overrides what it names. `docs/flight-files.md` explains
every key.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, TypeAlias, TypeVar

from pydantic import Field, ValidationError, model_validator

from stoop.base.schema_errors import first_complaint
from stoop.base.text import nearest
from stoop.base.toml import parse_source, read_source
from stoop.base.units import FACTORS, UNITS, WRITTEN
from stoop.base.variables import VARIABLES
from stoop.errors import FlightError, LogError, listed
from stoop.flight.alignment import Alignment
from stoop.flight.conversion import (
    CalibrationTable,
    Frame,
    MixerTable,
    Number,
    Surfaces,
    SurfaceTable,
    Table,
    Text,
    check_frame,
)
from stoop.flight.flight import with_other_form

MAX_EXPANSION: Final = 64  #: names that one pair of braces may stand for
_BRACES: Final = re.compile(r"\{(\d{1,3})\.\.(\d{1,3})\}")
_Item = TypeVar("_Item")
TimeUnit: TypeAlias = Literal["s", "ms", "us", "ns"]
Columns: TypeAlias = str | Annotated[dict[str, Number], Field(min_length=1)]  #: one, or weights of a sum
FrameName: TypeAlias = Literal["frd", "flu", "ned", "enu", "nwu"]


class Clock(Table):
    """[time], or [clock.STREAM]: the column that holds the time, its unit, and an offset in s that is added."""

    column: Text
    unit: TimeUnit
    offset: Number = 0.0

    @property
    def factor(self) -> float:
        """Seconds of one."""
        return FACTORS[self.unit]


class _SourceKeys(Table):
    stream: str = ""
    scale: Number | list[Number] = 1.0
    offset: Number | list[Number] = 0.0
    valid: str | list[str] = ""
    stamp: str = ""
    stamp_unit: TimeUnit = "us"
    frame: FrameName | list[FrameName] = Field(default_factory=list)
    instance: Literal["first", "most moved"] = "first"
    unused: Number | None = None
    optional: bool = False


class VariableTable(_SourceKeys):
    """A line of [variables]: one column for one variable."""

    column: Columns
    unit: Text
    file: str = ""


class SourceTable(_SourceKeys):
    """An entry of sources in [group.NAME], with what the group says of all."""

    variables: Text | Annotated[list[Text], Field(min_length=1)]
    columns: Columns | list[Columns]
    unit: str | list[str] = ""
    partial: bool = False


class GroupTable(Table):
    """[group.NAME]: variables that belong together, and their sources in order of trust.

    Keys of a source that stand beside `sources` hold for all of them.
    """

    sources: list[SourceTable]
    choose: Literal["fastest", "first"] = "fastest"

    @model_validator(mode="before")
    @classmethod
    def _give_common_keys(cls, content: Any) -> Any:
        if not isinstance(content, dict):
            return content
        sources = content.get("sources", [{}])
        common = {key: x for key, x in content.items() if key not in ("sources", "choose")}
        if isinstance(sources, list):
            sources = [{**common, **one} if isinstance(one, dict) else one for one in sources]
        return {"sources": sources} | {key: x for key, x in content.items() if key == "choose"}


class MappingFile(Table):
    """A mapping file."""

    extends: Text | None = None
    files: dict[str, Text] = Field(default_factory=dict)
    time: Clock | None = None
    clock: dict[str, Clock] = Field(default_factory=dict)
    variables: dict[str, VariableTable] = Field(default_factory=dict)
    group: dict[str, GroupTable] = Field(default_factory=dict)
    calibration: dict[str, CalibrationTable] = Field(default_factory=dict)
    surface: dict[str, SurfaceTable] = Field(default_factory=dict)
    mixer: dict[str, MixerTable] = Field(default_factory=dict)
    align: dict[str, Alignment] = Field(default_factory=dict)


@dataclass(frozen=True)
class Source:
    """One stream that can supply a group of variables."""

    place: str  #: file and key, for messages
    variables: tuple[str, ...]  #: names in the registry
    stream: str  #: of the recording; empty means the one stream that holds the columns
    columns: tuple[Mapping[str, float], ...]  #: one per variable: column -> weight, summed
    factors: tuple[float, ...]  #: SI value of one and of zero, one per variable
    offsets: tuple[float, ...]
    units: tuple[str, ...]  #: as written, one per variable; empty where it was not
    #: flags that must be positive for a sample to count, one per variable; empty is none
    valid: tuple[str, ...] = ()
    #: column that holds the time of the measurement [stamp_factor s], empty for that of the stream
    stamp: str = ""
    stamp_factor: float = 1e-6
    frame: Frame = ()  #: axes that the columns are in, where they are not ours
    instance: Literal["first", "most moved"] = "first"  #: which of several instances of the stream is taken
    partial: bool = False  #: columns that are not there are left out; otherwise all must be there
    unused: float | None = None  #: a column that never holds anything but this is left out
    required: bool = False  #: its absence is an error


@dataclass(frozen=True)
class Group:
    """Variables that belong together."""

    sources: tuple[Source, ...]  #: in order of trust
    #: "first": the first that holds values; "fastest": unless a later one was logged more than twice as fast
    choose: Literal["fastest", "first"] = "fastest"
    without: frozenset[str] = frozenset()  #: variables that others supply


@dataclass(frozen=True)
class FlightMapping:
    """A whole mapping, with what it extends."""

    READY: ClassVar[dict[str, str]] = {
        "ulog": "px4", "px4-csv": "px4", "dataflash": "ardupilot", "dataflash-text": "ardupilot",
        "crazyflie": "crazyflie", "blackbox": "betaflight", "blackbox-csv": "betaflight",
    }  #: format of a recording -> the mapping that comes with the package  # fmt: skip

    place: str  #: file, or name of the ready mapping, for messages
    #: name -> group, in order of precedence: a variable belongs to the first that supplies it
    groups: Mapping[str, Group]
    clock: Clock | None = None  #: of every stream that holds its column; None keeps the clocks of the reader
    clocks: Mapping[str, Clock] = field(default_factory=dict)  #: stream -> a clock of its own
    surfaces: Surfaces = field(default_factory=Surfaces)  #: calibrations and mixers
    #: stream -> how its clock is brought to that of another
    alignments: Mapping[str, Alignment] = field(default_factory=dict)
    #: name -> file beside the log, that is read as well
    files: Mapping[str, str] = field(default_factory=dict)

    @functools.cached_property
    def sources(self) -> tuple[Source, ...]:
        """Sources of all groups."""
        return tuple(source for group in self.groups.values() for source in group.sources)

    @functools.cached_property
    def streams(self) -> frozenset[str]:
        """Names of the streams it needs, without instance."""
        named = {source.stream for source in self.sources}
        named |= {name for stream, one in self.alignments.items() for name in (stream, one.reference)}
        return frozenset(name.partition("/")[0] for name in named)

    @staticmethod
    @functools.cache
    def ready(name: str) -> FlightMapping:
        """Return a mapping that comes with the package; LogError when there is none of that name."""
        if name not in (known := sorted(set(FlightMapping.READY.values()))):
            raise LogError(f"there is no ready mapping '{name}'; {nearest(name, known)}")
        text = (files("stoop.data") / "mappings" / f"{name}.toml").read_text("utf-8")
        return FlightMapping.parse(name, parse_source(text, f"{name}.toml", LogError))

    @staticmethod
    def read(path: Path) -> FlightMapping:
        """Read a mapping file.

        Raises
        ------
        LogError
            When the file is missing, is no TOML, or says something unknown or impossible; names the key and the fix.
        FlightError
            When it names a variable that is not in the registry.
        """
        text = read_source(path, "mapping", LogError)
        try:
            content = parse_source(text, str(path), LogError)
        except LogError as error:
            if path.suffix == ".toml":
                raise
            raise LogError(f"{error}, or name a mapping, a TOML file as stoop map writes it") from None
        return FlightMapping.parse(str(path), content)

    @staticmethod
    def parse(place: str, content: Mapping[str, Any]) -> FlightMapping:
        """Return the mapping that a file of this content is; see :meth:`read`."""
        keys = MappingFile.model_fields.keys()
        if content and not any(
            key in keys or nearest(key, keys).startswith("did you mean") for key in content
        ):
            raise LogError(
                f"{place}: no mapping but a file of {listed(content, 6)}; a mapping has [variables], "
                "draft one by stoop map LOG -o M.toml"
            )
        try:
            file = MappingFile.model_validate(content)
        except ValidationError as error:
            raise LogError(f"{place}: {first_complaint(error, content, MappingFile)}") from None
        own: dict[str, Group] = {}
        for name, line in file.variables.items():
            at = f"{place}: variables.{name}"
            if name not in VARIABLES:
                raise FlightError(f"{at} is no variable of stoop; {nearest(name, VARIABLES)}")
            shared = line.model_dump(exclude={"column", "file", "stream"})
            stream = line.stream if "stream" in line.model_fields_set else line.file
            table = SourceTable(variables=[name], columns=[line.column], stream=stream, **shared)
            own[name] = Group((replace(_source(at, table), required=not line.optional),))
        for name, group in file.group.items():
            own.update(_groups(place, name, group))
        if not own and file.extends is None:
            raise LogError(
                f"{place}: it names no variable; add a table [variables], such as p = {{column = "
                '"p", unit = "rad/s"}, or extends = "px4"'
            )
        groups = dict(own)
        if file.extends is not None:  # no group of the same name, none of the variables named anew
            taken = with_other_form({n for known in own.values() for s in known.sources for n in s.variables})
            for name, known in FlightMapping.ready(file.extends).groups.items():
                if name not in own and name.partition(".")[0] not in own:
                    groups[name] = replace(known, without=known.without | taken)
        surfaces = Surfaces.of(place, file.calibration, file.surface, file.mixer)
        for stream, one in file.align.items():
            if one.reference == stream:
                raise LogError(
                    f"{place}: align.{stream}: a stream cannot be aligned with itself; name another one in with"
                )
        return FlightMapping(place, groups, file.time, file.clock, surfaces, file.align, file.files)


ready, read_flight_mapping = FlightMapping.ready, FlightMapping.read


def _groups(place: str, name: str, table: GroupTable) -> dict[str, Group]:
    """Return one group per variable where the variables stand in different streams, else one for all."""
    sources = [_source(f"{place}: group.{name}.sources[{i}]", one) for i, one in enumerate(table.sources)]
    if not any(_BRACES.search(source.stream) for source in sources):
        return {name: Group(tuple(sources), table.choose)}
    parts: dict[str, Group] = {}
    for source in sources:
        streams = _expanded(source.place, source.stream)
        columns = source.columns * len(streams) if len(source.columns) == 1 else source.columns
        if not len(streams) == len(source.variables) == len(columns):
            raise LogError(f"{source.place}: as many streams as variables are needed; count the braces")
        for i, (variable, stream) in enumerate(zip(source.variables, streams, strict=True)):
            keys = ("variables", "factors", "offsets", "units", "valid")
            lists = {key: getattr(source, key)[i : i + 1] for key in keys}
            one = replace(source, stream=stream.removesuffix("/0"), columns=columns[i : i + 1], **lists)
            before = parts.get(f"{name}.{variable}", Group((), table.choose))
            parts[f"{name}.{variable}"] = replace(before, sources=(*before.sources, one))
    return parts


def _source(at: str, table: SourceTable) -> Source:
    variables = table.variables if isinstance(table.variables, list) else [table.variables]
    names = tuple(name for text in variables for name in _expanded(at, text))
    for name in names:
        if name not in VARIABLES:
            raise FlightError(f"{at}.variables: '{name}' is no variable of stoop; {nearest(name, VARIABLES)}")
    columns: list[Mapping[str, float]] = []
    for part in table.columns if isinstance(table.columns, list) else [table.columns]:
        columns += [part] if isinstance(part, dict) else [{name: 1.0} for name in _expanded(at, part)]
    if len(columns) != len(names) and not _BRACES.search(table.stream):
        raise LogError(f"{at}: {len(names)} variables, but {len(columns)} columns; name one for each")
    units = _each(at, "unit", table.unit, len(names))
    factors = [_unit_factor(at, name, unit) for name, unit in zip(names, units, strict=True)]
    scales = _each(at, "scale", table.scale, len(names))
    zeros = (UNITS[unit].zero if unit else 0.0 for unit in units)
    offsets = zip(zeros, _each(at, "offset", table.offset, len(names)), strict=True)
    return Source(
        at,
        names,
        table.stream,
        tuple(columns),
        factors=tuple(factor * scale for factor, scale in zip(factors, scales, strict=True)),
        offsets=tuple(zero + offset for zero, offset in offsets),
        units=units,
        valid=_each(at, "valid", table.valid, len(names)),
        stamp=table.stamp,
        stamp_factor=FACTORS[table.stamp_unit],
        frame=check_frame(at, names, table.frame),
        instance=table.instance,
        partial=table.partial,
        unused=table.unused,
    )


def _unit_factor(at: str, variable: str, unit: str) -> float:
    """Return the SI value of one, or us of a pulse; a unit of another quantity than the variable's is refused."""
    if not unit:
        return 1.0
    one = VARIABLES[variable]
    if unit not in (one.units if variable.startswith("pwm_") else UNITS):
        meant = WRITTEN.get(unit.strip().lower())
        advice = f'write "{meant}"' if meant in one.units else nearest(unit, one.units)
        raise LogError(f"{at}.unit = '{unit}' is unknown; {advice}")
    if unit != "1" and unit not in one.units:
        kinds = f"{UNITS[unit].kind}, but {variable} is {UNITS[one.unit].kind}"
        raise LogError(f"{at}.unit = '{unit}' is {kinds}; write one of {', '.join(one.units)}")
    return one.units.get(unit, 1.0)


def _expanded(at: str, text: str) -> list[str]:
    """Write out braces as a shell does: a{1..3} is a1, a2, a3."""
    found = _BRACES.search(text)
    if not found:
        return [text]
    first, last = (int(part) for part in found.groups())
    if not 0 <= last - first < MAX_EXPANSION:
        raise LogError(
            f"{at}: '{text}' stands for nothing, or for more than {MAX_EXPANSION}; write {{first..last}}"
        )
    return [text[: found.start()] + str(n) + text[found.end() :] for n in range(first, last + 1)]


def _each(at: str, key: str, given: _Item | Sequence[_Item], size: int) -> tuple[_Item, ...]:
    """Return one for each variable: the one that was given, or those of a list."""
    parts = tuple(given) if isinstance(given, list) else (given,) * size
    if len(parts) != size:
        raise LogError(f"{at}.{key}: {len(parts)} for {size} variables; give one, or as many as variables")
    return parts  # type: ignore[return-value]
