"""Data compatibility of a flight: check, correct, write result, corrected flight and page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from stoop.base.files import make_folder, write_text_atomic
from stoop.flight import Flight, save
from stoop.reconstruction.compatibility import Compatibility, check
from stoop.reconstruction.corrected import corrected_flight
from stoop.workflow.provenance import file_hashes, flight_files, versions

PAGE: Final = "compatibility.html"
FLIGHT: Final = "flight.nc"
RESULT: Final = "compatibility.json"
NAMES: Final = (PAGE, FLIGHT, RESULT)  #: the result last: where it is, the others are


def check_compatibility(
    flight: Flight, windows: Sequence[tuple[float, float]] = ()
) -> tuple[Compatibility, Flight]:
    """Return the contradictions between the sensors, and the flight with their errors corrected.

    Parameters
    ----------
    flight : Flight
    windows : sequence of (start, stop)
        s on the log's own clock; the airborne part without any.

    Raises
    ------
    FlightError
        The flight holds nothing that could be compared.
    """
    result, found = check(flight, windows)
    return result, corrected_flight(found)


def write_compatibility(
    result: Compatibility,
    original: Flight,
    corrected: Flight,
    folder: Path,
    command: str,
    others: Sequence[Path] = (),
) -> None:
    """Write page, corrected flight and result into a folder, the result last."""
    from stoop.report.compatibility import compatibility_sheet
    from stoop.report.sheet import write_sheet

    make_folder(folder)
    hashes = file_hashes([*flight_files([original]), *others])
    write_sheet(compatibility_sheet(result, command), folder / PAGE)
    save(corrected, folder / FLIGHT)
    write_text_atomic(folder / RESULT, result.document(versions(), hashes))
