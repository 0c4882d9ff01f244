"""The cases that failed in campaigns, once more: what was mended stays so."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import pytest
from docs.pages import DOCS

from stoop_studies.robustness.trials import BAD, Tried, try_all
from stoop_studies.robustness.verbs import BOUNDS, VERBS, verb_cases
from stoop_studies.verify.robustness import SURFACES

COLD = replace(BOUNDS, seconds=60)  #: equations may have to be compiled


def cases(table: Path) -> list[tuple[str, int, int]]:
    with table.open(newline="", encoding="utf-8") as file:
        found = [row for row in csv.DictReader(file) if row.get("outcome", "fault") in BAD]
    return [(row["surface"], int(row["seed"]), int(row["number"])) for row in found]


FOUND = cases(Path(__file__).with_name("found.csv"))


def _once_more(surface: str, seed: int, number: int, data: Path) -> Tried:
    verb = surface.removeprefix("stoop ")
    if verb in VERBS:
        (tried,) = try_all(verb_cases(verb, seed), range(number, number + 1), COLD)
        return tried
    return list(SURFACES[surface].trials(seed, number + 1, str(data)))[-1]


@pytest.mark.parametrize(("surface", "seed", "number"), FOUND)
def test_what_failed_ends_well(surface: str, seed: int, number: int, shared_data: Path) -> None:
    tried = _once_more(surface, seed, number, shared_data)
    assert tried.number == number
    assert tried.outcome not in BAD, tried.message


def test_what_failed_in_the_published_campaign_is_among_them() -> None:
    assert set(cases(DOCS / "verify" / "robustness-found.csv")) <= set(FOUND)
