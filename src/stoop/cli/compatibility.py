"""`stoop compatibility`: whether the sensors of a flight agree with each other."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.cli.outputs import add_overwrite, check_targets
from stoop.cli.page import Page, busy, page
from stoop.cli.point import LOG_HELP, MAPPING_HELP
from stoop.cli.spans import add_window, spans

if TYPE_CHECKING:
    from stoop.reconstruct.compatibility import Compatibility


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add("flight", metavar="FLIGHT", type=Path, help=f"flight log: {LOG_HELP}")
    add("--mapping", metavar="M.toml", type=Path, help=MAPPING_HELP)
    add_window(parser, "what is compared (default: the airborne part)")
    folder = "folder for compatibility.html, compatibility.json and the corrected flight.nc"
    add("-o", "--output", metavar="DIR", type=Path, help=folder)
    add_overwrite(parser)


def run(arguments: argparse.Namespace) -> int:
    """Check, write where asked to, and say what was found."""
    from stoop.flight import load
    from stoop.workflow.compatibility import FLIGHT, NAMES, PAGE, check_compatibility, write_compatibility

    others = [path for path in (arguments.mapping,) if path is not None]
    if arguments.output is not None:
        check_targets(arguments.output, NAMES, arguments.overwrite, [arguments.flight, *others])
    with busy("reading the log"):
        flight = load(arguments.flight, arguments.mapping)
    with busy("integrating and comparing"):
        result, corrected = check_compatibility(flight, spans(arguments.window))
    _tell(page(), result)
    if arguments.output is not None:
        command = shlex.join(["stoop", *sys.argv[1:]])
        arguments.output.mkdir(parents=True, exist_ok=True)
        write_compatibility(result, flight, corrected, arguments.output, command, others)
        page().line(f"page: {arguments.output / PAGE}; corrected flight: {arguments.output / FLIGHT}")
    return 0


def _tell(out: Page, result: Compatibility) -> None:
    from stoop.base.notices import of_severity
    from stoop.base.numbers import factor_and_unit, number, rounded_to_error
    from stoop.cli.tables import words

    out.heading("Sensors")
    rows = []
    for name, one in result.findings.items():
        factor, unit = factor_and_unit(one.unit)
        value, error = rounded_to_error(factor * one.estimate, factor * one.std_error)
        rows.append((name, value, error, unit, "" if one.identifiable else one.reason, one.meaning))
    columns = list(zip(*rows, strict=True))
    heads = ("", "estimate", "std error", "unit", "not told by the data", "meaning")
    out.table([words(head, column) for head, column in zip(heads, columns, strict=True)])
    out.heading("Measured minus reconstructed, rms")
    for name, left in result.channels.items():
        factor, unit = factor_and_unit(left.unit)
        shown = number(factor * left.rms, 3), number(factor * left.movement, 3)
        out.line(f"{name:16}{shown[0]:>8} {unit:6} of {shown[1]:>8} {unit} movement")
    out.heading("What is inconsistent")
    out.bullets(map(str, of_severity(result.notices, "warning") or ("nothing evident",)))
    notes = of_severity(result.notices, "info")
    if notes:
        out.heading("Notes")
        out.bullets(map(str, notes))
