"""Variants of PS-GDE raced to the target on the same seeds: success, evaluations, and a test of the difference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.parallel import Run
from stoop_studies.findings import Results, Setting
from stoop_studies.reproduce.estimates import hits_of
from stoop_studies.reproduce.suite import search_run

BUDGET: Final = 60_000.0  #: evaluations after which a run counts as lost
PAPER: Final[dict[str, Any]] = {"name": "ps-gde"}


@dataclass(frozen=True, eq=False)
class Race:
    """Runs of one variant.

    Attributes
    ----------
    hits : (n,)
        Evaluations to 1e-6 J0; inf where the budget ran out first.
    costs : (n,)
        At the end.
    """

    hits: FloatArray
    costs: FloatArray

    @property
    def solved(self) -> int:
        """How many reached the target."""
        return int(np.isfinite(self.hits).sum())

    @property
    def median(self) -> float:
        """Median evaluations of all runs; inf where fewer than half got there."""
        # the mean of the middle two is nan where both are inf
        return float(np.sort(self.hits)[(len(self.hits) - 1) // 2]) if len(self.hits) else np.inf

    @property
    def expected(self) -> float:
        """Expected running time: evaluations of all runs over how many got there; inf where none did."""
        spent = np.where(np.isfinite(self.hits), self.hits, BUDGET).sum()
        return float(spent / self.solved) if self.solved else np.inf


def runs(variants: Mapping[str, Any], setting: Setting) -> list[Run]:
    """Return every variant on every seed; one that appears under two names is run once."""
    found = [
        search_run(_key(v, s), v, f"paper-{setting.box}", s, None, budget=BUDGET, to_target=True)
        for v in variants.values()
        for s in setting.seeds
    ]
    return list({run.key: run for run in found}.values())


def _key(variant: Mapping[str, Any], seed: int) -> str:
    return f"{' '.join(f'{k}={variant[k]}' for k in sorted(variant))}/{seed:06d}"


def races(variants: Mapping[str, Any], setting: Setting, results: Results) -> dict[str, Race]:
    """Return the runs by variant."""
    found = {name: [results[_key(v, s)] for s in setting.seeds] for name, v in variants.items()}
    return {
        name: Race(hits_of(r), np.array([t["cost"] for t in r], dtype=float)) for name, r in found.items()
    }


def mann_whitney(one: Race, other: Race) -> float:
    """Return the two-sided p-value that evaluations to the target differ; lost runs come last, and tie.

    References
    ----------
    Mann and Whitney (1947), Ann. Math. Stat. 18, 50-60.
    """
    from scipy.stats import mannwhitneyu

    a, b = (np.where(np.isfinite(r.hits), r.hits, 2.0 * BUDGET) for r in (one, other))
    if np.ptp(np.concatenate([a, b])) == 0.0:
        return 1.0
    return float(mannwhitneyu(a, b, alternative="two-sided", method="asymptotic").pvalue)


def holm(pvalues: Mapping[str, float]) -> dict[str, float]:
    """Return p-values that hold for all of them together.

    References
    ----------
    Holm (1979), Scand. J. Stat. 6, 65-70.
    """
    worst, found = 0.0, {}
    for i, name in enumerate(sorted(pvalues, key=lambda n: pvalues[n])):
        worst = max(worst, min(1.0, (len(pvalues) - i) * pvalues[name]))
        found[name] = worst
    return {name: found[name] for name in pvalues}
