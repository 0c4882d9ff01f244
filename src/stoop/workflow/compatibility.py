"""Data compatibility of a flight: check, correct, write result, corrected flight and page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from stoop.base.files import write_text_atomic
from stoop.flight import Flight, save
from stoop.reconstruct.compatibility import Compatibility, check
from stoop.reconstruct.corrected import corrected_flight
from stoop.workflow.provenance import file_hashes, flight_files, versions

PAGE: Final = "compatibility.html"
FLIGHT: Final = "flight.nc"
RESULT: Final = "compatibility.json"
NAMES: Final = (PAGE, FLIGHT, RESULT)  #: the result last: where it is, the others are


def check_compatibility(
    flight: Flight, windows: Sequence[tuple[float, float]] = ()
) -> tuple[Compatibility, Flight]:
    """Return what the sensors contradict each other in, and the flight with their errors undone.

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
    """Write page, corrected flight and result into a folder that is there."""
    from stoop.report.consistency import consistency_sheet
    from stoop.report.sheet import write_sheet

    hashes = file_hashes([*flight_files([original]), *others])
    write_sheet(consistency_sheet(result, command), folder / PAGE)
    save(corrected, folder / FLIGHT)
    write_text_atomic(folder / RESULT, result.document(versions(), hashes))
