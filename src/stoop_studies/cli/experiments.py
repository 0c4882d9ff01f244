"""What verbs that run experiments share: their arguments, and experiments from their runs to their claims."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.base.text import printable, show
from stoop.cli.options import at_least_one, count
from stoop.cli.page import page
from stoop.cli.progress import add_campaign_arguments, run_campaign
from stoop.errors import StoopError

if TYPE_CHECKING:
    from stoop_studies.findings import Experiment, Findings, Setting
    from stoop_studies.outputs import Suite

EVERYTHING = "all"
CORRECTABLE = 2  #: exit status where something is missing that the user can supply


def add_experiment_arguments(
    parser: argparse.ArgumentParser, names: Sequence[str], what: str, folder: Path
) -> None:
    """Add what to run, how many times, where, and into which folder; ``what`` has one line on each experiment."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = (
        f"experiments:\n{what}\n\nThe same command again goes on from where the last one was stopped."
    )
    add = parser.add_argument
    add("experiment", metavar="EXPERIMENT", choices=(*names, EVERYTHING), help="one of those below")
    where = f"folder for page, table and store (default: {folder})"
    add("-o", "--output", metavar="DIR", type=Path, default=folder, help=where)
    add("--runs", metavar="N", type=at_least_one, help="seeds of each case (default: as the list below says)")
    add("--seed", metavar="N", type=count, default=0, help="the first of them (default: 0)")
    add_campaign_arguments(parser)
    again = "begin anew: forget the runs in DIR, and replace files of something else"
    add("--overwrite", action="store_true", help=again)


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
