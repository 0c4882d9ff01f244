"""Parts of the vehicles of a fleet: which serial stood in which place, from when to when; and which software flew.

A table has the columns ``vehicle, part, serial, from, to``: dates and times by ISO 8601, in UTC where no zone stands; an empty
``to`` says that the part is still there, an empty ``from`` that it always was.
"""

from __future__ import annotations

import csv
import io
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop.extend.errors import StoopError
from stoop.extend.files import toml
from stoop.extend.text import count

if TYPE_CHECKING:
    from stoop_fleet.table import FigureTable

COLUMNS: Final = ("vehicle", "part", "serial", "from", "to")
MAX_BYTES: Final = 2**26
NAMED: Final = 5  #: names in a line


@dataclass(frozen=True)
class Fitting:
    """A part in its place on a vehicle, for a time."""

    vehicle: str
    part: str  #: the place, such as rotor_1, battery or pitot; places that differ by a number take the same parts
    serial: str
    begin: float  #: s since 1970, UTC; minus infinity where it always was there
    end: float  #: s; infinity where it still is

    @property
    def kind(self) -> str:
        """The kind of part: the place without its number."""
        return self.part.rstrip("_-0123456789") or self.part


@dataclass(frozen=True)
class Parts:
    """All fittings of a fleet, sorted by vehicle, part and time."""

    fittings: tuple[Fitting, ...] = ()

    def places(self) -> tuple[str, ...]:
        """Return the different places, sorted."""
        return tuple(sorted({one.part for one in self.fittings}))

    def serials(self, part: str, vehicles: Sequence[str], times: FloatArray) -> list[str | None]:
        """Return the serial in a place of each vehicle at each time (n,); None where the table has none."""
        own = defaultdict(list)
        for one in self.fittings:
            if one.part == part:
                own[one.vehicle].append(one)
        return [
            next((f.serial for f in own.get(vehicle, ()) if f.begin <= t < f.end), None)
            for vehicle, t in zip(vehicles, times.tolist(), strict=True)
        ]

    def exchanges(self, vehicle: str) -> tuple[tuple[Fitting, Fitting], ...]:
        """Return what a vehicle had in a place and what it received there next, in order of time."""
        own = [one for one in self.fittings if one.vehicle == vehicle]
        pairs = [(one, other) for one, other in pairwise(own) if one.part == other.part]
        return tuple(sorted(pairs, key=lambda pair: (pair[1].begin, pair[1].part)))

    def unused(self, table: FigureTable) -> tuple[str, ...]:
        """Return a sentence on the vehicles that have no flights in a table, and one on the places that no figure depends on."""
        places = {place for text in set(table.parts) for place in text.split()}
        kinds = (
            ("vehicle", "flights", {one.vehicle for one in self.fittings} - {*table.vehicle}),
            ("place", "figures", {*self.places()} - places if places else set[str]()),
        )
        return tuple(
            f"{count(len(names), kind)} without {what} ({', '.join(sorted(names)[:NAMED])}); correct the name"
            for kind, what, names in kinds
            if names
        )


def read_parts(path: Path) -> Parts:
    """Read a table of parts.

    Raises
    ------
    StoopError
        One line that names the row, where a column or a date is wrong, two parts are in one place, or one part is in two.
    """
    text = toml.read_source(path, "parts", StoopError, MAX_BYTES, ".csv")
    fittings = sorted(_rows(str(path), text), key=lambda one: (one.vehicle, one.part, one.begin))
    _check(str(path), fittings)
    return Parts(tuple(fittings))


def _rows(where: str, text: str) -> Iterator[Fitting]:
    try:
        rows = list(csv.DictReader(io.StringIO(text), skipinitialspace=True))
    except csv.Error as error:
        raise StoopError(f"{where}: not a comma-separated table ({error})") from None
    for line, row in enumerate(rows, start=2):
        lost = [c for c in COLUMNS if row.get(c) is None]
        if lost:
            raise StoopError(f"{where}: line {line} has no {lost[0]}; columns are {', '.join(COLUMNS)}")
        vehicle, part, serial = (row[c].strip() for c in COLUMNS[:3])
        if not (vehicle and part and serial):
            raise StoopError(f"{where}: line {line} names no vehicle, part or serial; fill in all three")
        texts = row["from"].strip(), row["to"].strip()
        begin, end = (
            moment(f"{where}: line {line}", text) if text else open_end
            for text, open_end in zip(texts, (-np.inf, np.inf), strict=True)
        )
        if not begin < end:
            raise StoopError(
                f"{where}: line {line}: {serial} leaves {part} before it comes; correct from or to"
            )
        yield Fitting(vehicle, part, serial, begin, end)


def moment(where: str, text: str) -> float:
    """Return a date by ISO 8601 as s since 1970, in UTC where no zone stands; `where` is named if it is none."""
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        raise StoopError(f"{where}: '{text}' is no date; write 2026-05-31 or 2026-05-31T14:30") from None
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()


def day(seconds: float) -> date:
    """Return the day (UTC) of a time, s since 1970."""
    return datetime.fromtimestamp(seconds, UTC).date()


def _check(where: str, fittings: Sequence[Fitting]) -> None:
    """Raise for the first two fittings that contradict each other."""
    in_place: dict[tuple[str, str], list[Fitting]] = defaultdict(list)
    of_part: dict[tuple[str, str], list[Fitting]] = defaultdict(list)
    for one in fittings:
        in_place[one.vehicle, one.part].append(one)
        of_part[one.kind, one.serial].append(one)
    for groups, what in (
        (in_place, "{0.vehicle} has {0.serial} and {1.serial} as {0.part}"),
        (of_part, "{0.serial} is {0.part} of {0.vehicle} and {1.part} of {1.vehicle}"),
    ):
        for own in groups.values():
            for one, other in pairwise(sorted(own, key=lambda one: one.begin)):
                if other.begin < one.end:
                    at = day(max(other.begin, 0.0))
                    raise StoopError(f"{where}: {what.format(one, other)} on {at}; correct from or to")
