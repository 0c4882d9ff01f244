"""`stoop polar`: the drag polar of a performance flight."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from stoop.base.files import check_targets
from stoop.cli.arguments import add_flight, add_folder, add_window, command_line, given_paths
from stoop.cli.numbers import positive, windows
from stoop.cli.page import Page, busy, page

if TYPE_CHECKING:
    from stoop.base.notices import Notice
    from stoop.reconstruction.polar import Polar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add_flight(parser)
    add("--mass", metavar="KG", type=positive, required=True, help="of the aircraft as flown")
    add("--area", metavar="M2", type=positive, required=True, help="of the wing, the reference of CL and CD")
    efficiency = "of motor, controller and blades, and its standard error (default: 0.7 0.1)"
    add("--efficiency", metavar=("ETA", "STD"), nargs=2, type=positive, default=(0.7, 0.1), help=efficiency)
    disc = "diameter of the propeller's disc (default: unknown, about 0.35 of the root of the area)"
    add("--disc", metavar="M", type=positive, help=disc)
    add_window(parser, "what is used (default: the airborne part)")
    add_folder(parser, "polar.html and polar.json", "them if they exist", required=False)


def run(arguments: argparse.Namespace) -> int:
    """Fit, write where asked to, and print what was found."""
    from stoop.flight import load
    from stoop.reconstruction.polar import Propulsion
    from stoop.workflow.polar import NAMES, PAGE, drag_polar, write_polar

    folder, others = arguments.output, given_paths(arguments.mapping)
    if folder is not None:
        check_targets(folder, NAMES, arguments.overwrite, [arguments.flight, *others])
    with busy("reading the log"):
        flight = load(arguments.flight, arguments.mapping)
    efficiency, std = arguments.efficiency
    propulsion = Propulsion(efficiency, std, arguments.disc)
    used = windows(arguments.window)
    polar, notices = drag_polar(flight, arguments.mass, arguments.area, used, propulsion)
    out = page()
    _print(out, polar, notices)
    if folder is not None:
        write_polar(polar, notices, flight, folder, command_line(), others)
        out.line(f"page: {folder / PAGE}")
    return 0


def _print(out: Page, polar: Polar, notices: Sequence[Notice]) -> None:
    from stoop.assessment.covariance import NORMAL_95
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
    out.bullets(notices)
