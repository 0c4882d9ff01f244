"""windows.toml: windows of flights that `stoop maneuvers` proposes, the user edits, and `stoop identify` takes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from stoop.base.text import nearest
from stoop.base.toml import parse_source, read_source
from stoop.errors import FlightError, one_line
from stoop.logs.table import quoted

FORMAT: Final = "stoop-windows/1"
NAME: Final = "windows.toml"
USES: Final = ("fit", "validate")
MOST: Final = 1000  #: windows in a file
KEYS: Final = ("flight", "start", "stop", "loading", "axis", "why", "information", "gain", "accept", "use")
HEAD: Final = """\
# Windows that stoop maneuvers proposes; times are seconds of the log's own clock. Edit start and stop, set accept to
# false for what is not to be used, use = "fit" or "validate", and give this file to
#   {command}
#
# information: by how much this window alone shrinks the error bars (mean logarithm; 0.69 halves them)
# gain:        likewise, beside the windows that were chosen before it
"""


@dataclass(frozen=True)
class Entry:
    """A window of a file.

    Attributes
    ----------
    flight, start, stop : name, and s on the log's own clock
    accept : whether it is to be used
    use : "fit" or "validate"
    loading : of the vehicle file, or empty
    axis, why, information, gain : for the reader; nothing depends on them
    """

    flight: str
    start: float
    stop: float
    accept: bool = True
    use: str = "fit"
    loading: str = ""
    axis: str = ""
    why: str = ""
    information: float = 0.0
    gain: float = 0.0

    @property
    def text(self) -> str:
        """The window as the command line takes it."""
        return f"{self.flight}@{self.start:.13g}:{self.stop:.13g}" + (
            f"#{self.loading}" if self.loading else ""
        )


def written(entries: Sequence[Entry], command: str, notes: Sequence[str] = ()) -> str:
    """Return the text of a file.

    Parameters
    ----------
    entries : the windows
    command : which takes the file
    notes : more comments, one line each
    """
    blocks = [_block(entry) for entry in entries]
    said = [f"# {one_line(note)}" for note in notes]
    head = HEAD.format(command=one_line(command)) + "".join(f"{line}\n" for line in said)
    return "\n".join([f"{head}format = {quoted(FORMAT)}", *blocks, ""])


def _block(entry: Entry) -> str:
    lines = ["", "[[window]]", f"flight = {quoted(entry.flight)}"]
    lines += [f"start = {entry.start:.13g}", f"stop = {entry.stop:.13g}"]
    lines += [f"loading = {quoted(entry.loading)}"] if entry.loading else []
    lines += [f"axis = {quoted(entry.axis)}", f"why = {quoted(entry.why)}"]
    lines += [f"information = {entry.information:.3f}", f"gain = {entry.gain:.3f}"]
    lines += [f"accept = {str(entry.accept).lower()}", f"use = {quoted(entry.use)}"]
    return "\n".join(lines)


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
    rows = document.get("window", [])
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows) or len(rows) > MOST:
        raise FlightError(f"{path}: write each window below a line [[window]], at most {MOST} of them")
    return tuple(_entry(f"{path}: window {i}", row) for i, row in enumerate(rows, 1))


def _entry(where: str, row: Mapping[str, Any]) -> Entry:
    for key in row:
        if key not in KEYS:
            raise FlightError(f"{where}: '{key}' is not known; {nearest(key, KEYS)}")
    start, stop = (_number(where, row, key) for key in ("start", "stop"))
    if not start < stop:
        raise FlightError(f"{where}: start = {start:g} is not before stop = {stop:g}; exchange or mend them")
    accept, use = row.get("accept", True), row.get("use", "fit")
    if not isinstance(accept, bool):
        raise FlightError(f"{where}: accept = {accept!r}; write accept = true or accept = false")
    if use not in USES:
        raise FlightError(f'{where}: use = {use!r}; write use = "fit" or use = "validate"')
    flight, loading = (_text(where, row, key) for key in ("flight", "loading"))
    if not flight:
        raise FlightError(
            f'{where}: names no flight; write flight = "NAME", the name of the log without its ending'
        )
    return Entry(flight, start, stop, accept, use, loading)


def _number(where: str, row: Mapping[str, Any], key: str) -> float:
    value = row.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise FlightError(
            f"{where}: {key} is no number; write {key} = SECONDS on the log's own clock, such as 140.5"
        )
    return float(value)


def _text(where: str, row: Mapping[str, Any], key: str) -> str:
    value = row.get(key, "")
    if not isinstance(value, str):
        raise FlightError(f'{where}: {key} = {value!r}; write it in quotes: {key} = "NAME"')
    return value


def expanded(maneuvers: Sequence[str], validate: Sequence[str]) -> tuple[list[str], list[str]]:
    """Replace files among windows by the accepted windows that they hold.

    Windows to validate of a file among the maneuvers are taken where none are given otherwise.

    Raises
    ------
    FlightError
        A file cannot be read, or nothing in it is accepted.
    """
    fitted, offered = _taken(maneuvers, "fit"), _taken([m for m in maneuvers if _is_file(m)], "validate")
    if not fitted and maneuvers:
        files = ", ".join(m for m in maneuvers if _is_file(m))
        raise FlightError(
            f'{files}: no window is accepted for fitting; set accept = true and use = "fit" in one'
        )
    return fitted, _taken(validate, "validate") if validate else offered


def _taken(texts: Sequence[str], use: str) -> list[str]:
    out: list[str] = []
    for text in texts:
        entries = read_windows(Path(text)) if _is_file(text) else ()
        out += [e.text for e in entries if e.accept and e.use == use] if _is_file(text) else [text]
    return out


def _is_file(text: str) -> bool:
    return text.endswith(".toml")


def files_among(texts: Sequence[str]) -> list[Path]:
    """Return the files among windows of the command line."""
    return [Path(text) for text in texts if _is_file(text)]
