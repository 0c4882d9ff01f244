"""Ways to damage a log. All are told what to do by one generator: the same number, the same damage."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from random import Random
from typing import Final

from stoop_studies.verify.readers.forms import FORMS, Form, Span

MOST: Final = 2**17  #: bytes of a damaged file
EXTREMES: Final = (0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**53, 2**63 - 1,
                   2**63, 2**64 - 1)  # fmt: skip
WORDS: Final = (b"", b"nan", b"-inf", b"1e309", b"-1e308", b"1e-320", b"0x10", b"9" * 25, b"-1", b"0", b"true", b'"', b"[", b"{",
                b"\\u0000", b"\xff\xfe", b"\xc3\xa9", b",", b"\0", b"\r", b"1_0", b"1979-05-27", b"a" * 300, b"#",
                b"=")  # fmt: skip
NUMBER: Final = re.compile(rb"-?\d+(?:\.\d+)?(?:e-?\d+)?")

Damage = Callable[[Random, bytes, bytes, Form], bytes]  #: generator, a log, another one, how they are built


def _place(rng: Random, data: bytes) -> int:
    return rng.randrange(len(data) + 1)


def _span(rng: Random, data: bytes, form: Form) -> Span:
    found = form.spans(data)
    return rng.choice(found) if found else (0, len(data))


def cut(rng: Random, data: bytes, other: bytes, form: Form) -> bytes:
    """Cut the end off, anywhere or where a piece ends, or the beginning."""
    if rng.random() < 0.1:
        return data[_place(rng, data) :]
    end = _place(rng, data) if rng.random() < 0.5 else _span(rng, data, form)[1] + rng.randint(-2, 2)
    return data[: max(end, 0)]


def flip(rng: Random, data: bytes, other: bytes, form: Form) -> bytes:
    """Turn single bits."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8, 40)) if out else 0):
        out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def overwrite(rng: Random, data: bytes, other: bytes, form: Form) -> bytes:
    """Put random bytes, zeros or ones over a stretch."""
    begin = _place(rng, data)
    size = min(rng.choice((1, 2, 8, 64, 512)), len(data) - begin)
    fill = rng.choice((rng.randbytes(size), bytes(size), b"\xff" * size))
    return data[:begin] + fill + data[begin + size :]


def blow_up(rng: Random, data: bytes, other: bytes, form: Form) -> bytes:
    """Put extreme numbers where sizes and counts may stand."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 5))):
        width, order = rng.choice((1, 2, 4, 8)), rng.choice(("little", "big"))
        value = rng.choice((*EXTREMES, len(data), rng.randrange(256))) & (1 << 8 * width) - 1
        begin = rng.choice((_place(rng, data), _span(rng, data, form)[0], _place(rng, data) // 4 * 4))
        out[begin : begin + width] = value.to_bytes(width, order)  # type: ignore[arg-type]
    return bytes(out)


def resize(rng: Random, data: bytes, other: bytes, form: Form) -> bytes:
    """Change the first bytes of a piece a little: its length, kind or name."""
    begin, end = _span(rng, data, form)
    at = begin + min(rng.randrange(8), max(end - begin - 1, 0))
    if at >= len(data):
        return data
    return data[:at] + bytes([(data[at] + rng.choice((-3, -1, 1, 2, 16))) % 256]) + data[at + 1 :]


def erase(rng: Random, data: bytes, other: bytes, form: Form) -> bytes:
    """Take a stretch out, or whole pieces."""
    if rng.random() < 0.5:
        begin = _place(rng, data)
        return data[:begin] + data[begin + rng.choice((1, 3, 16, 100, 1000)) :]
    begin, end = _span(rng, data, form)
    return data[:begin] + data[end:]


def repeat(rng: Random, data: bytes, other: bytes, form: Form) -> bytes:
    """Write a piece again, here or elsewhere, sometimes very often."""
    begin, end = _span(rng, data, form)
    piece = data[begin:end] * rng.choice((1, 1, 2, 50, 1000))
    at = end if rng.random() < 0.5 else _span(rng, data, form)[0]
    return (data[:at] + piece + data[at:])[: max(MOST, len(data))]


def swap(rng: Random, data: bytes, other: bytes, form: Form) -> bytes:
    """Let two pieces change places."""
    (a, b), (c, d) = sorted((_span(rng, data, form), _span(rng, data, form)))
    return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:] if b <= c else data


def splice(rng: Random, data: bytes, other: bytes, form: Form) -> bytes:
    """Begin with one log and go on with another."""
    here = rng.choice((_place(rng, data), _span(rng, data, form)[0]))
    there = rng.choice((_place(rng, other), _span(rng, other, form)[0]))
    return data[:here] + other[there:]


def shuffle(rng: Random, data: bytes, other: bytes, form: Form) -> bytes:
    """Put some pieces into another order."""
    spans = form.spans(data)
    begin = rng.randrange(len(spans)) if spans else 0
    some = spans[begin : begin + rng.randint(2, 12)]
    if not some:
        return data
    mixed = rng.sample(some, len(some))
    return data[: some[0][0]] + b"".join(data[a:b] for a, b in mixed) + data[some[-1][1] :]


def head(rng: Random, data: bytes, other: bytes, form: Form) -> bytes:
    """Damage the first bytes."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 3)) if out else 0):
        out[rng.randrange(min(len(out), 2 * form.head + 16))] = rng.choice((rng.randrange(256), 0, 255))
    return bytes(out)


def garbage(rng: Random, data: bytes, other: bytes, form: Form) -> bytes:
    """Write random bytes after what the file is known by."""
    return data[: form.head] + rng.randbytes(rng.choice((0, 1, 16, 256, 4096)))


def words(rng: Random, data: bytes, other: bytes, form: Form) -> bytes:
    """Put odd numbers and words where a text has numbers, or names."""
    found = list(NUMBER.finditer(data)) or list(re.finditer(rb"\w+", data))
    for match in sorted(rng.sample(found, min(len(found), rng.choice((1, 1, 3)))), key=lambda m: -m.start()):
        data = data[: match.start()] + rng.choice(WORDS) + data[match.end() :]
    return data


DAMAGES: Final[Mapping[str, Damage]] = {
    "cut": cut, "flip": flip, "overwrite": overwrite, "blow up": blow_up, "resize": resize, "erase": erase,
    "repeat": repeat, "swap": swap, "splice": splice, "shuffle": shuffle, "head": head, "garbage": garbage, "words": words,
}  # fmt: skip
INSIDE: Final = 0.5  #: share of cases in which what is packed is damaged inside, or its checksum made to fit
TWICE: Final = 0.25  #: share in which a second damage follows


def damaged(rng: Random, data: bytes, other: bytes, kind: str) -> tuple[str, bytes]:
    """Return what was done first, and a damaged log.

    Parameters
    ----------
    rng : Random
    data, other : bytes
        A log, and another one of the same form.
    kind : str
        Key of `FORMS`.
    """
    form = FORMS[kind]
    inside = rng.random() < INSIDE
    pair = (form.open(data), form.open(other)) if inside else (data, other)
    name = rng.choice(tuple(DAMAGES))
    out = DAMAGES[name](rng, *pair, form)
    if rng.random() < TWICE:
        out = DAMAGES[rng.choice(tuple(DAMAGES))](rng, out, pair[1], form)
    out = out[: max(MOST, len(data))]
    return name, form.close(out) if inside else out
