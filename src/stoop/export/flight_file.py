"""A flight written as the log of an autopilot, or as a table, with a mapping beside it where one is needed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from stoop.base.files import write_bytes_atomic
from stoop.errors import OutputError
from stoop.export.ardupilot_log import ardupilot_log
from stoop.export.crazyflie_log import crazyflie_log
from stoop.export.px4_log import px4_log
from stoop.export.tables import TABLES
from stoop.flight import Flight, save
from stoop.logs.table import beside

OWN: Final = ".nc"
LOGS: Final[dict[str, Callable[[Flight], tuple[bytes, str]]]] = {
    ".ulg": px4_log,
    ".bin": ardupilot_log,
    ".usd": crazyflie_log,
    **TABLES,
}  #: ending -> log and mapping
ENDINGS: Final = (OWN, *LOGS)


def check_ending(target: Path) -> None:
    """Refuse a name by which the file could not be read again.

    Raises
    ------
    OutputError
        With the endings that there are.
    """
    if target.suffix.lower() not in ENDINGS:
        raise OutputError(
            f"{target}: no kind of flight file; end its name in {', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}"
        )


def save_flight_as(flight: Flight, target: Path) -> Path | None:
    """Write a flight in the form that the ending of the file tells.

    Parameters
    ----------
    flight : whose channels share one clock
    target : ends in one of `ENDINGS`

    Returns
    -------
    Path or None : the mapping that was written beside it

    Raises
    ------
    OutputError
        When it cannot be written.
    """
    check_ending(target)
    if target.suffix.lower() == OWN:
        save(flight, target)
        return None
    content, mapping = LOGS[target.suffix.lower()](flight)
    place = beside(target)
    write_bytes_atomic(target, content)
    if mapping:
        write_bytes_atomic(place, mapping.encode())
        return place
    place.unlink(missing_ok=True)
    return None
