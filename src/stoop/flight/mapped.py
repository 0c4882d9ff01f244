"""A recording under a mapping: which of several sources is taken, and what was left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray
from stoop.base.units import FACTORS, KINDS
from stoop.base.variables import EULER
from stoop.errors import LogError, listed
from stoop.flight.channels import WILD, Channels
from stoop.flight.clocks import align
from stoop.flight.frames import turned
from stoop.flight.mapping import Clock, FlightMapping, with_other_form
from stoop.flight.sources import Group, Source
from stoop.flight.surfaces import deflections
from stoop.logs import Recording, Stream
from stoop.logs.recording import clean_stream

BoolArray = npt.NDArray[np.bool_]

MAX_TRANSPORT: Final = 0.2  #: s; a sample stamp further from its publication is not believed


@dataclass(frozen=True)
class Mapped:
    """What a mapping made of a recording.

    Attributes
    ----------
    channels : variables of the registry, each group on its own clock
    notes : plain words
    unmapped : stream -> columns that the mapping does not name; none where nothing of the stream was read
    places : variable -> file and key of the mapping, for advice
    """

    channels: list[Channels]
    notes: list[str]
    unmapped: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    places: Mapping[str, str] = field(default_factory=dict)


def apply(mapping: FlightMapping, recording: Recording) -> Mapped:
    """Pick the variables of the registry out of a recording.

    Raises
    ------
    LogError
        When a column that the mapping names for a variable is not in the log.
    """
    retimed, notes = _on_clocks(mapping, recording)
    timed, aligned = align(mapping.alignments, retimed, lambda log, name: supplied(mapping, log, name))
    channels: list[Channels] = []
    for group in mapping.groups.values():
        taken = {name for known in channels for name in known.values}
        found = _best(timed, group, group.without | with_other_form(taken))
        channels += [] if found is None else [found]
        notes += _left_out(timed, group)
    channels = _joined(channels)
    made, told = deflections(mapping.surfaces, channels)
    channels = [
        less for known in channels if (less := _less(known, frozenset(mapping.surfaces.mixes))).values
    ]
    notes += [*aligned, *_contradicted(mapping, timed), *told]
    places = {name: source.place for source in reversed([*_sources(mapping)]) for name in source.variables}
    left = {**recording.unread, **unmapped(mapping, recording)}
    return Mapped([*channels, *made], notes, left, places)


def _best(recording: Recording, group: Group, without: frozenset[str]) -> Channels | None:
    supplied = [_supply(recording, source) for source in group.sources]
    rest = [_less(channels, without) for channels in supplied if channels is not None]
    found = [channels for channels in rest if channels.values]
    whole = [channels for channels in found if _finite(channels).all(axis=0).any()]
    some = [channels for channels in found if _finite(channels).any()]
    left = whole or some
    if group.choose == "first":
        return left[0] if left else None
    return _fastest(left)


def _less(channels: Channels, names: frozenset[str]) -> Channels:
    return replace(channels, values={name: x for name, x in channels.values.items() if name not in names})


def _joined(channels: list[Channels]) -> list[Channels]:
    """Put Euler angles that were named one by one together again, where they share a clock."""
    parts = [c for c in channels if set(c.values) & set(EULER)]
    if len(parts) < 2 or any(c.time is not parts[0].time for c in parts):
        return channels
    whole = replace(parts[0], values={name: x for c in parts for name, x in c.values.items()})
    return [whole if c is parts[0] else c for c in channels if c not in parts[1:]]


def _on_clocks(mapping: FlightMapping, recording: Recording) -> tuple[Recording, list[str]]:
    """Take the time from the columns that the mapping names."""
    streams: dict[str, Stream] = {}
    notes: list[str] = []
    for name, stream in recording.streams.items():
        clock = mapping.clocks.get(name, mapping.clock)
        streams[name], told = _retimed(mapping, name, stream, clock)
        notes += told
    return replace(recording, streams=streams), notes


def _retimed(
    mapping: FlightMapping, name: str, stream: Stream, clock: Clock | None
) -> tuple[Stream, list[str]]:
    if clock is None or clock.column not in stream.columns:
        if clock is not None and name in mapping.clocks:
            raise LogError(
                f"{mapping.place}: clock.{name}.column = '{clock.column}' is not in {name}; "
                f"its columns are {listed(stream.columns)}"
            )
        return stream, []
    time = stream.columns[clock.column] * clock.factor + clock.offset
    cleaned, defects = clean_stream(name, time, stream.columns)
    return cleaned, [str(defect) for defect in defects]


def _finite(channels: Channels) -> BoolArray:
    """Return (k, n): where each of the variables holds a value."""
    return np.array([np.isfinite(x) for x in channels.values.values()])


def _fastest(found: list[Channels]) -> Channels | None:
    best: Channels | None = None
    for channels in found:
        if best is None or channels.rate > 2.0 * best.rate:
            best = channels
    return best


def _supply(recording: Recording, source: Source) -> Channels | None:
    name, *_ = instances(recording, source) or [""]
    stream = recording.streams.get(name)
    if stream is None or not _whole(source, stream):
        if source.required:
            raise LogError(_missing(recording, source))
        return None
    values = {
        variable: _value(stream, source, i)
        for i, variable in enumerate(source.variables)
        if set(source.columns[i]) <= set(stream.columns)
    }
    used = {
        variable: x
        for variable, x in values.items()
        if (not source.partial and source.unused is None) or _used(x, source)
    }
    time = sample_time(stream, source.stamp, source.stamp_factor) if source.stamp else stream.time
    return Channels(name, time, turned(used, source.frame)) if used else None


def _whole(source: Source, stream: Stream) -> bool:
    there = [set(columns) <= set(stream.columns) for columns in source.columns]
    return any(there) if source.partial else all(there)


def _value(stream: Stream, source: Source, i: int) -> FloatArray:
    """Return one variable in SI, NaN where its flag says so; a log without the flag is believed."""
    with np.errstate(over="ignore", invalid="ignore"):  # what is beyond any size is dropped and told later
        total = sum(weight * stream.columns[name] for name, weight in source.columns[i].items())
        values = np.asarray(total) * source.factors[i] + source.offsets[i]
    good = stream.columns.get(source.valid[i]) if source.valid[i] else None
    return values if good is None else np.where(good > 0.0, values, np.nan)


def _used(x: FloatArray, source: Source) -> bool:
    if source.unused is None:
        return bool(np.isfinite(x).any())
    return bool((x[np.abs(x) < WILD] != source.unused).any())


def instances(recording: Recording, source: Source) -> list[str]:
    """Return the streams that a source may mean, the one that is taken first."""
    if not source.stream:
        holding = [name for name, stream in recording.streams.items() if _whole(source, stream)]
        if len(holding) > 1 and source.required:
            column = next(iter(source.columns[0]))
            raise LogError(
                f"{source.place}.column = '{column}' is in {listed(holding)}; name one of them by stream"
            )
        return holding
    if source.instance == "first":
        return [source.stream] if source.stream in recording.streams else []
    movement = {
        name: sum(float(np.std(x[np.abs(x) < WILD])) for x in used)
        for name, stream in recording.streams.items()
        if name.split("/")[0] == source.stream and (used := _moved(stream, source))
    }
    return sorted(movement, key=lambda name: (-movement[name], name))


def _moved(stream: Stream, source: Source) -> list[FloatArray]:
    there = [i for i, columns in enumerate(source.columns) if set(columns) <= set(stream.columns)]
    return [x for i in there if _used(x := _value(stream, source, i), source)]


def sample_time(stream: Stream, column: str, factor: float) -> FloatArray:
    """Return when the samples were taken [s], where the stream says so and it can be believed."""
    stamp = stream.columns.get(column)
    if stamp is None:
        return stream.time
    taken = stamp * factor
    late = stream.time - taken
    believable = np.all((late >= 0.0) & (late < MAX_TRANSPORT)) and np.all(np.diff(taken) > 0.0)
    return taken if believable else stream.time


def supplied(mapping: FlightMapping, recording: Recording, stream: str) -> list[Channels]:
    """Return all that one stream can supply, taken or not."""
    alone = replace(recording, streams={stream: recording.streams[stream]})
    meant = [
        replace(source, required=False)
        for source in _sources(mapping)
        if source.stream in ("", stream) or source.instance != "first"
    ]
    found = [_supply(alone, source) for source in meant]
    return _joined([channels for channels in found if channels is not None])


def _left_out(recording: Recording, group: Group) -> list[str]:
    """Say which instances were left out, because the variables hold those of one only."""
    notes = []
    for source in group.sources:
        if source.instance == "most moved":
            taken, *others = instances(recording, source) or [""]
            span = f"{source.variables[0]} to {source.variables[-1]}"
            what = "pulses" if span.startswith("pwm") else "values"
            notes += [
                f"{span} are the {what} of {taken}, whose outputs move most; those of {other} were left out"
                for other in others
            ]
    return notes


def _missing(recording: Recording, source: Source) -> str:
    column = next(iter(source.columns[0]))
    stream = recording.streams.get(source.stream)
    if stream is not None:
        return f"{source.place}.column = '{column}' is not in {source.stream}; its columns are {listed(stream.columns)}"
    if source.stream:
        return f"{source.place}.stream = '{source.stream}' is not in the log; it holds {listed(recording.streams)}"
    return (
        f"{source.place}.column = '{column}' is in no stream of the log; it holds {listed(recording.streams)}"
    )


def _contradicted(mapping: FlightMapping, recording: Recording) -> list[str]:
    """Say where the file states another unit than the mapping."""
    notes = []
    for source in _sources(mapping):
        stated = recording.units.get(source.stream, {})
        for unit, columns in zip(source.units, source.columns, strict=True):
            for column in columns:
                said = stated.get(column, "")
                if unit and KINDS.get(said) == KINDS[unit] and FACTORS[said] != FACTORS[unit]:
                    notes.append(
                        f"{source.stream}.{column}: {source.place} says {unit}, the file itself {said}; which is right?"
                    )
    return notes


def _sources(mapping: FlightMapping) -> Iterator[Source]:
    return (source for group in mapping.groups.values() for source in group.sources)


def unmapped(mapping: FlightMapping, recording: Recording) -> dict[str, tuple[str, ...]]:
    """Return the columns of each stream that the mapping does not name; clocks and flags count as named."""
    named: dict[str, set[str]] = {}
    for source in _sources(mapping):
        columns = {name for columns in source.columns for name in columns}
        for stream in [source.stream] if source.stream else recording.streams:
            named.setdefault(stream, set()).update(columns, source.valid, {source.stamp})
    clocks = {clock.column for clock in (*mapping.clocks.values(), mapping.clock) if clock is not None}
    left = {
        name: tuple(
            column
            for column in stream.columns
            if column not in named.get(name, named.get(name.partition("/")[0], set())) | clocks
            and not column.startswith("timestamp")
        )
        for name, stream in recording.streams.items()
    }
    return {name: columns for name, columns in left.items() if columns}
