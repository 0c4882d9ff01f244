"""Figures of flights as a table: one row for a flight and a figure, with its standard error."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from stoop.extend.arrays import BoolArray, FloatArray
from stoop.extend.errors import StoopError
from stoop.extend.files import read_bounded

if TYPE_CHECKING:
    import pandas as pd

FIGURES: Final = "figures"  #: folder of the tables of a store
LOGS: Final = f"{FIGURES}/logs.parquet"  #: figures of logs
REST: Final = "rest of "  #: what a flight does not tell of a group of figures, beside what it tells
TEXTS: Final = ("flight", "vehicle", "figure")
NUMBERS: Final = ("value", "std_error")
NEEDED: Final = (*TEXTS, "time", *NUMBERS)
OPTIONAL: Final = ("software", "parts", "unit")
#: of a number or a date; a vehicle may be called so
UNKNOWN: Final = ("", "NA", "N/A", "NaN", "nan", "null", "None")
PARQUET: Final = (".parquet", ".pq")
MAX_BYTES: Final = 2**30
MAX_HEAD: Final = 2**20


@dataclass(frozen=True, eq=False)
class FigureTable:
    """Rows in order of time, then of vehicle, flight and figure.

    Attributes
    ----------
    flight, vehicle, figure : (n,) texts
    software : (n,) texts, empty where it is not known
    parts : (n,) places of the parts on which the figure depends, separated by blanks
    unit : (n,) texts, of the figure, empty where it is not known
    time : (n,) s since 1970, UTC, at which the flight began
    value : (n,) in the unit of the figure
    std_error : (n,) positive, of the value
    conditions : name -> (n,) what differs from flight to flight by nature, such as density or temperature
    """

    flight: tuple[str, ...]
    vehicle: tuple[str, ...]
    figure: tuple[str, ...]
    software: tuple[str, ...]
    parts: tuple[str, ...]
    unit: tuple[str, ...]
    time: FloatArray
    value: FloatArray
    std_error: FloatArray
    conditions: Mapping[str, FloatArray]

    def span(self, first: int, last: int) -> FigureTable:
        """Return the rows from one to before another."""
        at = np.arange(len(self.time))
        return self.rows((at >= first) & (at < last))

    @classmethod
    def of_columns(
        cls,
        texts: Mapping[str, Sequence[str]],
        numbers: Mapping[str, FloatArray],
        conditions: Mapping[str, FloatArray],
    ) -> FigureTable:
        """Return a table of columns by name, all of one length; optional ones may be absent."""
        empty = ("",) * len(numbers["time"])
        flight, vehicle, figure, *more = (tuple(texts.get(n, empty)) for n in (*TEXTS, *OPTIONAL))
        time, value, std_error = (numbers[n] for n in ("time", *NUMBERS))
        software, parts, unit = more
        return cls(flight, vehicle, figure, software, parts, unit, time, value, std_error, conditions)

    def frame(self) -> pd.DataFrame:
        """Return the table for pandas, in its own columns; `read_figures` reads it."""
        import pandas as pd

        return pd.DataFrame(
            {name: getattr(self, name) for name in (*NEEDED, *OPTIONAL)} | dict(self.conditions)
        )

    def figures(self) -> tuple[str, ...]:
        """Return the names of the figures, sorted."""
        return tuple(sorted(set(self.figure)))

    def of(self, figure: str) -> FigureTable:
        """Return the rows of a figure."""
        return self.rows(np.fromiter(map(figure.__eq__, self.figure), np.bool_, len(self.figure)))

    def rows(self, which: BoolArray) -> FigureTable:
        """Return some rows."""
        at = np.flatnonzero(which)
        places = at.tolist()
        texts = {name: tuple(map(getattr(self, name).__getitem__, places)) for name in (*TEXTS, *OPTIONAL)}
        numbers = {name: getattr(self, name)[at] for name in ("time", *NUMBERS)}
        return self.of_columns(texts, numbers, {name: x[at] for name, x in self.conditions.items()})


def read_figures(*paths: Path) -> FigureTable:
    """Read tables of figures, CSV or Parquet: ``flight, vehicle, time, figure, value, std_error``.

    ``software``, ``parts`` and ``unit`` may stand beside them. ``time`` is seconds since 1970, or a date by ISO 8601, in UTC
    where no zone stands. Other columns of numbers are conditions.

    Raises
    ------
    StoopError
        One line that says which column or row is wrong, and what to do.
    """
    return of_frames(", ".join(map(str, paths)), [read_frame(path, NEEDED) for path in paths])


def read_frame(path: Path, needed: Sequence[str]) -> pd.DataFrame:
    """Return a table that has some columns, a time among them in seconds since 1970; errors as of `read_figures`."""
    import pandas as pd

    kept = dict.fromkeys((*TEXTS, *OPTIONAL), str)  # 007 is no number
    try:
        file = io.BytesIO(read_bounded(path, MAX_BYTES))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise StoopError(f"{path}: cannot be read ({reason}); name a table of figures") from None
    try:
        if path.suffix in PARQUET:
            table = pd.read_parquet(file)
        else:
            unknown = {name: ("",) if name in kept else UNKNOWN for name in columns_of(path)} or UNKNOWN
            table = pd.read_csv(file, dtype=kept, keep_default_na=False, na_values=unknown)
    except ImportError:
        raise StoopError(f"{path}: Parquet needs a library; pip install '.[parquet]'") from None
    except (ValueError, OSError) as error:
        what = str(error).splitlines()[0][:200]
        raise StoopError(f"{path}: not a table ({what}); write CSV with commas, or Parquet") from None
    if lost := [name for name in needed if name not in table.columns]:
        raise StoopError(f"{path}: no column {lost[0]}; the table needs {', '.join(needed)}")
    if table.empty:
        raise StoopError(f"{path}: holds no row")
    return table.assign(time=_seconds(str(path), table["time"])) if "time" in table.columns else table


def columns_of(path: Path) -> tuple[str, ...]:
    """Return the columns of a CSV or Parquet file by its head; none of what is no such file."""
    if path.suffix not in (".csv", *PARQUET) or not path.is_file():
        return ()
    if path.suffix == ".csv":
        with path.open("rb") as file:
            head = file.readline(MAX_HEAD).decode("utf-8-sig", "replace")
        return tuple(next(csv.reader([head]), ()))
    try:
        from pyarrow.parquet import read_schema

        return tuple(read_schema(path).names)
    except (ImportError, ValueError, OSError):
        return ()


def of_frames(where: str, tables: Sequence[pd.DataFrame]) -> FigureTable:
    """Return the rows of tables with the columns of `read_figures` as one; `where` is named in its errors."""
    import pandas as pd

    table = pd.concat(tables, ignore_index=True)
    numbers = {name: _numbers(where, table, name) for name in ("time", *NUMBERS)}
    there = [*TEXTS, *(name for name in OPTIONAL if name in table.columns)]
    texts = {name: pd.factorize(table[name].fillna("").astype(str), sort=True) for name in there}
    own = [texts[name] for name in ("figure", "flight", "vehicle")]
    bad = np.flatnonzero(
        ~(np.isfinite(numbers["value"]) & np.isfinite(numbers["time"]) & (numbers["std_error"] > 0.0))
        | np.any([np.asarray(names == "")[at] for at, names in own], axis=0)
    )
    if bad.size:
        flight = table["flight"].iloc[int(bad[0])]
        raise StoopError(
            f"{where}: {len(bad)} rows, first that of flight {flight}, lack a value, a time, a standard error above zero, or "
            "the name of flight, vehicle or figure; leave such rows out"
        )
    places = [at for at, _ in own]
    twice = pd.DataFrame(dict(enumerate(places))).duplicated()
    if twice.any():
        row = table[twice].iloc[0]
        raise StoopError(
            f"{where}: {row['figure']} of flight {row['flight']} stands there twice; keep one row"
        )
    order = np.lexsort((*places, numbers["time"]))
    others = [c for c in table.columns if c not in (*NEEDED, *OPTIONAL) and table[c].dtype.kind in "fiu"]
    return FigureTable.of_columns(
        {name: names.to_numpy(object)[at[order]].tolist() for name, (at, names) in texts.items()},
        {name: x[order] for name, x in numbers.items()},
        {str(c): _numbers(where, table, c)[order] for c in others},
    )


def _numbers(where: str, table: pd.DataFrame, name: str) -> FloatArray:
    import pandas as pd

    try:
        return np.asarray(pd.to_numeric(table[name]), dtype=np.float64)
    except (ValueError, TypeError):
        raise StoopError(f"{where}: column {name} holds what is no number; correct it") from None


def _seconds(where: str, column: pd.Series[Any]) -> pd.Series[Any]:
    import pandas as pd

    if column.dtype.kind in "fiu":
        return column
    try:
        moments = pd.to_datetime(column, utc=True, format="ISO8601")
    except (ValueError, TypeError):
        raise StoopError(
            f"{where}: column time holds what is no date; write seconds or 2026-05-31T14:30"
        ) from None
    return (moments - pd.Timestamp(0, tz="UTC")).dt.total_seconds()
