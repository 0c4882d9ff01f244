"""Success, expected running time, and how sure both are: what a comparison rests on.

References
----------
Auger and Hansen (2005), Performance evaluation of an advanced local search evolutionary algorithm, IEEE CEC:
the expected running time, evaluations of all runs over the number of successes.
Efron and Tibshirani (1993), An Introduction to the Bootstrap: percentile intervals; pairs share the seeds drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb, inf, isnan
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray, IntArray
from stoop.base.numbers import number
from stoop_studies.compare.race import Race

DRAWS: Final = 2000
SEED: Final = 20_120_000  #: of the draws; the same for every pair, so that a page is the same bytes again


@dataclass(frozen=True)
class Span:
    """A figure with the interval in which 95 % of resampled seeds leave it; inf where nobody succeeded."""

    value: float
    low: float
    high: float

    @property
    def interval(self) -> str:
        """The interval as text."""
        unknown = isnan(self.low) or self.low == inf
        return "–" if unknown else f"{number(self.low, 3)} to {number(self.high, 3)}"


@dataclass(frozen=True)
class Score:
    """How an optimizer did on a problem."""

    problem: str
    optimizer: str
    #: runs, those that reached the target, those that claimed another optimum, those that claimed the right one, but a little
    #: above the target
    runs: int
    successes: int
    wrong: int
    short: int
    ert: Span  #: evaluations
    median: float  #: evaluations of the successful runs; nan without any
    evaluations: float  #: of all runs
    baseline: str  #: whom the ratio refers to
    ratio: Span  #: expected running time over the baseline's, the same seeds drawn for both

    @property
    def ahead(self) -> bool:
        """Whether it takes less than the baseline."""
        return self.optimizer != self.baseline and self.ratio.value < 1.0

    @property
    def clear(self) -> bool:
        """Whether the interval of the ratio leaves no doubt on which side of one it is."""
        return self.ratio.high < 1.0 or self.ratio.low > 1.0

    @property
    def rate_text(self) -> str:
        """Successes of runs."""
        return f"{self.successes} / {self.runs}"

    @property
    def ert_text(self) -> str:
        """The expected running time; what was spent without success where there was none."""
        return number(self.ert.value, 3) if self.ert.value < inf else f"> {number(self.evaluations, 3)}"

    @property
    def ratio_text(self) -> str:
        """The ratio to the baseline as a multiple."""
        value = self.ratio.value
        return "–" if isnan(value) or value == inf else f"{number(value, 3)}×"


def score(races: Sequence[Race], baseline: Sequence[Race]) -> Score:
    """Measure the runs of one optimizer on one problem beside the baseline's with the same seeds."""
    draws = np.random.default_rng(SEED).integers(0, len(races), size=(DRAWS, len(races)))
    time, times = running_time(races), _resampled(races, draws)
    with np.errstate(invalid="ignore"):  # two failures are no ratio
        ratios = times / _resampled(baseline, draws)
        ratio = float(np.float64(time) / running_time(baseline))
    hits = [race.hit for race in races if race.hit is not None]
    return Score(
        problem=races[0].problem,
        optimizer=races[0].optimizer,
        runs=len(races),
        successes=len(hits),
        wrong=sum(race.wrong for race in races),
        short=sum(r.status == "converged" and r.hit is None and not r.wrong for r in races),
        ert=_span(time, times),
        median=float(np.median(hits)) if hits else float("nan"),
        evaluations=float(np.array([r.spent for r in sorted(races, key=lambda race: race.seed)]).sum()),
        baseline=baseline[0].optimizer,
        ratio=_span(ratio, ratios),
    )


def running_time(races: Sequence[Race]) -> float:
    """Return the expected evaluations to the target if failures are begun anew: all spent over successes."""
    successes = sum(race.hit is not None for race in races)
    return sum(race.spent for race in races) / successes if successes else inf


def _resampled(races: Sequence[Race], draws: IntArray) -> FloatArray:
    """Return the running time of each resample of the seeds, (DRAWS,); inf without a success."""
    ordered = sorted(races, key=lambda race: race.seed)
    spent = np.array([race.spent for race in ordered])[draws].sum(axis=1)
    success = np.array([race.hit is not None for race in ordered], dtype=np.float64)[draws].sum(axis=1)
    return np.where(success > 0.0, spent / np.maximum(success, 1.0), np.inf)


def _span(value: float, resampled: FloatArray) -> Span:
    """Return the percentile interval of 95 %; order statistics, as infinite values cannot be averaged."""
    known = np.sort(resampled[~np.isnan(resampled)])
    if not known.size:
        return Span(value, float("nan"), float("nan"))
    low, high = (
        float(known[round(share * (known.size - 1))]) for share in ((1.0 - 0.95) / 2.0, (1.0 + 0.95) / 2.0)
    )
    return Span(value, low, high)


@dataclass(frozen=True)
class Duel:
    """Two optimizers on the same instances."""

    optimizer: str
    baseline: str
    #: both, only_own, only_other, neither: instances solved by both, by one of them, by none
    both: int
    only_own: int
    only_other: int
    neither: int
    #: that chance parts those solved by one alone as unevenly, or more (two-sided sign test)
    probability: float
    #: geometric mean over the instances both solved of evaluations over the baseline's; nan without any
    ratio: float


def duel(races: Sequence[Race], baseline: Sequence[Race]) -> Duel:
    """Compare two optimizers instance by instance, over all problems that both ran on."""
    others = {(race.problem, race.seed): race for race in baseline}
    pairs = [(r, others[r.problem, r.seed]) for r in races if (r.problem, r.seed) in others]
    solved = [(a.hit is not None, b.hit is not None) for a, b in pairs]
    own, other = solved.count((True, False)), solved.count((False, True))
    logs = [np.log(a.hit / b.hit) for a, b in pairs if a.hit is not None and b.hit is not None]
    return Duel(
        races[0].optimizer,
        baseline[0].optimizer,
        len(logs),
        own,
        other,
        solved.count((False, False)),
        sign_test(own, other),
        float(np.exp(np.mean(logs))) if logs else float("nan"),
    )


def sign_test(a: int, b: int) -> float:
    """Return the two-sided probability of a split at least as uneven as a to b, were both equally likely."""
    n, least = a + b, min(a, b)
    tail = sum(comb(n, k) for k in range(least + 1))
    return min(1.0, float(2 * tail / 2**n))
