"""Proposed windows as a file to edit and a page to look at."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from stoop.base.files import make_folder, write_text_atomic
from stoop.flight import Flight
from stoop.input_design.windows import Found
from stoop.problem.windows import NAME, Entry, written

FILES: Final = (NAME, "windows.html")


def write_windows(
    found: Found,
    flights: Mapping[str, Flight],
    vehicle: str,
    folder: Path,
    command: str,
    following: Sequence[str],
) -> None:
    """Write `windows.toml` and `windows.html` into a folder; each whole or not at all.

    Parameters
    ----------
    vehicle : name of the vehicle, or empty
    command : by which they were made
    following : words of the command that takes the file
    """
    from stoop.report.sheet import write_sheet
    from stoop.report.windows import windows_sheet

    make_folder(folder)
    entries = [
        Entry(
            flight=w.flight, start=w.start, stop=w.stop, accept=w.accept, use=w.use, axis=w.axis, why=w.why,
            information=round(w.information, 3), gain=round(w.gain, 3),
        )
        for w in found.windows
    ]  # fmt: skip
    write_text_atomic(folder / NAME, written(entries, shlex.join(following), tuple(map(str, found.notices))))
    write_sheet(windows_sheet(found, flights, vehicle, command, following), folder / "windows.html")
