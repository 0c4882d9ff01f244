"""The figures of the page on propagated uncertainty are those of the committed study, and they bear out what is claimed."""

from __future__ import annotations

import csv

import numpy as np

from docs.pages import DOCS, table
from stoop_studies.verify.propagate import DRAWS, MAX_DIFFERENCE, NAMES, POOLED, RIGHTLY

PAGE = DOCS / "propagate.md"


def records() -> list[dict[str, str]]:
    with (DOCS / "verify" / "propagate.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_table_is_the_one_that_was_measured() -> None:
    shown = {row[0]: row[1:] for row in table(PAGE, "Measured", "case").rows}
    assert list(shown) == list(NAMES.values())
    for case, words in NAMES.items():
        own = [r for r in records() if r["case"] == case]
        pooled = float(np.mean([float(r["coverage"]) for r in own]))
        count = max(int(r["intervals"]) for r in own)
        assert shown[words] == (str(count), f"{100 * pooled:.1f}")
        assert POOLED[0] <= pooled <= POOLED[1]


def test_the_naive_twin_agrees() -> None:
    (twin,) = (r for r in records() if r["case"] == "twin")
    assert float(twin["coverage"]) < MAX_DIFFERENCE
    text = PAGE.read_text(encoding="utf-8")
    assert f"{twin['intervals']} draws one at a time" in " ".join(text.split())
    assert f"drawn {DRAWS} times" in text


def test_marks_of_figures_that_rest_on_priors_are_those_of_the_study() -> None:
    own = [(int(r["intervals"]), float(r["coverage"])) for r in records() if r["case"] == "marks"]
    count = sum(n for n, _ in own)
    rightly = sum(n * share for n, share in own) / count
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert f"{100 * rightly:.1f} % of {count} figures are marked rightly" in text
    assert rightly >= RIGHTLY
