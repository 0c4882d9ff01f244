"""`stoop example` and `stoop vehicle`: list or copy the examples and the built-in vehicles."""

from __future__ import annotations

import argparse
from pathlib import Path

from stoop.base.files import write_file
from stoop.base.text import show
from stoop.cli import options
from stoop.cli.page import page, words
from stoop.cli.progress import LiveLine


def run(arguments: argparse.Namespace) -> int:
    """List the examples, or copy one."""
    from stoop.workflow.examples import copy, example, examples

    out, output = page(), arguments.output
    if arguments.name is None:
        if output is not None:
            arguments.complain("-o needs the name of an example")
        known = examples()
        out.table(words("name", known), words("what it shows", (e.title for e in known.values()), wraps=True))
        out.command("copy one: ", ["stoop", "example", next(iter(known))])
        return 0
    one = example(arguments.name)
    for path in copy(one, output or Path(one.name), arguments.overwrite):
        out.line(f"wrote {path}")
    for folder in one.data:
        out.line(
            f"the notebook reads flights from a folder {folder} beside it; its first lines say where they are published"
        )
    out.line("a notebook is opened by Jupyter (pip install notebook), or by an editor that knows notebooks")
    return 0


def vehicle(arguments: argparse.Namespace) -> int:
    """List the built-in vehicles, print the file of one, or write it."""
    from stoop.vehicle.builtin import BUILT_IN, builtin_text, builtin_title

    name, output, out = arguments.name, arguments.output, page()
    if arguments.equations:
        if name is None or output is not None:
            arguments.complain("--equations needs the name of a vehicle or its file, and no -o")
        from stoop.vehicle.builtin import load_vehicle
        from stoop.vehicle.symbolic import build_model

        with LiveLine(options.COMPILING):
            lines = build_model(load_vehicle(name)).latex
        for line in lines:
            show(line)
    elif name is None:
        if output is not None:
            arguments.complain("-o needs the name of a vehicle")
        out.table(words("name", BUILT_IN), words("what it is", map(builtin_title, BUILT_IN), wraps=True))
        out.command("a draft of your own, by its log: ", ["stoop", "vehicle", "new", "LOG", "-o", "my.toml"])
        out.command("a copy to edit: ", ["stoop", "vehicle", "quad-x", "-o", "my.toml"])
    elif output is None:
        show(builtin_text(name).removesuffix("\n"))
    else:
        text = builtin_text(name)
        write_file(output, text)
        out.line(f"{output}: the built-in vehicle {name}, with its comments; edit its numbers")
        out.command("next: ", ["stoop", "trim", str(output)])
    return 0
