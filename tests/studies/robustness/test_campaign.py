"""What the page of the campaign counts."""

from __future__ import annotations

from stoop_studies.findings import Setting
from stoop_studies.robustness.trials import Tried, count_outcomes
from stoop_studies.verify.robustness import FAILED, FAMILIES, SURFACES, show, tabulate


def test_every_family_is_tried() -> None:
    assert {surface.family for surface in SURFACES.values()} == set(FAMILIES)


def test_counts_are_those_of_the_cases() -> None:
    outcomes = ["refused"] * 5 + ["listed"] * 3 + ["fault"]
    result = count_outcomes(Tried(n, "reader", "cut", outcome, "said") for n, outcome in enumerate(outcomes))
    findings = show(Setting(1), {"csv": [result], "ulog drawn": [result]})
    assert [c.verdict for c in findings.claims] == ["does not hold", "does not hold"]
    table = tabulate({"csv": [result]})
    assert table["cases"].sum() == 9
    assert table[FAILED].sum() == 1
    assert len(findings.parts["found"][1]) == 2
    assert "1 failures in 9 cases" in findings.claims[0].figures
