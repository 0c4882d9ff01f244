"""`stoop verify`: what stoop claims of its own accuracy, measured."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.cli.page import page
from stoop.cli.printable import printable
from stoop.errors import StoopError
from stoop_studies.cli.experiments import EVERYTHING, add_experiment_arguments, run_experiment

if TYPE_CHECKING:
    from stoop_studies.findings import Findings, Setting

HERE = Path("stoop-verify")
_MENDABLE = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    from stoop_studies.verify.suite import EXPERIMENTS

    lines = [f"  {name:<12} {entry.words}" for name, entry in EXPERIMENTS.items()]
    what = "\n".join((*lines, f"  {EVERYTHING:<12} each of these, and an index"))
    add_experiment_arguments(parser, tuple(EXPERIMENTS), what, HERE)
    data = "folder of published data, for an experiment that reads some (nist: the files of NIST StRD)"
    parser.add_argument("--data", metavar="DIR", type=Path, help=data)


def run(arguments: argparse.Namespace) -> int:
    """Run one experiment, or all of them one after the other, and say what each one showed."""
    if arguments.experiment == EVERYTHING:
        return _run_all(arguments)
    _run_one(arguments, arguments.experiment)
    return 0


def _run_one(arguments: argparse.Namespace, name: str) -> tuple[Setting, Findings]:
    from stoop_studies.findings import Setting
    from stoop_studies.verify.suite import SUITE, load_experiment

    experiment = load_experiment(name)
    setting = Setting(arguments.runs or experiment.runs, arguments.seed, data=arguments.data)
    return setting, run_experiment(arguments, SUITE, experiment, setting)


def _run_all(arguments: argparse.Namespace) -> int:
    """Run them all; one that cannot be run, for want of a package or data, does not keep the others from it."""
    from stoop_studies.outputs import INDEX, check_index, write_index
    from stoop_studies.verify.suite import EXPERIMENTS, SUITE

    check_index(SUITE, arguments.output, arguments.overwrite)
    done: dict[str, tuple[Setting, Findings]] = {}
    for name in EXPERIMENTS:
        try:
            done[name] = _run_one(arguments, name)
        except StoopError as error:
            print(printable(f"stoop: error: {error}"), file=sys.stderr)
    found = {name: findings for name, (_, findings) in done.items()}
    write_index(SUITE, found, [setting for setting, _ in done.values()], arguments.output)
    page().line(f"all pages: {arguments.output / INDEX}")
    return 0 if len(done) == len(EXPERIMENTS) else _MENDABLE
