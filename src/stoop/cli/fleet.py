"""`stoop fleet`: what changed in a fleet, since which flight, and which part explains it."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

from stoop.base.numbers import count
from stoop.base.text import show
from stoop.cli import options
from stoop.cli.page import number, page, to_json
from stoop.cli.progress import LiveLine
from stoop.errors import StoopError

if TYPE_CHECKING:
    from stoop.fleet.store import Fleet, ToldAlarm

NEWS: Final = 3  #: exit code where alarms are new


def run(arguments: argparse.Namespace) -> int:
    """Update or open a fleet, print its alarms, and return 3 if some are new."""
    from stoop.fleet.page import fleet_page
    from stoop.fleet.parts import moment
    from stoop.fleet.store import PAGE, document, open_fleet, update_fleet

    since = None if arguments.since is None else moment("--since", arguments.since)
    told: tuple[ToldAlarm, ...] = ()
    if arguments.output is None:
        if len(arguments.sources) > 1 or arguments.parts or arguments.alarms_a_year:
            raise StoopError("fleet: tables, parts and a rate go into a store; name its folder with -o")
        fleet = open_fleet(arguments.sources[0])
    else:
        with LiveLine("looking for changes"):
            update = (arguments.parts, arguments.alarms_a_year)
            fleet, told, found = update_fleet(arguments.output, [*map(Path, arguments.sources)], *update)
            fleet_page(fleet, found, options.command_line()).save(arguments.output / PAGE)
    new = told if since is None else tuple(a for a in fleet.standing() if a.found_time >= since)
    if arguments.json:
        alarms = [{**document(a), "new": a in new} for a in fleet.alarms]
        show(to_json({"alarms_a_year": fleet.alarms_a_year, "threshold": fleet.threshold, "alarms": alarms}))
    else:
        _print(fleet, new, arguments.output is None and since is None)
    return NEWS if new else 0


def _print(fleet: Fleet, new: Sequence[ToldAlarm], every: bool) -> None:
    """Print a line for each alarm: all of them, or the new ones."""
    from stoop.fleet.store import PAGE

    out, table = page(), fleet.table
    vehicles, flights = set(table.vehicle), set(zip(table.vehicle, table.flight, strict=True))
    out.line(
        f"{count(len(vehicles), 'vehicle')}, {count(len(flights), 'flight')}, {count(len(table.figures()), 'figure')}; "
        f"{fleet.alarms_a_year:g} false alarms a year"
    )
    standing = fleet.standing()
    for alarm in standing if every else new:
        out.line(line(alarm))
    for alarm in fleet.alarms if every else ():
        if alarm.withdrawn:
            out.line(f"withdrawn: {line(alarm)}")
    if not (every or new):
        out.line(f"no new alarm; {count(len(standing), 'earlier one')}")
    if (path := fleet.folder / PAGE).exists():
        out.line(f"page: {path}")


def line(alarm: ToldAlarm) -> str:
    """Return an alarm as a line: figure, size and error, since when, and the two likeliest causes."""
    day = datetime.fromtimestamp(alarm.began_time, UTC).date()
    unit = " a day" if alarm.kind == "drift" else ""
    causes = ", or ".join(f"{cause.name} ({100.0 * cause.probability:.0f} %)" for cause in alarm.causes[:2])
    return (
        f"{alarm.vehicle} {alarm.figure}: {alarm.kind} of {number(alarm.size)} +- {number(alarm.std_error, 2)}{unit} "
        f"since flight {alarm.began} ({day}), found in {alarm.found}: {causes}"
    )
