"""The table of delays says what the committed numbers say, and they bear out what is claimed."""

from __future__ import annotations

import csv

from docs.pages import DOCS, table

PAGE = DOCS / "compatibility.md"
WITHIN = 0.1  #: samples


def records() -> list[dict[str, str]]:
    with (DOCS / "verify" / "delays.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_table_is_the_one_that_was_written() -> None:
    shown = table(PAGE, "Delays", "case").rows
    assert len(shown) == len(records())
    for cells, row in zip(shown, records(), strict=True):
        figures = [f"{float(row[c]):.3f}" for c in ("rms_error", "largest_error", "mean_sigma")]
        assert list(cells) == [
            row["case"],
            row["delay"],
            *figures,
            f"{100 * float(row['coverage']):.0f}",
        ]


def test_the_model_tells_every_delay_within_a_tenth_of_a_sample() -> None:
    told = [row for row in records() if row["case"] == "identify"]
    assert len(told) == 9
    assert all(float(row["rms_error"]) < WITHIN for row in told)
    assert f"over {told[0]['flights']} flights" in PAGE.read_text(encoding="utf-8")
