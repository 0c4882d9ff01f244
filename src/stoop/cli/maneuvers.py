"""`stoop maneuvers`: which windows of a flight to fit, and which to predict."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from dataclasses import replace
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.base.notices import as_notice
from stoop.cli.freed import freed
from stoop.cli.outputs import check_targets
from stoop.cli.page import Page, busy, page
from stoop.cli.point import COMPILING, LOG_HELP, MAPPING_HELP, VEHICLE_HELP
from stoop.cli.progress import Watch
from stoop.cli.tables import Column, fixed, numbers, points, words
from stoop.errors import FlightError, VehicleError

if TYPE_CHECKING:
    from stoop.design.windows import Found
    from stoop.flight import Flight
    from stoop.vehicle import Vehicle


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add("flight", metavar="FLIGHT", nargs="+", type=Path, help=f"flight log(s) of one vehicle: {LOG_HELP}")
    without = "without it windows are chosen that move each axis by itself"
    add("--vehicle", metavar="V.toml", default="", help=f"{VEHICLE_HELP}; {without}")
    add("--mapping", metavar="M.toml", type=Path, help=MAPPING_HELP)
    add(
        "--free", metavar="NAME", action="append", default=[], help="estimate this number of the vehicle file"
    )
    add("--fix", metavar="NAME", action="append", default=[], help="hold this number")
    add(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        required=True,
        help="folder for windows.toml and windows.html",
    )
    add("--overwrite", action="store_true", help="replace earlier windows in DIR")


def run(arguments: argparse.Namespace) -> int:
    """Find, write, and say what was found."""
    from stoop.workflow.windows import FILES, write_windows

    check_targets(arguments.output, FILES, arguments.overwrite, _inputs(arguments))
    from stoop.design.windows import doubts, find_windows
    from stoop.flight import load, without_faults

    vehicle = _vehicle(arguments)
    with busy("reading the log"):
        flights = _by_name([without_faults(load(path, arguments.mapping)) for path in arguments.flight])
    with Watch(COMPILING if vehicle is not None else "looking for maneuvers") as watch:
        warned = doubts(flights, vehicle) if vehicle is not None else []
        for doubt in warned:
            watch.warn(doubt)
        found = find_windows(flights, vehicle, watch.turn_to)
    command, following = shlex.join(["stoop", *sys.argv[1:]]), _next(arguments)
    written = replace(found, notices=(*map(as_notice, warned), *found.notices))
    name = "" if vehicle is None else vehicle.name
    write_windows(written, flights, name, arguments.output, command, following)
    _tell(page(), found, arguments.output, following)
    return 0


def _inputs(arguments: argparse.Namespace) -> list[Path]:
    named = [Path(arguments.vehicle)] if arguments.vehicle else []
    return [*arguments.flight, *named, *([arguments.mapping] if arguments.mapping else [])]


def _vehicle(arguments: argparse.Namespace) -> Vehicle | None:
    from stoop.vehicle.builtin import resolve_vehicle

    if not arguments.vehicle:
        if arguments.free or arguments.fix:
            raise VehicleError("--free and --fix choose numbers of a vehicle file; name it with --vehicle")
        return None
    return freed(resolve_vehicle(arguments.vehicle), arguments.free, arguments.fix)


def _by_name(flights: Sequence[Flight]) -> dict[str, Flight]:
    out = {flight.name: flight for flight in flights}
    if len(out) < len(flights):
        raise FlightError("maneuvers: two flights have the same name; rename one of the files")
    return out


def _next(arguments: argparse.Namespace) -> list[str]:
    from stoop.problem.windows_file import NAME

    mapping = ["--mapping", str(arguments.mapping)] if arguments.mapping else []
    numbers_ = [word for name in arguments.free for word in ("--free", name)]
    numbers_ += [word for name in arguments.fix for word in ("--fix", name)]
    vehicle, windows = arguments.vehicle or "V.toml", str(arguments.output / NAME)
    flights = [str(path) for path in arguments.flight]
    return [
        "stoop", "identify", *flights, *mapping, "--vehicle", vehicle, *numbers_, "--maneuver", windows, "-o", "result",
    ]  # fmt: skip


def _tell(out: Page, found: Found, folder: Path, following: Sequence[str]) -> None:
    from stoop.problem.windows_file import NAME

    out.table(_windows(found))
    if found.expected:
        _tell_expected(out, found)
    if found.notices:
        out.heading("notes")
        out.bullets(map(str, found.notices))
    out.line()
    out.line(f"edit: {folder / NAME}")
    out.line(f"page: {folder / 'windows.html'}")
    out.command("next: ", following)


def _windows(found: Found) -> list[Column]:
    from stoop.workflow.windows import kind_of, numbered, span_of

    rows = numbered(found)
    return [
        fixed("", [i for i, _ in rows], 0),
        words("window s", [span_of(w, found) for _, w in rows]),
        words("use", [kind_of(w) for _, w in rows]),
        words("axis", [w.axis for _, w in rows]),
        fixed("information", [w.information for _, w in rows], 2),
        points("gain", [f"{w.gain:.2f}" if w.gain else "-" for _, w in rows]),
        words("why", [w.why for _, w in rows], wraps=True),
    ]


def _tell_expected(out: Page, found: Found) -> None:
    from stoop.workflow.windows import FIRST_GUESS, percent

    out.heading("expected of the windows to be fitted")
    out.line(FIRST_GUESS)
    out.table(
        [
            words("", [e.name for e in found.expected]),
            numbers("first guess", [e.value for e in found.expected]),
            numbers("std error", [e.std_error if isfinite(e.std_error) else nan for e in found.expected]),
            Column("of its size", tuple(percent(e.relative) for e in found.expected), right=True),
        ]
    )
