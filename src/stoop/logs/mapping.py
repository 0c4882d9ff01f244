"""The mapping of a CSV log: which column is which variable, in which unit.

A TOML file with two tables. For a log NAME.csv it is given as an argument, or lies beside the log as
NAME.csv.toml; for a folder of CSV files with clocks of their own it lies inside as mapping.toml.

.. code-block:: toml

    [time]
    column = "t_ms"                     # column that holds the time
    unit = "ms"                         # s, ms, us or ns

    [variables]                         # variable of stoop = where it is found
    p = {column = "roll_rate", unit = "deg/s"}
    az = {column = "acc_z", unit = "g", scale = -1}           # turn the sign
    temperature = {column = "T_C", unit = "K", offset = 273.15}
    phi = {column = "roll", unit = "deg", file = "euler.csv"}  # only when the log is a folder

SI value = number in the column * unit * scale + offset; scale is 1 and offset is 0 unless given.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Mapping as TextMapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from stoop.base.units import FACTORS, PULSE_FACTORS, ZEROS
from stoop.errors import LogError

TIME_UNITS: Final = ("s", "ms", "us", "ns")
LARGEST: Final = 1e300  #: number that a mapping may hold
MAX_BYTES: Final = 2**20
_KEYS: Final = frozenset({"column", "unit", "scale", "offset", "file"})
_SECOND: Final = frozenset({"extends", "files", "group", "calibration", "surface", "mixer", "align"})


@dataclass(frozen=True)
class Column:
    """Where one variable is found.

    Attributes
    ----------
    variable : name in stoop
    column : name in the header of the file
    factor : SI value of one, with the sign
    offset : SI value of zero
    file : name of the file in the folder; empty when the log is one file
    """

    variable: str
    column: str
    factor: float
    offset: float
    file: str


@dataclass(frozen=True)
class Mapping:
    """A whole mapping: where it was read, the clock, and the variables in the order of the file."""

    path: Path
    time_column: str
    time_factor: float
    columns: tuple[Column, ...]


def read_mapping(path: Path) -> Mapping:
    """Read a mapping.

    Raises
    ------
    LogError
        When the file is missing, is no TOML, or says something unknown; names the key and the fix.
    """
    return mapping_of(path, read_toml(path))


def mapping_of(path: Path, content: TextMapping[str, Any]) -> Mapping:
    """Return the mapping that a file of this content is; see `read_mapping`."""
    for key in content:
        if key not in ("time", "variables"):
            raise LogError(f"{path}: unknown table '{key}'; a mapping has [time] and [variables]")
    clock, variables = (_table(path, content, key) for key in ("time", "variables"))
    only_keys(path, "time", clock, frozenset({"column", "unit"}))
    unit = text_of(path, "time", clock, "unit")
    if unit not in TIME_UNITS:
        raise LogError(
            f"{path}: time.unit = '{unit}' is no unit of time; write one of {', '.join(TIME_UNITS)}"
        )
    columns = tuple(_column(path, name, entry) for name, entry in variables.items())
    return Mapping(path, text_of(path, "time", clock, "column"), FACTORS[unit], columns)


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file that is no larger than a mapping can be."""
    try:
        with path.open("rb") as file:
            text = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise LogError(f"{path}: the mapping cannot be read ({error.strerror}); check the name") from None
    if len(text) > MAX_BYTES:
        raise LogError(f"{path}: larger than a mapping can be; name a TOML file with [time] and [variables]")
    return parse_toml(str(path), text)


def parse_toml(place: str, text: bytes) -> dict[str, Any]:
    """Parse TOML; every way in which it can be wrong is one line."""
    try:
        return tomllib.loads(text.decode())
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise LogError(
            f"{place}: not valid TOML ({' '.join(str(error).split())[:120]}); mend that line"
        ) from None


def is_first_edition(content: TextMapping[str, Any]) -> bool:
    """Tell whether a mapping says no more than which column of a table is which variable."""
    entries = content.get("variables")
    later = isinstance(entries, dict) and any(
        isinstance(entry, dict) and not entry.keys() <= _KEYS and entry.keys() & {"stream", "frame"}
        for entry in entries.values()
    )
    clocks = content.get("clock")
    own = isinstance(clocks, dict) and any(isinstance(clock, dict) for clock in clocks.values())
    return not later and not own and not content.keys() & _SECOND


def _table(path: Path, content: TextMapping[str, Any], key: str) -> dict[str, Any]:
    table = content.get(key)
    if not isinstance(table, dict) or not table:
        example = 'column = "t", unit = "s"' if key == "time" else 'p = {column = "p", unit = "rad/s"}'
        raise LogError(f"{path}: there is no table [{key}]; add it, such as {example}")
    return table


def only_keys(place: Path | str, where: str, table: TextMapping[str, Any], keys: frozenset[str]) -> None:
    """Refuse keys that mean nothing."""
    for key in table:
        if key not in keys:
            raise LogError(f"{place}: {where}.{key} is unknown; the keys are {', '.join(sorted(keys))}")


def text_of(place: Path | str, where: str, table: TextMapping[str, Any], key: str) -> str:
    """Return a text that must be there."""
    value = table.get(key)
    if not isinstance(value, str) or not value:
        raise LogError(f'{place}: {where}.{key} is missing or not a text; write {key} = "..."')
    return value


def number_of(place: Path | str, where: str, table: TextMapping[str, Any], key: str, default: float) -> float:
    """Return a finite number, or the default."""
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < LARGEST:
        raise LogError(f"{place}: {where}.{key} is not a number; write {key} = {default:g} or leave it out")
    return float(value)


def _column(path: Path, name: str, entry: object) -> Column:
    where = f"variables.{name}"
    if not isinstance(entry, dict):
        raise LogError(f'{path}: {where} is not a table; write {name} = {{column = "...", unit = "..."}}')
    only_keys(path, where, entry, _KEYS)
    unit = text_of(path, where, entry, "unit")
    factor = factor_of(path, where, name, unit)
    scale = number_of(path, where, entry, "scale", 1.0)
    offset = number_of(path, where, entry, "offset", 0.0) + ZEROS.get(unit, 0.0)
    file = text_of(path, where, entry, "file") if "file" in entry else ""
    return Column(name, text_of(path, where, entry, "column"), factor * scale, offset, file)


def factor_of(place: Path | str, where: str, variable: str, unit: str) -> float:
    """Return the SI value of one unit; pulses are kept in microseconds."""
    factors = PULSE_FACTORS if variable.startswith("pwm_") else FACTORS
    if unit not in factors:
        near = difflib.get_close_matches(unit, factors, n=3, cutoff=0.3) or list(factors)
        raise LogError(f"{place}: {where}.unit = '{unit}' is unknown; did you mean {' or '.join(near)}?")
    return factors[unit]
