"""A mapping, backwards: from variables of a flight to the columns of a log that the mapping would read them from."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.flight import Flight
from stoop.flight.frames import rotate_axes
from stoop.flight.mapping import FlightMapping, Source, with_other_form

Columns: TypeAlias = dict[str, FloatArray]
Layout: TypeAlias = Mapping[str, Collection[str]]  #: stream -> the columns that an autopilot logs in it


@dataclass
class LaidOut:
    """What a log is to hold.

    Attributes
    ----------
    streams : stream -> column -> (n,) in the unit and the axes of the log
    left : variable -> (n,) SI, of those that the mapping has no column for
    """

    streams: dict[str, Columns] = field(default_factory=dict)
    left: Columns = field(default_factory=dict)
    _placed: set[tuple[str, str]] = field(default_factory=set)

    def place(self, known: Mapping[str, FloatArray], source: Source, there: Collection[str]) -> None:
        """Write what one source would supply; a variable stands once in a stream."""
        wanted = [
            i
            for i, name in enumerate(source.variables)
            if name in known and set(source.columns[i]) <= set(there)
        ]
        if not wanted or (not source.partial and len(wanted) < len(source.variables)):
            return
        names = [source.variables[i] for i in wanted]
        back = rotate_axes({name: known[name] for name in names}, source.frame)  # a half turn undoes itself
        for i, name in zip(wanted, names, strict=True):
            if (source.stream, name) not in self._placed:
                self._placed.add((source.stream, name))
                self._write(source, i, (back[name] - source.offsets[i]) / source.factors[i])

    def _write(self, source: Source, i: int, total: FloatArray) -> None:
        """Solve the sum of columns for those that nothing stands in yet; the last of them takes what is left."""
        table = self.streams.setdefault(source.stream, {})
        weights = source.columns[i]
        if source.valid[i]:
            table[source.valid[i]] = np.ones(total.size)
        empty = [column for column in weights if column not in table]
        for column in empty[1:]:
            table[column] = np.zeros(total.size)
        if empty:
            rest = sum((w * table[c] for c, w in weights.items() if c != empty[0]), np.zeros(total.size))
            table[empty[0]] = (total - rest) / weights[empty[0]]

    @property
    def placed(self) -> frozenset[str]:
        """Variables that stand in the log, in either form of the attitude."""
        return with_other_form({name for _, name in self._placed})


def lay_out(flight: Flight, mapping: FlightMapping, layout: Layout) -> LaidOut:
    """Lay a flight out as a log.

    Parameters
    ----------
    flight : whose channels share one clock
    mapping : by which the log will be read
    layout : streams and columns to write; every source of the mapping among them is written
    """
    known = {str(name): flight.column(str(name)) for name in flight.data.data_vars}
    out = LaidOut()
    for group in mapping.groups.values():
        for source in group.sources:
            if source.stream in layout:
                out.place(known, source, layout[source.stream])
    out.left = {name: x for name, x in known.items() if name not in out.placed}
    return out
