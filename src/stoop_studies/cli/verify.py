"""`stoop verify`: what stoop claims of its own accuracy, measured."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from stoop_studies.cli.experiments import EVERYTHING, add_experiment_arguments, run_experiments

if TYPE_CHECKING:
    from stoop_studies.findings import Experiment, Setting

FOLDER = Path("stoop-verify")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    from stoop_studies.verify.study import EXPERIMENTS

    lines = [f"  {name:<12} {line}" for name, (_, line) in EXPERIMENTS.items()]
    what = "\n".join((*lines, f"  {EVERYTHING:<12} each of these, and an index"))
    add_experiment_arguments(parser, tuple(EXPERIMENTS), what, FOLDER)
    data = "folder of published data, for an experiment that reads some (nist: any files of the form of NIST StRD)"
    parser.add_argument("--data", metavar="DIR", type=Path, help=data)


def run(arguments: argparse.Namespace) -> int:
    """Run experiments; one that cannot be run, for want of a package or data, does not keep `all` from the others."""
    from stoop_studies.findings import Setting
    from stoop_studies.verify.study import EXPERIMENTS, SUITE, load_experiment

    def load(name: str) -> tuple[Experiment, Setting]:
        experiment = load_experiment(name)
        return experiment, Setting(arguments.runs or experiment.runs, arguments.seed, data=arguments.data)

    return run_experiments(arguments, SUITE, tuple(EXPERIMENTS), load, skip_failed=True)
