"""The table of designed inputs says what the committed numbers say, and they bear out what is claimed."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from docs.pages import DOCS, run_python, table

PAGE = DOCS / "design.md"
COLUMNS = (
    "textbook_predicted", "designed_predicted", "textbook_achieved", "designed_achieved", "ratio_predicted", "ratio_achieved",
)  # fmt: skip


def records() -> dict[str, dict[str, str]]:
    with (DOCS / "verify" / "design.csv").open(newline="", encoding="utf-8") as file:
        return {row["parameter"]: row for row in csv.DictReader(file)}


def test_the_table_is_the_one_that_was_written() -> None:
    shown = table(PAGE, "Benefit", "parameter").rows
    assert len(shown) > 10
    for name, *cells in shown:
        row = records()[name]
        assert cells == [f"{float(row[c]):.3g}" if row[c] else "" for c in COLUMNS], name


def test_error_bars_come_down_by_thirty_percent_as_promised() -> None:
    mean = records()["mean"]
    assert float(mean["ratio_predicted"]) < 0.7
    assert float(mean["ratio_achieved"]) < 0.7
    assert mean["flights"] == "100"
    assert "100 flights of each input" in PAGE.read_text(encoding="utf-8")


@pytest.mark.slow
def test_python_of_the_page(tmp_path: Path) -> None:
    assert "Cmelevator" in run_python(PAGE, tmp_path)
