"""`stoop validate`: a fitted model predicts flights that it was not fitted to."""

from __future__ import annotations

import argparse
from pathlib import Path

from stoop.base.files import check_targets
from stoop.cli.arguments import WINDOW, add_flights, add_folder, command_line, given_paths
from stoop.cli.page import busy, page


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    windows = "windows to predict (default: the maneuvers that stoop info finds)"
    add("result", metavar="RESULT", type=Path, help="folder of stoop identify, or its result.json")
    add_flights(parser, "flight log(s) that were not fitted")
    add("--maneuver", metavar=WINDOW, nargs="+", action="extend", default=[], help=windows)
    add_folder(parser, "page and figures", "a validation in DIR")


def run(arguments: argparse.Namespace) -> int:
    """Predict, write, and print how well."""
    from stoop.flight import load
    from stoop.workflow.summary import figures_table
    from stoop.workflow.validation import NAMES, validate

    inputs = [*arguments.flight, *given_paths(arguments.mapping)]
    check_targets(arguments.output, NAMES, arguments.overwrite, inputs)
    with busy("reading and predicting"):
        flights = [load(path, arguments.mapping) for path in arguments.flight]
        done = validate(arguments.result, flights, arguments.maneuver, command_line())
    done.save(arguments.output)
    out, record = page(), done.record
    out.text(figures_table(record.maneuvers))
    out.line()
    if record.compared:
        out.line(f"better than a first-order lag in {record.better} of {record.compared} channels")
    found = {"warnings": record.warnings, "found while preparing the data": record.notes}
    for title, lines in found.items():
        if lines:
            out.heading(title)
            out.bullets(lines)
    out.line()
    out.line(f"page: {arguments.output / NAMES[0]}")
    return 0
