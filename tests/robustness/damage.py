"""Damage to the pieces of a log (messages, lines, records) and, with checksums that fit, to compressed content."""

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


def found(pattern: bytes, every: int = 0) -> Callable[[bytes], list[int]]:
    def marks(data: bytes) -> list[int]:
        pieces = range(0, len(data), every) if every else ()
        return sorted({*(match.start() for match in re.finditer(pattern, data)), *pieces})

    return marks


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
    "ulog": Form(ulog_marks, 7), "dataflash": Form(found(rb"\xa3\x95"), 3), "lines": Form(found(rb"(?m)^"), 4),
    "gzip": Form(found(rb"(?m)^"), 3, lambda data: zlib.decompress(data, 31), lambda data: zlib.compress(data, 1, 31)),
    "crazyflie": Form(found(rb"(?<=\0)."), 3, close=lambda data: data[:-4] + struct.pack("<I", zlib.crc32(data[:-4]))),
    "blackbox": Form(found(rb"(?<=\n)H |[IPGSE]"), 18), "matlab": Form(found(rb"(?!)", 8), 128, open_matlab, close_matlab),
    "hdf5": Form(found(rb"TREE|SNOD|HEAP|OHDR|OCHK|FRHP|BTHD|FSHD|GCOL", 512), 8), "parquet": Form(parquet_marks, 4),
    "words": Form(found(rb"(?!)", 8), 13), "pages": Form(found(rb"(?!)", 512), 16),
}  # fmt: skip  #: name -> form


class Damager:
    def __init__(self, draw, data: bytes, other: bytes, form: Form) -> None:
        self.draw, self.data, self.other, self.form = draw, data, other, form

    def one(self, *options):
        return self.draw(st.sampled_from(options))

    def upto(self, most: int) -> int:
        return self.draw(st.integers(0, max(most, 0)))

    def span(self) -> tuple[int, int]:
        marks = [0, *self.form.marks(self.data), len(self.data)]
        at = self.upto(len(marks) - 2)
        return marks[at], max(marks[at + 1], marks[at])

    def place(self) -> int:
        size = len(self.data)
        return self.one(self.upto(size), self.span()[0], self.upto(min(size, 2 * self.form.head + 16)))

    def cut(self) -> bytes:
        at = self.place()
        return self.one(self.data[:at], self.data[:at], self.data[:at], self.data[at:])

    def flip(self) -> bytes:
        out = bytearray(self.data)
        for _ in range(self.one(1, 2, 8, 40) if out else 0):
            out[min(self.place(), len(out) - 1)] ^= 1 << self.upto(7)
        return bytes(out)

    def overwrite(self) -> bytes:
        at, size = self.place(), self.one(1, 2, 8, 64, 512)
        fill = self.one(self.draw(st.binary(max_size=64)), bytes(size), b"\xff" * size)
        return (self.data[:at] + fill + self.data[at + len(fill) :])[: len(self.data)]

    def blow_up(self) -> bytes:
        out = bytearray(self.data)
        for _ in range(self.one(1, 1, 2, 5)):
            at, width = self.place(), self.one(1, 2, 4, 8)
            value = self.one(*EXTREMES, len(out), self.upto(255)) & (1 << 8 * width) - 1
            out[at : at + width] = value.to_bytes(width, self.one("little", "big"))
        return bytes(out)

    def erase(self) -> bytes:
        (begin, end), at = self.span(), self.place()
        lost = self.one(1, 3, 16, 100, 1000)
        return self.one(self.data[:begin] + self.data[end:], self.data[:at] + self.data[at + lost :])

    def repeat(self) -> bytes:
        (begin, end), at = self.span(), self.span()[0]
        return self.data[:at] + self.data[begin:end] * self.one(1, 2, 50, 1000) + self.data[at:]

    def splice(self) -> bytes:
        return self.data[: self.place()] + self.other[self.upto(len(self.other)) :]

    def shuffle(self) -> bytes:
        marks = self.form.marks(self.data)
        begin = self.upto(len(marks) - 1)
        some = [*marks[begin : begin + 12], len(self.data)]
        pieces = [self.data[a:b] for a, b in pairwise(some)][:-1]
        mixed = b"".join(self.draw(st.permutations(pieces)))
        return self.data[: some[0]] + mixed + self.data[some[-2] :] if pieces else self.data

    def garbage(self) -> bytes:
        return self.data[: self.form.head] + self.draw(st.binary(max_size=300))

    def words(self) -> bytes:
        data, matches = self.data, list(NUMBER.finditer(self.data)) or list(re.finditer(rb"\w+", self.data))
        for match in self.draw(st.lists(st.sampled_from(matches), max_size=3)) if matches else ():
            data = data[: match.start()] + self.one(*ODD_WORDS) + data[match.end() :]
        return data


WAYS = (
    Damager.cut, Damager.flip, Damager.overwrite, Damager.blow_up, Damager.erase, Damager.repeat, Damager.splice,
    Damager.shuffle, Damager.garbage, Damager.words,
)  # fmt: skip


@st.composite
def damaged(draw, data: bytes, other: bytes, kind: str) -> bytes:
    """Draw damaged content of a form: damaged once or twice, half of the time inside what is packed."""
    form, most = FORMS[kind], max(MAX_BYTES, len(data))
    inside = draw(st.booleans())
    if inside:
        data, other = form.open(data), form.open(other)
    for way in draw(st.lists(st.sampled_from(WAYS), min_size=1, max_size=2)):
        data = way(Damager(draw, data, other, form))[:most]
    return form.close(data) if inside else data
