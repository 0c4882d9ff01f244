"""What is compared: who runs where, with which seeds, and the plan that a campaign executes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

from stoop import optimize
from stoop.base.text import nearest
from stoop.errors import IdentificationError
from stoop.optimize.problem import ScalarProblem
from stoop.parallel import Json, Plan, Run
from stoop_studies import problems, variants
from stoop_studies.compare.race import Race, read_race

WORK: Final = "stoop_studies.compare.race:race"
PROBLEMS: Final = ("paper-N", "paper-S", "paper-W", "paper-N+noise", "paper-W+noise", "paper-N+few")
#: the first of them that runs on a problem, else the first that does
BASELINES: Final = ("ps-gde-lm", "ordered-shade")
FLIGHT: Final = "flight"


@dataclass(frozen=True)
class Field:
    """Optimizers, problems and seeds of a comparison."""

    optimizers: tuple[str, ...]
    problems: tuple[str, ...]
    seeds: range  #: the same for every pair; each draws the problem and begins the search
    budget: float  #: evaluations that a run may take
    #: arguments of the problem ``flight``: flight, vehicle and maneuvers; empty without it
    flight: Mapping[str, Any] = field(default_factory=dict)
    #: digests of the files behind it: a store holds runs on the same files only
    files: Mapping[str, str] = field(default_factory=dict)
    #: optimizers that were not asked for by name and cannot run here, with the reason
    absent: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def pairs(self) -> list[tuple[str, str]]:
        """Problem and optimizer of every pair that can run."""
        return [(p, o) for p in self.problems for o in self.optimizers if (p, o) not in self.impossible]

    @cached_property
    def impossible(self) -> list[tuple[str, str]]:
        """Problem and optimizer of pairs in which the optimizer needs the residuals that the problem lacks."""
        bare = [
            p
            for p in self.problems
            if p != FLIGHT and isinstance(problems.pose(p, self.seeds[0]).problem, ScalarProblem)
        ]
        needy = [o for o in self.optimizers if variants.needs_residuals(o)] if bare else []
        return [(p, o) for p in bare for o in needy]

    def baseline(self, problem: str) -> str:
        """Return whom the others are compared with on a problem."""
        running = [o for p, o in self.pairs if p == problem]
        return next((name for name in BASELINES if name in running), running[0])

    def plan(self) -> Plan:
        """Return the runs.

        Raises
        ------
        IdentificationError
            There are none.
        """
        if not self.pairs:
            raise IdentificationError(
                "compare: none of these optimizers can run on any of these problems; add others, such as ps-gde"
            )
        settings: dict[str, Json] = {
            "budget": self.budget,
            "flight": dict(self.flight),
            "files": dict(self.files),
        }
        # seeds outermost: a campaign that is stopped early has something of everything
        runs: list[Run] = []
        for seed in self.seeds:
            for problem, optimizer in self.pairs:
                own: dict[str, Json] = {"optimizer": optimizer, "problem": problem, "seed": seed}
                more = self.flight if problem == FLIGHT else {}
                arguments = own | {"budget": self.budget, **more}
                runs.append(Run(_key(problem, optimizer, seed), WORK, arguments))
        return Plan("compare", settings, tuple(runs))

    def races(self, results: Mapping[str, Any]) -> dict[tuple[str, str], list[Race]]:
        """Return by problem and optimizer what a campaign's results say."""
        return {
            (p, o): [read_race(p, o, seed, results[_key(p, o, seed)]) for seed in self.seeds]
            for p, o in self.pairs
        }


def _key(problem: str, optimizer: str, seed: int) -> str:
    return f"{problem} {optimizer} {seed:06d}"


def installed() -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the optimizers that can run here, and why the others cannot."""
    absent: dict[str, str] = {}
    for name in optimize.names():
        try:
            optimize.create(name)
        except IdentificationError as error:
            absent[name] = str(error)
    return tuple(name for name in optimize.names() if name not in absent), absent


def check_optimizers(names: Sequence[str]) -> None:
    """Refuse what is no optimizer, or cannot run here.

    Raises
    ------
    IdentificationError
        One line with the nearest names, or with what to install.
    """
    for name in names:
        _check(name.partition(":")[0], "optimizer", optimize.names())
        variants.build(name)


def check_problems(names: Sequence[str], flown: bool, first_seed: int = 1) -> None:
    """Refuse what is no problem, or lacks a package; raises as `check_optimizers`."""
    for name in names:
        _check(name, "problem", problems.names())
        if name != FLIGHT:
            problems.pose(name, first_seed)
        elif not flown:
            raise IdentificationError("problem flight: needs --flight, --vehicle and --maneuver; give them")


def _check(name: str, kind: str, known: Sequence[str]) -> None:
    if name not in known:
        raise IdentificationError(f"{kind} {name}: there is none of that name; {nearest(name, known, 0.4)}")
