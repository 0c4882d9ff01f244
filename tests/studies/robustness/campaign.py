"""How many cases a surface is given, and how they end.

A plain run tries the same cases each time; ``--hypothesis-profile=campaign`` tries a hundred times as many, drawn anew, and
``--counts FILE`` writes how they ended. ``--hypothesis-seed=N`` repeats a campaign.
"""

from __future__ import annotations

import csv
from collections import Counter
from pathlib import Path

from hypothesis import HealthCheck, Phase, settings
from studies.robustness.trials import BAD, Ended

FACTOR = settings.default.max_examples / 100  #: of the cases of a plain run
OUTCOMES = ("refused", "listed", "unnoticed", "same", "read", "limit", "contained", "failed")
COUNTS: Counter[tuple[str, str, str]] = Counter()  #: family, surface and outcome -> cases


def cases(count: float) -> settings:
    """Return the settings of a test of so many cases in a plain run."""
    return settings(
        max_examples=max(1, round(FACTOR * count)),
        derandomize=FACTOR <= 1,
        database=None,
        deadline=None,
        phases=(Phase.explicit, Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )


def check(family: str, surface: str, ended: Ended) -> None:
    """Count a case; it must not have failed."""
    failed = ended.outcome in BAD
    COUNTS[family, surface, "failed" if failed else ended.outcome] += 1
    assert not failed, f"{ended.outcome}: {ended.message}"


def write_counts(path: Path) -> None:
    """Write how many cases ended how, a line for each surface."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["family", "surface", "cases", *OUTCOMES])
        for family, surface in dict.fromkeys(key[:2] for key in COUNTS):
            ended = [COUNTS[family, surface, outcome] for outcome in OUTCOMES]
            table.writerow([family, surface, sum(ended), *ended])
