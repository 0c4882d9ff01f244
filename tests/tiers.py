"""The tiers of the tests: standard protects correctness; full and studies hold what takes longer or more packages.

``tiers.txt`` is the only list. A test that it does not name is of the standard tier. A guard is a standard test that may
take longer than `LIMIT`.
"""

import os
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

import pytest

HERE: Final = Path(__file__).parent
LIST: Final = HERE / "tiers.txt"
TIERS: Final = ("standard", "full", "studies")
WORDS: Final = (*TIERS, "guard")
LIMIT: Final = 0.7  #: s of processor time of a standard test, with kernels compiled and modules imported
GUARDS: Final = 40  #: standard tests that may take longer, at most
TOTAL: Final = (
    300.0  #: s of processor time of all standard tests, likewise: 160 to 215, by what else the cores do
)
CALIBRATION: Final = (
    0.008  #: s that `pace` takes where these limits were set, a virtual core of a Zen 5 server
)


def listed(file: Path = LIST) -> dict[str, str]:
    """Return test -> first word of its line."""
    words: dict[str, str] = {}
    for n, line in enumerate(file.read_text("utf-8").splitlines(), 1):
        word, _, test = (part.strip() for part in line.partition(" "))
        if not line.strip() or word.startswith("#"):
            continue
        if word not in WORDS or not test or test in words or (word == "guard" and "::" not in test):
            raise pytest.UsageError(
                f"{file.name}, line {n}: write one of {', '.join(WORDS)} and a test, once"
            )
        words[test] = word
    return words


def names(test: str) -> tuple[str, ...]:
    """Return the names by which the list can name a test, the most specific first: with its parameter, without, its file."""
    return test, test.partition("[")[0], test.partition("::")[0]


def word_of(test: str, words: Mapping[str, str]) -> str:
    """Return standard, guard, full or studies."""
    return next((words[name] for name in names(test) if name in words), "standard")


def tier_of(test: str, words: Mapping[str, str]) -> str:
    """Return the tier of a test."""
    return "standard" if (word := word_of(test, words)) == "guard" else word


def left_out(file: str, tier: str, words: Mapping[str, str]) -> bool:
    """Return whether no test of a file belongs to a tier, so that the file need not be imported."""
    if file not in words or tier == "all":
        return False
    exceptions = (tier_of(test, words) for test in words if test.startswith(f"{file}::"))
    return tier not in (tier_of(file, words), *exceptions)


def stale(words: Mapping[str, str], collected: Iterable[str]) -> list[str]:
    """Return entries of the files collected that name no test, and those of files that do not exist."""
    known = {name for test in collected for name in names(test)}
    files = {name for name in known if "::" not in name}
    gone = {name for name in words if not (HERE.parent / name.partition("::")[0]).is_file()}
    return sorted(gone | {name for name in words if name.partition("::")[0] in files} - known)


def processor_time() -> float:
    """Return the processor time of this process and of its children that have ended, s."""
    return sum(os.times()[:4])


def pace() -> float:
    """Return by how much this processor is slower now than where the limits were set; at least 1."""
    best = min(_calibration() for _ in range(3))
    return max(1.0, best / CALIBRATION)


def _calibration() -> float:
    began = time.process_time()
    total = 0
    for i in range(200_000):
        total += i % 7
    return time.process_time() - began


def changed(cache: Path) -> int:
    """Return what changes where a kernel is compiled into the cache."""
    return cache.stat().st_mtime_ns if cache.is_dir() else 0
