"""Windows of flights: how a user names one, and windows.toml, which holds those that `stoop maneuvers` proposes.

A window is ``[FLIGHT@]START:STOP[#LOADING]``, seconds of the log's own clock, or the words ``start`` and ``end``. The user
edits windows.toml, and `stoop identify` takes it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, TypeAlias

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from stoop.base.arrays import BoolArray
from stoop.base.schema_errors import first_complaint
from stoop.base.toml import parse_source, quoted, read_source
from stoop.errors import FlightError, one_line
from stoop.flight import Flight

FORMAT: Final = "stoop-windows/1"
NAME: Final = "windows.toml"
MAX_WINDOWS: Final = 1000  #: in a file
HEAD: Final = """\
# Windows that stoop maneuvers proposes; times are seconds of the log's own clock. Edit start and stop, set accept to
# false for what is not to be used, use = "fit" or "validate", and give this file to
#   {command}
#
# information: by how much this window alone shrinks the error bars (mean logarithm; 0.69 halves them)
# gain:        likewise, beside the windows that were chosen before it
"""


@dataclass(frozen=True)
class Window:
    """One stretch of one flight, s on the log's own clock, with the name of the vehicle file's loading that was flown."""

    flight: str
    start: float
    stop: float
    loading: str | None = None

    def __str__(self) -> str:
        return f"{self.flight}@{self.start:g}:{self.stop:g}"


OneWindow: TypeAlias = str | tuple[float, float] | slice | Window
#: "140:145", (140, 145), slice(140, 145); one or several
Windows: TypeAlias = OneWindow | Sequence[OneWindow]


def as_windows(given: Windows, flights: Mapping[str, Flight]) -> tuple[Window, ...]:
    """Return windows, however they were written.

    Raises
    ------
    FlightError
        Of none of these forms, see :func:`parse_window`.
    """
    pair = isinstance(given, tuple) and len(given) == 2 and all(isinstance(x, int | float) for x in given)
    out = []
    for one in [given] if pair or isinstance(given, str | slice | Window) else given:
        edges = (one.start, one.stop) if isinstance(one, slice) else one
        text = ":".join(map(str, edges)) if isinstance(edges, tuple | list) else str(edges)
        out.append(one if isinstance(one, Window) else parse_window(text, flights))
    return tuple(out)


def whole(flights: Mapping[str, Flight]) -> list[Window]:
    """Return one window for each flight, all of it."""
    return [Window(f.name, float(f.time[0]), float(f.time[-1])) for f in flights.values()]


def within(flight: Flight, windows: Sequence[Window]) -> BoolArray:
    """Return which samples (n,) of a flight lie in some of its windows."""
    out = np.zeros(flight.time.size, dtype=np.bool_)
    for w in windows:
        out |= (flight.time >= w.start) & (flight.time <= w.stop)
    return out


def parse_window(text: str, flights: Mapping[str, Flight]) -> Window:
    """Read a window; the flight's name may be left out when there is one flight; ``start`` and ``end`` are the record's.

    Raises
    ------
    FlightError
        Not of this form, an unknown flight, or a window that ends before it begins.
    """
    text = text.strip()
    span, _, loading = text.partition("#")
    name, at, times = span.rpartition("@")
    if not at:
        if len(flights) != 1:
            raise FlightError(
                f"maneuver '{text}': several flights are given; write FLIGHT@START:STOP with one of {', '.join(flights)}"
            )
        name = next(iter(flights))
    if name not in flights:
        raise FlightError(
            f"maneuver '{text}': no flight is called '{name}'; flights are {', '.join(flights)}"
        )
    ends = {"start": 0, "end": -1}
    try:
        start, stop = (
            float(flights[name].time[ends[part]] if part in ends else part) for part in times.split(":")
        )
    except ValueError:
        raise FlightError(f"maneuver '{text}': write START:STOP in seconds, for example 140:145") from None
    if not (math.isfinite(start) and math.isfinite(stop) and start < stop):
        raise FlightError(f"maneuver '{text}': the start must come before the stop")
    return Window(name, start, stop, loading or None)


class Entry(BaseModel):
    """A window of a file; nothing depends on `axis`, `why`, `information` and `gain`, which are for the reader."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    flight: str = Field(min_length=1)
    start: float
    stop: float
    loading: str = ""
    axis: str = ""
    why: str = ""
    information: float = Field(default=0.0, allow_inf_nan=True)
    gain: float = Field(default=0.0, allow_inf_nan=True)
    accept: bool = True
    use: Literal["fit", "validate"] = "fit"

    @model_validator(mode="after")
    def _check_order(self) -> Entry:
        if not self.start < self.stop:
            raise ValueError(
                f"start = {self.start:g} is not before stop = {self.stop:g}; exchange or mend them"
            )
        return self

    @property
    def text(self) -> str:
        """The window as the command line takes it."""
        loading = f"#{self.loading}" if self.loading else ""
        return f"{self.flight}@{self.start:.13g}:{self.stop:.13g}{loading}"


class WindowsFile(BaseModel):
    """The content of a file."""

    model_config = ConfigDict(extra="forbid")

    format: Literal["stoop-windows/1"]
    window: tuple[Entry, ...] = Field(default=(), max_length=MAX_WINDOWS)


def written(entries: Sequence[Entry], command: str, notes: Sequence[str] = ()) -> str:
    """Return the text of a file for the `command` that takes it; `notes` are more comments, one line each."""
    lines = [*(f"# {one_line(note)}" for note in notes), f"format = {quoted(FORMAT)}"]
    for entry in entries:
        lines += ["", "[[window]]"]
        for key, value in entry:
            if isinstance(value, bool):
                text = str(value).lower()
            elif isinstance(value, str):
                text = quoted(value)
            else:
                text = f"{value:.3f}" if key in ("information", "gain") else f"{value:.13g}"
            if key != "loading" or value:
                lines.append(f"{key} = {text}")
    return HEAD.format(command=one_line(command)) + "\n".join([*lines, ""])


def read_windows(path: Path) -> tuple[Entry, ...]:
    """Read a file that the user may have edited.

    Raises
    ------
    FlightError
        In one line: which window, what is wrong, what to write.
    """
    document = parse_source(read_source(path, "windows", FlightError), str(path), FlightError)
    if document.get("format") != FORMAT:
        raise FlightError(f'{path}: format is not "{FORMAT}"; write that line, or run stoop maneuvers again')
    try:
        return WindowsFile.model_validate(document).window
    except ValidationError as error:
        raise FlightError(f"{path}: {one_line(first_complaint(error, document, WindowsFile))}") from None


def files_among(texts: Sequence[str]) -> list[Path]:
    """Return the files among windows of the command line."""
    return [Path(text) for text in texts if text.endswith(".toml")]


def expanded(maneuvers: Sequence[str], validate: Sequence[str]) -> tuple[list[str], list[str]]:
    """Replace files among windows by the accepted windows that they hold.

    Windows to validate of a file among the maneuvers are taken where none are given otherwise.

    Raises
    ------
    FlightError
        A file cannot be read, or nothing in it is accepted.
    """
    files = [str(path) for path in files_among(maneuvers)]
    found: list[list[str]] = []
    for use, texts in (("fit", maneuvers), ("validate", validate or files)):
        found.append([])
        for text in texts:
            entries = read_windows(Path(text)) if text.endswith(".toml") else [None]
            found[-1] += [e.text if e else text for e in entries if e is None or (e.accept and e.use == use)]
    if maneuvers and not found[0]:
        raise FlightError(
            f'{", ".join(files)}: no window is accepted for fitting; set accept = true and use = "fit" in one'
        )
    return found[0], found[1]
