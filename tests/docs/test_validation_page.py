"""The limits of the verdict that its page gives are those of the code, and its error rates those of the study."""

from __future__ import annotations

import csv
from dataclasses import asdict

import pytest

from docs.pages import DOCS, table
from stoop.assessment.verdict import LIMITS
from stoop_studies.verify.defects import RIGHT
from stoop_studies.verify.verdict import GRADES, MOST_WRONG

PAGE = DOCS / "validation.md"


def test_limits() -> None:
    shown = {row[0].strip("`"): float(row[1]) for row in table(PAGE, "The verdict", "limit").rows}
    assert shown == pytest.approx(asdict(LIMITS))


def test_error_rates() -> None:
    """The counts by verdict are those of the committed table of the study, and what is asked is met."""
    with (DOCS / "verify" / "verdict.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))

    def total(key: str, right: bool) -> int:
        return sum(int(r[key]) for r in rows if (r["case"] in RIGHT) == right)

    right = [total(key, True) for key in ("flights", *GRADES)]
    all_wrong = [total(key, False) for key in ("flights", *GRADES)]
    bad, trusted, refused = (total(key, False) for key in ("bad", "bad_trusted", "bad_refused"))
    wrong = [bad, trusted, bad - trusted - refused, refused]
    harmless = [a - b for a, b in zip(all_wrong, wrong, strict=True)]
    shown = [list(map(int, row[1:])) for row in table(PAGE, "Error rates of the verdict", "models").rows]
    assert shown == [right, wrong, harmless]
    assert right[3] <= MOST_WRONG * right[0]
    assert trusted <= MOST_WRONG * bad
