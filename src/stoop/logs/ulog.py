"""PX4 .ulg files through pyulog, whose prints, global state and trust in the file are contained here."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np

from stoop.errors import LogError
from stoop.logs.recording import Defect, Recording, Stream, clean_stream
from stoop.units import MICROSECOND

MAGIC: Final = b"ULog\x01\x12\x35"
MAX_BYTES: Final = 2**30
MAX_FIELDS: Final = 200_000  #: columns of all topics together; a real log has some thousands
MAX_NESTING: Final = 16
_REREADING: Final = (
    16  #: times the size of the file that may be read while searching for the next good message
)


class _EndlessError(Exception):
    """The parser goes round in circles in a damaged file."""


class _BoundedFile:
    """A file that ends the search of a parser that no longer advances, and remembers a cut end."""

    def __init__(self, file: BinaryIO, size: int) -> None:
        self._file = file
        self._left = _REREADING * size + 2**20
        self.cut = False

    def read(self, size: int = -1) -> bytes:
        self._left -= max(size, 0) + 1
        if self._left < 0:
            raise _EndlessError
        data = self._file.read(size)
        self.cut = len(data) < size and not (size == 3 and not data)  # messages begin with 3 bytes
        return data

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def close(self) -> None:
        self._file.close()


def read_ulog(path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a .ulg file.

    Raises
    ------
    LogError
        When it is no ULog file, or so damaged that no topic can be read.
    """
    size = _check_head(path)
    parsed, cut = _parse(path, size)
    streams: dict[str, Stream] = {}
    defects = _file_defects(path, parsed, cut)
    for data in parsed.data_list:
        name = f"{data.name}/{data.multi_id}" if data.multi_id else str(data.name)
        stream, found = _stream(name, data.data)
        defects.extend(found)
        if stream is not None:
            streams[name] = stream
    if not streams:
        raise LogError(f"{path}: no topic holds data; the log was cut before the first sample, record again")
    return Recording(path, "ulog", streams, tuple(defects))


def _check_head(path: Path) -> int:
    try:
        with path.open("rb") as file:
            head = file.read(len(MAGIC))
        size = path.stat().st_size
    except OSError as error:
        raise LogError(
            f"{path}: cannot be read ({error.strerror}); check the name and its permissions"
        ) from None
    if not size:
        raise LogError(f"{path}: the log is empty; copy it again from the autopilot")
    if head != MAGIC:
        raise LogError(
            f"{path}: not a ULog file, its first bytes are wrong; copy it again from the autopilot"
        )
    if size > MAX_BYTES:
        raise LogError(f"{path}: larger than {MAX_BYTES >> 20} MiB; cut the log to the flight of interest")
    return size


def _parse(path: Path, size: int) -> tuple[Any, bool]:
    """Let pyulog parse; it meets damage by any of a dozen exceptions, all of which mean the same."""
    from pyulog import ULog  # heavy, and only here

    strings = ULog._disable_str_exceptions
    try:
        with path.open("rb") as file, contextlib.redirect_stdout(io.StringIO()):
            bounded = _BoundedFile(file, size)
            return _bounded_parser(ULog)(bounded), bounded.cut
    except _EndlessError:
        raise LogError(f"{path}: damaged beyond reading; copy it again from the autopilot") from None
    except Exception as error:
        what = " ".join(str(error).split())[:120] or type(error).__name__
        raise LogError(f"{path}: damaged ULog file ({what}); copy it again from the autopilot") from None
    finally:
        ULog._disable_str_exceptions = strings


def _bounded_parser(parser: Any) -> Any:
    """Return pyulog's parser with a limit on what a few bytes of format can unfold to."""
    fields = 0

    class Subscription(parser._MessageAddLogged):  # type: ignore[misc]
        def _parse_nested_type(self, prefix: str, type_name: str, formats: dict[str, Any]) -> None:
            nonlocal fields
            fields += sum(max(size, 1) for _, size, _ in formats[type_name].fields)
            if fields > MAX_FIELDS or prefix.count(".") > MAX_NESTING:
                raise ValueError("format unfolds without end")
            super()._parse_nested_type(prefix, type_name, formats)

    return type("BoundedULog", (parser,), {"_MessageAddLogged": Subscription})


def _file_defects(path: Path, parsed: Any, cut: bool) -> list[Defect]:
    defects = []
    if parsed.file_corruption:
        defects.append(Defect("corrupt", path.name, "damaged messages were skipped"))
    elif cut:
        defects.append(Defect("truncated", path.name, "the last message is cut; read what is left"))
    if parsed.dropouts:
        lost = 1e-3 * sum(float(d.duration) for d in parsed.dropouts)
        message = f"the logger reports {len(parsed.dropouts)} dropouts, {lost:.2f} s in all"
        defects.append(Defect("dropout", path.name, message))
    return defects


def _stream(name: str, data: dict[str, Any]) -> tuple[Stream | None, tuple[Defect, ...]]:
    columns = {key: values for key, values in data.items() if not key.startswith("_padding")}
    stamp = columns.pop("timestamp", None)
    if stamp is None:
        return None, (Defect("skipped", name, "no field 'timestamp'"),)
    stream, defects = clean_stream(name, np.asarray(stamp, dtype=np.float64) * MICROSECOND, columns)
    return (stream if stream.time.size else None), defects
