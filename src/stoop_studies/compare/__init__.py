"""Optimizers on the same problems, counted the same way: success, running time, and who is ahead where.

A `Field` of optimizers, problems and seeds says what a campaign runs; `conclude` writes of its results
``compare.csv`` (a row per optimizer and problem), ``runs.csv`` (a row per run) and ``compare.html`` into a folder,
beside the campaign's store ``compare.sqlite``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from stoop.base.files import write_text_atomic
from stoop.report.sheet import write_sheet
from stoop_studies.compare.field import Field
from stoop_studies.compare.folder import PAGE, RUNS, SCORES, STORE, prepare
from stoop_studies.compare.measures import Score, score
from stoop_studies.compare.page import page
from stoop_studies.compare.race import Race
from stoop_studies.compare.tables import races_text, scores_text

__all__ = ["PAGE", "RUNS", "SCORES", "STORE", "Field", "Score", "conclude", "prepare", "scored"]


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
