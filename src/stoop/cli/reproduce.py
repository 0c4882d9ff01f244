"""`stoop reproduce`: the paper's experiments, run again, and those that it leaves out."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.cli.campaign import add_campaign_arguments
from stoop.cli.numbers import at_least_one, count
from stoop.cli.page import page

if TYPE_CHECKING:
    from stoop.study.reproduce.findings import Experiment, Findings, Setting

HERE = Path("stoop-reproduce")
NAMES = (
    "table1", "figure1", "figure2", "figure3", "lateral", "longitudinal-full", "sweep", "ablation", "noise",
)  # fmt: skip
WHAT = """\
  table1             GA, PSO, PS-GDE and the default at 500 to 2000 iterations (50 runs each)
  figure1            the logistic map, and what it is worth as a first population
  figure2            the dive along the gradient, and the pseudo-code as printed
  figure3            the response to the elevator, trim and modes
  lateral            18 lateral and directional terms; do asymmetry terms absorb sensor biases?
  longitudinal-full  14 longitudinal terms; do V terms catch the propulsion?
  sweep              NC, pr, F and CR about the paper's values
  ablation           which idea of PS-GDE helps
  noise              scatter against the Cramer-Rao bound (200 seeds)
  all                each of these, and an index"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = (
        f"experiments:\n{WHAT}\n\nThe same command again goes on from where the last one was stopped."
    )
    add = parser.add_argument
    add("experiment", metavar="EXPERIMENT", choices=(*NAMES, "all"), help="one of those below")
    folder = f"folder for page, table and store (default: {HERE})"
    add("-o", "--output", metavar="DIR", type=Path, default=HERE, help=folder)
    add("--runs", metavar="N", type=at_least_one, help="seeds of each case (default: as the list below says)")
    add("--seed", metavar="N", type=count, default=0, help="the first of them (default: 0)")
    bounds = "bounds: N as wide as each value, W eight times, S from zero (default: N; noise: W)"
    add("--box", choices=("N", "S", "W"), help=bounds)
    add_campaign_arguments(parser)
    again = "begin anew: forget the runs in DIR, and replace files of something else"
    add("--overwrite", action="store_true", help=again)


def run(arguments: argparse.Namespace) -> int:
    """Run the experiments one after the other, and say what each one showed."""
    from stoop.study.reproduce.outputs import check_index, write_index
    from stoop.study.reproduce.registry import EXPERIMENTS

    everything = arguments.experiment == "all"
    names = NAMES if everything else (arguments.experiment,)
    if everything:
        check_index(arguments.output, arguments.overwrite)
    settings = [_setting(arguments, EXPERIMENTS[name]) for name in names]
    found = {n: _one(arguments, EXPERIMENTS[n], s) for n, s in zip(names, settings, strict=True)}
    if everything:
        write_index(found, settings, arguments.output)
        page().line(f"all pages: {arguments.output / 'index.html'}")
    return 0


def _setting(arguments: argparse.Namespace, experiment: Experiment) -> Setting:
    from stoop.study.reproduce.findings import Setting

    return Setting(arguments.runs or experiment.runs, arguments.seed, arguments.box or experiment.box)


def _one(arguments: argparse.Namespace, experiment: Experiment, setting: Setting) -> Findings:
    """Run one experiment and tell its claims."""
    from stoop.cli.campaign import run_campaign
    from stoop.study.reproduce.outputs import page_path, reproduce

    findings = reproduce(
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
