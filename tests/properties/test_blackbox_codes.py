"""Every encoding and predictor of blackbox logs: bits as Cleanflight's "Blackbox Internals" describes them, and orangebox.

Orangebox, an independent decoder, knows all but encoding 10 and the first version of encoding 8.
"""

from pathlib import Path

import numpy as np
import pytest

from stoop.logs import blackbox
from stoop.logs.blackbox_walk import ENCODINGS, PREDICTORS, G, I

N = 60
SETTINGS = {"Data version": 2, "minthrottle": 1150, "vbatref": 430, "motorOutput": "48,2047"}
#: encoding -> number of fields in the table, and the bits of a random number of a field
FIELDS = {0: (1, 31), 1: (1, 31), 3: (1, 13), 6: (8, 20), 7: (3, 31), 8: (4, 15), 9: (1, 0), 10: (3, 31)}


def varint(value: int) -> bytes:
    """Seven bits a byte, the lowest first; the highest bit says that more follow."""
    out = []
    while value > 127:
        out.append(128 | value & 127)
        value >>= 7
    return bytes([*out, value])


def zigzag(value: int) -> bytes:
    """0, -1, 1, -2, ... as 0, 1, 2, 3, ..."""
    return varint(2 * value if value >= 0 else -2 * value - 1)


def packed(bits: str) -> bytes:
    """Eight bits a byte, the highest first, filled up with zeros."""
    return bytes(int(bits[k : k + 8].ljust(8, "0"), 2) for k in range(0, len(bits), 8))


def two(value: int, width: int) -> str:
    """Two's complement."""
    return format(value % 2**width, f"0{width}b") if width else ""


def fits(values: list[int], widths: tuple[int, ...]) -> bool:
    return all(-(2 ** (w - 1)) <= v < 2 ** (w - 1) for v, w in zip(values, widths, strict=True))


def three(values: list[int], cases: tuple[tuple[tuple[int, ...], str], ...]) -> bytes:
    """Two bits name the first case whose widths hold the numbers, else the bytes of each, 1 to 4, stand before them."""
    for tag, (widths, gap) in enumerate(cases):
        if fits(values, widths):
            head = two(tag, 2) + (gap if tag == 1 else "")
            return packed(head + (gap if tag == 2 else "").join(map(two, values, widths)))
    sizes = [next(n for n in range(1, 5) if fits([v], (8 * n,))) for v in values]
    lead = 3 << 6 | sum((n - 1) << 2 * k for k, n in enumerate(sizes))
    whole = ((v % 2**32).to_bytes(4, "little") for v in values)
    return bytes([lead]) + b"".join(v[:n] for v, n in zip(whole, sizes, strict=True))


def four(values: list[int]) -> bytes:
    """Widths 0, 4, 8 and 16 bits, two bits each, of the first number lowest; then the numbers without gaps."""
    widths = (0, 4, 8, 16)
    codes = [next(c for c, w in enumerate(widths) if (fits([v], (w,)) if w else not v)) for v in values]
    bits = "".join(two(v, widths[c]) for v, c in zip(values, codes, strict=True))
    return bytes([sum(c << 2 * k for k, c in enumerate(codes))]) + packed(bits)


WRITERS = {
    0: lambda v: zigzag(*v), 1: lambda v: varint(*v), 3: lambda v: varint(-v[0] % 2**14), 9: lambda v: b"",
    6: lambda v: bytes([sum((x != 0) << k for k, x in enumerate(v))]) + b"".join(zigzag(x) for x in v if x),
    7: lambda v: three(v, (((2, 2, 2), ""), ((4, 4, 4), "00"), ((6, 6, 6), "00"))), 8: four,
    10: lambda v: three(v, (((2, 2, 2), ""), ((5, 5, 4), ""), ((8, 7, 7), ""))),
}  # fmt: skip


def log(fields: list[tuple[str, int, int, int, int]], frames: bytes, interval: int, **more: str) -> bytes:
    """Return a log of I frames (name, signed, predictor, encoding) and P frames, whose predictor is the last column."""
    lines = {**SETTINGS, "P interval": "1/1", "I interval": interval}
    for key, k in (("I name", 0), ("I signed", 1), ("I predictor", 2), ("I encoding", 3), ("P predictor", 4)):
        lines[f"Field {key}"] = ",".join(str(f[k]) for f in fields)
    lines["Field P encoding"] = ",".join("9" if f[4] == 6 else "0" for f in fields)
    lines |= {f"Field {name.replace('_', ' ')}": value for name, value in more.items()}
    head = "H Product:Blackbox flight data recorder by Nicholas Sherlock\n"
    return (head + "".join(f"H {k}:{v}\n" for k, v in lines.items())).encode() + frames + b"E\xffEnd of log\0"


