"""`stoop polar`: the drag polar of a performance flight."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.cli.numbers import positive
from stoop.cli.outputs import add_overwrite, check_targets
from stoop.cli.page import Page, busy, page
from stoop.cli.point import LOG_HELP, MAPPING_HELP
from stoop.cli.spans import add_window, spans

if TYPE_CHECKING:
    from stoop.base.notices import Notice
    from stoop.reconstruct.polar import Polar, Propulsion


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add("flight", metavar="FLIGHT", type=Path, help=f"flight log: {LOG_HELP}")
    add("--mass", metavar="KG", type=positive, required=True, help="of the aircraft as flown")
    add("--area", metavar="M2", type=positive, required=True, help="of the wing, the reference of CL and CD")
    efficiency = "of motor, controller and blades, and its standard error (default: 0.7 0.1)"
    add("--efficiency", metavar=("ETA", "STD"), nargs=2, type=positive, default=(0.7, 0.1), help=efficiency)
    disc = "diameter of the propeller's disc (default: unknown, about 0.35 of the root of the area)"
    add("--disc", metavar="M", type=positive, help=disc)
    add_window(parser, "what is used (default: the airborne part)")
    add("--mapping", metavar="M.toml", type=Path, help=MAPPING_HELP)
    add("-o", "--output", metavar="DIR", type=Path, help="folder for polar.html and polar.json")
    add_overwrite(parser)


def run(arguments: argparse.Namespace) -> int:
    """Fit, write where asked to, and say what was found."""
    from stoop.flight import load
    from stoop.workflow.polar import NAMES, PAGE, drag_polar, write_polar

    others = [path for path in (arguments.mapping,) if path is not None]
    if arguments.output is not None:
        check_targets(arguments.output, NAMES, arguments.overwrite, [arguments.flight, *others])
    with busy("reading the log"):
        flight = load(arguments.flight, arguments.mapping)
    polar, notices = drag_polar(
        flight, arguments.mass, arguments.area, spans(arguments.window), _propulsion(arguments)
    )
    _tell(page(), polar, notices)
    if arguments.output is not None:
        arguments.output.mkdir(parents=True, exist_ok=True)
        write_polar(polar, notices, flight, arguments.output, shlex.join(["stoop", *sys.argv[1:]]), others)
        page().line(f"page: {arguments.output / PAGE}")
    return 0


def _propulsion(arguments: argparse.Namespace) -> Propulsion:
    from stoop.reconstruct.polar import Propulsion

    efficiency, std = arguments.efficiency
    return Propulsion(efficiency, std, arguments.disc)


def _tell(out: Page, polar: Polar, notices: tuple[Notice, ...]) -> None:
    from stoop.assess.covariance import NORMAL_95
    from stoop.cli.tables import fixed, numbers, words
    from stoop.report.polar import MEANINGS, grid

    out.heading("Polar")
    summary = polar.summary
    out.table(
        [
            words("", summary),
            numbers("estimate", [value for value, _ in summary.values()]),
            numbers("std error", [error for _, error in summary.values()]),
            words("meaning", [MEANINGS[name] for name in summary]),
        ]
    )
    CL = grid(polar)
    value, std = polar.drag(CL)
    low, high = value - NORMAL_95 * std, value + NORMAL_95 * std
    out.heading("Drag coefficient, 95 % interval")
    out.table([fixed("CL", CL, 1), fixed("CD", value, 4), fixed("from", low, 4), fixed("to", high, 4)])
    out.heading("What it rests on")
    out.bullets(map(str, notices))
