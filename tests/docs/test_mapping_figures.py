"""What the page says of mappings that are judged is what the committed table says."""

from __future__ import annotations

import csv

from docs.pages import DOCS, table

PAGE = DOCS / "flight-files.md"


def records(case: str) -> list[dict[str, str]]:
    with (DOCS / "verify" / "lines.csv").open(newline="") as file:
        return [row for row in csv.DictReader(file) if row["case"] == case]


def test_the_table_is_the_one_that_was_written() -> None:
    said = {
        "mangled": ("named", "ambiguous", "wrong", "silent"),
        "right": ("accused", "accused", "accused", "silent"),
    }
    rows = {
        "mangled": records("mangled"),
        "other axes": records("frames"),
        "several together": records("together"),
        "right, simulated": records("clean"),
        "right, real": records("real"),
    }
    shown = table(PAGE, "Measured", "flights").rows
    assert [row[0] for row in shown] == list(rows)
    for name, count, *cells in shown:
        own = [row["said"] for row in rows[name]]
        assert int(count) == len(own)
        words = said["right" if name.startswith("right") else "mangled"]
        assert [int(cell) for cell in cells] == [own.count(word) for word in words]


def test_what_is_asked_is_met() -> None:
    mangled = records("mangled")
    assert len(mangled) == 60
    assert sum(row["said"] in ("named", "ambiguous") for row in mangled) >= 54
    right = [*records("clean"), *records("real")]
    assert len(right) >= 40
    assert {row["said"] for row in right} == {"silent"}
    followed = [row["followed"] for row in (*mangled, *records("frames"), *records("together"))]
    assert (followed.count("right"), followed.count("wrong")) == (172, 0)
    cases = ("mangled", "frames", "together")
    assert [sum(row["draft"] == "wrong" for row in records(case)) for case in cases] == [1, 0, 5]
