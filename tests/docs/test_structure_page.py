"""The page on model structure says what the committed tables say, and the tables what is claimed."""

from __future__ import annotations

import csv

import pytest

from docs.pages import DOCS, table
from stoop_studies.verify.recursive import DIFFERENCE_LIMIT, WELL_IDENTIFIED
from stoop_studies.verify.structure import (
    AMPLITUDES,
    CRITERIA,
    DURATION,
    FLIGHTS,
    OCCASIONAL,
    RATE,
    full_aircraft,
)

PAGE = DOCS / "structure.md"
TEXT = PAGE.read_text(encoding="utf-8")


def records(name: str) -> list[dict[str, str]]:
    with (DOCS / "verify" / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def percent(share: str) -> str:
    return f"{100.0 * float(share):.2f} %"


def test_the_table_of_structures_is_the_one_that_was_written() -> None:
    written = {(r["criterion"], r["coefficient"]): r for r in records("structure")}
    shown = table(PAGE, "Success rate", "coefficient").rows
    assert len(shown) * len(CRITERIA) == len(written)
    for coefficient, *cells in shown:
        key = "all" if coefficient == "all six" else coefficient
        assert cells == [f"{written[k, key]['exact']} of {written[k, key]['aircraft']}" for k in CRITERIA]


def test_structures_reach_what_was_asked_for() -> None:
    whole = next(r for r in records("structure") if (r["criterion"], r["coefficient"]) == ("f", "all"))
    assert int(whole["aircraft"]) == 200
    assert int(whole["exact"]) >= 0.9 * 200
    assert f"For {whole['exact']} of 200 simulated aircraft, `f` selected exactly the true terms" in TEXT


def test_the_scene_is_the_one_that_is_told() -> None:
    assert (FLIGHTS, DURATION, RATE) == (4, 25.0, 50.0)
    assert AMPLITUDES == {"elevator": 0.22, "aileron": 0.08, "rudder": 0.12}
    assert sum(map(len, OCCASIONAL.values())) == 9  # nine others
    sensors = full_aircraft().file.sensors
    told = {"V": 0.3, "alpha": 0.005, "beta": 0.005, "p": 0.01, "phi": 0.01, "ax": 0.1}
    assert {c: getattr(sensors, c).sigma for c in told} == told


def test_the_table_of_recursive_estimates_is_the_one_that_was_written() -> None:
    written = {r["parameter"]: r for r in records("recursive") if r["largest_difference_well_identified"]}
    shown = table(PAGE, "In real time", "parameter").rows
    assert [row[0] for row in shown] == list(written)
    for name, well, *shares in shown:
        r = written[name]
        assert well == f"{r['well_identified']} of {r['flights']}"
        columns = ("batch_std_error", "median_difference", "largest_difference_well_identified")
        assert shares == [percent(r[c]) for c in columns]


def test_recursive_estimates_reach_what_was_asked_for() -> None:
    assert (WELL_IDENTIFIED, DIFFERENCE_LIMIT) == (0.02, 0.02)
    found = [r for r in records("recursive") if r["largest_difference_well_identified"]]
    worst = max(found, key=lambda r: float(r["largest_difference_well_identified"]))
    assert float(worst["largest_difference_well_identified"]) < DIFFERENCE_LIMIT
    assert f"within {percent(worst['largest_difference_well_identified'])} of\n" in TEXT
    assert f"largest: {worst['parameter']}" in TEXT
    assert len(found) >= 10


@pytest.mark.parametrize("name", ["structure", "recursive"])
def test_the_pages_were_made_by_the_default_command(name: str) -> None:
    html = (DOCS / "verify" / f"{name}.html").read_text(encoding="utf-8")
    assert f"stoop verify {name} --runs {200 if name == 'structure' else 50} --seed 0" in html
