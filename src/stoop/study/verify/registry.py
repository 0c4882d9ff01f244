"""All experiments by name, in the order in which ``all`` runs them; each is imported only when it is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Entry:
    """Where an experiment is, and what the help says of it.

    Attributes
    ----------
    place : str
        "module:Class" of a `stoop.study.findings.Experiment` that is made without arguments.
    words : str
    """

    place: str
    words: str


EXPERIMENTS: Final[Mapping[str, Entry]] = {
    "nist": Entry(
        "stoop.study.verify.nist.experiment:Nist",
        "certified regressions of NIST, from both starts; reads --data DIR",
    ),
    "export": Entry(
        "stoop.study.verify.export.experiment:Export",
        "exported aircraft flown by JSBSim beside our own simulation",
    ),
}
