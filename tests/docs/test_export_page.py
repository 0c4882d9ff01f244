"""The page on exports says what the committed table says, and the table what is claimed; its example runs."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest

from docs.pages import DOCS, run_python, table
from stoop_studies.verify.export import DIFFERENCE_LIMIT, INPUTS, VEHICLES

PAGE = DOCS / "export.md"
COLUMNS = ("difference", "difference_4000_hz", "difference_on_frames", "difference_earth")


def flights() -> dict[tuple[str, str], list[dict[str, str]]]:
    found: dict[tuple[str, str], list[dict[str, str]]] = {}
    with (DOCS / "verify" / "export.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            found.setdefault((row["vehicle"], row["inputs"]), []).append(row)
    return found


def most(rows: list[dict[str, str]], column: str) -> float:
    return max(float(row[column]) for row in rows)


def test_the_table_is_the_one_that_was_written() -> None:
    shown = table(PAGE, "Accuracy", "vehicle", "inputs").rows
    written = flights()
    assert list(written) == [(v, i) for v in VEHICLES for i in INPUTS]
    for cells, (key, rows) in zip(shown, written.items(), strict=True):
        worst = max(rows, key=lambda row: float(row["difference_on_frames"]))["channel"]
        assert list(cells) == [*key, worst, *(f"{most(rows, c):.1e}" for c in COLUMNS)]


def test_what_is_claimed() -> None:
    written = flights()
    text = re.sub(r"\s+", " ", PAGE.read_text(encoding="utf-8"))
    assert max(most(rows, "difference_on_frames") for rows in written.values()) < DIFFERENCE_LIMIT
    assert (
        max(most(rows, "difference") for (v, _), rows in written.items() if v != "crooked") < DIFFERENCE_LIMIT
    )
    crooked = written["crooked", "3-2-1-1, doublets"]
    worst = max(crooked, key=lambda row: float(row["difference"]))
    assert worst["channel"] == "ax"
    assert f"the crooked aircraft's {most(crooked, 'difference'):.1e}".replace("e-0", "e-") in text
    assert f"it is {most(crooked, 'difference_on_frames'):.1e}".replace("e-0", "e-") in text
    boom = written["twin-boom", "3-2-1-1, doublets"]
    assert most(boom, "difference") / most(boom, "difference_4000_hz") == pytest.approx(16.0, rel=0.05)


def test_the_example_flies(tmp_path: Path) -> None:
    said = run_python(PAGE, tmp_path).strip().splitlines()
    assert {f"stoop/channel/{c} (RW)" for c in ("elevator", "aileron", "rudder")} <= set(said)
    assert re.search(r"^\d+\.\d m/s after 30 s$", said[-1])
