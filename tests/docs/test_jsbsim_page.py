"""The page on JSBSim's aircraft says what the committed table says, and the table what is claimed."""

from __future__ import annotations

import pytest

from docs.jsbsim_tables import check_summary, shown
from docs.pages import DOCS, table
from stoop_studies.verify.jsbsim import EXPERIMENT, NOISE
from stoop_studies.verify.jsbsim_flight import FLEET, Stock

PAGE = DOCS / "jsbsim.md"


@pytest.mark.parametrize("stock", FLEET, ids=lambda s: s.model)
def test_the_tables_are_those_that_were_written(stock: Stock) -> None:
    assert list(table(PAGE, stock.title, "derivative").rows) == shown("jsbsim", stock.model)


@pytest.mark.parametrize("stock", FLEET, ids=lambda s: s.model)
def test_what_is_said_of_them(stock: Stock) -> None:
    summary = next(r for r in table(PAGE, "What holds", "aircraft").rows if r[0] == stock.title)
    check_summary("jsbsim", stock.model, summary[1:], EXPERIMENT.runs)


def test_noise() -> None:
    listed = dict(table(PAGE, "How", "channel").rows)
    assert {c: float(cell.split()[0]) for c, cell in listed.items()} == NOISE
