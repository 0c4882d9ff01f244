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
        "module:Class" of a `stoop_studies.findings.Experiment` that is made without arguments.
    words : str
    """

    place: str
    words: str


EXPERIMENTS: Final[Mapping[str, Entry]] = {
    "coverage": Entry(
        "stoop_studies.verify.coverage.experiment:Coverage",
        "how often 95 % intervals hold the truth (400 flights each)",
    ),
    "delays": Entry(
        "stoop_studies.verify.delays.experiment:Delays",
        "delays of inputs and outputs, fractions of a sample (40 flights, twice)",
    ),
    "nist": Entry(
        "stoop_studies.verify.nist.experiment:Nist",
        "certified regressions of NIST, from both starts; reads --data DIR",
    ),
    "export": Entry(
        "stoop_studies.verify.export.experiment:Export",
        "exported aircraft flown by JSBSim beside our own simulation",
    ),
    "design": Entry(
        "stoop_studies.verify.designed.experiment:Designed",
        "a designed input against a 3-2-1-1, predicted and achieved (100 flights each)",
    ),
    "structure": Entry(
        "stoop_studies.verify.structured.experiment:Structured",
        "whether the true terms are found among candidates (200 aircraft)",
    ),
    "recursive": Entry(
        "stoop_studies.verify.realtime.experiment:Realtime",
        "estimates in flight against those of the whole record (50 flights)",
    ),
    "jsbsim": Entry(
        "stoop_studies.verify.jsbsim_truth.experiment:JsbsimTruth",
        "stock aircraft of JSBSim identified from their outputs (10 flights each)",
    ),
    "multirotor": Entry(
        "stoop_studies.verify.multirotor.experiment:Multirotor",
        "JSBSim's F450 identified from its outputs (10 flights, by speeds and by commands)",
    ),
    "hexacopter": Entry(
        "stoop_studies.verify.hexacopter.experiment:Hexacopter",
        "forces of a real hexacopter predicted in sprints, beside its owners' model; reads --data DIR",
    ),
    "propellers": Entry(
        "stoop_studies.verify.propellers.experiment:Propellers",
        "cut propellers and added weights on real quadrotors; reads --data DIR",
    ),
    "readers": Entry(
        "stoop_studies.verify.readers.experiment:Readers",
        "damaged logs over all readers: no crash, hang or hunger (29 runs of 250 each)",
    ),
}
