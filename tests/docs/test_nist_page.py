"""The page on certified regressions says what the committed table says, and the table what is claimed."""

from __future__ import annotations

import csv

from docs.pages import DOCS, table

PAGE = DOCS / "nist.md"
COLUMNS = (
    "problem", "level", "start", "iterations", "digits_parameters", "digits_deviations", "digits_rss", "local_search_ending",
    "local_search_digits_parameters",
)  # fmt: skip


def records() -> list[dict[str, str]]:
    with (DOCS / "verify" / "nist.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_table_is_the_one_that_was_written() -> None:
    shown = table(PAGE, "What holds", "problem").rows
    written = records()
    assert len(shown) == len(written) == 2 * len({row["problem"] for row in written})
    for cells, row in zip(shown, written, strict=True):
        told = [
            f"{float(row[c]):.1f}" if c.startswith(("digits", "local_search_digits")) else row[c]
            for c in COLUMNS
        ]
        assert list(cells) == told


def test_what_is_said_of_it() -> None:
    rows = records()
    text = PAGE.read_text(encoding="utf-8")
    parameters = min((float(r["digits_parameters"]), r["problem"]) for r in rows)
    deviations = min((float(r["digits_deviations"]), r["problem"]) for r in rows)
    assert parameters[0] >= 9.0
    assert deviations[0] >= 9.0
    assert f"in all {len(rows)} fits" in text
    assert f"{parameters[0]:.1f} digits of a\nparameter ({parameters[1]})" in text
    assert f"{deviations[0]:.1f} of a standard deviation ({deviations[1]}" in text
    arrived = sum(r["local_search_ending"] == "converged" for r in rows)
    assert f"It arrives in {arrived} of {len(rows)}" in text
