"""The page on flights under feedback says what the committed table says, and the table what is asked."""

from __future__ import annotations

import csv
from collections.abc import Mapping

import numpy as np
import pytest

from docs.pages import DOCS, table
from stoop_studies.verify import unstable
from stoop_studies.verify.feedback import CASES, MAX_BIAS, POOLED, Case

STUDIES = pytest.mark.parametrize(
    ("study", "title", "cases"),
    [("feedback", "What holds", CASES), ("unstable", "Unstable aircraft", unstable.CASES)],
)


def records(study: str) -> dict[str, list[dict[str, str]]]:
    with (DOCS / "verify" / f"{study}.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {case: [r for r in rows if r["case"] == case] for case in dict.fromkeys(r["case"] for r in rows)}


@STUDIES
def test_the_table_is_the_one_that_was_written_and_what_is_asked_is_met(
    study: str, title: str, cases: Mapping[str, Case]
) -> None:
    shown = {row[0]: list(row[1:]) for row in table(DOCS / "feedback.md", title, "case").rows}
    written = records(study)
    assert list(shown) == list(written) == list(cases)
    for case, rows in written.items():
        bias = np.array([abs(float(r["bias"])) for r in rows])
        coverage, sharpness = (float(np.mean([float(r[n]) for r in rows])) for n in ("coverage", "sharpness"))
        figures = [f"{100 * coverage:.1f}", f"{sharpness:.2f}", f"{bias.max():.2f}"]
        assert shown[case][:1] + shown[case][2:] == [
            rows[0]["flights"],
            *figures,
            rows[int(bias.argmax())]["parameter"],
        ]
        assert POOLED[0] <= coverage <= POOLED[1], case
        assert bias.max() < MAX_BIAS, case


@STUDIES
def test_the_method_is_that_of_the_page(study: str, title: str, cases: Mapping[str, Case]) -> None:
    page = (DOCS / "verify" / f"{study}.html").read_text()
    shown = table(DOCS / "feedback.md", title, "case")
    assert len(shown.rows) == len(cases)
    for method, row in zip(shown.column("method taken"), shown.rows, strict=True):
        assert f"{method.replace(' ', '-')} {row[1]}</td>" in page
