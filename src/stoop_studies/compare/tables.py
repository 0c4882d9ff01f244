"""The comparison as CSV: a row per pair, a row per run."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

from stoop.base.csv_text import csv_text
from stoop_studies.compare.measures import Score
from stoop_studies.compare.race import Race

SCORES: Final = (
    "problem", "optimizer", "runs", "successes", "ert", "ert_low", "ert_high", "median_of_successes",
    "baseline", "ratio", "ratio_low", "ratio_high", "wrong_optima", "ended_short", "evaluations",
)  # fmt: skip
RACES: Final = ("problem", "optimizer", "seed", "hit", "evaluations", "cost", "status", "target", "reference")


def scores_text(scores: Iterable[Score]) -> str:
    """Return a row per optimizer and problem; inf where no run succeeded, nothing where there is no ratio."""
    return csv_text(SCORES, [_score(s) for s in scores])


def races_text(races: Iterable[Race]) -> str:
    """Return a row per run; ``hit`` is empty where the target was not reached."""
    rows = [
        (r.problem, r.optimizer, r.seed, r.hit, r.evaluations, r.cost, r.status, r.target, r.reference)
        for r in races
    ]
    return csv_text(RACES, rows)


def _score(s: Score) -> list[str | int | float | None]:
    spans = [_known(x) for span in (s.ert, s.ratio) for x in (span.value, span.low, span.high)]
    return [
        s.problem, s.optimizer, s.runs, s.successes, *spans[:3], _known(s.median),
        s.baseline, *spans[3:], s.wrong, s.short, s.evaluations,
    ]  # fmt: skip


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value
