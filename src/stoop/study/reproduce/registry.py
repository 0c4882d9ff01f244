"""All experiments by name, in the order in which ``all`` runs them."""

from __future__ import annotations

from typing import Final

from stoop.study.reproduce.ablation import Ablation
from stoop.study.reproduce.figure1 import Figure1
from stoop.study.reproduce.figure2 import Figure2
from stoop.study.reproduce.figure3 import Figure3
from stoop.study.reproduce.lateral import Lateral
from stoop.study.reproduce.longitudinal import LongitudinalFull
from stoop.study.reproduce.multirotor_page import Multirotor
from stoop.study.reproduce.noise import Noise
from stoop.study.reproduce.suite import PaperExperiment
from stoop.study.reproduce.sweep import Sweep
from stoop.study.reproduce.table1_page import Table1

_ALL: Final[tuple[PaperExperiment, ...]] = (
    Table1(), Figure1(), Figure2(), Figure3(), Lateral(), LongitudinalFull(), Sweep(), Ablation(), Noise(),
    Multirotor(),
)  # fmt: skip
EXPERIMENTS: Final[dict[str, PaperExperiment]] = {experiment.name: experiment for experiment in _ALL}
