"""`stoop map`: a mapping drafted for any log."""

from __future__ import annotations

import argparse
from pathlib import Path

from stoop.base.files import check_target, write_text_atomic
from stoop.cli.arguments import LOG_HELP, add_file
from stoop.cli.page import busy, page


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument("log", metavar="FLIGHT", type=Path, help=f"flight log: {LOG_HELP}")
    add_file(parser, "M.toml", "where to write it")


def run(arguments: argparse.Namespace) -> int:
    """Read, draft, print or write."""
    from stoop.flight.mapping_draft import draft

    output: Path | None = arguments.output
    if output is not None:
        check_target(output, arguments.overwrite)
    with busy("reading the log"):
        made = draft(arguments.log)
    if output is None:
        print(made.text, end="")
        return 0
    write_text_atomic(output, made.text)
    out = page()
    out.line(f"{output}: {made.mapped} variables, {made.unsure} of them unsure")
    out.command("next: ", ["stoop", "info", str(arguments.log), "--mapping", str(output)])
    return 0
