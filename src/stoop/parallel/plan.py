"""Plans: which runs there are, which of them are one task, and values as canonical JSON, so that equal values are equal bytes."""

from __future__ import annotations

import functools
import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from stoop.errors import CampaignError

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"


def to_text(value: Any, what: str) -> str:
    """Return the canonical text of a value: keys sorted, no blanks, ASCII only, floats to the last bit.

    JSON has no infinity and nan; as in Python, SQLite and JavaScript, they are written ``Infinity`` and ``NaN``.
    `what` names the value in the error.

    Raises
    ------
    CampaignError
        The value is not made of None, bool, int, float, str, list and dict with str keys: read back, it would differ.
    """
    try:
        _check(value, what)
        return json.dumps(value, sort_keys=True, separators=(",", ":"))
    except (RecursionError, ValueError) as error:
        problem = f"cannot be written as JSON ({error}); make it flatter or smaller"
        raise CampaignError(f"{what}: {problem}") from None


def from_text(text: str) -> Json:
    """Return the value of a text that :func:`to_text` wrote."""
    value: Json = json.loads(text)
    return value


def _check(value: Any, where: str) -> None:
    """Refuse a value that would be read back as another one."""
    if value is None or isinstance(value, bool | int | float | str):
        return
    if isinstance(value, list):
        for i, item in enumerate(value):
            _check(item, f"{where}[{i}]")
    elif isinstance(value, dict):
        for key, item in value.items():
            if not isinstance(key, str):
                raise CampaignError(
                    f"{where}: the key {key!r} is no text; JSON has no other keys, use str(key)"
                )
            _check(item, f"{where}[{key!r}]")
    else:
        remedy = "a list" if isinstance(value, tuple | set | frozenset) else "numbers, texts, lists and dicts"
        if hasattr(value, "tolist"):  # NumPy's arrays and scalars
            remedy = "a list or number with .tolist()"
        raise CampaignError(f"{where}: a {type(value).__name__} is not JSON; make it {remedy}")


@dataclass(frozen=True)
class Run:
    """One run of a campaign."""

    key: str  #: its name, unique in the plan; the table is sorted by it
    #: the function that computes it, ``"package.module:function"``. It is called as ``function(arguments, stops)`` and
    #: returns a list with one JSON result per stop, in that order. It must be pure: the same arguments, the same bytes.
    work: str
    arguments: Mapping[str, Json]  #: of the function; seeds included
    #: where on its way the run ends (generations, say). Runs that differ in nothing but this share their prefix: they are
    #: computed together, once.
    stop: int | None = None
    #: further arguments, which say where inputs lie; the result does not depend on them
    places: Mapping[str, Json] = field(default_factory=dict)

    @functools.cached_property
    def text(self) -> str:
        """The arguments, places included, as canonical text."""
        return self._text({**self.arguments, **self.places})

    @functools.cached_property
    def identity(self) -> str:
        """Hash of everything that determines the result."""
        return hashlib.sha256(f"{self.work}\n{self._text(self.arguments)}\n{self.stop}".encode()).hexdigest()

    def _text(self, arguments: Mapping[str, Json]) -> str:
        return to_text(dict(arguments), f"run {self.key}: arguments")


@dataclass(frozen=True)
class Plan:
    """Runs that make one table.

    Raises
    ------
    CampaignError
        Two runs have one key, or a name cannot be printed.
    """

    name: str
    #: common to all runs; a store takes more runs of the same name and settings, and no others
    settings: Mapping[str, Json]
    runs: tuple[Run, ...]

    def __post_init__(self) -> None:
        if not (self.name and self.name.isprintable()):
            raise CampaignError(f"plan {self.name!r}: the name cannot be printed; choose another")
        for key, count in Counter(run.key for run in self.runs).items():
            if not (key and key.isprintable()):
                raise CampaignError(f"plan {self.name}: the key {key!r} cannot be printed; choose another")
            if count > 1:
                raise CampaignError(f"plan {self.name}: two runs have the key {key}; give each its own")


@dataclass(frozen=True)
class Task:
    """Runs that share a prefix, the earliest stop first: one call of their function, with the arguments as `text`."""

    work: str
    text: str
    runs: tuple[Run, ...]

    @property
    def stops(self) -> list[int | None]:
        """Where results are wanted."""
        return [run.stop for run in self.runs]


def tasks(runs: Iterable[Run]) -> list[Task]:
    """Return the tasks of some runs, in the order in which the runs name them; no stop is the last one."""
    groups: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        groups.setdefault((run.work, run.text), []).append(run)
    return [
        Task(work, text, tuple(sorted(group, key=lambda run: (run.stop is None, run.stop or 0))))
        for (work, text), group in groups.items()
    ]
