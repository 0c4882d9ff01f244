"""How much flight: the tables of the page are what the pictures compute."""

from __future__ import annotations

import sys

import pytest

from docs.pages import DOCS, table

sys.path.insert(0, str(DOCS))
pytest.importorskip("matplotlib")

from pictures import how_much

PAGE = DOCS / "how-much-flight.md"


def same(shown: str, error: float) -> bool:
    """Whether a cell shows an error, but for rounding on other processors."""
    if shown == "\N{EN DASH}":
        return error > 0.97 * how_much.POOR
    return float(shown) == pytest.approx(error, rel=0.06)


def test_which_maneuver_identifies_what() -> None:
    shown = table(PAGE, "Which maneuver identifies what", "parameter", "elevator 3-2-1-1")
    computed = how_much.by_maneuver()
    assert shown.head[1:] == tuple(computed)
    assert tuple(shown.column("parameter")) == how_much.SHOWN
    for name, *cells in shown.rows:
        for column, cell in zip(computed.values(), cells, strict=True):
            assert same(cell, column[name]), name


def test_how_many() -> None:
    shown = table(PAGE, "How many", "parameter", "one set")
    one = tuple(how_much.forecast(n) for n in how_much.ONE_OF_EACH)
    columns = [how_much.errors(*(one * k)) for k in (1, 2, 4)]
    columns.append(
        how_much.errors(*(how_much.forecast(n, how_much.SECONDS, 1.5) for n in how_much.ONE_OF_EACH))
    )
    for name, *cells in shown.rows:
        assert all(same(cell, column[name]) for cell, column in zip(cells, columns, strict=True)), name


def test_what_the_page_says_of_them() -> None:
    """The 3-2-1-1 halves the errors of the doublet; four sets halve those of one."""
    table_of = how_much.by_maneuver()
    for name in ("CLalpha", "CLq", "Cmalpha", "Cmq", "Cmelevator"):
        assert 1.6 < table_of["elevator doublet"][name] / table_of["elevator 3-2-1-1"][name] < 2.4
    one = tuple(how_much.forecast(n) for n in how_much.ONE_OF_EACH)
    assert how_much.errors(*(one * 4))["Cmq"] == pytest.approx(0.5 * how_much.errors(*one)["Cmq"], rel=1e-6)
