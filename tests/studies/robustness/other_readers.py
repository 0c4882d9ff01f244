"""What independent readers find in a log: pyulog, pymavlink, Python's csv module, SciPy and h5py.

Each difference of convention to stoop's own readers is a small rule here, with its reason; nothing else is made alike.
"""

from __future__ import annotations

import csv
import gzip
import io
import math
import os
import re
import signal
import tomllib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from unittest import mock

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray

SECONDS: Final = 0.15  #: of processor time that another reader may take
DESCRIPTIVE: Final = frozenset({"FMT", "FMTU", "UNIT", "MULT", "PARM", "MSG", "VER"})
DIVISORS: Final = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}  #: of [ArduPilot's] letters
EMPTY_CELLS: Final = frozenset(
    (
        "", "#N/A", "#N/A N/A", "#NA", "-1.#IND", "-1.#QNAN", "-NaN", "-nan", "1.#IND", "1.#QNAN", "<NA>", "N/A", "NA", "NULL",
        "NaN", "None", "n/a", "nan", "null",
    )
)  # fmt: skip  #: what tables write where there is no number, as pandas documents it


class TooSlowError(BaseException):
    """Another reader takes too long; no `Exception`, which the readers catch."""


@dataclass(frozen=True)
class Samples:
    """Samples of a stream in the order of the file, or not `ordered`: their time (n,) [s] and columns (n,)."""

    time: FloatArray
    columns: Mapping[str, FloatArray]
    ordered: bool = True


@dataclass(frozen=True)
class Found:
    """What another reader finds: streams of samples, or named arrays of numbers, each in every form that it may be read in."""

    streams: Mapping[str, Samples] = field(default_factory=dict)
    arrays: Mapping[str, FloatArray] = field(default_factory=dict)


@contextmanager
def limited() -> Iterator[None]:
    """Give others' code some time of the processor, again and again where it goes on; its warnings are its own."""

    def stop(*_: object) -> None:
        raise TooSlowError

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS, 0.1)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)


def floats(values: Sequence[Any]) -> FloatArray:
    """Return numbers as Python converts each of them; those beyond float64 are infinite, as in all readers."""

    def one(value: Any) -> float:
        try:
            return float(value)
        except OverflowError:
            return math.copysign(math.inf, value)

    return np.array([one(value) for value in values], dtype=np.float64)


def plain(name: str) -> str:
    """Return a name as it is compared.

    Stoop makes blanks of control characters, and pyulog ends names of fields at a blank.
    """
    return re.sub(r" [^.\[]*", "", "".join(c if c.isprintable() else " " for c in name).strip())


