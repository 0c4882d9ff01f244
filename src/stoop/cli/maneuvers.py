"""`stoop maneuvers`: which windows of a flight to fit, and which to predict."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.base.files import check_targets
from stoop.base.notices import as_notice
from stoop.cli.arguments import (
    COMPILING,
    VEHICLE_HELP,
    add_flights,
    add_folder,
    add_free_fix,
    command_line,
    given_paths,
    with_free,
)
from stoop.cli.page import Page, busy, page
from stoop.cli.progress import Watch
from stoop.cli.tables import Column, fixed, numbers, points, words
from stoop.errors import VehicleError

if TYPE_CHECKING:
    from stoop.input_design.windows import Found
    from stoop.vehicle import Vehicle


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    without = "without it windows are chosen that move each axis by itself"
    add_flights(parser, "flight log(s) of one vehicle")
    parser.add_argument("--vehicle", metavar="V.toml", default="", help=f"{VEHICLE_HELP}; {without}")
    add_free_fix(parser)
    add_folder(parser, "windows.toml and windows.html", "earlier windows in DIR")


def run(arguments: argparse.Namespace) -> int:
    """Find, write, and print what was found."""
    from stoop.workflow.maneuvers import FILES, write_windows

    inputs = [*arguments.flight, *given_paths(arguments.mapping)]
    inputs += [Path(arguments.vehicle)] if arguments.vehicle else []
    check_targets(arguments.output, FILES, arguments.overwrite, inputs)
    from stoop.flight import load, without_faults
    from stoop.input_design.windows import doubts, find_windows
    from stoop.workflow.provenance import by_name

    vehicle = _vehicle(arguments)
    with busy("reading the log"):
        read = [without_faults(load(path, arguments.mapping)) for path in arguments.flight]
        flights = by_name(read, "maneuvers")
    with Watch(COMPILING if vehicle is not None else "looking for maneuvers") as watch:
        warned = doubts(flights, vehicle) if vehicle is not None else []
        for doubt in warned:
            watch.warn(str(doubt))
        found = find_windows(flights, vehicle, watch.turn_to)
    following = _next(arguments)
    all_notes = replace(found, notices=(*map(as_notice, warned), *found.notices))
    name = "" if vehicle is None else vehicle.name
    write_windows(all_notes, flights, name, arguments.output, command_line(), following)
    _print(page(), found, arguments.output, following)
    return 0


def _vehicle(arguments: argparse.Namespace) -> Vehicle | None:
    from stoop.vehicle.builtin import resolve_vehicle

    if not arguments.vehicle:
        if arguments.free or arguments.fix:
            raise VehicleError("--free and --fix choose numbers of a vehicle file; name it with --vehicle")
        return None
    return with_free(resolve_vehicle(arguments.vehicle), arguments.free, arguments.fix)


def _next(arguments: argparse.Namespace) -> list[str]:
    """Return the command that fits the proposed windows."""
    from stoop.problem.windows import NAME

    options: list[tuple[str, str]] = [("--mapping", str(path)) for path in given_paths(arguments.mapping)]
    options.append(("--vehicle", arguments.vehicle or "V.toml"))
    options += [("--free", name) for name in arguments.free] + [("--fix", name) for name in arguments.fix]
    options += [("--maneuver", str(arguments.output / NAME)), ("-o", "result")]
    flights = map(str, arguments.flight)
    return ["stoop", "identify", *flights, *(word for option in options for word in option)]


def _print(out: Page, found: Found, folder: Path, following: Sequence[str]) -> None:
    from stoop.problem.windows import NAME
    from stoop.report.windows import FIRST_GUESS, numbered, percent, span_of, use_of

    rows = numbered(found)
    out.table(
        [
            fixed("", [i for i, _ in rows], 0),
            words("window s", [span_of(w, found) for _, w in rows]),
            words("use", [use_of(w) for _, w in rows]),
            words("axis", [w.axis for _, w in rows]),
            fixed("information", [w.information for _, w in rows], 2),
            points("gain", [f"{w.gain:.2f}" if w.gain else "-" for _, w in rows]),
            words("why", [str(w.why) for _, w in rows], wraps=True),
        ]
    )
    if found.expected:
        out.heading("expected of the windows to be fitted")
        out.line(FIRST_GUESS)
        errors = [e.std_error if isfinite(e.std_error) else nan for e in found.expected]
        out.table(
            [
                words("", [e.name for e in found.expected]),
                numbers("first guess", [e.value for e in found.expected]),
                numbers("std error", errors),
                Column("of its size", tuple(percent(e.relative) for e in found.expected), right=True),
            ]
        )
    if found.notices:
        out.heading("notes")
        out.bullets(map(str, found.notices))
    out.line()
    out.line(f"edit: {folder / NAME}")
    out.line(f"page: {folder / 'windows.html'}")
    out.command("next: ", following)
