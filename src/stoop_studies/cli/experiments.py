"""What verbs that run experiments share: their arguments, and one experiment from its runs to its claims."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.cli.campaign import add_campaign_arguments
from stoop.cli.numbers import at_least_one, count
from stoop.cli.page import page

if TYPE_CHECKING:
    from stoop_studies.findings import Experiment, Findings, Setting
    from stoop_studies.outputs import Suite

EVERYTHING = "all"


def add_experiment_arguments(
    parser: argparse.ArgumentParser, names: Sequence[str], what: str, here: Path
) -> None:
    """Add what to run, how many times, where, and into which folder.

    Parameters
    ----------
    parser : ArgumentParser
    names : sequence of str
        Of the experiments.
    what : str
        One line on each, for the help.
    here : Path
        The folder when none is named.
    """
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = (
        f"experiments:\n{what}\n\nThe same command again goes on from where the last one was stopped."
    )
    add = parser.add_argument
    add("experiment", metavar="EXPERIMENT", choices=(*names, EVERYTHING), help="one of those below")
    folder = f"folder for page, table and store (default: {here})"
    add("-o", "--output", metavar="DIR", type=Path, default=here, help=folder)
    add("--runs", metavar="N", type=at_least_one, help="seeds of each case (default: as the list below says)")
    add("--seed", metavar="N", type=count, default=0, help="the first of them (default: 0)")
    add_campaign_arguments(parser)
    again = "begin anew: forget the runs in DIR, and replace files of something else"
    add("--overwrite", action="store_true", help=again)


def run_experiment(
    arguments: argparse.Namespace, suite: Suite, experiment: Experiment, setting: Setting
) -> Findings:
    """Run one experiment and tell its claims.

    Raises
    ------
    StoopError
        The folder cannot be used, or a run failed; nothing is lost.
    """
    from stoop.cli.campaign import run_campaign
    from stoop_studies.outputs import carry_out, page_path

    findings = carry_out(
        suite,
        experiment,
        setting,
        arguments.output,
        lambda plan, store: run_campaign(arguments, plan, store),
        arguments.overwrite,
    )
    out = page()
    out.heading(findings.title)
    out.bullets(claim.line for claim in findings.claims)
    out.line(f"page: {page_path(arguments.output, experiment.name)}")
    return findings