def check(content: bytes, expected: np.ndarray, path: Path, independent: bool = True) -> None:
    found = blackbox._session(content, 0, len(content), "log", 10**7)
    assert isinstance(found, blackbox.Session)
    assert found.defects == ()
    np.testing.assert_array_equal(found.rows[I][:, 1:], expected)
    if independent:
        import orangebox

        path.write_bytes(content)
        theirs = [frame.data for frame in orangebox.Parser.load(str(path)).frames()]
        theirs, expected = np.mod(theirs, 2**32), np.mod(expected, 2**32)  # it gives four bytes no sign
        np.testing.assert_array_equal(theirs, expected)


@pytest.mark.parametrize("encoding", FIELDS)
def test_every_encoding(encoding: int, tmp_path: Path) -> None:
    assert {*FIELDS} == ENCODINGS
    rng, (count, most) = np.random.default_rng(encoding), FIELDS[encoding]
    rows, frames = [], b""
    for k in range(N):
        wide = rng.integers(0, most + 1) if k % 4 else most  # of numbers of all sizes, and of the largest
        values = [int(rng.integers(-(2**wide), 2**wide)) if wide else 0 for _ in range(count)]
        values = [abs(v) for v in values] if encoding == 1 else values
        rows.append([k, 1000 * (k + 1), *values])
        frames += b"I" + varint(k) + varint(1000 * (k + 1)) + WRITERS[encoding](values)
    fields = [("loopIteration", 0, 0, 1, 6), ("time", 0, 0, 1, 2)]
    fields += [(f"x{k}", int(encoding != 1), 0, encoding, 1) for k in range(count)]
    check(log(fields, frames, 1), np.array(rows), tmp_path / "a.bbl", encoding != 10)


def predicted(predictor: int, i: int, new: list[int], one: list[int], before: list[int]) -> int:
    """Return motor[0] of this frame, the number before, the line through the last two, or their mean towards zero."""
    if predictor == 5:
        return new[2]
    return {1: one[i], 2: 2 * one[i] - before[i], 3: int((one[i] + before[i]) / 2)}[predictor]


def test_every_predictor_of_main_frames(tmp_path: Path) -> None:
    """Numbers of I frames and P frames by the published rules; 7 and 10 are of frames of the satellite receiver."""
    constant = {0: 0, 4: 1150, 8: 1500, 9: 430, 11: 48}
    first = [0, 0, 0, *constant, 5, 0, 0, 0]
    later = [6, 2, 0, *constant, 5, 1, 2, 3]
    assert {*first, *later} == PREDICTORS - {7, 10}
    names = ["loopIteration", "time", "motor[0]", *(f"x{k}" for k in range(len(first) - 3))]
    fields = [(n, int(k > 1), first[k], int(k < 2), later[k]) for k, n in enumerate(names)]
    rng, rows, frames = np.random.default_rng(3), [], b""
    for k in range(N):
        whole = k % 32 == 0
        one, before = (rows[-1] if rows else []), (rows[-1] if k % 32 == 1 else rows[-2] if k > 1 else [])
        new, body = [], b""
        for i, predictor in enumerate(first if whole else later):
            delta = int(rng.integers(-50, 50))
            if i < 2 and whole:
                new.append((k, 1000 * (k + 1))[i])
                body += varint(new[-1])
                continue
            if predictor == 6:
                new.append(one[i] + 1)
                continue
            base = constant[predictor] if predictor in constant else predicted(predictor, i, new, one, before)
            delta = delta if i != 1 else 1000 * (k + 1) - base
            new.append(base + delta)
            body += zigzag(delta)
        rows.append(new)
        frames += (b"I" if whole else b"P") + body
    check(log(fields, frames, 32), np.array(rows), tmp_path / "a.bbl")


def test_every_predictor_of_satellites() -> None:
    """7: the home coordinate of the same kind; 10: the time of the main frame before."""
    main = [("loopIteration", 0, 0, 1, 6), ("time", 0, 0, 1, 2)]
    more = {"H_name": "GPS_home[0],GPS_home[1]", "H_signed": "1,1", "H_predictor": "0,0", "H_encoding": "0,0",
            "G_name": "time,GPS_coord[0],GPS_coord[1]", "G_signed": "0,1,1", "G_predictor": "10,7,7",
            "G_encoding": "1,0,0"}  # fmt: skip
    frames = b"H" + zigzag(474_000_000) + zigzag(-85_000_000)
    for k in range(5):
        frames += b"I" + varint(k) + varint(1000 * (k + 1))
        frames += b"G" + varint(7) + zigzag(-3 * k) + zigzag(5 * k)
    content = log(main, frames, 1, **more)
    found = blackbox._session(content, 0, len(content), "log", 10**7)
    assert isinstance(found, blackbox.Session)
    wanted = [[1000 * (k + 1) + 7, 474_000_000 - 3 * k, -85_000_000 + 5 * k] for k in range(5)]
    np.testing.assert_array_equal(found.rows[G][:, 1:], wanted)
    assert found.rows[G][:, 0].tolist() == [row[0] for row in wanted]