def by_plain_name(columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return columns by the names by which they are compared, without those of which two are then alike."""
    names = [plain(name) for name in columns]
    return {
        name: values for name, values in zip(names, columns.values(), strict=True) if names.count(name) == 1
    }


def ulog(path: Path, mapping: Path | None) -> Found:
    """Read a ULog by pyulog; padding is no column, and one instance in two subscriptions is one stream."""
    from pyulog import ULog

    merged: dict[str, list[Samples]] = {}
    for data in ULog(str(path)).data_list:
        name = f"{data.name}/{data.multi_id}" if data.multi_id else data.name
        if "timestamp" in data.data:  # a stream of stoop has a time
            time = data.data["timestamp"] * 1e-6
            # NumPy names what has no name by its place
            nameless = {f"f{k}" for k, field in enumerate(data.field_data) if not field.field_name}
            columns = {
                "" if key in nameless else key: floats(values.tolist())
                for key, values in data.data.items()
                if key != "timestamp" and not key.rpartition(".")[2].startswith("_padding")
            }
            merged.setdefault(plain(name), []).append(Samples(floats(time.tolist()), by_plain_name(columns)))
    return Found({name: _joined(parts) for name, parts in merged.items()})


def _joined(parts: Sequence[Samples]) -> Samples:
    """Return several parts of a stream as one."""
    if len(parts) == 1:
        return parts[0]
    names = set.intersection(*(set(part.columns) for part in parts))
    columns = {name: np.concatenate([part.columns[name] for part in parts]) for name in names}
    return Samples(np.concatenate([part.time for part in parts]), columns, ordered=False)


def dataflash(path: Path, mapping: Path | None) -> Found:
    """Read a DataFlash log, binary or text, by pymavlink; kinds that describe the log are no streams."""
    from pymavlink import DFReader

    is_text = path.suffix == ".log"
    rows: dict[tuple[str, str], list[list[float]]] = {}
    split: set[str] = set()
    with (
        mock.patch.dict(os.environ, {"PYMAVLINK_FAST_INDEX": "0"}),  # plain Python, which can be stopped
        (DFReader.DFReader_text if is_text else DFReader.DFReader_binary)(str(path), True) as reader,
    ):
        while (message := reader.recv_msg()) is not None:
            kind = message.fmt
            # bytes that are no UTF-8 are Latin, as pymavlink reads texts, not names
            names = re.sub(r"\\x([0-9a-f]{2})", lambda byte: chr(int(byte[1], 16)), ",".join(kind.columns))
            invalid = len(kind.columns) != len(kind.msg_fmts)  # as where a name holds a comma
            if invalid or kind.name in DESCRIPTIVE or "TimeUS" not in kind.columns:
                continue
            stream = kind.name
            if kind.instance_field:
                stream += _instance(message, kind.colhash[kind.instance_field], is_text)
            columns = zip(kind.columns, kind.msg_fmts, strict=True)
            cells = [_cell(message, *column, is_text) for column in columns]
            key = stream, f"{kind.format} {names}"
            if is_text and any("," in cell for cell in message._elements[:-1]):
                split.add(stream)  # a comma ends a cell; for pymavlink, one with a blank
                continue
            rows.setdefault(key, []).append([x for cell in cells for x in cell])
    merged: dict[str, list[Samples]] = {}
    for (stream, layout), table in rows.items():
        kinds, _, names = layout.partition(" ")
        labels = [
            label
            for letter, name in zip(kinds, names.split(","), strict=True)
            for label in _labels(letter, name)
        ]
        block = dict(zip(labels, np.array(table, dtype=np.float64).T, strict=True))
        time = 1e-6 * block.pop("TimeUS")
        samples = Samples(time, by_plain_name(block), ordered=stream not in split)
        merged.setdefault(plain(stream), []).append(samples)
    return Found({name: _joined(parts) for name, parts in merged.items()})


def _instance(message: Any, place: int, is_text: bool) -> str:
    """Return what the name of an instance ends in: the number as it is stored, not scaled, or a text; nothing of the first."""
    letter, value = message.fmt.msg_fmts[place], message._elements[place]
    if letter in "nNZ":
        text = message.__getattr__(message.fmt.columns[place])
        return f"/{text}" if text else ""
    number = float(value) if is_text else value % 256 if letter == "M" else value
    return f"/{float(number):g}" if number else ""


def _labels(letter: str, name: str) -> list[str]:
    """Return the names of the numbers of a column: none of a text, 32 of an array."""
    return (
        []
        if letter in "nNZ"
        else [f"{name.strip()}[{i}]" for i in range(32)]
        if letter == "a"
        else [name.strip()]
    )


def _cell(message: Any, column: str, letter: str, is_text: bool) -> list[float]:
    """Return the numbers of a cell; what pymavlink cannot convert is NaN."""
    if letter in "nNZ":
        return []
    try:
        if is_text:  # whole numbers too are read as float
            return [_number(message._elements[message.fmt.colhash[column]])]
        value = message.__getattr__(column)
    except (ValueError, IndexError, TypeError):
        return [math.nan] * (32 if letter == "a" else 1)
    if letter == "a":
        return [float(x) for x in value]
    # ArduPilot's M is a uint8_t, which pymavlink takes for a signed one
    return [float(value % 256 if letter == "M" else value)]


def table(path: Path, mapping: Path | None) -> Found:
    """Read a table by Python's csv module and `float`; a cell that is empty or holds no number is NaN."""
    raw = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    lines = raw.decode("utf-8-sig")
    end = lines.rfind("\n") + 1
    if 0 < end < len(lines):  # a last line without an end is perhaps cut, and is dropped
        lines = lines[:end]
    head, *cells = csv.reader(io.StringIO(lines, newline=""), strict=True)
    names = [name.strip() for name in head]
    full = [row for row in cells if row]
    if any(len(row) > len(full[0]) for row in full):  # stoop refuses a table whose lines grow
        raise ValueError("more cells than columns")
    columns: dict[str, FloatArray] = {}
    for k, name in enumerate(names):
        columns.setdefault(name, np.array([_number(row[k]) if k < len(row) else math.nan for row in full]))
    clock = tomllib.loads(mapping.read_text())["time"]["column"] if mapping else names[0]
    return Found({path.name: Samples(columns[clock], by_plain_name(columns))})


def _number(cell: str) -> float:
    """Return the number in a cell: ASCII digits without marks between them, as other readers of tables have it."""
    cell = cell.strip(" \t")
    try:
        return (
            math.nan
            if cell in EMPTY_CELLS or "_" in cell or not (cell.isascii() and cell.isprintable())
            else float(cell)
        )
    except ValueError:
        return math.nan


def _unpacked(values: npt.NDArray[Any], fill: Any, missing: Any, scale: Any, offset: Any) -> FloatArray:
    """Return the numbers behind packed ones, one after the other: conventions CF, section 8.1."""
    absent = [np.asarray(x).flat[0] for x in (fill, missing) if x is not None]
    factor, shift = (
        default if x is None else float(np.asarray(x).flat[0]) for x, default in ((scale, 1.0), (offset, 0.0))
    )
    packed = any(x is not None for x in (fill, missing, scale, offset))
    numbers = floats(values.ravel().tolist())
    if packed:
        gone = [any(bool(x == no) for no in absent) for x in values.ravel()]
        numbers = np.array(
            [math.nan if no else x * factor + shift for x, no in zip(numbers.tolist(), gone, strict=True)]
        )
    return numbers.reshape(values.shape)


_PACKING: Final = ("_FillValue", "missing_value", "scale_factor", "add_offset")


def netcdf(path: Path, mapping: Path | None) -> Found:
    """Read a netCDF 3 file by SciPy."""
    from scipy.io import netcdf_file

    with netcdf_file(str(path), mmap=False) as file:
        return Found(
            arrays={
                name: _unpacked(
                    np.array(variable.data), *(vars(variable)["_attributes"].get(key) for key in _PACKING)
                )
                for name, variable in file.variables.items()
                if np.asarray(variable.data).dtype.kind in "biuf"
            }
        )


def hdf5(path: Path, mapping: Path | None) -> Found:
    """Read an HDF5 file by h5py, each array once."""
    import h5py

    arrays: dict[str, FloatArray] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "biuf" and item.shape is not None:
            values = np.asarray(item[()])
            arrays[name.replace("/", ".")] = _unpacked(values, *(item.attrs.get(key) for key in _PACKING))

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return Found(arrays=arrays)


READERS = {
    "ulog": ulog, "dataflash": dataflash, "dataflash-text": dataflash, "csv": table, "hdf5": hdf5, "netcdf": netcdf,
}  # fmt: skip  #: format -> reader
