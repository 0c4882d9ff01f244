"""What verbs that run experiments share: their arguments, and experiments from their runs to their claims."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from stoop.base.text import printable, show
from stoop.cli.page import page
from stoop.cli.progress import run_campaign
from stoop.errors import StoopError

if TYPE_CHECKING:
    from stoop_studies.findings import Experiment, Findings, Setting
    from stoop_studies.outputs import Suite

EVERYTHING = "all"
CONTINUES = "The same command again goes on from where the last one was stopped."
CORRECTABLE = 2  #: exit status where something is missing that the user can supply


def run_experiments(
    arguments: argparse.Namespace,
    suite: Suite,
    names: Sequence[str],
    load: Callable[[str], tuple[Experiment, Setting]],
    skip_failed: bool = False,
) -> int:
    """Run one experiment, or all of them one after the other, and print what each one showed.

    ``load`` gives the experiment of a name and its setting; with ``skip_failed`` one that cannot be run does not keep
    ``all`` from the others.
    """
    from stoop_studies.outputs import INDEX, carry_out, check_index, page_path, write_index

    everything = arguments.experiment == EVERYTHING
    if everything:
        check_index(suite, arguments.output, arguments.overwrite)
    wanted = names if everything else (arguments.experiment,)
    found: dict[str, Findings] = {}
    settings: list[Setting] = []
    out = page()
    for name in wanted:
        try:
            experiment, setting = load(name)
            found[name] = carry_out(
                suite,
                experiment,
                setting,
                arguments.output,
                lambda plan, store: run_campaign(arguments, plan, store),
                arguments.overwrite,
            )
        except StoopError as error:
            if not (everything and skip_failed):
                raise
            show(printable(f"stoop: error: {error}"), sys.stderr)
            continue
        settings.append(setting)
        out.heading(found[name].title)
        out.bullets(claim.line for claim in found[name].claims)
        out.line(f"page: {page_path(arguments.output, name)}")
    if everything:
        write_index(suite, found, settings, arguments.output)
        out.line(f"all pages: {arguments.output / INDEX}")
    return 0 if len(found) == len(wanted) else CORRECTABLE
