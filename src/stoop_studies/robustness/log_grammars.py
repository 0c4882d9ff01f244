"""Logs drawn from the grammar of each format, with hostile numbers, names, sizes and clocks.

They are written from the public specifications, not from the readers, so that they hold what a specification allows and no
writer of ours has written: nested and cyclic definitions, several instances, messages in any order, every width of number.

References
----------
PX4 Autopilot User Guide, "ULog File Format". ArduPilot, "Logging: DataFlash message definitions" (types and units of FMT,
FMTU, UNIT and MULT). RFC 4180 (comma-separated values).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from random import Random
from typing import Final

from stoop.base.variables import VARIABLES
from stoop_studies.robustness.damaged_logs import Sample, single

FLOATS: Final = (
    0.0, -0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 5e-324, 1e-45, 3.5e38, -3.5e38, 1e308, -1e308, 1e-9, 1e9, 1e15,
)  # fmt: skip
WIDE: Final = 400  #: digits of a whole number beyond float64
WORDS: Final = (
    "", " ", "a", "x" * 300, "é", "名", "a b", "a,b", "a;b", "a/b", "../a", "a[0]", "a.b", "\x1b[31m", "\x00", "\x7f", "nan",
    "None", "timestamp", "__class__", "%s", "{}", "\u202e", "\ud7ff", "0", "-1", "1e999",
)  # fmt: skip
INTEGERS: Final = {"b": 8, "h": 16, "i": 32, "q": 64}  #: letter of struct -> bits; large letters are unsigned
ULOG_MAGIC: Final = b"ULog\x01\x12\x35"
ULOG_SYNC: Final = bytes.fromhex("2f731320250cbb12")
ULOG_TYPES: Final = {
    "int8_t": "b", "uint8_t": "B", "int16_t": "h", "uint16_t": "H", "int32_t": "i", "uint32_t": "I", "int64_t": "q",
    "uint64_t": "Q", "float": "f", "double": "d", "bool": "?", "char": "c",
}  # fmt: skip
PX4_TOPICS: Final = {
    "vehicle_angular_velocity": (("float", 3, "xyz"),),
    "sensor_combined": (("float", 3, "gyro_rad"), ("float", 3, "accelerometer_m_s2")),
    "vehicle_attitude": (("float", 4, "q"), ("float", 4, "delta_q_reset")),
    "vehicle_local_position": (
        ("float", 0, "vx"),
        ("float", 0, "vy"),
        ("float", 0, "vz"),
        ("bool", 0, "v_xy_valid"),
    ),
    "airspeed_validated": (("float", 0, "true_airspeed_m_s"), ("float", 0, "calibrated_airspeed_m_s")),
    "actuator_servos": (("float", 8, "control"),),
    "actuator_motors": (("float", 12, "control"),),
    "actuator_outputs": (("uint32_t", 0, "noutputs"), ("float", 16, "output")),
}  #: topic -> its fields behind the time stamp, as PX4 writes them
DATAFLASH_TYPES: Final = {
    "b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "q": "q", "Q": "Q", "f": "f", "d": "d", "n": "4s", "N": "16s",
    "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "a": "64s", "g": "e",
}  # fmt: skip
ARDUPILOT: Final = {
    "IMU": ("QBfffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,T"),
    "ATT": ("Qccccc", "TimeUS,DesRoll,Roll,DesPitch,Pitch,Yaw"),
    "ARSP": ("QBfff", "TimeUS,I,Airspeed,DiffPress,Temp"),
    "RCOU": ("QHHHH", "TimeUS,C1,C2,C3,C4"),
    "XKF1": ("QBccCfff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD"),
    "PARM": ("QNff", "TimeUS,Name,Value,Default"),
    "MSG": ("QZ", "TimeUS,Message"),
}  #: message -> its types and columns
DESCRIPTIONS: Final = {
    "UNIT": "QbZ",
    "MULT": "Qbd",
    "FMTU": "QBNN",
}  #: messages of units and instances -> their types


@dataclass(frozen=True)
class Draw:
    """Random choices for a log; equal seeds give equal choices."""

    rng: Random
    hostile: float  #: share of numbers and words that are hostile

    def bad(self) -> bool:
        """Whether the next choice is a hostile one."""
        return self.rng.random() < self.hostile

    def number(self, letter: str) -> float | int:
        """Draw a number of a letter of `struct`."""
        if bits := INTEGERS.get(letter.lower(), 0):
            low, high = (0, 2**bits - 1) if letter.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
            return (
                self.rng.choice((low, high, 0, 1, high // 2))
                if self.bad()
                else self.rng.randrange(min(high, 2000))
            )
        value = self.rng.choice(FLOATS) if self.bad() else self.rng.gauss(0.0, 0.3)
        largest = {"e": 65504.0, "f": 3.4028234e38}.get(letter, math.inf)
        return value if not math.isfinite(value) or abs(value) <= largest else math.copysign(math.inf, value)

    def packed(self, letters: str) -> bytes:
        """Draw the bytes of a row of numbers, flags and texts."""
        out = b""
        for letter in letters:
            if letter in "?c":
                out += bytes([self.rng.randrange(256) if self.bad() else 1])
            else:
                out += struct.pack(f"<{letter}", self.number(letter))
        return out

    def word(self, usual: str) -> str:
        """Draw a name or text."""
        return self.rng.choice(WORDS) if self.bad() else usual

    def size(self, usual: int, most: int) -> int:
        """Draw a count or size that a file states."""
        return self.rng.choice((0, 1, most // 2, most - 1, most)) if self.bad() else usual

    def clock(self, count: int, period: float) -> list[float]:
        """Draw times of samples [s], most of them rising."""
        start = self.rng.choice((0.0, 2.0, 1.7e9, 1.8e13)) if self.bad() else 2.0
        times = [start + period * i for i in range(count)]
        for _ in range(self.rng.randrange(3) if self.bad() else 0):
            at, leap = self.rng.randrange(count), self.rng.choice((-1e3, -period, 0.0, 60.0, 1e6, 1e12))
            times[at:] = (
                [t + leap for t in times[at:]]
                if self.rng.random() < 0.5
                else [times[at] + leap] * (count - at)
            )
        return times


def _stamp(seconds: float, bits: int = 64) -> int:
    """Return a time in microseconds as an unsigned integer."""
    return int(max(0, int(seconds * 1e6)) % 2**bits)


def _ulog_message(kind: str, content: bytes) -> bytes:
    return struct.pack("<HB", len(content) % 2**16, ord(kind)) + content[: 2**16 - 1]


def _ulog_fields(draw: Draw, names: Sequence[str]) -> list[tuple[str, int, str]]:
    """Draw fields (type, count or zero, name); a type may be another topic, or the topic itself."""
    kinds = [*ULOG_TYPES, *(names if draw.bad() else ())]
    return [
        (
            draw.rng.choice(kinds),
            draw.size(draw.rng.choice((0, 0, 3)), 2**16) if draw.bad() else 0,
            draw.word(f"f{i}"),
        )
        for i in range(draw.rng.randrange(1, 6))
    ]


def _ulog_row(draw: Draw, fields: Sequence[tuple[str, int, str]], time: float) -> bytes:
    row = struct.pack("<Q", _stamp(time))
    for kind, count, _ in fields:
        row += draw.packed(ULOG_TYPES.get(kind, "B") * min(max(count, 1), 64))
    return row


def _ulog_beside(draw: Draw) -> bytes:
    """Draw a message beside the data: information, a parameter, a text, a dropout, a sync mark."""
    kind = draw.rng.choice("IMPQLCSO")
    if kind in "IMPQ":
        letter = draw.rng.choice(("int32_t", "float", "char[5]", draw.word("uint64_t")))
        key = f"{letter} {draw.word('SYS_AUTOSTART')}".encode("utf-8", "surrogatepass")[:255]
        value = b"12345" if "char" in letter else draw.packed(ULOG_TYPES.get(letter, "q"))
        head = {"M": b"\0", "Q": bytes([draw.size(1, 255)])}.get(kind, b"")
        return _ulog_message(kind, head + bytes([draw.size(len(key), 255)]) + key + value)
    text = draw.word("armed").encode("utf-8", "surrogatepass")
    body = {
        "L": bytes([draw.size(54, 255)]) + struct.pack("<Q", _stamp(2.0)) + text,
        "C": bytes([54]) + struct.pack("<HQ", draw.size(1, 65535), _stamp(2.0)) + text,
        "S": ULOG_SYNC,
        "O": struct.pack("<H", draw.size(40, 65535)),
    }
    return _ulog_message(kind, body[kind])


def ulog(draw: Draw) -> Sample:
    """Draw a ULog."""
    known = draw.rng.sample(list(PX4_TOPICS), draw.rng.randrange(1, len(PX4_TOPICS)))
    names = [*known, *(draw.word(f"topic_{i}") for i in range(draw.rng.randrange(3)))]
    formats = {name: list(PX4_TOPICS.get(name, ())) or _ulog_fields(draw, names) for name in names}
    out = ULOG_MAGIC + bytes([draw.size(1, 255)]) + struct.pack("<Q", _stamp(2.0))
    if draw.rng.random() < 0.7:
        offsets = [draw.size(0, 2**64 - 1) for _ in range(3)]
        out += _ulog_message(
            "B", draw.rng.choice((bytes(16), bytes(8) + b"\1" + bytes(7))) + struct.pack("<3Q", *offsets)
        )
    parts = []
    for name, fields in formats.items():
        columns = ";".join(f"{kind}{f'[{n}]' if n else ''} {field}" for kind, n, field in fields)
        text = f"{name}:uint64_t timestamp;{columns}{'' if draw.bad() else ';'}"
        parts.append(_ulog_message("F", text.encode("utf-8", "surrogatepass")))
    parts += [_ulog_beside(draw) for _ in range(draw.rng.randrange(4))]
    data = []
    for i, (name, fields) in enumerate(formats.items()):
        for instance in range(1 + draw.bad()):
            number = draw.size(2 * i + instance, 65535)
            head = bytes([instance]) + struct.pack("<H", number) + name.encode("utf-8", "surrogatepass")
            parts.append(_ulog_message("A", head))
            rows = draw.clock(draw.rng.choice((1, 2, 5, 60)), draw.rng.choice((0.004, 0.02, 0.1)))
            data += [
                (t, _ulog_message("D", struct.pack("<H", number) + _ulog_row(draw, fields, t))) for t in rows
            ]
    data += [(draw.rng.uniform(2.0, 3.0), _ulog_beside(draw)) for _ in range(draw.rng.randrange(5))]
    if not draw.bad():
        data.sort(key=lambda row: row[0])
    if draw.bad():
        draw.rng.shuffle(parts)
    return single("a.ulg", out + b"".join(parts) + b"".join(message for _, message in data), "ulog")


def _dataflash_kinds(draw: Draw) -> dict[str, tuple[str, list[str]]]:
    """Draw messages: their types and columns."""
    kinds = {name: (letters, columns.split(",")) for name, (letters, columns) in ARDUPILOT.items()}
    chosen = {name: kinds[name] for name in draw.rng.sample(list(kinds), draw.rng.randrange(1, len(kinds)))}
    for i in range(draw.rng.randrange(3)):
        letters = "Q" + "".join(draw.rng.choices(list(DATAFLASH_TYPES), k=draw.rng.randrange(1, 15)))
        chosen[draw.word(f"T{i}")] = (
            letters,
            ["TimeUS", *(draw.word(f"c{k}") for k in range(len(letters) - 1))],
        )
    return chosen


def _dataflash_cell(draw: Draw, letter: str, column: str, time: float) -> float | int | str:
    """Draw the value of a column."""
    if column == "TimeUS" and not draw.bad():
        return _stamp(time)
    if letter in "nNZa":
        return draw.word("ABC")
    return draw.number(DATAFLASH_TYPES[letter])


def dataflash(draw: Draw) -> Sample:
    """Draw a DataFlash log of ArduPilot."""
    kinds = _dataflash_kinds(draw)
    head = b"\xa3\x95\x80\x80\x59FMT\0BBnNZ" + bytes(11) + b"Type,Length,Name,Format,Columns".ljust(64, b"\0")
    defined, data = [head], []
    for i, (name, (letters, columns)) in enumerate(kinds.items(), 129):
        kind = draw.size(i, 255)
        layout = "<" + "".join(DATAFLASH_TYPES[letter] for letter in letters)
        size = draw.size(3 + struct.calcsize(layout), 255) % 256
        texts = [text.encode("utf-8", "surrogatepass") for text in (name, letters, ",".join(columns))]
        defined.append(b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, size, *texts))
        for t in draw.clock(draw.rng.choice((1, 2, 5, 60)), draw.rng.choice((0.004, 0.02, 0.1))):
            cells = [_dataflash_cell(draw, *column, t) for column in zip(letters, columns, strict=True)]
            packed = [c.encode("utf-8", "surrogatepass") if isinstance(c, str) else c for c in cells]
            data.append((t, b"\xa3\x95" + bytes([kind]) + struct.pack(layout, *packed)))
    if not draw.bad():
        data.sort(key=lambda row: row[0])
    described = _dataflash_units(draw, kinds) if draw.rng.random() < 0.5 else b""
    content = b"".join(defined) + described + b"".join(message for _, message in data)
    return single("a.bin", content, "dataflash")


def _dataflash_units(draw: Draw, kinds: Mapping[str, tuple[str, list[str]]]) -> bytes:
    """Draw units, multipliers and, of each kind of messages, the marks of its columns; "#" numbers the instance."""
    names = {"UNIT": "TimeUS,Id,Label", "MULT": "TimeUS,Id,Mult", "FMTU": "TimeUS,FmtType,UnitIds,MultIds"}
    out = b""
    for number, (name, letters) in enumerate(DESCRIPTIONS.items(), 200):
        size = 3 + struct.calcsize("<" + "".join(DATAFLASH_TYPES[letter] for letter in letters))
        texts = (name.encode(), letters.encode(), names[name].encode())
        out += b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, size, *texts)
    for mark, label in (("s", "s"), ("E", "rad/s"), ("#", "instance")):
        out += b"\xa3\x95\xc8" + struct.pack(
            "<Qb64s", 0, ord(mark), draw.word(label).encode("utf-8", "surrogatepass")
        )
    for mark, factor in (("F", 1e-6), ("0", 1.0), ("-", 0.0)):
        value = draw.number("d") if draw.bad() else factor
        out += b"\xa3\x95\xc9" + struct.pack("<Qbd", 0, ord(mark), value)
    for number, (_, columns) in enumerate(kinds.values(), 129):
        numbered = draw.rng.randrange(len(columns)) if draw.bad() else 1
        marks = "".join("#" if i == numbered else draw.rng.choice("sE-?") for i in range(len(columns)))
        times = "".join(draw.rng.choice("F0-") for _ in columns)
        out += b"\xa3\x95\xca" + struct.pack(
            "<QB16s16s", 0, draw.size(number, 255), marks.encode(), times.encode()
        )
    return out


def dataflash_text(draw: Draw) -> Sample:
    """Draw a DataFlash log as text."""
    lines, kinds = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"], _dataflash_kinds(draw)
    for i, (name, (letters, columns)) in enumerate(kinds.items(), 129):
        lines.append(
            f"FMT, {draw.size(i, 10**6)}, {draw.size(50, 255)}, {name}, {letters}, {','.join(columns)}"
        )
        for t in draw.clock(draw.rng.choice((1, 2, 60)), 0.02):
            cells = [_dataflash_cell(draw, *column, t) for column in zip(letters, columns, strict=True)]
            lines.append(", ".join([name, *(text(draw, cell) for cell in cells)]))
    return single("a.log", _lines(draw, lines), "lines")


def _lines(draw: Draw, lines: Sequence[str]) -> bytes:
    """Write lines, the last of which seldom has no end."""
    return "\n".join([*lines, *([] if draw.bad() else [""])]).encode("utf-8", "surrogatepass")


def text(draw: Draw, cell: float | str) -> str:
    """Write a cell of a table."""
    if draw.rng.random() < 0.02 * draw.hostile:
        return draw.rng.choice((f"1{WIDE * '0'}", "0x10", "1_0", "1,5", '"', "1e400", "", "true", "-"))
    return str(cell)


def table(draw: Draw) -> Sample:
    """Draw a table of comma-separated values with its mapping."""
    names = draw.rng.sample(list(VARIABLES), draw.rng.randrange(1, 20))
    times = draw.clock(draw.rng.choice((1, 2, 5, 60, 400)), draw.rng.choice((0.01, 0.02, 0.1)))
    labels = [draw.word(name) for name in names]
    lines = [",".join(["t", *labels])]
    lines += [",".join([text(draw, t), *(text(draw, draw.number("d")) for _ in names)]) for t in times]
    mapping = ["[time]", 'column = "t"', f'unit = "{draw.word("s") if draw.bad() else "s"}"', "[variables]"]
    for name, label in zip(names, labels, strict=True):
        key = (
            label.replace("\\", "").replace('"', "").encode("unicode_escape").decode().replace("\\x", "\\u00")
        )
        mapping.append(f'{name} = {{ column = "{key}", unit = "{VARIABLES[name].unit}" }}')
    return single("a.csv", _lines(draw, lines), "lines", "\n".join(mapping).encode("utf-8", "surrogatepass"))


GRAMMARS: Final[Mapping[str, Callable[[Draw], Sample]]] = {
    "ulog": ulog,
    "dataflash": dataflash,
    "dataflash-text": dataflash_text,
    "csv": table,
}  #: format -> its logs
SHARES: Final = (0.0, 0.02, 0.1, 0.4)  #: shares of hostile choices of a log
