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
import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from stoop.errors import LogError
from stoop.units import FACTORS, ZEROS

TIME_UNITS: Final = ("s", "ms", "us", "ns")
MAX_BYTES: Final = 2**20
_KEYS: Final = frozenset({"column", "unit", "scale", "offset", "file"})
PULSES: Final = {
    "pwm": 1.0,
    "us": 1.0,
    "ms": 1e3,
    "s": 1e6,
}  #: unit of a pulse -> microseconds, as it is kept


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
    content = _toml(path)
    for key in content:
        if key not in ("time", "variables"):
            raise LogError(f"{path}: unknown table '{key}'; a mapping has [time] and [variables]")
    clock, variables = (_table(path, content, key) for key in ("time", "variables"))
    _only(path, "time", clock, frozenset({"column", "unit"}))
    unit = _text(path, "time", clock, "unit")
    if unit not in TIME_UNITS:
        raise LogError(
            f"{path}: time.unit = '{unit}' is no unit of time; write one of {', '.join(TIME_UNITS)}"
        )
    columns = tuple(_column(path, name, entry) for name, entry in variables.items())
    return Mapping(path, _text(path, "time", clock, "column"), FACTORS[unit], columns)


def _toml(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            text = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise LogError(f"{path}: the mapping cannot be read ({error.strerror}); check the name") from None
    if len(text) > MAX_BYTES:
        raise LogError(f"{path}: larger than a mapping can be; name a TOML file with [time] and [variables]")
    try:
        return tomllib.loads(text.decode())
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise LogError(
            f"{path}: not valid TOML ({' '.join(str(error).split())[:120]}); mend that line"
        ) from None


def _table(path: Path, content: dict[str, Any], key: str) -> dict[str, Any]:
    table = content.get(key)
    if not isinstance(table, dict) or not table:
        example = 'column = "t", unit = "s"' if key == "time" else 'p = {column = "p", unit = "rad/s"}'
        raise LogError(f"{path}: there is no table [{key}]; add it, such as {example}")
    return table


def _only(path: Path, where: str, table: dict[str, Any], keys: frozenset[str]) -> None:
    for key in table:
        if key not in keys:
            raise LogError(f"{path}: {where}.{key} is unknown; the keys are {', '.join(sorted(keys))}")


def _text(path: Path, where: str, table: dict[str, Any], key: str) -> str:
    value = table.get(key)
    if not isinstance(value, str) or not value:
        raise LogError(f'{path}: {where}.{key} is missing or not a text; write {key} = "..."')
    return value


def _number(path: Path, where: str, table: dict[str, Any], key: str, default: float) -> float:
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise LogError(f"{path}: {where}.{key} is not a number; write {key} = {default:g} or leave it out")
    return float(value)


def _column(path: Path, name: str, entry: object) -> Column:
    where = f"variables.{name}"
    if not isinstance(entry, dict):
        raise LogError(f'{path}: {where} is not a table; write {name} = {{column = "...", unit = "..."}}')
    _only(path, where, entry, _KEYS)
    factors = PULSES if name.startswith("pwm_") else FACTORS
    unit = _text(path, where, entry, "unit")
    if unit not in factors:
        near = difflib.get_close_matches(unit, factors, n=3, cutoff=0.3) or list(factors)
        raise LogError(f"{path}: {where}.unit = '{unit}' is unknown; did you mean {' or '.join(near)}?")
    scale = _number(path, where, entry, "scale", 1.0)
    offset = _number(path, where, entry, "offset", 0.0) + ZEROS.get(unit, 0.0)
    file = _text(path, where, entry, "file") if "file" in entry else ""
    return Column(name, _text(path, where, entry, "column"), factors[unit] * scale, offset, file)
