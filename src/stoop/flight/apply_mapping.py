"""A recording under a mapping: which mapping counts, which of several sources is taken, and what is left out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from stoop import logs
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.text import likely
from stoop.base.units import UNITS
from stoop.base.variables import EULER
from stoop.errors import FlightError, LogError, listed
from stoop.flight.alignment import align, suggest_alignments
from stoop.flight.conversion import rotate_axes
from stoop.flight.flight import with_other_form
from stoop.flight.gridding import MAX_VALUE, Channels
from stoop.flight.mapping import FlightMapping, Source
from stoop.logs import Recording, Stream
from stoop.logs.csv_tables import mapping_beside, read_raw_csv
from stoop.logs.read import kind
from stoop.logs.recording import clean_stream

MOST_LISTED: Final = 12  #: columns or streams, where one of them was to be named
MAX_TRANSPORT: Final = 0.2  #: s; a sample stamp further from its publication is not believed


@dataclass(frozen=True)
class Mapped:
    """A recording under a mapping."""

    channels: list[Channels]  #: variables of the registry, each group on its own clock
    notices: list[Notice]  #: what was found
    #: stream -> columns that the mapping does not name; none where nothing of the stream was read
    unmapped: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    #: variable -> file and key of the mapping, for advice
    places: Mapping[str, str] = field(default_factory=dict)
    #: variable of a ready mapping -> its source there, and the stream that supplied it
    ready: Mapping[str, tuple[Source, str]] = field(default_factory=dict)

    @staticmethod
    def read(
        path: Path, given: Path | None = None, further: frozenset[str] = frozenset()
    ) -> tuple[Recording, Mapped | None]:
        """Read the streams of a log that its mapping needs, and name its channels by the registry.

        Parameters
        ----------
        path : the log
        given : its mapping; None takes the one beside the log, else the ready one of the format
        further : streams, without instance, that are read besides

        Returns
        -------
        recording : of any format
        mapped : its channels; None for a flight that stoop wrote

        Raises
        ------
        FlightError, LogError
            When log or mapping cannot be read, there is none for this format, or it names what is not in log or registry.
        """
        place = given
        if place is None:
            try:
                place = mapping_beside(path) if mapping_beside(path).is_file() else None
            except (OSError, ValueError):  # the reader says it better
                place = None
        form = kind(path) if path.is_file() else ""
        known = FlightMapping.READY.get(form) if place is None else None
        mapping = None if known is None else FlightMapping.ready(known)
        if place is not None and path.exists():
            mapping = FlightMapping.read(place)
        needed = None if mapping is None or "" in mapping.streams else mapping.streams | further
        recording = logs.read(path, given, needed)
        if recording.format == "stoop-netcdf":
            return recording, None
        if mapping is None and recording.format not in FlightMapping.READY:
            start = mapping_beside(recording.path)
            raise FlightError(
                f"{recording.path}: this kind of log needs a mapping of its columns; "
                f"draft one by stoop map {recording.path} -o {start}, and correct it"
            )
        mapping = mapping or FlightMapping.ready(FlightMapping.READY[recording.format])
        whole = _with_files(recording, mapping) if mapping.files else recording
        found = Mapped.of(mapping, whole)
        if not mapping.alignments and (mapping.files or recording.format not in FlightMapping.READY):
            by_stream: dict[str, list[Channels]] = {}
            for group in found.channels:
                by_stream.setdefault(group.source, []).append(group)
            where = str(place or "the mapping")
            disagreeing = suggest_alignments(whole, lambda _, name: by_stream.get(name, []), where)
            found = replace(found, notices=[*found.notices, *disagreeing])
        unnamed = {f"{stream} {column}" for stream, columns in found.unmapped.items() for column in columns}
        defects = tuple(d for d in recording.defects if d.kind != "text" or d.place not in unnamed)
        return replace(recording, defects=defects), found

    @staticmethod
    def of(mapping: FlightMapping, recording: Recording) -> Mapped:
        """Pick the variables of the registry out of a recording; LogError when a column that the mapping names is not there."""
        timed, notices = _with_clocks(mapping, recording)
        aligned: list[Notice] = []
        contradicted: list[Notice] = []
        beyond: list[Notice] = []
        if mapping.alignments:
            at = mapping.place
            timed, aligned = align(at, mapping.alignments, timed, lambda log, n: _all(mapping, log, n))
        channels: list[Channels] = []
        places: dict[str, str] = {}
        of_ready: dict[str, tuple[Source, str]] = {}
        named: dict[str, set[str]] = {}  # columns, flags and stamps that the mapping names of each stream
        for group in mapping.groups.values():
            without = group.without | with_other_form({name for known in channels for name in known.values})
            supplied: list[Channels] = []
            suppliers: list[Source] = []
            for source in group.sources:
                places = {**dict.fromkeys(source.variables, source.place), **places}
                columns = {name for weights in source.columns for name in weights}
                for topic in [source.stream] if source.stream else timed.streams:
                    named.setdefault(topic, set()).update(columns, source.valid, {source.stamp})
                stated = timed.units.get(source.stream, {})
                for unit, weights in zip(source.units, source.columns, strict=True):
                    for column in weights if unit and stated else ():
                        own, where = stated.get(column, ""), f"{source.stream}.{column}"
                        there, said = UNITS.get(own), UNITS[unit]
                        if there is not None and there.kind == said.kind and there.factor != said.factor:
                            values = {"place": source.place, "unit": unit, "stated": own}
                            contradicted.append(notice("unit-contradicted", where, **values))
                first, *others = _instances(timed, source) or [""]
                span = {"first": source.variables[0], "last": source.variables[-1]}
                notices += [notice("instance-left-out", other, taken=first, **span) for other in others]
                found = _supply(timed, source, first)
                if found is not None and (rest := _without(found, without)).values:
                    supplied.append(rest)
                    suppliers.append(source)
            best = _best(supplied, group.choose == "fastest", timed.format == "table")
            if best is not None:
                channels.append(best)
                (source,) = (own for own, one in zip(suppliers, supplied, strict=True) if one is best)
                places |= {name: source.place for name in best.values if not _of_ready(source)}
                of_ready |= {name: (source, best.source) for name in best.values if _of_ready(source)}
        channels = _join_lines(timed.format, channels)
        if mapping.surfaces.mixes:
            surfaces, beyond = mapping.surfaces.deflections(channels)
            mixed = frozenset(mapping.surfaces.mixes)
            channels = [*(less for known in channels if (less := _without(known, mixed)).values), *surfaces]
        clocks = {clock.column for clock in (*mapping.clocks.values(), mapping.clock) if clock is not None}
        left = dict(recording.unread)
        for name, stream in recording.streams.items():
            used = named.get(name, named.get(name.partition("/")[0], set())) | clocks
            columns_left = tuple(c for c in stream.columns if c not in used and not c.startswith("timestamp"))
            left |= {name: columns_left} if columns_left else {}
        return Mapped(channels, [*notices, *aligned, *contradicted, *beyond], left, places, of_ready)


def _with_files(recording: Recording, mapping: FlightMapping) -> Recording:
    """Add the streams of further files that a mapping names, such as that of a motion-capture system."""
    streams, units = dict(recording.streams), dict(recording.units)
    for name, file in mapping.files.items():
        folder = recording.path if recording.path.is_dir() else recording.path.parent
        path = folder / file
        if Path(file).name != file or not path.is_file():
            raise LogError(
                f"{mapping.place}: files.{name} = '{file}' is not in {folder}; put it beside the log"
            )
        clock = mapping.clocks.get(name)
        other = logs.read(path) if kind(path) else read_raw_csv(path, {"": clock.column} if clock else None)
        for stream, content in other.streams.items():
            key = name if len(other.streams) == 1 else f"{name}:{stream}"
            streams[key] = content
            units |= {key: other.units[stream]} if stream in other.units else {}
    return replace(recording, streams=streams, units=units)


def _of_ready(source: Source) -> bool:
    return source.place.partition(":")[0] in FlightMapping.READY.values()


def _best(supplied: Sequence[Channels], fastest: bool, named: bool) -> Channels | None:
    """Return the channels of the best source: one with values of all its variables at once rather than of some.

    A column that the user `named` stays, though it holds no number.
    """
    known = [(c, np.array([np.isfinite(x) for x in c.values.values()])) for c in supplied]
    usable = [c for c, good in known if good.all(axis=0).any()] or [c for c, good in known if good.any()]
    usable = usable or (list(supplied) if named else [])
    best = usable[0] if usable else None
    for later in usable[1:] if fastest else ():
        if best is not None and later.rate > 2.0 * best.rate:
            best = later
    return best


def _all(mapping: FlightMapping, recording: Recording, stream: str) -> list[Channels]:
    """Return all that one stream can supply, taken or not."""
    alone = replace(recording, streams={stream: recording.streams[stream]})
    found = []
    for source in mapping.sources:
        if source.stream in ("", stream) or source.instance != "first":
            source = replace(source, required=False)
            found.append(_supply(alone, source, next(iter(_instances(alone, source)), "")))
    return _join_lines(recording.format, [channels for channels in found if channels is not None])


def _with_clocks(mapping: FlightMapping, recording: Recording) -> tuple[Recording, list[Notice]]:
    """Take the time from the columns that the mapping names."""
    streams: dict[str, Stream] = {}
    notices: list[Notice] = []
    for name, stream in recording.streams.items():
        streams[name] = stream
        clock = mapping.clocks.get(name, mapping.clock)
        if clock is not None and clock.column in stream.columns:
            time = stream.columns[clock.column] * clock.factor + clock.offset
            streams[name], defects = clean_stream(name, time, stream.columns)
            notices += [notice("log-defect", d.place, kind=d.kind, text=d.message) for d in defects]
        elif name in mapping.clocks:
            raise LogError(
                f"{mapping.place}: clock.{name}.column = '{mapping.clocks[name].column}' is not in {name}; "
                f"its columns are {listed(stream.columns)}"
            )
    return replace(recording, streams=streams), notices


def _without(channels: Channels, names: frozenset[str]) -> Channels:
    return replace(channels, values={name: x for name, x in channels.values.items() if name not in names})


def _join_lines(form: str, channels: list[Channels]) -> list[Channels]:
    """Join variables that were named one by one and share a clock: columns of a table, elsewhere Euler angles."""
    if form == "table":
        joined: dict[tuple[str, int], Channels] = {}
        for one in channels:
            first = joined.setdefault((one.source, id(one.time)), one)
            joined[one.source, id(one.time)] = replace(first, values={**first.values, **one.values})
        return [*joined.values()]
    parts = [c for c in channels if set(c.values) & set(EULER)]
    if len(parts) < 2 or any(c.time is not parts[0].time for c in parts):
        return channels
    whole = replace(parts[0], values={name: x for c in parts for name, x in c.values.items()})
    return [whole if c is parts[0] else c for c in channels if c not in parts[1:]]


def _supply(recording: Recording, source: Source, name: str) -> Channels | None:
    """Return what a source supplies of a stream, in SI and in our axes; None when it supplies nothing."""
    stream = recording.streams.get(name)
    if stream is None or not _has_columns(source, stream):
        if not source.required:
            return None
        one = recording.streams.get(source.stream)
        there = {c for own in ([one] if one else recording.streams.values()) for c in own.columns}
        name = next((n for weights in source.columns for n in weights if n not in there), "")
        column = f"{source.place}.column = '{name}'"
        only = next(iter(recording.streams)) if len(recording.streams) == 1 else ""
        known = recording.streams.get(source.stream or only)
        if known is not None:
            raise LogError(
                f"{column} is not in {source.stream or only}; {_near(name, known.columns)}its columns are "
                f"{listed(known.columns, MOST_LISTED)}"
            )
        holds = f"it holds {listed(recording.streams, MOST_LISTED)}"
        if source.stream:
            near = _near(source.stream, recording.streams)
            raise LogError(f"{source.place}.stream = '{source.stream}' is not in the log; {near}{holds}")
        raise LogError(f"{column} is in no stream of the log; {holds}")
    values = _values(stream, source, only_used=source.partial or source.unused is not None)
    time = stream.time
    # when the samples were taken, where that can be believed
    if source.stamp and source.stamp in stream.columns:
        taken = stream.columns[source.stamp] * source.stamp_factor
        late = time - taken
        if np.all((late >= 0.0) & (late < MAX_TRANSPORT)) and np.all(np.diff(taken) > 0.0):
            time = taken
    values = rotate_axes(values, source.frame) if source.frame else values
    return Channels(name, time, values) if values else None


def _near(name: str, among: Iterable[str]) -> str:
    """Ask for the name that was meant, where one is near."""
    advice = likely(name, among)
    return f"{advice} " if advice else ""


def _has_columns(source: Source, stream: Stream) -> bool:
    there = [set(columns) <= stream.columns.keys() for columns in source.columns]
    return any(there) if source.partial else all(there)


def _values(stream: Stream, source: Source, only_used: bool) -> dict[str, FloatArray]:
    """Return variables in SI, NaN where their flag says so; a log without the flag is believed.

    With `only_used` those are left out that never hold anything.
    """
    out = {}
    for i, (variable, weights) in enumerate(zip(source.variables, source.columns, strict=True)):
        if not set(weights) <= stream.columns.keys():
            continue
        with np.errstate(over="ignore", invalid="ignore"):  # impossible values are dropped later
            total = sum(weight * stream.columns[name] for name, weight in weights.items())
            x = np.asarray(total) * source.factors[i] + source.offsets[i]
        good = stream.columns.get(source.valid[i]) if source.valid[i] else None
        x = x if good is None else np.where(good > 0.0, x, np.nan)
        if only_used:
            held = np.isfinite(x) if source.unused is None else x[np.abs(x) < MAX_VALUE] != source.unused
            if not held.any():
                continue
        out[variable] = x
    return out


def _instances(recording: Recording, source: Source) -> list[str]:
    """Return the streams that a source may mean, the one that is taken first."""
    if not source.stream:
        holding = [name for name, stream in recording.streams.items() if _has_columns(source, stream)]
        if len(holding) > 1 and source.required:
            column = next(iter(source.columns[0]))
            raise LogError(
                f"{source.place}.column = '{column}' is in {listed(holding)}; name one of them by stream"
            )
        return holding[:1]
    if source.instance == "first":
        return [source.stream] if source.stream in recording.streams else []
    movement = {}
    for name, stream in recording.streams.items():
        if name.split("/")[0] == source.stream and (used := _values(stream, source, only_used=True)):
            movement[name] = sum(float(np.std(x[np.abs(x) < MAX_VALUE])) for x in used.values())
    return sorted(movement, key=lambda name: (-movement[name], name))
