"""The page on what a model lacks says what the committed table of the study says, and what is asked is met."""

from __future__ import annotations

import csv
import re

from docs.pages import DOCS, table
from stoop_studies.verify.defects import RIGHT, defects
from stoop_studies.verify.extensions import LEAST_DEFECTS, LEAST_NAMED, MOST_SUGGESTED

PAGE = DOCS / "extensions.md"


def rows() -> list[dict[str, str]]:
    with (DOCS / "verify" / "extensions.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_size_and_power() -> None:
    assert [r["case"] for r in rows()] == list(defects())
    shown = {row[0]: list(row[1:]) for row in table(PAGE, "Size and power", "models").rows}
    for words, right in (("right", True), ("defects", False)):
        for kind in ("fixed wing", "quadrotor"):
            own = [r for r in rows() if (r["case"] in RIGHT) == right and r["kind"] == kind]
            flights = sum(int(r["flights"]) for r in own)
            said, named = (
                sum(float(r[key] or 0.0) * int(r["flights"]) for r in own) for key in ("suggested", "named")
            )
            share = "–" if right else f"{100 * named / flights:.1f}"
            assert shown.pop(f"{words}, {kind}") == [str(flights), f"{said:.0f}", share]
            assert said <= MOST_SUGGESTED * flights if right else named >= LEAST_NAMED * flights
    assert not shown


def test_kinds_that_are_named() -> None:
    defective = [r for r in rows() if r["case"] not in RIGHT]
    weak = [r["case"] for r in defective if float(r["named"]) < LEAST_NAMED]
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert f"{len(defective) - len(weak)} of the {len(defective)} kinds are named" in text
    assert re.findall(r"`(\w+)` \(lift in translation", text) == weak
    assert len(defective) - len(weak) >= LEAST_DEFECTS
