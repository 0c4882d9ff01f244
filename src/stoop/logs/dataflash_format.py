"""What an FMT message says of a kind of messages: its name, its columns and how each is stored.

Source of the letters and multipliers: ArduPilot, libraries/AP_Logger/LogStructure.h.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray
from stoop.errors import one_line

Bytes = npt.NDArray[np.uint8]

TYPES: Final = {
    "a": "(32,)<i2", "b": "<i1", "B": "<u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4",
    "g": "<f2", "f": "<f4", "d": "<f8", "n": "S4", "N": "S16", "Z": "S64",
    "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4", "M": "<u1", "q": "<i8", "Q": "<u8",
}  #: letter of the format -> NumPy's name of the type  # fmt: skip
DIVISORS: Final = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}
TEXTS: Final = "nNZ"
PREFIXES: Final = {1e-1: "d", 1e-2: "c", 1e-3: "m", 1e-6: "u", 1e-9: "n"}
SPELLINGS: Final = {
    "m/s/s": "m/s2", "deg/s/s": "deg/s2", "rad/s/s": "rad/s2", "N.m": "N m", "Watt": "W",
    "degheading": "deg", "deglatitude": "deg", "deglongitude": "deg", "UNKNOWN": "", "instance": "",
}  #: unit as ArduPilot writes it -> as stoop does; the rest is the same  # fmt: skip
BODY: Final = np.dtype(
    [("kind", "u1"), ("length", "u1"), ("name", "S4"), ("format", "S16"), ("columns", "S64")]
)


@dataclass(frozen=True)
class Layout:
    """One kind of messages.

    Attributes
    ----------
    kind : id, the third byte of each message
    name : such as "IMU"
    letters : one for each column
    columns : names, without repetition
    scaled : columns whose letter says by how much a number in the log is to be divided
    """

    kind: int
    name: str
    letters: str
    columns: tuple[str, ...]
    scaled: frozenset[str]

    @property
    def row(self) -> np.dtype[Any]:
        """Return the type of a body; its fields are called 0, 1, 2."""
        return np.dtype([(str(i), TYPES[letter]) for i, letter in enumerate(self.letters)])

    def letter(self, column: str) -> str:
        """Return the letter of a column; empty if there is none."""
        return self.letters[self.columns.index(column)] if column in self.columns else ""


def parse_layout(body: bytes) -> Layout | None:
    """Read the body of an FMT message; None where it makes no sense (damage, or letters that came later)."""
    fields = np.frombuffer(body, BODY)[0]
    columns = text(fields["columns"])
    layout = make_layout(int(fields["kind"]), text(fields["name"]), text(fields["format"]), columns)
    if layout is None or layout.row.itemsize != int(fields["length"]) - 3:
        return None
    return layout


def make_layout(kind: int, name: str, letters: str, columns: str) -> Layout | None:
    """Build a layout of texts; None where they make no sense."""
    names = tuple(columns.split(",")) if columns else ()
    plain = name.isascii() and name.isprintable() and name.strip() == name != "" and "/" not in name
    sound = 0 < len(names) == len(letters) == len(set(names)) and all(n.isprintable() and n for n in names)
    if not (plain and sound and set(letters) <= TYPES.keys()):
        return None
    scaled = frozenset(n for n, letter in zip(names, letters, strict=True) if letter in DIVISORS)
    return Layout(kind, name, letters, names, scaled)


def text(content: bytes) -> str:
    """Return what is written before the first zero; bytes that are no UTF-8 are Latin, unprintable ones blanks."""
    written = bytes(content).split(b"\0", 1)[0]
    try:
        decoded = written.decode()
    except UnicodeDecodeError:
        decoded = written.decode("latin-1")
    return one_line(decoded)


def unit(label: str, multiplier: float) -> str:
    """Return the unit of a column as stoop spells it: "mV" for volts of which one is a thousandth.

    Parameters
    ----------
    label : as an UNIT message has it
    multiplier : as a MULT message has it; 0 and 1 mean none
    """
    base = SPELLINGS.get(label, label)
    rounded = float(f"{multiplier:.7g}")  # written as float, kept as double
    if not base or rounded in (0.0, 1.0):
        return base
    return PREFIXES[rounded] + base if rounded in PREFIXES else f"{rounded:.4g} {base}"


@dataclass(frozen=True)
class Messages:
    """All messages of one kind, in the order of the log.

    Attributes
    ----------
    layout : of their bodies
    rows : (n,) bodies; the fields are called 0, 1, 2
    """

    layout: Layout
    rows: npt.NDArray[Any]

    def texts(self, column: str) -> list[str]:
        """Return a column of text; empty if it holds none."""
        if self.layout.letter(column) not in {*TEXTS}:
            return []
        return [text(value) for value in self.rows[str(self.layout.columns.index(column))]]

    def numbers(self, column: str) -> FloatArray:
        """Return a column of numbers; empty if it holds none."""
        columns = Columns(self.layout, self.rows, frozenset())
        return columns[column] if column in columns else np.empty(0)


class Columns(Mapping[str, FloatArray]):
    """Numeric columns of the messages of one kind, turned into float64 when they are asked for.

    Parameters
    ----------
    layout : of the messages
    rows : (n,) their bodies
    left_out : columns that are not shown, such as the clock
    """

    def __init__(self, layout: Layout, rows: npt.NDArray[Any], left_out: frozenset[str]) -> None:
        self._rows = rows
        self._places: dict[str, tuple[str, int | None, float]] = {}
        for i, (name, letter) in enumerate(zip(layout.columns, layout.letters, strict=True)):
            if name not in left_out and letter not in TEXTS:
                self._places |= _places(name, str(i), letter)

    def __getitem__(self, name: str) -> FloatArray:
        field, element, divisor = self._places[name]
        values = self._rows[field] if element is None else self._rows[field][:, element]
        with np.errstate(invalid="ignore"):  # a signaling NaN is a NaN
            numbers = np.asarray(values, dtype=np.float64)
        return numbers / divisor if divisor != 1.0 else numbers

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


def _places(name: str, field: str, letter: str) -> dict[str, tuple[str, int | None, float]]:
    if letter == "a":
        return {f"{name}[{k}]": (field, k, 1.0) for k in range(32)}
    return {name: (field, None, DIVISORS.get(letter, 1.0))}
