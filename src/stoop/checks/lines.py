"""The lines of a mapping, and how a notice names them."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from stoop.base.text import enumerated


@dataclass(frozen=True)
class Line:
    """One line of a mapping that the user wrote.

    Attributes
    ----------
    file, key : place, such as "M.toml" and "variables.p"
    unit : as written; empty where none is
    """

    file: str
    key: str
    unit: str = ""


Lines: TypeAlias = Mapping[str, Line]  #: variable -> its line; variables of ready mappings have none


def read_lines(places: Mapping[str, str]) -> dict[str, Line]:
    """Return the lines of mappings that the user wrote.

    Parameters
    ----------
    places : variable -> place of its line, "FILE: KEY"; ready mappings are no files
    """
    split = {name: place.rpartition(": ")[::2] for name, place in places.items()}
    units = {file: _units(Path(file)) for file in {file for file, _ in split.values() if file}}
    return {
        name: Line(file, key, known.get(name, ""))
        for name, (file, key) in split.items()
        if (known := units.get(file)) is not None
    }


def _units(file: Path) -> dict[str, str] | None:
    """Return the unit of each variable as a mapping states it; None where there is no such file."""
    if not file.is_file():
        return None
    try:
        table = tomllib.loads(file.read_text("utf-8")).get("variables", {})
    except (OSError, ValueError):
        return {}
    entries = table.items() if isinstance(table, dict) else ()
    return {name: str(line["unit"]) for name, line in entries if isinstance(line, dict) and "unit" in line}


def where(names: Iterable[str], lines: Lines) -> str:
    """Return where to write what corrects variables: their lines, or a mapping that extends the ready one."""
    names = tuple(names)
    own = [lines[name] for name in names if name in lines]
    if len(own) < len(names) or not own:
        return f"{enumerated(names)} in a mapping (see stoop map)"
    return f"{enumerated([line.key for line in own])} in {own[0].file}"
