"""The page of motion capture: its figures are those of the tables of the study."""

from __future__ import annotations

import csv

from docs.pages import DOCS, table

PAGE = DOCS / "motion-capture.md"
WITHIN = 0.010  #: s


def rows(name: str) -> list[dict[str, str]]:
    with (DOCS / "verify" / name).open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_table_is_that_of_the_study() -> None:
    shown = {row[0]: row[1:] for row in table(PAGE, "How well it works", "", "airplanes").rows}
    vehicles = rows("capture-vehicles.csv")
    for column, one in enumerate(rows("capture.csv")):
        said = {name: cells[column] for name, cells in shown.items()}
        share, count = 100.0 * float(one["coverage"]), one["numbers"]
        assert said["95 % intervals that hold the truth"] == f"{share:.1f} % of {count}"
        assert said["rms error, standard errors"].startswith(f"{float(one['rms']):.3g}"[:4].rstrip("0"))
        assert f"{one['far']} of {count} above 5" in said["rms error, standard errors"]
        own = [v for v in vehicles if v["case"] == one["case"]]
        late = [abs(float(v["found"]) - float(v["delay"])) <= WITHIN for v in own if v["found"]]
        assert said["delay of the commands within 10 ms"] == f"{sum(late)} of {len(own)}"
        assert said["verdict right"] == f"{one['right']} of {one['flights']}"
        assert said["stopped on the way"] == one["stopped"]
        times = f"{float(one['seconds']):.0f} s, {float(one['slowest']):.0f} s"
        assert said["from log to report, median and longest"] == times
