"""`stoop fleet`: what changed in a fleet, since which flight, and which part explains it; and fleets that are made up."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from stoop.extend.errors import StoopError
from stoop.extend.files import to_json
from stoop.extend.text import count, enumerated
from stoop.extend.verbs import LiveLine, Page, options, page, run_campaign

if TYPE_CHECKING:
    from stoop_fleet.store import Fleet, ToldAlarm

NEWS: Final = 3  #: exit code where alarms are new
UNUSABLE: Final = {"log": "not read:", "flight": "left out:"}  #: group -> what became of the flight
MOST: Final = 10  #: lines for each of these groups


def run(arguments: argparse.Namespace) -> int:
    """Update or open a fleet, print its alarms, and return 3 if some are new."""
    from stoop_fleet.parts import moment
    from stoop_fleet.store import open_fleet, updated_fleet

    since = None if arguments.since is None else moment("--since", arguments.since)
    if (folder := arguments.output) is None:
        given = (
            arguments.parts,
            arguments.alarms_a_year,
            arguments.flights,
            arguments.vehicle,
            arguments.mapping,
        )
        if len(arguments.sources) > 1 or any(given):
            raise StoopError("fleet: logs, tables, parts and a rate go into a store; name its folder with -o")
        return _tell(arguments, open_fleet(arguments.sources[0]), (), since)
    from stoop_fleet.update import add_page, read_sources

    of_logs = (arguments.vehicle, arguments.mapping, arguments.flights)
    tables, logs = read_sources(folder, arguments.sources, partial(run_campaign, arguments), *of_logs)
    with ExitStack() as held:
        with LiveLine("looking for changes"):
            words = (folder, tables, arguments.parts, arguments.alarms_a_year, logs)
            update = held.enter_context(updated_fleet(*words))
            add_page(update, options.command_line())
        code = _tell(arguments, update.fleet, update.fresh, since, update.absent)
        sys.stdout.flush()  # an alarm is told before the store says so
    return code


def _tell(
    arguments: argparse.Namespace,
    fleet: Fleet,
    told: Sequence[ToldAlarm],
    since: float | None,
    absent: Sequence[tuple[str, str, str]] = (),
) -> int:
    """Print the alarms that are new, or found since a time, and return 3 if there are some."""
    from stoop_fleet.store import document

    new = told if since is None else [a for a in fleet.standing() if a.found_time >= since]
    if arguments.json:
        alarms = [{**document(a), "new": a in new} for a in fleet.alarms]
        page().text(
            to_json({"alarms_a_year": fleet.alarms_a_year, "threshold": fleet.threshold, "alarms": alarms})
        )
    else:
        opened = arguments.output is None
        _print(fleet, new, opened and since is None, absent, not opened)
    return NEWS if new else 0


def simulate(arguments: argparse.Namespace) -> int:
    """Fly a fleet that is made up, write its logs, and print what to do next."""
    from stoop import load_maneuver, load_vehicle
    from stoop_fleet.simulation import ENDING, HOVER, PARTS, TRUTH, read_fleet, write_fleet

    if arguments.autopilot:
        arguments.complain("--autopilot flies one flight; leave it out, or --fleet")
    vehicle, folder = load_vehicle(arguments.vehicle), arguments.output
    fleet = read_fleet(arguments.fleet, vehicle)
    maneuver = HOVER if arguments.maneuver is None else load_maneuver(arguments.maneuver)
    with LiveLine(options.COMPILING) as live:
        flown = write_fleet(
            fleet, vehicle, maneuver, folder, arguments.seed, not arguments.no_noise, arguments.overwrite,
            lambda done, total: live.turn_to(f"flying: {done} of {count(total, 'flight')}"),
        )  # fmt: skip
    out = page()
    size = f"{count(fleet.vehicles, 'vehicle')}, {count(flown, 'flight')}"
    out.line(f"wrote {folder}: {size}, seed {arguments.seed}")
    out.line(f"wrote {folder / TRUTH}: what flew, {enumerated(fleet.numbers)}")
    words = ["--vehicle", str(arguments.vehicle), "--parts", str(folder / PARTS), "-o", f"{folder}-store"]
    out.command(f"next: stoop fleet {shlex.quote(str(folder))}/*{ENDING} ", words)
    return 0


def _print(
    fleet: Fleet, new: Sequence[ToldAlarm], every: bool, absent: Sequence[tuple[str, str, str]], updated: bool
) -> None:
    """Print a line for each alarm, all of them or the new ones, and what the logs could not tell."""
    from stoop_fleet.store import PAGE

    out = page()
    out.line(f"{fleet.extent()}; {fleet.alarms_a_year:g} false alarms a year")
    standing = fleet.standing()
    for alarm in standing if every else new:
        out.line(line(alarm))
    for alarm in fleet.alarms if every else ():
        if alarm.withdrawn:
            out.line(f"withdrawn: {line(alarm)}")
    if not (every or new):
        out.line(f"no new alarm; {count(len(standing), 'earlier one')}")
    if absent:
        _print_absent(absent, fleet.folder)
    for sentence in fleet.parts.unused(fleet.table) if updated else ():
        out.line(f"parts: {sentence} in parts.csv")
    if (path := fleet.folder / PAGE).exists() or updated:
        out.line(f"page: {path}")


def _print_absent(absent: Sequence[tuple[str, str, str]], folder: Path) -> None:
    """Print the logs that are of no use, with the reasons, and how many flights lack each group of figures."""
    from stoop_fleet.logs import ABSENT
    from stoop_fleet.table import REST

    out, file = page(), folder / ABSENT
    for group, what in UNUSABLE.items():
        own = [f"{what} {flight}: {reason}" for flight, of, reason in absent if of == group]
        for text in own[:MOST]:
            out.line(text)
        if len(own) > MOST:
            out.line(f"{what} {count(len(own) - MOST, 'more flight')} ({file} says why)")
    whole = (group for _, group, _ in absent if group not in UNUSABLE and not group.startswith(REST))
    groups = Counter(whole)
    if groups:
        told = ", ".join(f"{group} in {count(n, 'flight')}" for group, n in groups.items())
        out.line(f"absent: {told} ({file} says why)")


def line(alarm: ToldAlarm) -> str:
    """Return an alarm as a line: figure, size and error, since when, and the two likeliest causes."""
    return (
        f"{alarm.vehicle} {alarm.figure}: {alarm.kind} of {Page.number(alarm.size)} +- "
        f"{Page.number(alarm.std_error, 2)}{alarm.per} "
        f"since flight {alarm.since}, found in {alarm.found}: {alarm.explanation}"
    )
