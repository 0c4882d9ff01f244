"""A flight as a file: stoop's own, the log of an autopilot, or a table, with a mapping beside it where one is needed."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.files import write_bytes_atomic
from stoop.base.variables import EULER, QUATERNION
from stoop.errors import OutputError
from stoop.exporters.autopilot_logs import ardupilot_log, crazyflie_log, px4_log
from stoop.exporters.log_layout import MappingFile
from stoop.flight import VARIABLES, Flight, save
from stoop.logs.csv_tables import mapping_beside

OWN: Final = ".nc"
CLOCK: Final = "t"  #: name of the column of time of a table, s
STRUCTURE: Final = "flight"  #: name of the variable in MATLAB


def check_ending(target: Path) -> None:
    """Refuse a name by which the file could not be read again.

    Raises
    ------
    OutputError
        With the endings that there are.
    """
    if target.suffix.lower() not in ENDINGS:
        raise OutputError(
            f"{target}: no kind of flight file; end its name in {', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}"
        )


def save_flight_as(flight: Flight, target: Path) -> Path | None:
    """Write a flight in the form that the ending of the file names.

    Parameters
    ----------
    flight : whose channels share one clock
    target : ends in one of `ENDINGS`

    Returns
    -------
    Path or None : the mapping that was written beside it

    Raises
    ------
    OutputError
        When it cannot be written.
    """
    check_ending(target)
    if target.suffix.lower() == OWN:
        save(flight, target)
        return None
    content, mapping = WRITERS[target.suffix.lower()](flight)
    place = mapping_beside(target)
    write_bytes_atomic(target, content)
    if mapping:
        write_bytes_atomic(place, mapping.encode())
        return place
    place.unlink(missing_ok=True)
    return None


def csv_table(flight: Flight) -> tuple[bytes, str]:
    """Return a table of text, and the mapping that names its columns."""
    columns, mapping = _table(flight)
    lines, head = io.StringIO(), ",".join(columns)
    np.savetxt(
        lines, np.column_stack([*columns.values()]), fmt="%.9g", delimiter=",", header=head, comments=""
    )
    return lines.getvalue().encode(), mapping


def matlab_table(flight: Flight) -> tuple[bytes, str]:
    """Return a .mat file of version 5 with one structure, and the mapping that names its fields."""
    from scipy.io import savemat

    (columns, mapping), content = _table(flight), io.BytesIO()
    savemat(content, {STRUCTURE: columns}, oned_as="column")  # type: ignore[arg-type]  # it takes any binary file
    return content.getvalue(), mapping


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
    (columns, mapping), content = _table(flight), io.BytesIO()
    parquet.write_table(pa.table(columns), content)
    return content.getvalue(), mapping


def _table(flight: Flight) -> tuple[dict[str, FloatArray], str]:
    """Return time and variables by stoop's names and units, the attitude as angles where there are any; and the mapping."""
    names = [str(name) for name in flight.data.data_vars]
    angles = set(EULER) <= set(names)
    kept = [name for name in names if not (angles and name in QUATERNION)]
    mapping = MappingFile(clock=CLOCK)
    for name in kept:
        mapping.add(name, name, VARIABLES[name].unit)
    return {CLOCK: flight.time, **{name: flight.column(name) for name in kept}}, mapping.text()


TABLES: Final[dict[str, Callable[[Flight], tuple[bytes, str]]]] = {
    ".csv": csv_table,
    ".mat": matlab_table,
    ".parquet": parquet_table,
}
WRITERS: Final[dict[str, Callable[[Flight], tuple[bytes, str]]]] = {
    ".ulg": px4_log,
    ".bin": ardupilot_log,
    ".usd": crazyflie_log,
    **TABLES,
}  #: ending -> log and mapping
ENDINGS: Final = (OWN, *WRITERS)
