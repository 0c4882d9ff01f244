"""Random damage to the pieces of a log (messages, lines, records) and to compressed content.

Compressed content is damaged unpacked, and packed again with sizes and checksums that fit, so that the reader meets the
damage and not the checksum before it.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Final

from stoop_studies.robustness.trials import lay_out

Span = tuple[int, int]  #: first byte, and first after it
ULOG_HEAD: Final = 16
MAT_HEAD: Final = 128
PAGE: Final = 512
HDF5_MARKS: Final = re.compile(b"TREE|SNOD|HEAP|OHDR|OCHK|FRHP|BTHD|FSHD|GCOL")
BLACKBOX_PARTS: Final = re.compile(b"(?<=\n)H |[IPGSE]")
MAX_BYTES: Final = 2**17  #: of a damaged file
EXTREMES: Final = (0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**53, 2**63 - 1,
                   2**63, 2**64 - 1)  # fmt: skip
ODD_WORDS: Final = (b"", b"nan", b"-inf", b"1e309", b"-1e308", b"1e-320", b"0x10", b"9" * 25, b"-1", b"0", b"true", b'"', b"[",
                    b"{", b"\\u0000", b"\xff\xfe", b"\xc3\xa9", b",", b"\0", b"\r", b"1_0", b"1979-05-27", b"a" * 300, b"#",
                    b"=")  # fmt: skip
NUMBER: Final = re.compile(rb"-?\d+(?:\.\d+)?(?:e-?\d+)?")
INSIDE_SHARE: Final = 0.5  #: of cases in which what is packed is damaged inside, or its checksum made to fit
TWICE_SHARE: Final = 0.25  #: of cases in which a second damage follows


@dataclass(frozen=True)
class Form:
    """How a log is built.

    ``spans`` gives the pieces in its bytes, ``head`` the number of bytes that identify the format; ``open`` unpacks
    what is compressed, and ``close`` packs it again.
    """

    spans: Callable[[bytes], list[Span]]
    head: int
    open: Callable[[bytes], bytes] = bytes
    close: Callable[[bytes], bytes] = bytes


def lines(data: bytes) -> list[Span]:
    """Return the lines of a text."""
    return _between([0, *(match.end() for match in re.finditer(rb"\n", data))], len(data))


def _between(marks: list[int], end: int) -> list[Span]:
    """Return what lies between marks, and behind the last."""
    return list(pairwise(marks if marks and marks[-1] == end else [*marks, end]))


def equal(data: bytes, size: int = 8, begin: int = 0, end: int | None = None) -> list[Span]:
    """Return pieces of one size in a stretch."""
    end = len(data) if end is None else end
    return [(at, min(at + size, end)) for at in range(begin, end, size)]


def ulog_messages(data: bytes) -> list[Span]:
    """Return the messages of a ULog."""
    found, at = [], ULOG_HEAD
    while at + 3 <= len(data):
        end = at + 3 + struct.unpack_from("<H", data, at)[0]
        found.append((at, min(end, len(data))))
        at = end
    return found


def dataflash_messages(data: bytes) -> list[Span]:
    """Return the messages of a DataFlash log, as far as marks show them."""
    marks = [match.start() for match in re.finditer(rb"\xa3\x95", data)]
    return _between(marks, len(data)) if marks else []


def crazyflie_events(data: bytes) -> list[Span]:
    """Return the zero-ended texts of the head, and behind them pieces of eight bytes."""
    texts, at = [], 5
    while 0 <= data.find(b"\0", at) < min(at + 40, len(data)):
        end = data.find(b"\0", at) + 1
        texts.append((at, end))
        at = end
    return [*texts, *equal(data, begin=at)]


def blackbox_frames(data: bytes) -> list[Span]:
    """Return the lines of the headers of a blackbox log, and what lies between letters of frames."""
    return _between(
        [0, *(match.start() for match in BLACKBOX_PARTS.finditer(data) if match.start())], len(data)
    )


def hdf5_blocks(data: bytes) -> list[Span]:
    """Return the pieces between the marks of HDF5, those without one in halves of a kilobyte."""
    found = (match.start() for match in HDF5_MARKS.finditer(data))
    marks = sorted({0, *found, *range(0, len(data), PAGE)})
    return list(zip(marks, [*marks[1:], len(data)], strict=True))


def parquet_parts(data: bytes) -> list[Span]:
    """Return the footer, which describes all else, in pieces of eight bytes, and the pages before it as a few."""
    size = int.from_bytes(data[-8:-4], "little") if len(data) > 12 else 0
    begin = max(4, len(data) - 8 - size)
    return [*equal(data, 64, end=min(begin, len(data))), *equal(data, begin=begin)]


def _open_matlab(data: bytes) -> bytes:
    """Unpack every variable of a .mat file of version 5; the file is then one of plain variables."""
    out, at = data[:MAT_HEAD], MAT_HEAD
    while at + 8 <= len(data):
        kind, size = struct.unpack_from("<II", data, at)
        body = data[at + 8 : at + 8 + size]
        out += zlib.decompress(body) if kind == 15 else data[at : at + 8 + size]
        at += 8 + size
    return out


def _close_matlab(data: bytes) -> bytes:
    """Pack all that follows the head as one variable."""
    body = zlib.compress(data[MAT_HEAD:], 1)
    return data[:MAT_HEAD] + struct.pack("<II", 15, len(body)) + body


FORMS: Final[Mapping[str, Form]] = {
    "ulog": Form(ulog_messages, 7),
    "dataflash": Form(dataflash_messages, 3),
    "lines": Form(lines, 4),
    "gzip": Form(lines, 3, partial(zlib.decompress, wbits=31), partial(zlib.compress, level=1, wbits=31)),
    "crazyflie": Form(
        crazyflie_events,
        3,
        close=lambda data: data[:-4] + struct.pack("<I", zlib.crc32(data[:-4])) if len(data) > 4 else data,
    ),
    "blackbox": Form(blackbox_frames, 18),
    "matlab": Form(equal, MAT_HEAD, _open_matlab, _close_matlab),
    "hdf5": Form(hdf5_blocks, 8),
    "parquet": Form(parquet_parts, 4),
    "words": Form(equal, 13),
    "pages": Form(partial(equal, size=PAGE), 16),
}


@dataclass(frozen=True)
class Sample:
    """A small undamaged log: content of its files by name, and the form (key of `FORMS`) of those that are damaged.

    ``entry`` is the file that is read (empty: their folder), ``targets`` the files that are damaged, ``mapping`` the mapping
    file (empty where a built-in one serves, or none is needed).
    """

    files: Mapping[str, bytes]
    form: str
    entry: str = ""
    targets: tuple[str, ...] = ()
    mapping: str = ""

    def write(self, folder: Path) -> tuple[Path, Path | None]:
        """Write all files; return what is to be read, and the mapping."""
        lay_out(folder, self.files)
        return folder / self.entry, folder / self.mapping if self.mapping else None


def single(name: str, content: bytes, form: str, mapping: bytes = b"") -> Sample:
    """Return a log of one file, and perhaps a mapping of its own beside it."""
    beside = {"mapping.toml": mapping} if mapping else {}
    return Sample({name: content, **beside}, form, name, (name,), "mapping.toml" if mapping else "")


@dataclass(frozen=True)
class Damager:
    """Ways to damage a log of a form, perhaps with pieces of another log; the same seed gives the same damage.

    What each of them does stands in `DAMAGES`.
    """

    rng: Random
    other: bytes
    form: Form

    def place(self, data: bytes) -> int:
        """Draw a place."""
        return self.rng.randrange(len(data) + 1)

    def span(self, data: bytes) -> Span:
        """Draw a piece."""
        found = self.form.spans(data)
        return self.rng.choice(found) if found else (0, len(data))

    def _cut(self, data: bytes) -> bytes:
        if self.rng.random() < 0.1:
            return data[self.place(data) :]
        anywhere = self.rng.random() < 0.5
        end = self.place(data) if anywhere else self.span(data)[1] + self.rng.randint(-2, 2)
        return data[: max(end, 0)]

    def _flip(self, data: bytes) -> bytes:
        out = bytearray(data)
        for _ in range(self.rng.choice((1, 1, 2, 8, 40)) if out else 0):
            out[self.rng.randrange(len(out))] ^= 1 << self.rng.randrange(8)
        return bytes(out)

    def _overwrite(self, data: bytes) -> bytes:
        begin = self.place(data)
        size = min(self.rng.choice((1, 2, 8, 64, 512)), len(data) - begin)
        fill = self.rng.choice((self.rng.randbytes(size), bytes(size), b"\xff" * size))
        return data[:begin] + fill + data[begin + size :]

    def _blow_up(self, data: bytes) -> bytes:
        out, rng = bytearray(data), self.rng
        for _ in range(rng.choice((1, 1, 2, 5))):
            width, order = rng.choice((1, 2, 4, 8)), rng.choice(("little", "big"))
            value = rng.choice((*EXTREMES, len(data), rng.randrange(256))) & (1 << 8 * width) - 1
            begin = rng.choice((self.place(data), self.span(data)[0], self.place(data) // 4 * 4))
            out[begin : begin + width] = value.to_bytes(width, order)  # type: ignore[arg-type]
        return bytes(out)

    def _resize(self, data: bytes) -> bytes:
        begin, end = self.span(data)
        at = begin + min(self.rng.randrange(8), max(end - begin - 1, 0))
        if at >= len(data):
            return data
        return data[:at] + bytes([(data[at] + self.rng.choice((-3, -1, 1, 2, 16))) % 256]) + data[at + 1 :]

    def _erase(self, data: bytes) -> bytes:
        if self.rng.random() < 0.5:
            begin = self.place(data)
            return data[:begin] + data[begin + self.rng.choice((1, 3, 16, 100, 1000)) :]
        begin, end = self.span(data)
        return data[:begin] + data[end:]

    def _repeat(self, data: bytes) -> bytes:
        begin, end = self.span(data)
        piece = data[begin:end] * self.rng.choice((1, 1, 2, 50, 1000))
        at = end if self.rng.random() < 0.5 else self.span(data)[0]
        return (data[:at] + piece + data[at:])[: max(MAX_BYTES, len(data))]

    def _swap(self, data: bytes) -> bytes:
        (a, b), (c, d) = sorted((self.span(data), self.span(data)))
        return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:] if b <= c else data

    def _splice(self, data: bytes) -> bytes:
        here = self.rng.choice((self.place(data), self.span(data)[0]))
        there = self.rng.choice((self.place(self.other), self.span(self.other)[0]))
        return data[:here] + self.other[there:]

    def _shuffle(self, data: bytes) -> bytes:
        spans = self.form.spans(data)
        begin = self.rng.randrange(len(spans)) if spans else 0
        some = spans[begin : begin + self.rng.randint(2, 12)]
        if not some:
            return data
        mixed = self.rng.sample(some, len(some))
        return data[: some[0][0]] + b"".join(data[a:b] for a, b in mixed) + data[some[-1][1] :]

    def _head(self, data: bytes) -> bytes:
        out, rng = bytearray(data), self.rng
        for _ in range(rng.choice((1, 1, 3)) if out else 0):
            value = rng.choice((rng.randrange(256), 0, 255))
            out[rng.randrange(min(len(out), 2 * self.form.head + 16))] = value
        return bytes(out)

    def _garbage(self, data: bytes) -> bytes:
        return data[: self.form.head] + self.rng.randbytes(self.rng.choice((0, 1, 16, 256, 4096)))

    def _words(self, data: bytes) -> bytes:
        found = list(NUMBER.finditer(data)) or list(re.finditer(rb"\w+", data))
        some = self.rng.sample(found, min(len(found), self.rng.choice((1, 1, 3))))
        for match in sorted(some, key=lambda m: -m.start()):
            data = data[: match.start()] + self.rng.choice(ODD_WORDS) + data[match.end() :]
        return data


DAMAGES: Final[Mapping[str, tuple[Callable[[Damager, bytes], bytes], str]]] = {
    "cut": (Damager._cut, "the end is cut off, anywhere or where a message ends; sometimes the beginning"),
    "flip": (Damager._flip, "1 to 40 bits are turned"),
    "overwrite": (Damager._overwrite, "random bytes, zeros or ones over a stretch"),
    "blow up": (Damager._blow_up, "extreme numbers of 1 to 8 bytes, also where sizes and counts stand"),
    "resize": (
        Damager._resize,
        "the first bytes of a message, record or line change a little: its size, kind or name",
    ),
    "erase": (Damager._erase, "a stretch is taken out, or whole messages"),
    "repeat": (Damager._repeat, "messages are written again, up to a thousand times"),
    "swap": (Damager._swap, "two messages change places"),
    "splice": (Damager._splice, "one log begins, and another goes on"),
    "shuffle": (Damager._shuffle, "messages follow each other in another order"),
    "head": (Damager._head, "the first bytes are damaged"),
    "garbage": (Damager._garbage, "random bytes follow what the file is known by"),
    "words": (Damager._words, "odd numbers and words where a text has numbers or names"),
}  #: name -> method, and what the page says of it


def damaged(rng: Random, data: bytes, other: bytes, kind: str) -> tuple[str, bytes]:
    """Return the name of the first damage and a damaged log; ``other`` is another log of the same ``kind`` of `FORMS`."""
    form = FORMS[kind]
    inside = rng.random() < INSIDE_SHARE
    pair = (form.open(data), form.open(other)) if inside else (data, other)
    damager = Damager(rng, pair[1], form)
    name = rng.choice(tuple(DAMAGES))
    out = DAMAGES[name][0](damager, pair[0])
    if rng.random() < TWICE_SHARE:
        out = DAMAGES[rng.choice(tuple(DAMAGES))][0](damager, out)
    out = out[: max(MAX_BYTES, len(data))]
    return name, form.close(out) if inside else out
