"""The page on JSBSim's aircraft says what the committed table says, and the table what is claimed."""

from __future__ import annotations

import csv

import pytest

from docs.pages import DOCS, table
from stoop_studies.verify.jsbsim.experiment import EXPERIMENT, HEAD, SHARE, SIGMAS, cells
from stoop_studies.verify.jsbsim.flight import FLEET, Stock
from stoop_studies.verify.jsbsim.truth import NOISE

PAGE = DOCS / "jsbsim.md"
WORDS = ("aircraft", "parameter", "agrees")


def records(model: str) -> list[dict[str, str]]:
    with (DOCS / "verify" / "jsbsim.csv").open(newline="") as file:
        return [row for row in csv.DictReader(file) if row["aircraft"] == model]


def told(record: dict[str, str]) -> tuple[str, ...]:
    """Return what the page shows of a record of the table."""
    counts = ("flights", "flights_that_agree")
    values = [
        record[k] if k in WORDS else int(record[k]) if k in counts else float(record[k] or "nan")
        for k in HEAD
    ]
    return cells(
        [None if v != v else v == "yes" if k == "agrees" else v for k, v in zip(HEAD, values, strict=True)]
    )


@pytest.mark.parametrize("stock", FLEET, ids=lambda s: s.model)
def test_the_tables_are_those_that_were_written(stock: Stock) -> None:
    title, model = stock.title, stock.model
    assert list(table(PAGE, title, "derivative").rows) == [told(r) for r in records(model)]


@pytest.mark.parametrize("stock", FLEET, ids=lambda s: s.model)
def test_what_is_said_of_them(stock: Stock) -> None:
    rows = records(stock.model)
    flights = int(rows[0]["flights"])
    assert flights == EXPERIMENT.runs
    agree = sum(int(r["flights_that_agree"]) for r in rows)
    square = sum(float(r["rms_difference_in_sigma"]) ** 2 for r in rows) / len(rows)
    summary = next(r for r in table(PAGE, "What holds", "aircraft").rows if r[0] == stock.title)
    assert summary[1:] == (str(len(rows)), f"{agree} of {flights * len(rows)}", f"{square:.2f}")
    assert agree >= 0.99 * flights * len(rows)
    for r in rows:
        off = abs(float(r["mean_estimate"]) - float(r["jsbsim"]))
        assert off <= max(SIGMAS * float(r["sigma"]), SHARE * abs(float(r["jsbsim"]))), r["parameter"]


def test_noise() -> None:
    shown = dict(table(PAGE, "How", "channel").rows)
    assert {c: float(cell.split()[0]) for c, cell in shown.items()} == NOISE
