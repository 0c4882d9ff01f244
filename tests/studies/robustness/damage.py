"""Damage to the pieces of a log (messages, lines, records) and to compressed content, as Hypothesis strategies.

Compressed content is damaged unpacked, and packed again with sizes and checksums that fit, so that the reader meets the
damage and not the checksum before it.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

from hypothesis import strategies as st

MAX_BYTES = 2**17  #: of a damaged file
EXTREMES = (
    0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**53, 2**63, 2**64 - 1,
)  # fmt: skip
ODD_WORDS = (
    b"", b"nan", b"-inf", b"1e309", b"-1e308", b"1e-320", b"0x10", b"9" * 25, b"-1", b"0", b"true", b'"', b"[", b"{",
    b"\\u0000", b"\xff\xfe", b"\xc3\xa9", b",", b"\0", b"\r", b"1_0", b"1979-05-27", b"a" * 300, b"#", b"=",
)  # fmt: skip
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e-?\d+)?")


def ulog_marks(data: bytes) -> list[int]:
    """Return where the messages of a ULog begin."""
    found, at = [], 16
    while at + 3 <= len(data):
        found.append(at)
        at += 3 + struct.unpack_from("<H", data, at)[0]
    return found


def parquet_marks(data: bytes) -> list[int]:
    """Return pieces of 64 bytes of the pages, and of eight of the footer, which describes all else."""
    size = int.from_bytes(data[-8:-4], "little") if len(data) > 12 else 0
    begin = max(4, len(data) - 8 - size)
    return [*range(0, min(begin, len(data)), 64), *range(begin, len(data), 8)]


def found(pattern: bytes) -> Callable[[bytes], list[int]]:
    """Return a function that finds the places of a pattern."""
    expression = re.compile(pattern)
    return lambda data: [match.start() for match in expression.finditer(data)]


def each(size: int) -> Callable[[bytes], list[int]]:
    """Return a function that marks pieces of one size."""
    return lambda data: list(range(0, len(data), size))


def hdf5_marks(data: bytes) -> list[int]:
    """Return the marks of HDF5, and halves of a kilobyte."""
    marks = re.finditer(rb"TREE|SNOD|HEAP|OHDR|OCHK|FRHP|BTHD|FSHD|GCOL", data)
    return sorted({*(mark.start() for mark in marks), *range(0, len(data), 512)})


def open_matlab(data: bytes) -> bytes:
    """Unpack every variable of a .mat file of version 5; the file is then one of plain variables."""
    out, at = data[:128], 128
    while at + 8 <= len(data):
        kind, size = struct.unpack_from("<II", data, at)
        body = data[at + 8 : at + 8 + size]
        out += zlib.decompress(body) if kind == 15 else data[at : at + 8 + size]
        at += 8 + size
    return out


def close_matlab(data: bytes) -> bytes:
    """Pack all that follows the head as one variable."""
    body = zlib.compress(data[128:], 1)
    return data[:128] + struct.pack("<II", 15, len(body)) + body


@dataclass(frozen=True)
class Form:
    """How a log is built: where its pieces begin, the bytes that identify it, and how it is unpacked and packed again."""

    marks: Callable[[bytes], list[int]]
    head: int
    open: Callable[[bytes], bytes] = bytes
    close: Callable[[bytes], bytes] = bytes


FORMS = {
    "ulog": Form(ulog_marks, 7),
    "dataflash": Form(found(rb"\xa3\x95"), 3),
    "lines": Form(found(rb"(?m)^"), 4),
    "gzip": Form(
        found(rb"(?m)^"), 3, lambda data: zlib.decompress(data, 31), lambda data: zlib.compress(data, 1, 31)
    ),
    "crazyflie": Form(
        found(rb"(?<=\0)."), 3, close=lambda data: data[:-4] + struct.pack("<I", zlib.crc32(data[:-4]))
    ),
    "blackbox": Form(found(rb"(?<=\n)H |[IPGSE]"), 18),
    "matlab": Form(each(8), 128, open_matlab, close_matlab),
    "hdf5": Form(hdf5_marks, 8),
    "parquet": Form(parquet_marks, 4),
    "words": Form(each(8), 13),
    "pages": Form(each(512), 16),
}  #: name -> form


class Damager:
    """Ways to damage content of a form, perhaps with pieces of other content of that form."""

    def __init__(self, draw, other: bytes, form: Form) -> None:
        self.draw, self.other, self.form = draw, other, form

    def one(self, *options):
        """Draw one of some."""
        return self.draw(st.sampled_from(options))

    def upto(self, most: int) -> int:
        """Draw a number from zero to ``most``."""
        return self.draw(st.integers(0, max(most, 0)))

    def span(self, data: bytes) -> tuple[int, int]:
        """Draw a piece: its first byte, and the first after it."""
        marks = [0, *self.form.marks(data), len(data)]
        at = self.upto(len(marks) - 2)
        return marks[at], max(marks[at + 1], marks[at])

    def place(self, data: bytes) -> int:
        """Draw a place: anywhere, where a piece begins, or one of the first."""
        return self.one(
            self.upto(len(data)), self.span(data)[0], self.upto(min(len(data), 2 * self.form.head + 16))
        )

    def cut(self, data: bytes) -> bytes:
        at = min(self.place(data) + self.upto(2), len(data))
        return self.one(data[:at], data[:at], data[:at], data[at:])

    def flip(self, data: bytes) -> bytes:
        out = bytearray(data)
        for _ in range(self.one(1, 2, 8, 40) if out else 0):
            out[min(self.place(data), len(out) - 1)] ^= 1 << self.upto(7)
        return bytes(out)

    def overwrite(self, data: bytes) -> bytes:
        at, size = self.place(data), self.one(1, 2, 8, 64, 512)
        fill = self.one(self.draw(st.binary(max_size=64)), bytes(size), b"\xff" * size)
        return (data[:at] + fill + data[at + len(fill) :])[: len(data)]

    def blow_up(self, data: bytes) -> bytes:
        out = bytearray(data)
        for _ in range(self.one(1, 1, 2, 5)):
            at, width, order = self.place(data), self.one(1, 2, 4, 8), self.one("little", "big")
            value = self.one(*EXTREMES, len(data), self.upto(255)) & (1 << 8 * width) - 1
            out[at : at + width] = value.to_bytes(width, order)
        return bytes(out)

    def resize(self, data: bytes) -> bytes:
        at = self.span(data)[0] + self.upto(7)
        if at >= len(data):
            return data
        return data[:at] + bytes([(data[at] + self.one(-3, -1, 1, 2, 16)) % 256]) + data[at + 1 :]

    def erase(self, data: bytes) -> bytes:
        begin, end = self.span(data)
        at = self.place(data)
        return self.one(data[:begin] + data[end:], data[:at] + data[at + self.one(1, 3, 16, 100, 1000) :])

    def repeat(self, data: bytes) -> bytes:
        (begin, end), at = self.span(data), self.span(data)[0]
        return data[:at] + data[begin:end] * self.one(1, 2, 50, 1000) + data[at:]

    def swap(self, data: bytes) -> bytes:
        (a, b), (c, d) = sorted((self.span(data), self.span(data)))
        return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:] if b <= c else data

    def splice(self, data: bytes) -> bytes:
        return data[: self.place(data)] + self.other[self.place(self.other) :]

    def shuffle(self, data: bytes) -> bytes:
        marks = self.form.marks(data)
        begin = self.upto(len(marks) - 1)
        some = [*marks[begin : begin + 12], len(data)]
        pieces = [data[a:b] for a, b in pairwise(some)][:-1]
        if not pieces:
            return data
        return data[: some[0]] + b"".join(self.draw(st.permutations(pieces))) + data[some[-2] :]

    def garbage(self, data: bytes) -> bytes:
        return data[: self.form.head] + self.draw(st.binary(max_size=300))

    def words(self, data: bytes) -> bytes:
        matches = list(NUMBER.finditer(data)) or list(re.finditer(rb"\w+", data))
        for match in self.draw(st.lists(st.sampled_from(matches), max_size=3)) if matches else ():
            data = data[: match.start()] + self.one(*ODD_WORDS) + data[match.end() :]
        return data


DAMAGES = (
    Damager.cut, Damager.flip, Damager.overwrite, Damager.blow_up, Damager.resize, Damager.erase, Damager.repeat,
    Damager.swap, Damager.splice, Damager.shuffle, Damager.garbage, Damager.words,
)  # fmt: skip


@st.composite
def damaged(draw, data: bytes, other: bytes, kind: str) -> bytes:
    """Draw damaged content of a form: damaged once or twice, half of the time inside what is packed."""
    form, most = FORMS[kind], max(MAX_BYTES, len(data))
    inside = draw(st.booleans())
    if inside:
        data, other = form.open(data), form.open(other)
    for damage in draw(st.lists(st.sampled_from(DAMAGES), min_size=1, max_size=2)):
        data = damage(Damager(draw, other, form), data)[:most]
    return form.close(data) if inside else data
