"""`stoop vehicle`: the file of a built-in vehicle, to copy and to edit."""

from __future__ import annotations

import argparse
from pathlib import Path

from stoop.base.files import check_target, write_text_atomic
from stoop.cli.arguments import add_file
from stoop.cli.page import page
from stoop.cli.tables import words

EXAMPLE = ("quad-x", "my.toml")  #: what the list proposes to copy, and where to


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    name = "name of a built-in vehicle; without it all are listed"
    parser.add_argument("name", metavar="TEMPLATE", nargs="?", help=name)
    add_file(parser, "FILE.toml", "where to write it")


def run(arguments: argparse.Namespace) -> int:
    """List, print or write."""
    from stoop.vehicle.builtin import BUILT_IN, builtin_text, builtin_title

    name: str | None = arguments.name
    output: Path | None = arguments.output
    out = page()
    if name is None:
        if output is not None:
            arguments.complain("-o needs the name of a vehicle")
        out.table([words("name", BUILT_IN), words("what it is", map(builtin_title, BUILT_IN), wraps=True)])
        out.command("a copy to edit: ", ["stoop", "vehicle", EXAMPLE[0], "-o", EXAMPLE[1]])
        return 0
    text = builtin_text(name)
    if output is None:
        print(text, end="")
        return 0
    check_target(output, arguments.overwrite)
    write_text_atomic(output, text)
    out.line(f"{output}: the built-in vehicle {name}, with its comments; edit its numbers")
    out.command("next: ", ["stoop", "trim", str(output)])
    return 0
