"""How many cases a surface is given.

A plain run tries the same cases each time; ``--hypothesis-profile=campaign`` tries a hundred times as many, drawn anew.
``--hypothesis-seed=N`` repeats a campaign.
"""

from __future__ import annotations

from hypothesis import HealthCheck, Phase, settings
from studies.robustness.trials import BAD, Ended

FACTOR = settings.default.max_examples / 100  #: of the cases of a plain run


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
    assert ended.outcome not in BAD, f"{family}, {surface}: {ended.outcome}: {ended.message}"
