"""Text tables: bounded reading of plain or gzipped CSV into named columns of numbers."""

from __future__ import annotations

import io
import os
import zlib
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import LogError
from stoop.logs.recording import Defect, unreadable
from stoop.logs.tabular import most_values

if TYPE_CHECKING:
    import pandas as pd

MAX_BYTES: Final = 256 * 2**20  #: text of one file, unpacked; a fast topic of an hour takes 100 MiB
MAX_ROWS: Final = 5_000_000  #: three hours at 400 Hz
MAX_HEADER: Final = 2**20  #: bytes of the first line
MAX_COLUMNS: Final = 4096
_CHUNK: Final = 2**20


def read_table(path: Path) -> tuple[dict[str, FloatArray], tuple[Defect, ...]]:
    """Read a CSV file with one header line, plain or gzipped.

    Parameters
    ----------
    path : the file; its name ends in .csv or .csv.gz

    Returns
    -------
    columns : name -> (n,) numbers; cells that hold no number are NaN
    defects : a cut end, a broken archive, cells that hold no number

    Raises
    ------
    LogError
        When there is no header, no line of numbers, or more text than `MAX_BYTES`.
    """
    text, defects = _unpack(path)
    text, cut = _drop_cut_line(path, text)
    header = _header(path, text)
    if text.count(b"\n") > MAX_ROWS:
        raise LogError(f"{path}: more than {MAX_ROWS} lines; cut the log to the flight of interest")
    if len(header) * text.count(b"\n") > most_values(path):
        raise LogError(f"{path}: more than {most_values(path)} numbers, for a file that short; damaged?")
    table = _parse(path, text)
    columns, texts = _numbers(path, table, header)
    return columns, (*defects, *cut, *texts)


def read_header(path: Path) -> list[str]:
    """Return the names of the columns of a CSV file, plain or gzipped."""
    return _header(path, _unpack(path)[0])


def _unpack(path: Path) -> tuple[bytes, tuple[Defect, ...]]:
    try:
        with path.open("rb") as file:
            if path.suffix == ".gz":
                return _gunzip(path, file)
            size = min(MAX_BYTES, os.fstat(file.fileno()).st_size)
            return _bounded(path, file.read(size + 1)), ()
    except OSError as error:
        raise unreadable(path, error) from None


def _bounded(path: Path, text: bytes) -> bytes:
    if len(text) > MAX_BYTES:
        raise LogError(
            f"{path}: more than {MAX_BYTES >> 20} MiB of text; cut the log to the flight of interest"
        )
    return text


def _gunzip(path: Path, file: IO[bytes]) -> tuple[bytes, tuple[Defect, ...]]:
    """Unpack by hand so that a cut or damaged archive yields what it still holds."""
    stream = zlib.decompressobj(wbits=31)
    text = bytearray()
    try:
        while packed := file.read(_CHUNK):
            while packed and len(text) <= MAX_BYTES:
                text += stream.decompress(packed, MAX_BYTES + 1 - len(text))
                packed = stream.unconsumed_tail or _next_member(stream)
                if stream.eof and packed:
                    stream = zlib.decompressobj(wbits=31)
    except zlib.error:
        return _bounded(path, bytes(text)), (
            Defect("corrupt", path.name, "damaged archive; read up to the damage"),
        )
    if not stream.eof:
        return _bounded(path, bytes(text)), (
            Defect("truncated", path.name, "the archive is cut; read what is left"),
        )
    return _bounded(path, bytes(text)), ()


def _next_member(stream: zlib._Decompress) -> bytes:
    """Bytes after the end of one gzip member: the next member, or padding with zeros."""
    return stream.unused_data.lstrip(b"\0") if stream.eof else b""


def _drop_cut_line(path: Path, text: bytes) -> tuple[bytes, tuple[Defect, ...]]:
    """Drop a last line without an end: whether its last number is whole cannot be told."""
    end = text.rfind(b"\n") + 1
    if end == len(text) or end == 0:
        return text, ()
    return text[:end], (
        Defect("truncated", path.name, "the last line has no end, is perhaps cut, and was dropped"),
    )


def _header(path: Path, text: bytes) -> list[str]:
    line = text[: MAX_HEADER + 1].split(b"\n", 1)[0].rstrip(b"\r")
    if not text.strip():
        raise LogError(f"{path}: the log is empty; record again or name another file")
    names = line.split(b",")
    if len(line) > MAX_HEADER or len(names) > MAX_COLUMNS:
        raise LogError(
            f"{path}: the header has more than {MAX_COLUMNS} columns; is this a comma-separated table?"
        )
    try:
        return [name.decode("utf-8-sig").strip().strip('"') for name in names]
    except UnicodeDecodeError:
        raise LogError(f"{path}: not a text table; name a CSV file with one header line") from None


def _parse(path: Path, text: bytes) -> pd.DataFrame:
    import pandas as pd  # heavy, and only here

    try:
        table = pd.read_csv(
            io.BytesIO(text), skiprows=1, header=None, on_bad_lines="error",
            skip_blank_lines=True, low_memory=False, index_col=False, engine="c",
        )  # fmt: skip
    except pd.errors.EmptyDataError:
        raise LogError(
            f"{path}: not a table of numbers, nothing stands below its header; record again or name another file"
        ) from None
    except (ValueError, OverflowError, MemoryError) as error:  # pandas.errors derive from ValueError
        raise LogError(
            f"{path}: not a table of numbers ({_one_line(error)}); mend or replace the file"
        ) from None
    return table


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__


def _numbers(
    path: Path, table: pd.DataFrame, header: list[str]
) -> tuple[dict[str, FloatArray], tuple[Defect, ...]]:
    import pandas as pd

    columns: dict[str, FloatArray] = {}
    defects: list[Defect] = []
    for name, label in zip(header, table.columns, strict=False):
        series = table[label]
        if series.dtype.kind not in "iufb":
            numbers = pd.to_numeric(series, errors="coerce")
            lost = int(numbers.isna().sum() - series.isna().sum())
            defects.append(
                Defect("text", f"{path.name} {name}", f"{lost} of {len(series)} cells hold no number")
            )
            series = numbers
        columns.setdefault(name, np.asarray(series, dtype=np.float64))
    return columns, tuple(defects)
