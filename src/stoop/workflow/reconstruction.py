"""The data compatibility of a flight, by its reconstructed flight path."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from stoop.base.files import make_folder, write_files
from stoop.flight import Flight, flight_bytes
from stoop.reconstruction.compatibility import Compatibility, corrected_flight
from stoop.workflow.outputs import file_hashes, flight_files, versions

COMPATIBILITY: Final = ("compatibility.html", "flight.nc", "compatibility.json")
"""Files; the result last: where it is, the others are."""


def check_compatibility(
    flight: Flight, windows: Sequence[tuple[float, float]] = ()
) -> tuple[Compatibility, Flight]:
    """Return the contradictions between the sensors, and the flight with their errors corrected.

    `windows` are (start, stop) in s on the log's own clock; the airborne part without any.

    Raises
    ------
    FlightError
        The flight holds nothing that could be compared.
    """
    result, found = Compatibility.of(flight, windows)
    return result, corrected_flight(found)


def write_compatibility(
    result: Compatibility,
    original: Flight,
    corrected: Flight,
    folder: Path,
    command: str,
    others: Sequence[Path] = (),
) -> None:
    """Write page, corrected flight and result into a folder, all or none."""
    from stoop.report.reconstruction import compatibility_sheet
    from stoop.report.sheet import render_sheet

    make_folder(folder)
    hashes = file_hashes([*flight_files([original]), *others])
    page = render_sheet(compatibility_sheet(result, command))
    contents = page, flight_bytes(corrected), result.document(versions(), hashes)
    write_files(folder, dict(zip(COMPATIBILITY, contents, strict=True)))
