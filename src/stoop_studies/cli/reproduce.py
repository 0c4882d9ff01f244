"""`stoop reproduce`: the paper's experiments, run again, and those that it leaves out."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from stoop_studies.cli.experiments import CONTINUES, EVERYTHING, run_experiments

if TYPE_CHECKING:
    from stoop_studies.findings import Experiment, Setting

NAMES = (
    "table1", "figure3", "lateral", "longitudinal-full", "noise",
    "multirotor",
)  # fmt: skip
READERS = ("multirotor",)  #: of published data
EPILOG = f"""\
experiments:
  table1             GA, PSO, PS-GDE and the default at 500 to 2000 iterations (50 runs each)
  figure3            the response to the elevator, trim and modes
  lateral            18 lateral and directional terms; do asymmetry terms absorb sensor biases?
  longitudinal-full  14 longitudinal terms; do V terms catch the propulsion?
  noise              scatter against the Cramer-Rao bound (200 seeds)
  multirotor         the four optimizers on a simulated quadrotor, and with --data on a real hexacopter
  all                each of these, and an index

{CONTINUES}"""
CHOICES = (*NAMES, EVERYTHING)


def run(arguments: argparse.Namespace) -> int:
    """Run the experiments one after the other, and say what each one showed."""
    from stoop_studies.findings import Setting
    from stoop_studies.reproduce.registry import EXPERIMENTS
    from stoop_studies.reproduce.suite import SUITE

    def load(name: str) -> tuple[Experiment, Setting]:
        experiment = EXPERIMENTS[name]
        data = arguments.data if name in READERS else None
        runs, box = arguments.runs or experiment.runs, arguments.box or experiment.box
        return experiment, Setting(runs, arguments.seed, box, data)

    return run_experiments(arguments, SUITE, NAMES, load)
