"""How the bytes of a log are put together, so that it can be damaged where it hurts: pieces, and what covers them.

A form cuts bytes into pieces (messages, lines, records), opens what is packed, and closes it again with sizes and checksums
that fit: what is wrong inside is then met by the reader, and not by the checksum before it.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

Span = tuple[int, int]  #: first byte, and first after it
ULOG_HEAD: Final = 16
MAT_HEAD: Final = 128
PAGE: Final = 512
MARKS: Final = (b"TREE", b"SNOD", b"HEAP", b"OHDR", b"OCHK", b"FRHP", b"BTHD", b"FSHD", b"GCOL")  #: of HDF5


@dataclass(frozen=True)
class Form:
    """A way to build a log.

    Attributes
    ----------
    spans : callable
        Bytes to the pieces in them.
    head : int
        Bytes by which the file is known for what it is.
    open, close : callable
        Bytes to what is packed in them, and back.
    """

    spans: Callable[[bytes], list[Span]]
    head: int
    open: Callable[[bytes], bytes] = bytes
    close: Callable[[bytes], bytes] = bytes


def lines(data: bytes) -> list[Span]:
    """Return the lines of a text."""
    found, at = [], 0
    while at < len(data):
        end = data.find(b"\n", at) + 1 or len(data)
        found.append((at, end))
        at = end
    return found


def equal(data: bytes, size: int) -> list[Span]:
    """Return pieces of one size."""
    return [(at, min(at + size, len(data))) for at in range(0, len(data), size)]


def ulog_messages(data: bytes) -> list[Span]:
    """Return the messages of a ULog."""
    found, at = [], ULOG_HEAD
    while at + 3 <= len(data):
        end = at + 3 + struct.unpack_from("<H", data, at)[0]
        found.append((at, min(end, len(data))))
        at = end
    return found


def dataflash_messages(data: bytes) -> list[Span]:
    """Return the messages of a DataFlash log, as far as marks tell."""
    marks = []
    at = data.find(b"\xa3\x95")
    while at >= 0:
        marks.append(at)
        at = data.find(b"\xa3\x95", at + 2)
    return list(zip(marks, [*marks[1:], len(data)], strict=True))


def crazyflie_events(data: bytes) -> list[Span]:
    """Return the zero-ended texts of the head, and behind them pieces of eight bytes."""
    texts, at = [], 5
    while 0 <= data.find(b"\0", at) < min(at + 40, len(data)):
        end = data.find(b"\0", at) + 1
        texts.append((at, end))
        at = end
    return [*texts, *((a + at, b + at) for a, b in equal(data[at:], 8))]


def hdf5_blocks(data: bytes) -> list[Span]:
    """Return the pieces between the marks of HDF5, those without one in halves of a kilobyte."""
    marks = sorted({0, *(at for mark in MARKS for at in _places(data, mark)), *range(0, len(data), PAGE)})
    return list(zip(marks, [*marks[1:], len(data)], strict=True))


def _places(data: bytes, mark: bytes) -> list[int]:
    found, at = [], data.find(mark)
    while at >= 0:
        found.append(at)
        at = data.find(mark, at + 1)
    return found


def parquet_parts(data: bytes) -> list[Span]:
    """Return the footer, in which all is told, in pieces of eight bytes, and the pages before it as a few."""
    size = int.from_bytes(data[-8:-4], "little") if len(data) > 12 else 0
    begin = max(4, len(data) - 8 - size)
    return [*equal(data[:begin], 64), *((a + begin, b + begin) for a, b in equal(data[begin:], 8))]


def _gunzip(data: bytes) -> bytes:
    return zlib.decompress(data, wbits=31)


def _gzip(data: bytes) -> bytes:
    packer = zlib.compressobj(1, wbits=31)
    return packer.compress(data) + packer.flush()


def _unpacked_matlab(data: bytes) -> bytes:
    """Unpack every variable of a .mat file of version 5; the file is then one of plain variables."""
    out, at = data[:MAT_HEAD], MAT_HEAD
    while at + 8 <= len(data):
        kind, size = struct.unpack_from("<II", data, at)
        body = data[at + 8 : at + 8 + size]
        out += zlib.decompress(body) if kind == 15 else data[at : at + 8 + size]
        at += 8 + size
    return out


def _packed_matlab(data: bytes) -> bytes:
    """Pack all that follows the head as one variable."""
    body = zlib.compress(data[MAT_HEAD:], 1)
    return data[:MAT_HEAD] + struct.pack("<II", 15, len(body)) + body


def _sealed(data: bytes) -> bytes:
    """Give a Crazyflie's log its checksum anew."""
    return data[:-4] + struct.pack("<I", zlib.crc32(data[:-4])) if len(data) > 4 else data


def _words(data: bytes) -> list[Span]:
    return equal(data, 8)


def _pages(data: bytes) -> list[Span]:
    return equal(data, PAGE)


FORMS: Final[Mapping[str, Form]] = {
    "ulog": Form(ulog_messages, 7),
    "dataflash": Form(dataflash_messages, 3),
    "lines": Form(lines, 4),
    "gzip": Form(lines, 3, _gunzip, _gzip),
    "crazyflie": Form(crazyflie_events, 3, bytes, _sealed),
    "matlab": Form(_words, MAT_HEAD, _unpacked_matlab, _packed_matlab),
    "hdf5": Form(hdf5_blocks, 8),
    "parquet": Form(parquet_parts, 4),
    "words": Form(_words, 13),
    "pages": Form(_pages, 16),
}
