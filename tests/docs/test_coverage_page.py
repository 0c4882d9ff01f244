"""The page on coverage says what the committed table says, and the table what is claimed."""

from __future__ import annotations

import csv

from docs.pages import DOCS, table
from stoop_studies.verify import misspecified
from stoop_studies.verify.coverage import CASES, POOLED

PAGE = DOCS / "coverage.md"


def records() -> dict[str, list[dict[str, str]]]:
    with (DOCS / "verify" / "coverage.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {case: [r for r in rows if r["case"] == case] for case in dict.fromkeys(r["case"] for r in rows)}


def test_cases_are_those_that_are_run() -> None:
    listed = table(PAGE, "What is flown", "case")
    assert listed.column("case") == list(CASES)
    assert [m.replace(" ", "-") for m in listed.column("method")] == [c.method for c in CASES.values()]
    assert set(records()) <= set(CASES)


def test_the_table_is_the_one_that_was_written() -> None:
    shown = {row[0]: list(row[1:]) for row in table(PAGE, "What holds", "case").rows}
    written = records()
    assert set(shown) == set(written)
    for case, rows in written.items():
        pooled = next(r for r in rows if r["parameter"] == POOLED)
        each = [100 * float(r["coverage"]) for r in rows if r["parameter"] != POOLED]
        assert shown[case] == [
            pooled["flights"],
            f"{100 * float(pooled['coverage']):.1f}",
            f"{min(each):.1f}",
            f"{max(each):.1f}",
            f"{float(pooled['sharpness']):.2f}",
            f"{100 * float(pooled['coverage_cramer_rao']):.1f}",
            f"{float(pooled['sharpness_cramer_rao']):.2f}",
        ]


def test_what_is_asked_is_met() -> None:
    """Pooled coverage in the range that is asked for; each parameter's where enough flights were flown to tell."""
    for case, rows in records().items():
        for r in rows:
            low, high = CASES[case].pooled
            if r["parameter"] == POOLED:
                assert low <= float(r["coverage"]) <= high, case
            elif CASES[case].each is not None and int(r["flights"]) >= 400:
                low, high = CASES[case].each
                assert low <= float(r["coverage"]) <= high, (case, r["parameter"])


def test_wrong_models() -> None:
    """The table is the one that was written; from four maneuvers on what is asked is met."""
    with (DOCS / "verify" / "misspecified.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    shares = ("coverage", "coverage_conditional", "coverage_cramer_rao")
    assert [list(row) for row in table(PAGE, "Wrong models", "what the model lacks").rows] == [
        [
            *(r[key] for key in ("lacks", "maneuvers", "flights")),
            *(f"{100 * float(r[key]):.1f}" for key in shares),
            f"{float(r['sharpness']):.2f}",
        ]
        for r in rows
    ]
    assert [f"{r['case']}-{r['maneuvers']}" for r in rows] == list(misspecified.CASES)
    low, high = misspecified.POOLED
    assert all(low <= float(r["coverage"]) <= high for r in rows if int(r["maneuvers"]) > 1)
