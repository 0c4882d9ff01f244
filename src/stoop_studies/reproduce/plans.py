"""Plans of experiments: what a store must agree on before it takes more runs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from stoop.parallel import Plan, Run
from stoop_studies.findings import Setting

SEARCH: Final = "stoop_studies.search:search"


def planned(experiment: str, setting: Setting, runs: Iterable[Run]) -> Plan:
    """Return the plan of an experiment; a store of another box is refused."""
    settings = {"experiment": experiment, "box": setting.box}
    return Plan(experiment, settings, tuple(runs))


def searched(key: str, optimizer: Any, problem: str, seed: int, stop: int | None, **more: Any) -> Run:
    """Return one search; ``more`` are arguments of `stoop_studies.search.search`."""
    arguments = {"optimizer": optimizer, "problem": problem, "seed": seed, "history": 0, **more}
    return Run(key, SEARCH, arguments, stop)
