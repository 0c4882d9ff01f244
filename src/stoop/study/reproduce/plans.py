"""Plans of experiments: what a store must agree on before it takes more runs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from stoop.campaign import Plan, Run, source_digest
from stoop.study.reproduce.findings import Setting

SEARCH: Final = "stoop.study.search:search"
_STUDY: Final = Path(__file__).parents[1]
_SOURCES: Final = (
    "problems",
    "search.py",
    "variants.py",
    "reproduce/asymmetry.py",
    "reproduce/propulsion.py",
)


def planned(experiment: str, setting: Setting, runs: Iterable[Run]) -> Plan:
    """Return the plan of an experiment; a store of another box, or of other problems, is refused."""
    settings = {"experiment": experiment, "box": setting.box, "problems": _digest()}
    return Plan(experiment, settings, tuple(runs))


def searched(key: str, optimizer: Any, problem: str, seed: int, stop: int | None, **more: Any) -> Run:
    """Return one search; ``more`` are arguments of `stoop.study.search.search`."""
    arguments = {"optimizer": optimizer, "problem": problem, "seed": seed, "history": 0, **more}
    return Run(key, SEARCH, arguments, stop)


def _digest() -> str:
    return source_digest(*(_STUDY / name for name in _SOURCES))
