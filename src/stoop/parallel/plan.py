"""Plans: which runs there are, and which of them are one piece of work."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from stoop.errors import CampaignError
from stoop.parallel.canonical import Json, to_text


@dataclass(frozen=True)
class Run:
    """One run of a campaign.

    Attributes
    ----------
    key : str
        Its name, unique in the plan; the table is sorted by it.
    work : str
        The function that does it, ``"package.module:function"``. It is called as ``function(arguments, stops)`` and returns
        a list with one JSON result per stop, in that order. It must be pure: the same arguments, the same bytes.
    arguments : mapping of str to Json
        What the function is told; seeds included.
    stop : int, optional
        Where on its way the run ends (generations, say). Runs that differ in nothing but this share their prefix: they
        are computed together, once.
    """

    key: str
    work: str
    arguments: Mapping[str, Json]
    stop: int | None = None

    @functools.cached_property
    def text(self) -> str:
        """The arguments as canonical text."""
        return to_text(dict(self.arguments), f"run {self.key}: arguments")

    @functools.cached_property
    def identity(self) -> str:
        """What decides the result, in one hash."""
        return hashlib.sha256(f"{self.work}\n{self.text}\n{self.stop}".encode()).hexdigest()


@dataclass(frozen=True)
class Plan:
    """Runs that make one table.

    Attributes
    ----------
    name : str
        What the plan is for.
    settings : mapping of str to Json
        What all of its runs share. A store takes more runs of the same name and settings, and no others.
    runs : tuple of Run

    Raises
    ------
    CampaignError
        Two runs have one key, or a name cannot be printed.
    """

    name: str
    settings: Mapping[str, Json]
    runs: tuple[Run, ...]

    def __post_init__(self) -> None:
        if not (self.name and self.name.isprintable()):
            raise CampaignError(f"plan {self.name!r}: the name cannot be printed; choose another")
        seen: set[str] = set()
        for run in self.runs:
            if not (run.key and run.key.isprintable()):
                raise CampaignError(
                    f"plan {self.name}: the key {run.key!r} cannot be printed; choose another"
                )
            if run.key in seen:
                raise CampaignError(f"plan {self.name}: two runs have the key {run.key}; give each its own")
            seen.add(run.key)


@dataclass(frozen=True)
class Task:
    """Runs that share a prefix: one call of their function."""

    work: str
    text: str  #: the arguments
    runs: tuple[Run, ...]  #: the earliest stop first

    @property
    def stops(self) -> list[int | None]:
        """Where results are wanted."""
        return [run.stop for run in self.runs]


def tasks(runs: Iterable[Run]) -> list[Task]:
    """Return the tasks that make up some runs, in the order in which the runs name them."""
    together: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        together.setdefault((run.work, run.text), []).append(run)
    return [Task(*shared, tuple(sorted(group, key=_lateness))) for shared, group in together.items()]


def _lateness(run: Run) -> tuple[bool, int]:
    """Sort by stop; without a stop last."""
    return run.stop is None, run.stop or 0
