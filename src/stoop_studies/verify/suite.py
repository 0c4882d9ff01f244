"""All experiments of ``stoop verify`` by name; each is imported only when it is asked for."""

from __future__ import annotations

import importlib
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from stoop.errors import StoopError
from stoop_studies.findings import Experiment, Setting
from stoop_studies.outputs import Suite


@dataclass(frozen=True)
class Entry:
    """Where an experiment is, and what the help says of it.

    Attributes
    ----------
    module : str
        Its ``EXPERIMENT`` is a `stoop_studies.findings.Experiment`.
    words : str
    """

    module: str
    words: str


_HERE: Final = "stoop_studies.verify"
EXPERIMENTS: Final[Mapping[str, Entry]] = {
    "coverage": Entry(f"{_HERE}.coverage", "how often 95 % intervals hold the truth (400 flights each)"),
    "delays": Entry(
        f"{_HERE}.delays", "delays of inputs and outputs, fractions of a sample (40 flights, twice)"
    ),
    "nist": Entry(f"{_HERE}.nist", "certified regressions of NIST, from both starts; reads --data DIR"),
    "export": Entry(f"{_HERE}.export", "exported aircraft flown by JSBSim beside our own simulation"),
    "design": Entry(
        f"{_HERE}.design", "a designed input against a 3-2-1-1, predicted and achieved (100 flights each)"
    ),
    "structure": Entry(
        f"{_HERE}.structure", "whether the true terms are found among candidates (200 aircraft)"
    ),
    "recursive": Entry(
        f"{_HERE}.recursive", "estimates in flight against those of the whole record (50 flights)"
    ),
    "jsbsim": Entry(
        f"{_HERE}.jsbsim.experiment",
        "stock aircraft of JSBSim identified from their outputs (10 flights each)",
    ),
    "multirotor": Entry(
        f"{_HERE}.multirotor.experiment",
        "JSBSim's F450 identified from its outputs (10 flights, by speeds and by commands)",
    ),
    "hexacopter": Entry(
        f"{_HERE}.hexacopter.experiment",
        "forces of a real hexacopter predicted in sprints, beside its owners' model; reads --data DIR",
    ),
    "propellers": Entry(
        f"{_HERE}.propellers", "cut propellers and added weights on real quadrotors; reads --data DIR"
    ),
    "readers": Entry(
        f"{_HERE}.readers.experiment",
        "damaged logs over all readers: no crash, hang or hunger (29 runs of 250 each)",
    ),
}  #: in the order in which ``all`` runs them


def _options(setting: Setting) -> str:
    return "" if setting.data is None else f" --data {shlex.quote(str(setting.data))}"


SUITE: Final = Suite(
    "verify",
    "What stoop claims, measured",
    "What the documentation says of stoop's own accuracy, with the runs that bear it out.",
    _options,
)


def load_experiment(name: str) -> Experiment:
    """Return an experiment.

    Raises
    ------
    StoopError
        A package that it needs is not installed.
    """
    try:
        experiment: Experiment = importlib.import_module(EXPERIMENTS[name].module).EXPERIMENT
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing in ("", "stoop"):
            raise
        raise StoopError(
            f"{name}: needs the package {missing}, which is not installed; pip install {missing}"
        ) from None
    return experiment
