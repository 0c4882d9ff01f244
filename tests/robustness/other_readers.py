"""Logs read by stoop and by independent readers: numbers agree to the bit, but for conventions that are rules here."""

import csv
import gzip
import io
import math
import os
import re
import tomllib
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from pymavlink import DFReader
from pyulog import ULog
from robustness.readers import in_this_process
from robustness.trials import LISTED, READ, promise

from stoop import logs
from stoop.errors import StoopError

DESCRIPTIVE = frozenset({"FMT", "FMTU", "UNIT", "MULT", "PARM", "MSG", "VER"})
EMPTY_CELLS = {
    "", "#N/A", "#N/A N/A", "#NA", "-1.#IND", "-1.#QNAN", "-NaN", "-nan", "1.#IND", "1.#QNAN", "<NA>", "N/A", "NA", "NULL",
    "NaN", "None", "n/a", "nan", "null",
}  # fmt: skip  #: what tables write where there is no number, as pandas documents it
SAME = "same"  #: both read a log, and find the same
Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Samples:
    """Samples of a stream in the order of the file, or not `ordered`: their time (n,) [s] and columns (n,)."""

    time: np.ndarray
    columns: Columns
    ordered: bool = True


def floats(values: Sequence[Any]) -> np.ndarray:
    """Return numbers as Python converts each of them; those beyond float64 are infinite, as in all readers."""

    def one(value: Any) -> float:
        try:
            return float(value)
        except OverflowError:
            return math.copysign(math.inf, value)

    return np.array([one(value) for value in values], dtype=np.float64)


def plain(name: str) -> str:
    """Return a name as it is compared: stoop makes blanks of control characters, and pyulog ends fields at a blank."""
    return re.sub(r" [^.\[]*", "", "".join(c if c.isprintable() else " " for c in name).strip())


def by_plain_name(columns: Columns) -> dict[str, np.ndarray]:
    """Return columns by the names by which they are compared, without those of which two are then alike."""
    names = [plain(name) for name in columns]
    return {name: x for name, x in zip(names, columns.values(), strict=True) if names.count(name) == 1}


def joined(parts: Mapping[str, list[Samples]]) -> dict[str, Samples]:
    found = {}
    for stream, (first, *more) in parts.items():
        every = (first, *more)
        names = set.intersection(*(set(part.columns) for part in every))
        columns = {name: np.concatenate([part.columns[name] for part in every]) for name in names}
        time = np.concatenate([part.time for part in every])
        found[stream] = Samples(time, columns, first.ordered and not more)
    return found


def by_pyulog(path: Path, _: Path | None) -> dict[str, Samples]:
    """Padding is no column, and one instance in two subscriptions is one stream."""
    parts: dict[str, list[Samples]] = {}
    for data in ULog(str(path)).data_list:
        if "timestamp" in data.data:  # a stream of stoop has a time
            # NumPy names what has no name by its place
            nameless = {f"f{k}" for k, field in enumerate(data.field_data) if not field.field_name}
            columns = {
                "" if key in nameless else key: floats(values.tolist())
                for key, values in data.data.items()
                if key != "timestamp" and not key.rpartition(".")[2].startswith("_padding")
            }
            time = floats((data.data["timestamp"] * 1e-6).tolist())
            name = f"{data.name}/{data.multi_id}" if data.multi_id else data.name
            parts.setdefault(plain(name), []).append(Samples(time, by_plain_name(columns)))
    return joined(parts)


