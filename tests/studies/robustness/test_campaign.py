"""The campaign in little: a few cases of every surface, twenty thousand in CI; and what its page says."""

from __future__ import annotations

import pytest

from stoop_studies.findings import Setting
from stoop_studies.robustness.trials import BAD, Tried, count_outcomes
from stoop_studies.verify.robustness import FAILED, FAMILIES, SURFACES, show, tabulate

IN_CI = {
    "verbs": 1.0,
    "kills": 3.0,
    "full disks": 4.0,
}  #: slices of the campaign; two of all others: 20,000 inputs, 30 kills


@pytest.mark.slow
@pytest.mark.parametrize("surface", SURFACES)
def test_hostile_inputs_end_well(surface: str) -> None:
    of_a_slice = SURFACES[surface]
    count = round(IN_CI.get(of_a_slice.family, 2.0) * of_a_slice.count)
    tried = list(of_a_slice.trials(78, count, ""))
    assert [t.number for t in tried] == list(range(count))
    assert [t for t in tried if t.outcome in BAD] == []


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
