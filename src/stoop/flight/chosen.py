"""Which mapping counts for a log, and the channels that it gives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from stoop import logs
from stoop.base.text import nearest
from stoop.base.variables import VARIABLES
from stoop.errors import FlightError, LogError
from stoop.flight.channels import Channels
from stoop.flight.clocks import suggestions
from stoop.flight.mapped import Mapped, apply
from stoop.flight.mapping import READY, FlightMapping, flight_mapping, read_flight_mapping, ready
from stoop.logs import Recording
from stoop.logs.mapping import is_first_edition, read_toml
from stoop.logs.read import kind
from stoop.logs.table import beside, read_raw_csv


def mapping_of(path: Path, mapping: Path | None) -> Path | None:
    """Return the mapping that counts: the one that was given, else the one beside the log."""
    if mapping is not None:
        return mapping
    try:
        there = beside(path)
        return there if there.is_file() else None
    except (OSError, ValueError):  # the reader says it better
        return None


def topics_of(path: Path, place: Path | None) -> frozenset[str] | None:
    """Return the streams that are needed, where that is known before the log is read."""
    if not path.is_file():
        return None
    form = kind(path)
    known = READY.get(form)
    if not form or (place is None and known is None):
        return None
    streams = (read_flight_mapping(place) if place is not None else ready(known or "")).streams
    return None if "" in streams else streams


def channels_of(recording: Recording, place: Path | None = None) -> Mapped:
    """Name the channels of a recording by the registry.

    Parameters
    ----------
    recording : of any format
    place : mapping; None takes the ready one of the format

    Raises
    ------
    FlightError
        When the mapping names a variable that is not in the registry, or there is no mapping for this format.
    LogError
        When the mapping cannot be read, or names what is not in the log.
    """
    content = None if place is None else read_toml(place)
    table = recording.format == "table"
    if table and place is not None and content is not None and is_first_edition(content):
        return _first_edition(recording, place)
    if place is None and recording.format not in READY:
        start = beside(recording.path)
        raise FlightError(
            f"{recording.path}: this kind of log needs a mapping of its columns; "
            f"draft one by stoop map {recording.path} -o {start}, and correct it"
        )
    mapping = ready(READY[recording.format]) if content is None else flight_mapping(str(place), content)
    whole = with_files(recording, mapping)
    found = apply(mapping, whole)
    one_clock = recording.format in READY and not mapping.files
    apart = [] if one_clock or mapping.alignments else _suggested(whole, found, place)
    return replace(found, notes=[*found.notes, *apart])


def _first_edition(recording: Recording, place: Path) -> Mapped:
    """Take the variables as the reader of tables named them."""
    for stream in recording.streams.values():
        for name in stream.columns:
            if name not in VARIABLES:
                raise FlightError(
                    f"{place}: variables.{name} is no variable of stoop; {nearest(name, VARIABLES)}"
                )
    channels = [Channels(name, stream.time, stream.columns) for name, stream in recording.streams.items()]
    places = {name: f"{place}: variables.{name}" for group in channels for name in group.values}
    found = Mapped(channels, [], recording.unread, places)
    return replace(found, notes=_suggested(recording, found, place))


def _suggested(recording: Recording, found: Mapped, place: Path | None) -> list[str]:
    """Say whether clocks of several files disagree."""
    if len(recording.streams) < 2:
        return []
    by_stream: dict[str, list[Channels]] = {}
    for group in found.channels:
        by_stream.setdefault(group.source, []).append(group)
    return suggestions(recording, lambda _, name: by_stream.get(name, []), str(place or "the mapping"))


def with_files(recording: Recording, mapping: FlightMapping) -> Recording:
    """Add the streams of further files that a mapping names, such as that of a motion-capture system.

    Raises
    ------
    LogError
        When such a file is not beside the log, or cannot be read.
    """
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
