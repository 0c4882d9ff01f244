"""Parquet tables through pyarrow, in a child process (`stoop.logs.guard`): each numeric column, nested ones by dotted names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from stoop.errors import LogError
from stoop.logs.arrays import MAX_ARRAYS, Array, assemble, max_values
from stoop.logs.netcdf import MAX_DEPTH
from stoop.logs.recording import Defect, Recording, reason


def parse_parquet(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a .parquet file in this process; its library may crash, loop or raise anything.

    Raises
    ------
    LogError
        When it holds no samples, or more numbers than its size allows.
    """
    import pyarrow.parquet as pq  # heavy, and only here

    arrays: list[Array] = []
    skipped: list[str] = []
    defects: list[Defect] = []
    with pq.ParquetFile(path, memory_map=False) as file:
        rows, columns, schema = file.metadata.num_rows, file.metadata.num_columns, file.schema_arrow
        if columns > MAX_ARRAYS or rows * sum(map(_width, schema.types)) > max_values(path):
            raise LogError(
                f"{path}: more than {MAX_ARRAYS} columns or {max_values(path)} numbers; cut the flight"
            )
        for name, kind in zip(schema.names, schema.types, strict=True):
            # the index of a pandas table is mostly its time
            place = "time" if name.startswith("__index_level_0__") else name
            if not _width(kind):  # not unpacked: texts have any length
                skipped.append(place)
                continue
            try:
                column = file.read(columns=[name], use_threads=False).column(name).combine_chunks()
            except (OSError, ValueError) as error:  # pyarrow's own errors are of these kinds
                defects.append(Defect("corrupt", place, f"damaged and skipped ({reason(error, 80)})"))
                continue
            for inner, array in _leaves((place,), column):
                arrays.append(array) if array is not None else skipped.append(".".join(inner))
    defects += [Defect("skipped", name, "holds no numbers") for name in skipped[:10]]
    return assemble(path, "parquet", arrays, defects, topics)


def _width(kind: Any) -> int:
    """Return how many numbers a row of a type has."""
    import pyarrow as pa

    if pa.types.is_struct(kind):
        return sum(_width(kind.field(i).type) for i in range(kind.num_fields))
    if pa.types.is_fixed_size_list(kind):
        return int(kind.list_size) * _width(kind.value_type)
    return int(any(is_kind(kind) for is_kind in (
        pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean, pa.types.is_decimal, pa.types.is_timestamp,
        pa.types.is_duration)))  # fmt: skip


def _leaves(place: tuple[str, ...], column: Any) -> Iterator[tuple[tuple[str, ...], Array | None]]:
    """Descend into structures and lists of fixed length; missing numbers are NaN, dates count from 1970 in their unit."""
    import pyarrow as pa

    kind, unit = column.type, ""
    if pa.types.is_struct(kind) and len(place) <= MAX_DEPTH:
        for i in range(kind.num_fields):
            yield from _leaves((*place, kind.field(i).name), column.field(i))
        return
    if pa.types.is_fixed_size_list(kind) and kind.list_size and column.null_count == 0:
        for inner, array in _leaves(place, column.flatten()):
            rows = None if array is None else array.values.reshape(-1, kind.list_size)
            yield inner, None if array is None or rows is None else Array(inner, rows, array.unit)
        return
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        column, unit = column.cast(pa.int64()), str(kind.unit)
    elif pa.types.is_nested(kind) or not _width(kind):
        yield place, None
        return
    numbers = column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    yield place, Array(place, np.asarray(numbers), unit)
