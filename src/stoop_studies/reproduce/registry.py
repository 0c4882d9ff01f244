"""All experiments by name, in the order in which ``all`` runs them."""

from __future__ import annotations

from typing import Final

from stoop_studies.reproduce.figure3 import Figure3
from stoop_studies.reproduce.lateral import Lateral
from stoop_studies.reproduce.longitudinal import LongitudinalFull
from stoop_studies.reproduce.multirotor import Multirotor
from stoop_studies.reproduce.noise import Noise
from stoop_studies.reproduce.suite import PaperExperiment
from stoop_studies.reproduce.table1 import Table1

_ALL: Final[tuple[PaperExperiment, ...]] = (
    Table1(), Figure3(), Lateral(), LongitudinalFull(), Noise(),
    Multirotor(),
)  # fmt: skip
EXPERIMENTS: Final = {experiment.name: experiment for experiment in _ALL}
