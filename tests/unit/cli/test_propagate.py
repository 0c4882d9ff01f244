"""`stoop propagate` of the demonstration: tables, page, and intervals that hold the truth."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from stoop.cli.main import main


def test_tables_page_and_json(fitted: Path, tmp_path: Path, done: Callable[..., str]) -> None:
    page = tmp_path / "page.html"
    given = f"propagate {fitted} --draws 200 --expression ratio=Cmalpha/CLalpha -o {page}"
    printed = done(given)
    for words in (
        "200 draws from the covariance",
        "static margin",
        "short period, damping",
        "ratio",
        "chord",
    ):
        assert words in printed
    html = page.read_text(encoding="utf-8")
    assert "What the uncertainty means" in html
    assert "Cmalpha/CLalpha" in html
    assert main(given.split()) == 2, "the page is not written over"
    found = json.loads(done(f"propagate {fitted} --draws 300 --airspeed 33:38 --json"))
    assert found["format"] == "stoop-propagation/1"
    margin = next(f for f in found["figures"] if f["name"] == "static margin")
    assert margin["ci95_lower"] < 2.12 / 4.78 < margin["ci95_upper"]
    assert found["curves"][0]["airspeed"][0] == 33.0


def test_the_folder_of_a_result_is_linearized_as_its_vehicle_file(
    fitted: Path, done: Callable[..., str]
) -> None:
    assert done(["linearize", fitted]) == done(["linearize", fitted / "vehicle.toml"])
