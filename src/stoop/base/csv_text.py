"""Tables as text: comma-separated values that are the same bytes wherever they are written."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

Cell = str | int | float | bool | None


def csv_text(head: Sequence[str], rows: Iterable[Sequence[Cell]], newline: str = "\r\n") -> str:
    """Return a table as RFC 4180 text: ten significant digits, nothing for None.

    Parameters
    ----------
    head : sequence of str
        Names of the columns.
    rows : iterable of sequences
        As wide as the head.
    newline : str
        Between rows; CRLF as RFC 4180 has it.

    Raises
    ------
    ValueError
        A row of another width: a mistake of the caller.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator=newline)
    writer.writerow(head)
    for row in rows:
        if len(row) != len(head):
            raise ValueError(f"a row of {len(row)} cells under {len(head)} names")
        writer.writerow([_cell(value) for value in row])
    return out.getvalue()


def _cell(value: Cell) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return format(float(value), ".10g") if isinstance(value, float) else str(value)
