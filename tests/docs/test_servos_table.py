"""The table of servos says what the committed numbers say, and these bear out what is claimed."""

from __future__ import annotations

import csv

from docs.pages import DOCS, tables

ROWS = list(csv.DictReader((DOCS / "verify" / "servos.csv").read_text(encoding="utf-8").splitlines()))


def test_the_table_is_the_one_that_was_written() -> None:
    (shown,) = (t for t in tables(DOCS / "vehicle-file.md") if "servos of the truth" in t.head)
    for cells, row in zip(shown.rows, ROWS, strict=True):
        coverage, z, lag, delay = (float(row[n]) for n in ("coverage", "rms_z", "lag", "delay"))
        assert list(cells) == [
            row["servos"],
            f"{100 * coverage:.1f}",
            f"{z:.2f}",
            f"{lag:.1f}",
            f"{delay:.1f}",
        ]


def test_intervals_hold_whatever_the_servos() -> None:
    assert all(0.90 <= float(row["coverage"]) <= 0.98 and float(row["rms_z"]) <= 1.2 for row in ROWS)
    assert all(int(row["flights"]) >= 30 for row in ROWS)
