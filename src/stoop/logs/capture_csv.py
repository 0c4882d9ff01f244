"""Tables that motion capture exports: poses of rigid bodies below a header of several lines, by OptiTrack Motive or Vicon.

A pose comes out north, east, down and forward, right, down, whatever is up in the room: Motive's x, z and -y, Vicon's x, -y and
-z, of the room and of the body. A body that was defined with its nose along the room's x has its nose forward.

References
----------
.. [1] OptiTrack, "Data Export: CSV", documentation of Motive 2.3.
.. [2] Vicon, "Tracker User Guide", 3.9, "Export data to CSV".
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from stoop.base.arrays import FloatArray
from stoop.base.units import FACTORS
from stoop.errors import LogError

MOST_LINES: Final = 12  #: of a header
LONGEST: Final = 2**20  #: bytes of it
LENGTHS: Final = {"meters": "m", "centimeters": "cm", "millimeters": "mm"}
COMPONENTS: Final = frozenset(("px", "py", "pz", "qw", "qx", "qy", "qz"))
#: north, east, down: axis of the export and its sign
Y_UP: Final = (("x", 1.0), ("z", 1.0), ("y", -1.0))
Z_UP: Final = (("x", 1.0), ("y", -1.0), ("z", -1.0))


@dataclass(frozen=True)
class Export:
    """Header of an exported table."""

    lines: int  #: of text, before the numbers
    count: int  #: of columns
    clock: int  #: column that tells the time
    period: float  #: s, of a step of that column
    unit: str  #: of the positions
    axes: tuple[tuple[str, float], ...]
    #: body -> "px" ... "pz", "qw" ... "qz" -> column
    bodies: Mapping[str, Mapping[str, int]]


def export_of(path: Path, text: bytes) -> Export | None:
    """Return the header of an export of Motive or Vicon; None of any other table.

    Raises
    ------
    LogError
        When it holds no body with its attitude as a quaternion.
    """
    head = text[:LONGEST].decode("utf-8-sig", errors="replace").split("\n", MOST_LINES)[:MOST_LINES]
    try:
        rows = list(csv.reader(line.rstrip("\r") for line in head))
    except csv.Error:
        return None
    rows = [[cell.strip() for cell in row] for row in rows]
    found = _motive(rows) or _vicon(rows)
    if found is None:
        return None
    whole = {name: own for name, own in found.bodies.items() if own.keys() == COMPONENTS}
    if not whole:
        raise LogError(
            f"{path}: no rigid body with its position and a quaternion; export rigid bodies (objects), "
            "with rotations as quaternions"
        )
    return replace(found, bodies=whole)


def poses(export: Export, columns: Sequence[FloatArray]) -> dict[str, FloatArray]:
    """Return the time and the pose of each body, by names that a mapping is drafted from."""
    out = {"time [s]": columns[export.clock] * export.period}
    factor, several = FACTORS[export.unit], len(export.bodies) > 1
    for name, own in export.bodies.items():
        prefix = f"{name}." if several else ""
        for to, (axis, sign) in zip("ned", export.axes, strict=True):
            out[f"{prefix}pos_{to} [m]"] = sign * factor * columns[own[f"p{axis}"]]
        out[f"{prefix}qw"] = columns[own["qw"]]
        for to, (axis, sign) in zip("xyz", export.axes, strict=True):
            out[f"{prefix}q{to}"] = sign * columns[own[f"q{axis}"]]
    return out


def _motive(rows: Sequence[Sequence[str]]) -> Export | None:
    if not rows or rows[0][:1] != ["Format Version"]:
        return None
    lines = next((i for i, row in enumerate(rows) if row[:1] == ["Frame"]), 0)
    above = rows[1:lines]
    kinds = next((i for i, row in enumerate(above) if "Rigid Body" in row), len(above))
    if len(above) - kinds < 3:  # types, names, position or rotation
        return Export(lines, 0, 0, 1.0, "m", Y_UP, {})
    columns = zip(above[kinds], above[kinds + 1], above[-1], rows[lines], strict=False)
    cells = (
        (name, {"Position": "p", "Rotation": "q"}.get(part, "") + axis.lower(), i)
        for i, (kind, name, part, axis) in enumerate(columns)
        if kind == "Rigid Body"
    )
    about = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    unit = LENGTHS.get(about.get("Length Units", "").lower(), "m")
    return Export(lines + 1, len(rows[lines]), 1, 1.0, unit, Y_UP, _bodies(cells))


def _vicon(rows: Sequence[Sequence[str]]) -> Export | None:
    if len(rows) < 5 or rows[3][:2] != ["Frame", "Sub Frame"]:
        return None
    try:
        period = 1.0 / float(rows[1][0])
    except (IndexError, ValueError, ZeroDivisionError):
        return None
    names = [""]
    for cell in rows[2]:
        names.append(cell or names[-1])
    cells = (
        (name.rpartition(":")[2], {"T": "p", "R": "q"}.get(cell[:1], "") + cell[1:].lower(), i)
        for i, (name, cell) in enumerate(zip(names[1:], rows[3], strict=False))
    )
    unit = next((cell for cell in rows[4] if cell in LENGTHS.values()), "mm")
    return Export(5, len(rows[3]), 0, period, unit, Z_UP, _bodies(cells))


def _bodies(cells: Iterable[tuple[str, str, int]]) -> dict[str, dict[str, int]]:
    """Return the columns of each body by component, of (body, component, column); what is no component of a pose is left out."""
    bodies: dict[str, dict[str, int]] = {}
    for name, component, column in cells:
        if component in COMPONENTS:
            bodies.setdefault(name, {}).setdefault(component, column)
    return bodies
