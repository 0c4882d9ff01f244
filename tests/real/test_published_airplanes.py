"""Derivatives of the Skywalker X8 and the XK A430 as published, and as the table of the handbook study has them."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from docs.pages import DOCS

from stoop_studies.verify import handbook


@pytest.mark.parametrize(
    ("key", "name", "value"), [("x8", "CLalpha", 4.0203), ("a430", "Claileron", 0.350364)]
)
def test_published_numbers(key: str, name: str, value: float, shared_data: Path) -> None:
    found = handbook.published(key, shared_data)
    assert found[name] == pytest.approx(value, rel=1e-4)
    with (DOCS / "verify" / "handbook.csv").open(newline="") as file:
        rows = [r for r in csv.DictReader(file) if r["airplane"] == handbook.airplanes()[key]["name"]]
    assert {r["derivative"]: float(r["published"]) for r in rows} == pytest.approx(found)
