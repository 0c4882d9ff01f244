"""What the experiments on the paper share: their form, plans, tables, and how the paper is read."""

from __future__ import annotations

import shlex
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, TypeVar

from stoop.parallel import Plan, Run
from stoop.report.sheet import Prose, Section, Table
from stoop_studies.findings import Findings, Results, Setting
from stoop_studies.outputs import Suite

SEARCH: Final = "stoop_studies.search:search"
Row = TypeVar("Row")

RECONSTRUCTIONS: Final = """\
The paper's title names a multirotor, but its model, trim and experiment are those of a fixed-wing aircraft with \
two tail booms. That aircraft is flown here.

Mass, wing area, chord, span and inertia are not printed. Its trim (14) fixes the first two, if the angle of \
attack in Table 1 is absolute (Cm is then zero to four digits; measured from the trim it would be 0.218):

- at 200 m in the standard atmosphere, 1.20165 kg/m3, CL = 0.86959 and CD = 0.10413, so the wing has 2.8667 m2 \
and the aircraft 189.40 kg
- chord 0.55 m, span 5.19 m and Iyy = 120 kg m2 are chosen so that the short period is 5.1 rad/s and the 0.3 s \
steps excite it; Ixx = 100, Izz = 200, Ixz = 5 kg m2 are chosen too
- truths that Table 1 leaves out are ours: CLV 0.05, CDV 0.02, CDalpha2 1.2, CmV 0.03 where they are part of the \
experiment, zero elsewhere; those of CQ, Cl and Cn stand in the vehicle file

The maneuver is a 3-2-1-1 on the elevator, 0.3 s steps of 0.2 rad (11.46 deg) from 1 s on, and a pulse of \
-0.1 rad from 7 to 10 s; 30 s are recorded at 50 Hz. When each begins, the pulse's size and the rate are chosen.

The cost: Q is not printed; it is the inverse of the squared noise, 0.3 m/s for V, 0.005 rad or rad/s for angles \
and rates, 0.05 m/s2 for ax and ay, 0.10 m/s2 for az. J is the sum over all samples and channels.

Bounds are not printed. Box N is as wide as each true value, box W eight times as wide, box S begins or ends at \
zero; the truth lies at a random place of each box, another for each seed.

PS-GDE, whose F and CR are not printed either:

- F = 0.6, CR = 0.9, 50 members, NC = 20, pr = 5 %, so that three members are dived from
- steps 4 and 5 change places: local search when NC divides the generation, in place of evolution; step 6 stops \
when the condition is met
- the first branch of the golden section (its Fig. 2) evaluates the point that it moves; the search ends at 0.1 of \
the interval, which is 0.1 of the unit box along the negative gradient
- the gradient is a forward difference whose evaluations count; the end of a dive replaces its start only if better
- the three picks of (12) differ from each other and from their parent; one variable always comes from the mutant; \
what leaves the box is set on its bound, and the box does not shrink
- the chaotic start avoids 0, 0.25, 0.5, 0.75 and 1

Equation (1) prints qb/2V* beside the side force's rate term; it is read as pb/2V*. Table 1's delta_z is the elevator. \
One iteration is one generation of 50 members; every trajectory counts as one evaluation, those of differences too.
"""
"""What the paper leaves open or prints wrongly, and the reading taken; stands on every page."""


class PaperExperiment(ABC):
    """An experiment on the paper's problem.

    Attributes
    ----------
    name : str
        As on the command line.
    runs : int
        Seeds per case when none are asked for.
    box : str
        Which bounds when none are asked for.
    parts : tuple of str
        Names of the further tables that it writes.
    """

    name: str
    runs: int
    box: str = "N"
    parts: tuple[str, ...] = ()

    def plan(self, setting: Setting) -> Plan | None:
        """Return all runs; None where there is nothing that takes long."""
        return None

    @abstractmethod
    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what the runs, by key, show."""


def planned(experiment: str, setting: Setting, runs: Iterable[Run]) -> Plan:
    """Return the plan of an experiment; a store of another box is refused."""
    return Plan(experiment, {"experiment": experiment, "box": setting.box}, tuple(runs))


def search_run(key: str, optimizer: Any, problem: str, seed: int, stop: int | None, **more: Any) -> Run:
    """Return one search; ``more`` are arguments of `stoop_studies.search.search`."""
    arguments = {"optimizer": optimizer, "problem": problem, "seed": seed, "history": 0, **more}
    return Run(key, SEARCH, arguments, stop)


def tabulated(caption: str, columns: Mapping[str, Callable[[Row], str]], rows: Iterable[Row]) -> Table:
    """Return a table with one column for each name and function of a row."""
    return Table(
        caption, tuple(columns), tuple(tuple(text(row) for text in columns.values()) for row in rows)
    )


def minus(text: str) -> str:
    """Return a number with a true minus sign."""
    return text.replace("-", "−")


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
