"""The tables of the page on decisions are those of the published study, and its counts too."""

from __future__ import annotations

import csv

import pytest

from docs.pages import DOCS, table
from stoop_studies.verify.decision_fleet import CASES, REAL, folds
from stoop_studies.verify.decisions import EXPERIMENT, NONE

PAGE = DOCS / "decisions.md"
COLUMNS = {
    "coverage": ("coverage", 100.0), "error, standard errors": ("bias", 1.0), "score": ("score", 1.0),
    "log-likelihood": ("log_likelihood", 1.0), "Theil": ("theil", 1.0), "seconds": ("seconds", 1.0),
}  # fmt: skip


def records(case: str) -> dict[str, dict[str, str]]:
    with (DOCS / "verify" / "decisions.csv").open(newline="", encoding="utf-8") as file:
        rows = [r for r in csv.DictReader(file) if r["case"] == case and " + " not in r["without"]]
    return {r["without"]: r for r in rows}


def shown(record: dict[str, str], name: str, scale: float) -> str:
    if not record[f"{name}_se"]:
        return f"{scale * float(record[name]):+.2g}"
    return f"{scale * float(record[name]):+.2g} ± {scale * float(record[f'{name}_se']):.2g}"


@pytest.mark.parametrize(("case", "counted"), [("simulated", "vehicles"), ("real", "windows")])
def test_tables_are_those_of_the_study(case: str, counted: str) -> None:
    of_page, of_study = table(PAGE, "What they are worth", "without", counted), records(case)
    names = [NONE if n == "all of them" else n for n in of_page.column("without")]
    assert sorted(names) == sorted(of_study)
    assert of_page.column(counted) == [of_study[n]["vehicles"] for n in names]
    for column, (name, scale) in COLUMNS.items():
        if column in of_page.head:
            assert of_page.column(column) == [shown(of_study[n], name, scale) for n in names]


def test_every_vehicle_and_every_window_was_flown() -> None:
    assert int(records("simulated")[NONE]["vehicles"]) == len(CASES) * EXPERIMENT.runs
    windows = sum(map(folds, REAL))
    assert int(records("real")[NONE]["vehicles"]) == windows
    text = PAGE.read_text(encoding="utf-8")
    assert f"**{len(CASES) * EXPERIMENT.runs} simulated vehicles**" in text
    assert f"**{windows} windows of real flights**" in text
