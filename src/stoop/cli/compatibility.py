"""`stoop compatibility`: whether the sensors of a flight agree with each other."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from stoop.base.files import check_targets
from stoop.cli.arguments import add_flight, add_folder, add_window, command_line, given_paths
from stoop.cli.numbers import windows
from stoop.cli.page import Page, busy, page

if TYPE_CHECKING:
    from stoop.reconstruction.compatibility import Compatibility


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add_flight(parser)
    add_window(parser, "what is compared (default: the airborne part)")
    files = "compatibility.html, compatibility.json and the corrected flight.nc"
    add_folder(parser, files, "them if they exist", required=False)


def run(arguments: argparse.Namespace) -> int:
    """Check, write where asked to, and print what was found."""
    from stoop.flight import load
    from stoop.workflow.compatibility import FLIGHT, NAMES, PAGE, check_compatibility, write_compatibility

    folder, others = arguments.output, given_paths(arguments.mapping)
    if folder is not None:
        check_targets(folder, NAMES, arguments.overwrite, [arguments.flight, *others])
    with busy("reading the log"):
        flight = load(arguments.flight, arguments.mapping)
    with busy("integrating and comparing"):
        result, corrected = check_compatibility(flight, windows(arguments.window))
    out = page()
    _print(out, result)
    if folder is not None:
        write_compatibility(result, flight, corrected, folder, command_line(), others)
        out.line(f"page: {folder / PAGE}; corrected flight: {folder / FLIGHT}")
    return 0


def _print(out: Page, result: Compatibility) -> None:
    from stoop.base.notices import of_severity
    from stoop.base.numbers import factor_and_unit, number, rounded_to_error
    from stoop.cli.tables import words

    out.heading("Sensors")
    rows = []
    for name, one in result.findings.items():
        factor, unit = factor_and_unit(one.unit)
        value, error = rounded_to_error(factor * one.estimate, factor * one.std_error)
        rows.append((name, value, error, unit, "" if one.identifiable else str(one.reason), one.meaning))
    heads = ("", "estimate", "std error", "unit", "not identifiable", "meaning")
    out.table([words(head, column) for head, column in zip(heads, zip(*rows, strict=True), strict=True)])
    out.heading("Measured minus reconstructed, rms")
    for name, left in result.channels.items():
        factor, unit = factor_and_unit(left.unit)
        rms, movement = number(factor * left.rms, 3), number(factor * left.movement, 3)
        out.line(f"{name:16}{rms:>8} {unit:6} of {movement:>8} {unit} movement")
    out.heading("What is inconsistent")
    out.bullets(of_severity(result.notices, "warning") or ("nothing evident",))
    notes = of_severity(result.notices, "info")
    if notes:
        out.heading("Notes")
        out.bullets(notes)
