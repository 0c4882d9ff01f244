"""Parquet tables through pyarrow, in a process of its own: each numeric column, nested ones by dotted names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.errors import LogError
from stoop.logs.guard import guarded, need
from stoop.logs.recording import Defect, Recording
from stoop.logs.tabular import MAX_ARRAYS, Array, assemble, most_values, typed

MAX_DEPTH: Final = 16
_INDEX: Final = "__index_level_0__"  #: the index of a pandas table: mostly its time


def read_parquet(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a .parquet file.

    Raises
    ------
    LogError
        When it is damaged, holds no samples, or pyarrow is missing.
    """
    need(path, "pyarrow", "parquet", "Parquet files")
    return guarded("stoop.logs.parquet:load", path, topics)


def load(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a .parquet file in this very process; see `read_parquet`."""
    arrays, defects = typed(path, "Parquet file", _read)
    return assemble(path, "parquet", arrays, defects, topics)


def _read(path: Path) -> tuple[list[Array], list[Defect]]:
    import pyarrow.parquet as pq  # heavy, and only here

    arrays: list[Array] = []
    skipped: list[str] = []
    defects: list[Defect] = []
    with pq.ParquetFile(path, memory_map=False) as file:
        rows, columns = file.metadata.num_rows, file.metadata.num_columns
        if columns > MAX_ARRAYS or rows * columns > most_values(path):
            raise LogError(
                f"{path}: more than {MAX_ARRAYS} columns or {most_values(path)} numbers; cut the flight"
            )
        for name in file.schema_arrow.names:
            shown = "time" if name.startswith(_INDEX) else name
            try:
                column = file.read(columns=[name], use_threads=False).column(name).combine_chunks()
            except (OSError, ValueError) as error:  # pyarrow's own errors are of these kinds
                why = " ".join(str(error).split())[:80]
                defects.append(Defect("corrupt", shown, f"damaged and skipped ({why})"))
                continue
            for place, array in _leaves((shown,), column):
                arrays.append(array) if array is not None else skipped.append(".".join(place))
    return arrays, [*defects, *(Defect("skipped", name, "holds no numbers") for name in skipped[:10])]


def _leaves(place: tuple[str, ...], column: Any) -> Iterator[tuple[tuple[str, ...], Array | None]]:
    """Go down into structures and lists of fixed length."""
    import pyarrow as pa

    kind = column.type
    if pa.types.is_struct(kind) and len(place) <= MAX_DEPTH:
        for i in range(kind.num_fields):
            yield from _leaves((*place, kind.field(i).name), column.field(i))
    elif pa.types.is_fixed_size_list(kind) and kind.list_size and column.null_count == 0:
        for inner, array in _leaves(place, column.flatten()):
            yield (
                inner,
                None if array is None else Array(inner, array.values.reshape(-1, kind.list_size), array.unit),
            )
    else:
        yield place, _numbers(place, column)


def _numbers(place: tuple[str, ...], column: Any) -> Array | None:
    """Return a column of numbers, what is missing as NaN; a date is counted from 1970, in its own unit."""
    import pyarrow as pa

    kind, unit = column.type, ""
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        column, unit = column.cast(pa.int64()), str(kind.unit)
    elif not (
        pa.types.is_integer(kind)
        or pa.types.is_floating(kind)
        or pa.types.is_boolean(kind)
        or pa.types.is_decimal(kind)
    ):
        return None
    return Array(
        place, np.asarray(column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)), unit
    )
