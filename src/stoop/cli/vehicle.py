"""`stoop vehicle`: the file of a built-in vehicle, to copy and to edit."""

from __future__ import annotations

import argparse
from pathlib import Path

from stoop.cli.outputs import add_overwrite, check_target
from stoop.cli.page import page
from stoop.cli.tables import words

EXAMPLE = ("quad-x", "my.toml")  #: what the list proposes to copy, and where to


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument(
        "name", metavar="TEMPLATE", nargs="?", help="name of a built-in vehicle; without it all are listed"
    )
    parser.add_argument("-o", "--output", metavar="FILE.toml", type=Path, help="where to write it")
    add_overwrite(parser)


def run(arguments: argparse.Namespace) -> int:
    """List, print or write."""
    from stoop.base.files import write_text_atomic
    from stoop.vehicle.builtin import builtin_text

    name: str | None = arguments.name
    output: Path | None = arguments.output
    if name is None:
        if output is not None:
            arguments.complain("-o needs the name of a vehicle")
        return _list()
    text = builtin_text(name)
    if output is None:
        print(text, end="")
        return 0
    check_target(output, arguments.overwrite)
    write_text_atomic(output, text)
    out = page()
    out.line(f"{output}: the built-in vehicle {name}, with its comments; edit its numbers")
    out.command("next: ", ["stoop", "trim", str(output)])
    return 0


def _list() -> int:
    from stoop.vehicle.builtin import BUILT_IN, builtin_title

    out = page()
    out.table([words("name", BUILT_IN), words("what it is", map(builtin_title, BUILT_IN), wraps=True)])
    name, target = EXAMPLE
    out.command("a copy to edit: ", ["stoop", "vehicle", name, "-o", target])
    return 0
