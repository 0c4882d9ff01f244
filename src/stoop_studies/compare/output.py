"""The folder of a comparison: its store, tables and page.

``compare.csv`` has a row per optimizer and problem, ``runs.csv`` a row per run; they and ``compare.html`` lie beside the
campaign's store ``compare.sqlite``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from stoop.base.csv_text import csv_text
from stoop.base.files import write_text_atomic
from stoop.errors import OutputError
from stoop.parallel.store import forget
from stoop.report.sheet import write_sheet
from stoop_studies.compare.field import Field
from stoop_studies.compare.measures import Score, score
from stoop_studies.compare.page import page
from stoop_studies.compare.race import Race

STORE: Final = "compare.sqlite"
SCORES: Final = "compare.csv"
RUNS: Final = "runs.csv"
PAGE: Final = "compare.html"
SCORE_COLUMNS: Final = (
    "problem", "optimizer", "runs", "successes", "ert", "ert_low", "ert_high", "median_of_successes",
    "baseline", "ratio", "ratio_low", "ratio_high", "wrong_optima", "ended_short", "evaluations",
)  # fmt: skip
RUN_COLUMNS: Final = (
    "problem",
    "optimizer",
    "seed",
    "hit",
    "evaluations",
    "cost",
    "status",
    "target",
    "reference",
)


def prepare(folder: Path, overwrite: bool) -> None:
    """See to it that a folder may be written into: continue the store that is there, or with `overwrite` forget it.

    Raises
    ------
    OutputError
        It is a file, holds tables of something else, or with `overwrite`: the store is another program's file, or in use.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: is a file; name a folder")
    store = folder / STORE
    if store.exists():
        if overwrite:
            forget(store)
        return
    strange = [folder / name for name in (SCORES, RUNS, PAGE) if (folder / name).exists()]
    if strange and not overwrite:
        raise OutputError(
            f"{strange[0]}: exists already, and no {STORE} beside it; add --overwrite to replace it, or choose another folder"
        )


def conclude(field: Field, results: Mapping[str, Any], folder: Path, command: str) -> list[Score]:
    """Write tables and page of a campaign's results; return the scores by problem, the fastest first.

    Raises
    ------
    OutputError
        The folder cannot be written.
    """
    races = field.races(results)
    scores = scored(field, races)
    write_text_atomic(folder / SCORES, scores_text(scores))
    write_text_atomic(folder / RUNS, races_text(race for found in races.values() for race in found))
    write_sheet(page(field, races, scores, command), folder / PAGE)
    return scores


def scored(field: Field, races: Mapping[tuple[str, str], Sequence[Race]]) -> list[Score]:
    """Return the scores of all pairs, by problem in the field's order, the fastest first."""
    found = [score(races[p, o], races[p, field.baseline(p)]) for p, o in field.pairs]
    return sorted(
        found,
        key=lambda s: (field.problems.index(s.problem), s.ert.value, -s.successes, s.optimizer),
    )


def scores_text(scores: Iterable[Score]) -> str:
    """Return a row per optimizer and problem; inf where no run succeeded, nothing where there is no ratio."""

    def known(value: float) -> float | None:
        return None if math.isnan(value) else value

    return csv_text(
        SCORE_COLUMNS,
        [
            (
                s.problem, s.optimizer, s.runs, s.successes, known(s.ert.value), known(s.ert.low), known(s.ert.high),
                known(s.median), s.baseline, known(s.ratio.value), known(s.ratio.low), known(s.ratio.high),
                s.wrong, s.short, s.evaluations,
            )
            for s in scores
        ],
    )  # fmt: skip


def races_text(races: Iterable[Race]) -> str:
    """Return a row per run; ``hit`` is empty where the target was not reached."""
    return csv_text(RUN_COLUMNS, [tuple(getattr(r, column) for column in RUN_COLUMNS) for r in races])
