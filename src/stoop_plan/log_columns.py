"""A flight as the columns of a log: a mapping, inverted, and the mapping file for what no ready mapping reads."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from stoop import Flight
from stoop.extend.arrays import FloatArray
from stoop.extend.flights import FlightMapping, Source, rotate_axes, with_other_form

Columns: TypeAlias = dict[str, FloatArray]


def lay_out(
    flight: Flight, mapping: FlightMapping, columns: Mapping[str, Collection[str]]
) -> tuple[dict[str, Columns], Columns]:
    """Lay a flight out as a log: a mapping, inverted.

    Parameters
    ----------
    flight : whose channels share one clock
    mapping : by which the log will be read
    columns : stream -> columns to write; every source of the mapping among them is written

    Returns
    -------
    streams : stream -> column -> (n,) in the unit and the axes of the log
    unmapped : variable -> (n,) SI, of those that the mapping has no column for
    """
    known = {str(name): flight.column(str(name)) for name in flight.channels}
    streams: dict[str, Columns] = {}
    placed: set[tuple[str, str]] = set()  # a variable stands once in a stream
    for source in mapping.sources:
        there = set(columns.get(source.stream, ()))
        wanted = {
            name: i
            for i, name in enumerate(source.variables)
            if name in known and set(source.columns[i]) <= there
        }
        if source.stream not in columns or not wanted:
            continue
        if not source.partial and len(wanted) < len(source.variables):
            continue
        # a half turn is its own inverse
        rotated = rotate_axes({name: known[name] for name in wanted}, source.frame)
        for name, i in wanted.items():
            if (source.stream, name) not in placed:
                placed.add((source.stream, name))
                total = (rotated[name] - source.offsets[i]) / source.factors[i]
                _add_columns(streams.setdefault(source.stream, {}), source, i, total)
    either = with_other_form({name for _, name in placed})  # either form of the attitude
    return streams, {name: x for name, x in known.items() if name not in either}


def _add_columns(table: Columns, source: Source, i: int, total: FloatArray) -> None:
    """Solve a weighted sum of columns for those that are empty; the first of them takes the remainder."""
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
        self.tables += [
            f"[calibration.{output}]\npoints = {points}\n",
            f"[surface.{surface}]\nfrom = {{ {output} = 1.0 }}\n",
        ]

    def text(self) -> str:
        """Return the file; empty where the ready mapping reads all."""
        if not self.lines and not self.tables:
            return ""
        head = [f'extends = "{self.extends}"\n'] if self.extends else []
        head += [f'[time]\ncolumn = "{self.clock}"\nunit = "s"\n'] if self.clock else []
        lines = ["\n".join(["[variables]", *self.lines]) + "\n"] if self.lines else []
        return "\n".join([*head, *lines, *self.tables])
