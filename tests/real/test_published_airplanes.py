"""Derivatives of the Skywalker X8 and the XK A430 as published, and as the table of the handbook study has them."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from stoop_studies.verify import handbook

DOCS = Path(__file__).parents[2] / "docs"


def test_published_numbers(shared_data: Path) -> None:
    with (DOCS / "verify" / "handbook.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for key, name, value in (("x8", "CLalpha", 4.0203), ("a430", "Claileron", 0.350364)):
        found, airplane = handbook.published(key, shared_data), handbook.airplanes()[key]["name"]
        assert found[name] == pytest.approx(value, rel=1e-4)
        told = {r["derivative"]: float(r["published"]) for r in rows if r["airplane"] == airplane}
        assert told == pytest.approx(found)
