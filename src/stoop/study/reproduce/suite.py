"""What the pages of the paper's experiments share, beside what every experiment has (`stoop.study.findings`)."""

from __future__ import annotations

from typing import Final, Protocol

from stoop.report.sheet import Prose, Section
from stoop.study.findings import Experiment, Setting
from stoop.study.outputs import Suite
from stoop.study.reproduce.reconstructions import RECONSTRUCTIONS


class PaperExperiment(Experiment, Protocol):
    """An experiment on the paper's problem."""

    @property
    def box(self) -> str:
        """Which bounds when none are asked for."""


def _box(setting: Setting) -> str:
    return f" --box {setting.box}"


SUITE: Final = Suite(
    "reproduce",
    "The PS-GDE paper, run again",
    "Every table and figure of the paper, what it claims in passing, and what its experiment leaves out.",
    _box,
    (Section("What the paper leaves open, and how it is read here", (Prose(RECONSTRUCTIONS),)),),
)
