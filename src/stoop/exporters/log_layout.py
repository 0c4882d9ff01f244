"""A mapping, inverted: from variables of a flight to the columns of a log, and the mapping file for the rest."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Final, TypeAlias

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.flight import Flight
from stoop.flight.conversion import MAX_DEFLECTION, rotate_axes
from stoop.flight.mapping import FlightMapping, Source, with_other_form

Columns: TypeAlias = dict[str, FloatArray]
USUAL_TRAVEL: Final = 0.5  #: rad, of a surface to either side


@dataclass
class LogLayout:
    """Streams and columns of a log.

    Attributes
    ----------
    streams : stream -> column -> (n,) in the unit and the axes of the log
    unmapped : variable -> (n,) SI, of those that the mapping has no column for
    """

    streams: dict[str, Columns] = field(default_factory=dict)
    unmapped: Columns = field(default_factory=dict)
    _placed: set[tuple[str, str]] = field(default_factory=set)

    @classmethod
    def of(cls, flight: Flight, mapping: FlightMapping, columns: Mapping[str, Collection[str]]) -> LogLayout:
        """Lay a flight out as a log.

        Parameters
        ----------
        flight : whose channels share one clock
        mapping : by which the log will be read
        columns : stream -> columns to write; every source of the mapping among them is written
        """
        known = {str(name): flight.column(str(name)) for name in flight.data.data_vars}
        out = cls()
        for group in mapping.groups.values():
            for source in group.sources:
                if source.stream in columns:
                    out._place(known, source, columns[source.stream])
        placed = with_other_form({name for _, name in out._placed})  # either form of the attitude
        out.unmapped = {name: x for name, x in known.items() if name not in placed}
        return out

    def _place(self, known: Mapping[str, FloatArray], source: Source, there: Collection[str]) -> None:
        """Write the columns of one source; a variable stands once in a stream."""
        wanted = [
            i
            for i, name in enumerate(source.variables)
            if name in known and set(source.columns[i]) <= set(there)
        ]
        if not wanted or (not source.partial and len(wanted) < len(source.variables)):
            return
        names = [source.variables[i] for i in wanted]
        back = rotate_axes(
            {name: known[name] for name in names}, source.frame
        )  # a half turn is its own inverse
        for i, name in zip(wanted, names, strict=True):
            if (source.stream, name) not in self._placed:
                self._placed.add((source.stream, name))
                self._write(source, i, (back[name] - source.offsets[i]) / source.factors[i])

    def _write(self, source: Source, i: int, total: FloatArray) -> None:
        """Solve a weighted sum of columns for those that are empty; the first of them takes the remainder."""
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


@dataclass
class MappingFile:
    """Text of the mapping beside a log, for what the ready mapping does not read.

    Attributes
    ----------
    extends : the ready mapping that reads the rest; empty where there is none
    clock : name of the column that holds the time in seconds; empty for that of the reader
    lines : of [variables]
    tables : after them
    """

    extends: str = ""
    clock: str = ""
    lines: list[str] = field(default_factory=list)
    tables: list[str] = field(default_factory=list)

    def add(self, variable: str, column: str, unit: str, stream: str = "", more: str = "") -> None:
        """Add the column of a variable."""
        where = f'stream = "{stream}", ' if stream else ""
        self.lines.append(f'{variable} = {{ {where}column = "{column}", unit = "{unit}"{more} }}')

    def calibrate(self, surface: str, output: str, low: float, high: float, travel: float) -> None:
        """Add the calibration of a surface: -travel at the pulse or command `low`, travel at `high`."""
        points = f"[[{low:g}, {-travel:g}], [{high:g}, {travel:g}]]"
        self.tables.append(f"[calibration.{output}]\npoints = {points}\n")
        self.tables.append(f"[surface.{surface}]\nfrom = {{ {output} = 1.0 }}\n")

    def text(self) -> str:
        """Return the file; empty where the ready mapping reads all."""
        if not self.lines and not self.tables:
            return ""
        head = [f'extends = "{self.extends}"\n'] if self.extends else []
        head += [f'[time]\ncolumn = "{self.clock}"\nunit = "s"\n'] if self.clock else []
        lines = ["\n".join(["[variables]", *self.lines]) + "\n"] if self.lines else []
        return "\n".join([*head, *lines, *self.tables])


def travel(x: FloatArray) -> float:
    """Return the travel of a surface to either side, rad: the usual, or as far as it went."""
    most = float(np.nanmax(np.abs(x), initial=0.0))
    return min(max(USUAL_TRAVEL, math.ceil(10.0 * most) / 10.0), MAX_DEFLECTION)
