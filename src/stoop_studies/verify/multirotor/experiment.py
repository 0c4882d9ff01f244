"""The multirotor of an independent simulator identified from its outputs, against its own rotors and its own body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from stoop.flight import VARIABLES
from stoop.parallel import Plan, Run
from stoop.report.sheet import Prose, Section, Table
from stoop_studies.findings import Findings, Results, Setting
from stoop_studies.verify.jsbsim_truth.experiment import HEAD as OF_JSBSIM
from stoop_studies.verify.jsbsim_truth.experiment import Identified, cells, claims, identified, rows
from stoop_studies.verify.multirotor.case import COMMANDS, SPEEDS, WORK
from stoop_studies.verify.multirotor.flight import CLIMB, DURATION
from stoop_studies.verify.multirotor.vehicle import NOISE

HEAD: Final = ("recorded", *OF_JSBSIM[1:])
LEAD: Final = f"""\
The F450 of JSBSim's own package, a quadrotor of 1.4 kg with brushless motors and tables of measured propellers, is flown \
by a simple autopilot that shakes it on all four axes for {DURATION:.0f} s of a climb at {CLIMB:g} m/s. Its instruments are \
read, noise is added, and stoop identifies rotors, drag and inertia from short windows, mass and geometry known. What it \
finds is held against what JSBSim's own rotors and body do along that flight, each force for itself."""
WORDS: Final = """\
Estimate, standard error and difference are those of the first flight. An estimate agrees within 3 of its standard errors \
or 2 % of the true value, whichever is larger. The last column is the difference of the mean over all flights, in standard \
errors of one."""


@dataclass(frozen=True)
class Record:
    """What of the rotors is recorded: a case of the experiment.

    Attributes
    ----------
    model : str
        Its name.
    title, words : str
        For the page.
    """

    model: str
    title: str
    words: str


RECORDS: Final = (
    Record(
        SPEEDS,
        "Speeds of the rotors recorded",
        "As an autopilot does that hears its speed controllers: what the motors do is seen, what the propellers do is found.",
    ),
    Record(
        COMMANDS,
        "Commands alone recorded",
        "The lag of the motors is found, too. How fast they turn at a command is told (a straight line from the stand): "
        "otherwise thrust, torque and inertia of a rotor could be told per command only.",
    ),
)


@dataclass(frozen=True)
class Multirotor:
    """JSBSim's F450 as truth."""

    name: str = "multirotor"
    runs: int = 10
    parts: tuple[str, ...] = ()

    def plan(self, setting: Setting) -> Plan:
        """Return one run per record and seed."""
        runs = (
            Run(key(record.model, seed), WORK, {"recorded": record.model, "seed": seed})
            for seed in setting.seeds
            for record in RECORDS
        )
        return Plan(self.name, {"experiment": self.name}, tuple(runs))

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return how far the estimates are off."""
        found = [
            identified(record, [results[key(record.model, seed)] for seed in setting.seeds])
            for record in RECORDS
        ]
        tables = (part for one in found for part in (_table(one), Prose(one.stock.words)))
        return Findings(
            "JSBSim's F450, identified from its outputs",
            LEAD,
            tuple(claim for one in found for claim in claims(one, "parameter")),
            (Section("Parameters", (Prose(WORDS), *tables)), Section("Noise", (_noise(NOISE),))),
            HEAD,
            tuple(row for one in found for row in rows(one)),
        )


def key(recorded: str, seed: int) -> str:
    """Return the name of a run."""
    return f"{recorded}/{seed:06d}"


def _table(found: Identified) -> Table:
    head = (
        "parameter", "JSBSim", "estimate", "standard error", "difference in standard errors", "in %", "agrees",
        "flights that agree", "mean, in standard errors",
    )  # fmt: skip
    return Table(found.stock.title, head, tuple(cells(row) for row in rows(found)))


def _noise(noise: Mapping[str, Any]) -> Table:
    told = tuple((c, f"{sigma:g} {VARIABLES[c].unit}") for c, sigma in noise.items())
    return Table("White, one standard deviation", ("channel", "noise"), told)
