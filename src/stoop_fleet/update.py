"""An update of a fleet from logs and tables: what the command and Python share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from stoop.extend.campaigns import Plan, execute, forget
from stoop.extend.errors import StoopError
from stoop.extend.reports import sheet
from stoop_fleet.logs import LogFigures, gathered, is_table, plan, store_of
from stoop_fleet.page import fleet_page
from stoop_fleet.store import PAGE, Update, earlier_state, updated_fleet
from stoop_fleet.table import LOGS


def update_fleet(
    folder: Path | str,
    sources: Sequence[Path | str],
    *,
    vehicle: Path | str | None = None,
    parts: Path | str | None = None,
    flights: Path | str | None = None,
    mapping: Path | str | None = None,
    alarms_a_year: float | None = None,
    executor: Executor | None = None,
) -> Update:
    """Add logs and tables of figures to the fleet in a folder, or begin one; as ``stoop fleet -o``.

    Parameters
    ----------
    folder : Path or str
        The store.
    sources : sequence of Path or str
        Logs and tables; a table of the name of an earlier one replaces it.
    vehicle, flights, mapping : Path or str, optional
        Of the logs: vehicle file or built-in vehicle, table of the flights, and mapping.
    parts : Path or str, optional
        Table of parts; by default the earlier one.
    alarms_a_year : float, optional
        Rate of false alarms of the whole fleet; by default the earlier one, else 1.
    executor : concurrent.futures.Executor, optional
        Reads the logs; by default processes on this machine, which a script starts under ``if __name__ == "__main__"``.

    Returns
    -------
    Update
        With ``fleet``, the alarms that are new as ``fresh``, and ``absent``: (flight, group, reason) of what logs cannot tell.

    Raises
    ------
    StoopError
        One line; the fleet is what it was.
    """
    files = (None if one is None else Path(one) for one in (parts, flights, mapping))
    folder, (of_parts, of_flights, of_columns) = Path(folder), files
    run = partial(execute, pool=executor)
    name = None if vehicle is None else str(vehicle)
    tables, logs = read_sources(folder, [*map(Path, sources)], run, name, of_columns, of_flights)
    with updated_fleet(folder, tables, of_parts, alarms_a_year, logs) as update:
        add_page(update)
    return update


def read_sources(
    folder: Path,
    sources: Sequence[Path],
    run: Callable[[Plan, Path], Mapping[str, Any]],
    vehicle: str | None,
    mapping: Path | None,
    flights: Path | None,
) -> tuple[list[Path], Callable[[], LogFigures] | None]:
    """Return the tables among sources, and what gathers the figures of the logs, which `run` has read into a store of its own."""
    tables = [path for path in sources if is_table(path)]
    logs = [path for path in sources if path not in tables]
    earlier_state(folder)  # one that is not fit is refused before the logs are read
    if not logs:
        if flights or vehicle or mapping:
            raise StoopError("fleet: --flights, --vehicle and --mapping are for logs, and no log was named")
        return tables, None
    reading = plan(logs, vehicle, mapping, flights, folder)
    results = run(reading.campaign, kept := store_of(folder))
    if not (any(one["figures"] for one in results.values()) or (folder / LOGS).exists()):
        forget(kept)  # nothing in it is worth keeping
        with suppress(OSError):
            folder.rmdir()
        gathered(reading, results, folder)
    return tables, partial(gathered, reading, results, folder)


def add_page(update: Update, command: str = "") -> None:
    """Add the page, which names the command, to the files of an update."""
    page = fleet_page(update.fleet, update.analysis, command)
    update.files[PAGE] = sheet.render_sheet(page.content)
