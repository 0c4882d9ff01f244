"""`stoop verify`: what stoop claims of its own accuracy, measured."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from stoop_studies.cli.experiments import CONTINUES, EVERYTHING, run_experiments

if TYPE_CHECKING:
    from stoop_studies.findings import Experiment, Setting


def choices() -> tuple[str, ...]:
    """Return the names of the experiments, and that of all."""
    from stoop_studies.verify.study import EXPERIMENTS

    return (*EXPERIMENTS, EVERYTHING)


def epilog() -> str:
    """Return the list of experiments at the end of the help."""
    from stoop_studies.verify.study import EXPERIMENTS

    lines = {name: line for name, (_, line) in EXPERIMENTS.items()} | {
        EVERYTHING: "each of these, and an index"
    }
    return "\n".join(("experiments:", *(f"  {n:<12} {line}" for n, line in lines.items()), "", CONTINUES))


def run(arguments: argparse.Namespace) -> int:
    """Run experiments; one that cannot be run, for want of a package or data, does not keep `all` from the others."""
    from stoop_studies.findings import Setting
    from stoop_studies.verify.study import EXPERIMENTS, SUITE, load_experiment

    def load(name: str) -> tuple[Experiment, Setting]:
        experiment = load_experiment(name)
        return experiment, Setting(arguments.runs or experiment.runs, arguments.seed, data=arguments.data)

    return run_experiments(arguments, SUITE, tuple(EXPERIMENTS), load, skip_failed=True)
