"""The page on flights under feedback says what the committed table says, and the table what is asked."""

from __future__ import annotations

import csv

import numpy as np

from docs.pages import DOCS, table
from stoop_studies.verify.feedback import CASES, MAX_BIAS, POOLED


def records() -> dict[str, list[dict[str, str]]]:
    with (DOCS / "verify" / "feedback.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {case: [r for r in rows if r["case"] == case] for case in dict.fromkeys(r["case"] for r in rows)}


def test_the_table_is_the_one_that_was_written_and_what_is_asked_is_met() -> None:
    shown = {row[0]: list(row[1:]) for row in table(DOCS / "feedback.md", "What holds", "case").rows}
    written = records()
    assert list(shown) == list(written) == list(CASES)
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


def test_the_method_is_that_of_the_page() -> None:
    page = (DOCS / "verify" / "feedback.html").read_text()
    shown = table(DOCS / "feedback.md", "What holds", "case")
    for method, row in zip(shown.column("method taken"), shown.rows, strict=True):
        assert f"{method.replace(' ', '-')} {row[1]}</td>" in page
