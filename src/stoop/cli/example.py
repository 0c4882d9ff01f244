"""`stoop example`: list the examples, or copy the files of one."""

from __future__ import annotations

import argparse
from pathlib import Path

from stoop.cli.page import page, words


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
