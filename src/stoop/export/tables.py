"""A flight as a table: CSV, a structure of MATLAB, Parquet; columns are called and measured as in stoop."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.variables import EULER, QUATERNION
from stoop.errors import OutputError
from stoop.export.beside import Beside
from stoop.flight import VARIABLES, Flight

CLOCK: Final = "t"  #: name of the column of time, s
STRUCTURE: Final = "flight"  #: name of the variable in MATLAB


def csv_table(flight: Flight) -> tuple[bytes, str]:
    """Return a table of text, and the mapping that names its columns."""
    columns = _columns(flight)
    lines = io.StringIO()
    np.savetxt(
        lines,
        np.column_stack([*columns.values()]),
        fmt="%.9g",
        delimiter=",",
        header=",".join(columns),
        comments="",
    )
    return lines.getvalue().encode(), _mapping(columns)


def matlab_table(flight: Flight) -> tuple[bytes, str]:
    """Return a .mat file of version 5 with one structure, and the mapping that names its fields."""
    from scipy.io import savemat

    columns, content = _columns(flight), io.BytesIO()
    savemat(content, {STRUCTURE: columns}, oned_as="column")  # type: ignore[arg-type]  # it takes any binary file
    return content.getvalue(), _mapping(columns)


def parquet_table(flight: Flight) -> tuple[bytes, str]:
    """Return a Parquet file, and the mapping that names its columns.

    Raises
    ------
    OutputError
        Without pyarrow.
    """
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        raise OutputError(
            "Parquet is written by pyarrow, which is not installed: pip install 'stoop[parquet]'"
        ) from None
    columns, content = _columns(flight), io.BytesIO()
    parquet.write_table(pa.table(columns), content)
    return content.getvalue(), _mapping(columns)


def _columns(flight: Flight) -> dict[str, FloatArray]:
    """Return time and variables; the attitude as angles, where there are any."""
    names = [str(name) for name in flight.data.data_vars]
    angles = set(EULER) <= set(names)
    kept = [name for name in names if not (angles and name in QUATERNION)]
    return {CLOCK: flight.time, **{name: flight.column(name) for name in kept}}


def _mapping(columns: Iterable[str]) -> str:
    beside = Beside(clock=CLOCK)
    for name in columns:
        if name != CLOCK:
            beside.name(name, name, VARIABLES[name].unit)
    return beside.text()


TABLES: Final[dict[str, Callable[[Flight], tuple[bytes, str]]]] = {
    ".csv": csv_table,
    ".mat": matlab_table,
    ".parquet": parquet_table,
}
