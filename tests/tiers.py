"""The tiers of the tests: each test belongs to standard or to full; those of standard that are quick belong to quick too.

``tiers.txt`` names the tests of the full tier, and a few that are always quick, by hand. ``long_tests.txt`` names those that
the quick tier leaves out, with their seconds; ``scripts/durations.py`` writes it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

import pytest

HERE: Final = Path(__file__).parent
TIERS: Final = HERE / "tiers.txt"
LONG: Final = HERE / "long_tests.txt"
CHOICES: Final = ("quick", "standard", "full", "all")
#: test -> smallest tier that runs it, of all tests that were collected, those that are left out too
COLLECTED: Final = pytest.StashKey[dict[str, str]]()


def listed(file: Path) -> dict[str, str]:
    """Return test -> first word of its line."""
    lines = (line.strip() for line in file.read_text("utf-8").splitlines())
    rows = (line.split(maxsplit=1) for line in lines if line and not line.startswith("#"))
    return {test: word for word, test in rows}


def names(test: str) -> tuple[str, ...]:
    """Return the names by which a list can name a test, the most specific first: with its parameter, without, its file."""
    return test, test.partition("[")[0], test.partition("::")[0]


def tier_of(test: str, tiers: Mapping[str, str], long: Mapping[str, str]) -> str:
    """Return the smallest tier that runs a test: quick, standard or full."""
    by_hand = next((tiers[name] for name in names(test) if name in tiers), "")
    if by_hand:
        return by_hand
    return "standard" if any(name in long for name in names(test)) else "quick"


def runs(tier: str, smallest: str) -> bool:
    """Return whether a tier runs a test whose smallest tier is given."""
    return tier in ("all", smallest) or (tier, smallest) == ("standard", "quick")


def seconds_of_files(tests: Iterable[str], long: Mapping[str, str]) -> Counter[str]:
    """Return file -> seconds that its long tests take, of the tests given, summed in their order: workers must agree."""
    total: Counter[str] = Counter()
    for name in dict.fromkeys(name for test in tests for name in names(test) if name in long):
        total[name.partition("::")[0]] += float(long[name])
    return total