def by_pymavlink(path: Path, _: Path | None) -> dict[str, Samples]:
    is_text = path.suffix == ".log"
    rows: dict[tuple[str, str], list[list[float]]] = {}
    split: set[str] = set()
    with (
        mock.patch.dict(os.environ, {"PYMAVLINK_FAST_INDEX": "0"}),  # plain Python
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
            if is_text and any("," in cell for cell in message._elements[:-1]):
                split.add(stream)  # a comma ends a cell; for pymavlink, one with a blank
                continue
            cells = [_cell(message, *one, is_text) for one in zip(kind.columns, kind.msg_fmts, strict=True)]
            rows.setdefault((stream, f"{kind.format} {names}"), []).append([x for c in cells for x in c])
    parts: dict[str, list[Samples]] = {}
    for (stream, layout), table in rows.items():
        kinds, _, names = layout.partition(" ")
        labels: list[str] = []
        for letter, name in zip(kinds, (n.strip() for n in names.split(",")), strict=True):
            several = [f"{name}[{i}]" for i in range(32)] if letter == "a" else [name]
            labels += [] if letter in "nNZ" else several
        block = dict(zip(labels, np.array(table, dtype=np.float64).T, strict=True))
        time = 1e-6 * block.pop("TimeUS")
        samples = Samples(time, by_plain_name(block), stream not in split)
        parts.setdefault(plain(stream), []).append(samples)
    return joined(parts)


def _instance(message: Any, place: int, is_text: bool) -> str:
    """Return what the name of an instance ends in: the number as it is stored, not scaled, or a text; nothing of the first."""
    letter, value = message.fmt.msg_fmts[place], message._elements[place]
    if letter in "nNZ":
        text = message.__getattr__(message.fmt.columns[place])
        return f"/{text}" if text else ""
    number = float(value) if is_text else value % 256 if letter == "M" else value
    return f"/{float(number):g}" if number else ""


def _cell(message: Any, column: str, letter: str, is_text: bool) -> list[float]:
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


def by_csv(path: Path, mapping: Path | None) -> dict[str, Samples]:
    """Read a table by Python's csv module and `float`; a cell that is empty or holds no number is NaN."""
    raw = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    lines = raw.decode("utf-8-sig")
    lines = lines[: lines.rfind("\n") + 1] or lines  # a last line without an end is perhaps cut
    head, *cells = csv.reader(io.StringIO(lines, newline=""), strict=True)
    full = [row for row in cells if row]
    if any(len(row) > len(full[0]) for row in full):  # stoop refuses a table whose lines grow
        raise ValueError("more cells than columns")
    columns: dict[str, np.ndarray] = {}
    for k, name in enumerate(head):
        values = np.array([_number(row[k]) if k < len(row) else math.nan for row in full])
        columns.setdefault(name.strip(), values)
    clock = tomllib.loads(mapping.read_text())["time"]["column"] if mapping else head[0].strip()
    return {path.name: Samples(columns[clock], by_plain_name(columns))}


def _number(cell: str) -> float:
    """Return the number in a cell: ASCII digits without marks between them, as other readers of tables have it."""
    cell = cell.strip(" \t")
    odd = cell in EMPTY_CELLS or "_" in cell or not (cell.isascii() and cell.isprintable())
    try:
        return math.nan if odd else float(cell)
    except ValueError:
        return math.nan


READERS = {"ulog": by_pyulog, "dataflash": by_pymavlink, "dataflash-text": by_pymavlink, "csv": by_csv}


def compare(name: str, path: Path, mapping: Path | None) -> str:
    """Read a log twice and compare; return the outcome. Numbers that differ, or are lost and not listed, are a broken promise."""
    theirs: dict[str, Samples] | None = None
    with suppress(Exception), warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        theirs = READERS[name](path, mapping)
    try:
        with in_this_process():
            ours = logs.read(path, mapping)
    except StoopError as error:
        there = any(x.columns and longest_run(x.time) > 1 for x in (theirs or {}).values())
        promise(" (" in str(error) or not there, f"refused, and the other reads: {error}")
        raise
    if theirs is None:
        return READ
    known = {plain(key): (stream.time, by_plain_name(stream.columns)) for key, stream in ours.streams.items()}
    for key, other in theirs.items():
        about = [d for d in ours.defects if plain(d.place) == key or d.place.startswith(path.name)]
        if key in known and other.columns:  # texts make no stream
            compare_samples(key, *known[key], other, about)
        else:
            lost = np.isfinite(other.time).any() and other.columns and not about
            promise(not lost, f"the stream {key!r} is lost")
    return LISTED if ours.defects else SAME


def same(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray((a.view(np.int64) == b.view(np.int64)) | (np.isnan(a) & np.isnan(b)))


def compare_samples(name: str, time: np.ndarray, columns: Columns, other: Samples, about: Any) -> None:
    """Compare samples one by one where both readers have all, else at the times that occur once in both."""
    lost = set(other.columns) - set(columns)
    promise(about or not lost, f"{name} has lost the columns {sorted(lost)[:5]}")
    if other.ordered and time.size == other.time.size and same(time, other.time).all():
        here = there = np.arange(time.size)
    else:
        _, first, counts = np.unique(other.time, return_index=True, return_counts=True)
        alone = first[counts == 1]
        _, here, there = np.intersect1d(time, other.time[alone], return_indices=True)
        there, kinds = alone[there], {defect.kind for defect in about}
        kept = (np.isin(other.time, time) | ~np.isfinite(other.time)).all()
        promise(kinds or kept, f"{name} has lost samples: {time.size} of {other.time.size}")
        if kinds == {"time order"} and other.ordered:  # stoop had all samples, and kept as many as can be
            texts = (re.search(r"of (\d+) samples dropped", d.message) for d in about)
            had, most = next(int(match[1]) for match in texts if match), longest_run(other.time)
            whole = had > other.time.size or (had == other.time.size and time.size == most)
            promise(whole, f"{name} has {time.size} samples of {had}, not {most} of {other.time.size}")
        if len(kinds) > 1 and "time order" in kinds:
            return  # of samples at one time, of which some are damaged, each reader may keep another
    damages = sum(defect.kind not in ("time order", "text") for defect in about)
    for key in columns.keys() & other.columns.keys():
        wrong = np.flatnonzero(~same(columns[key][here], other.columns[key][there]))
        promise(wrong.size <= damages, f"{name} {key} is not the same, samples {wrong[:9]}")


def longest_run(time: np.ndarray) -> int:
    """Return the size of a longest run of finite times that grows: by each, the longest that ends in it."""
    finite = time[np.isfinite(time)]
    best = np.zeros(finite.size, dtype=np.int64)
    for i, value in enumerate(finite):
        best[i] = 1 + best[:i][finite[:i] < value].max(initial=0)
    return int(best.max(initial=0))
