"""The file windows.toml: `stoop maneuvers` proposes windows in it, the user edits it, `stoop identify` takes it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from stoop.extend.errors import FlightError
from stoop.extend.files import first_complaint, toml
from stoop.extend.text import printable

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
    lines = [*(f"# {printable(note)}" for note in notes), f"format = {toml.quoted(FORMAT)}"]
    for entry in entries:
        lines += ["", "[[window]]"]
        for key, value in entry:
            if isinstance(value, bool):
                text = str(value).lower()
            elif isinstance(value, str):
                text = toml.quoted(value)
            else:
                text = f"{value:.3f}" if key in ("information", "gain") else f"{value:.13g}"
            if key != "loading" or value:
                lines.append(f"{key} = {text}")
    return HEAD.format(command=printable(command)) + "\n".join([*lines, ""])


def read_windows(path: Path) -> tuple[Entry, ...]:
    """Read a file that the user may have edited.

    Raises
    ------
    FlightError
        In one line: which window, what is wrong, what to write.
    """
    document = toml.parse_source(toml.read_source(path, "windows", FlightError), str(path), FlightError)
    if document.get("format") != FORMAT:
        raise FlightError(f'{path}: format is not "{FORMAT}"; write that line, or run stoop maneuvers again')
    try:
        return WindowsFile.model_validate(document).window
    except ValidationError as error:
        raise FlightError(f"{path}: {printable(first_complaint(error, document, WindowsFile))}") from None


def expanded(maneuvers: Sequence[str], validate: Sequence[str]) -> tuple[list[str], list[str]]:
    """Replace files among windows by the accepted windows that they hold.

    Windows to validate of a file among the maneuvers are taken where none are given otherwise.

    Raises
    ------
    FlightError
        A file cannot be read, or nothing in it is accepted.
    """
    files = [text for text in maneuvers if text.endswith(".toml")]
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
