"""`stoop validate`: a fitted model predicts flights that it was not fitted to."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.cli.outputs import check_targets
from stoop.cli.page import busy, page
from stoop.cli.point import MAPPING_HELP

if TYPE_CHECKING:
    from stoop.workflow.validation import Validated

_WINDOW = "[FLIGHT@]START:STOP[#LOADING]"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    windows = "windows to predict (default: the maneuvers that stoop info finds)"
    add("result", metavar="RESULT", type=Path, help="folder of stoop identify, or its result.json")
    add("flight", metavar="FLIGHT", nargs="+", type=Path, help="flight log(s) that were not fitted")
    add("--maneuver", metavar=_WINDOW, nargs="+", action="extend", default=[], help=windows)
    add("--mapping", metavar="M.toml", type=Path, help=MAPPING_HELP)
    add("-o", "--output", metavar="DIR", type=Path, required=True, help="folder for page and figures")
    add("--overwrite", action="store_true", help="replace a validation in DIR")


def run(arguments: argparse.Namespace) -> int:
    """Predict, write, and say how well."""
    from stoop.flight import load
    from stoop.workflow.validation import NAMES, validate

    inputs = [*arguments.flight, *([arguments.mapping] if arguments.mapping else [])]
    check_targets(arguments.output, NAMES, arguments.overwrite, inputs)
    with busy("reading and predicting"):
        flights = [load(path, arguments.mapping) for path in arguments.flight]
        command = shlex.join(["stoop", *sys.argv[1:]])
        done = validate(arguments.result, flights, arguments.maneuver, command)
    done.save(arguments.output)
    _tell(done, arguments.output)
    return 0


def _tell(done: Validated, folder: Path) -> None:
    from stoop.workflow.summary import figures_table

    out, record = page(), done.record
    print(figures_table(record.maneuvers))
    out.line()
    if record.compared:
        out.line(f"better than a first-order lag in {record.better} of {record.compared} channels")
    if record.warnings:
        out.heading("warnings")
        out.bullets(record.warnings)
    if record.notes:
        out.heading("found while preparing the data")
        out.bullets(record.notes)
    out.line()
    out.line(f"page: {folder / 'validation.html'}")
