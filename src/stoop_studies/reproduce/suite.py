"""What the pages of the paper's experiments share, beside what every experiment has (`stoop_studies.findings`)."""

from __future__ import annotations

import shlex
from typing import Final, Protocol

from stoop.report.sheet import Prose, Section
from stoop_studies.findings import Experiment, Setting
from stoop_studies.outputs import Suite
from stoop_studies.reproduce.reconstructions import RECONSTRUCTIONS


class PaperExperiment(Experiment, Protocol):
    """An experiment on the paper's problem."""

    @property
    def box(self) -> str:
        """Which bounds when none are asked for."""


def _options(setting: Setting) -> str:
    data = "" if setting.data is None else f" --data {shlex.quote(str(setting.data))}"
    return f" --box {setting.box}{data}"


SUITE: Final = Suite(
    "reproduce",
    "The PS-GDE paper, run again",
    "Every table and figure of the paper, what it claims in passing, and what its experiment leaves out.",
    _options,
    (Section("What the paper leaves open, and how it is read here", (Prose(RECONSTRUCTIONS),)),),
)
