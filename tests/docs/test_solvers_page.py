"""The page of other solvers says what its committed figures say, and stoop's row is what the text claims."""

from __future__ import annotations

import json
from typing import Any

import pytest

from docs.pages import DOCS, ROOT, table
from stoop.base.numbers import number

PAGE = DOCS / "solvers.md"
COLUMNS = {
    "Time": ("fit", "fit, over that of stoop", "build"),
    "Where each ends": ("cost above the least", "largest deviation from stoop"),
    "What it takes": ("iterations", "simulations", "memory", "lines of code"),
}  #: heading to the figures of its table
UNITS = {"fit": " s", "fit, over that of stoop": "×", "build": " s", "memory": " MB"}


@pytest.fixture(scope="module")
def content() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((DOCS / "results" / "solvers.json").read_text(encoding="utf-8"))
    return found


@pytest.fixture(scope="module")
def figures(content: dict[str, Any]) -> dict[str, dict[str, float]]:
    """What was measured, by tool and figure."""
    found: dict[str, dict[str, float]] = {}
    for row in content["rows"]:
        tool, figure = row["figure"].split(": ")
        found.setdefault(tool, {})[figure] = row["value"]
    return found


def written(figure: str, value: float) -> str:
    if figure in ("cost above the least", "largest deviation from stoop"):
        return f"{value:.0e}".replace("e-0", "e-") if value else "0"
    return number(value, max(2, len(f"{value:.0f}"))) + UNITS[figure] if figure in UNITS else f"{value:.0f}"


@pytest.mark.parametrize("heading", COLUMNS)
def test_table(figures: dict[str, dict[str, float]], heading: str) -> None:
    shown, columns = table(PAGE, heading, "tool"), COLUMNS[heading]
    assert shown.head == ("tool", *columns)
    assert [row[0] for row in shown.rows] == list(figures)
    for tool, *cells in shown.rows:
        assert cells == [written(c, figures[tool][c]) for c in columns]


def test_everyone_reaches_the_same_optimum(figures: dict[str, dict[str, float]]) -> None:
    for found in figures.values():
        assert found["difference of trajectories"] <= 1e-8
        assert found["cost above the least"] < 1e-7
        assert found["largest deviation from stoop"] < 0.1


def test_readme(figures: dict[str, dict[str, float]]) -> None:
    row = next(
        r for r in table(ROOT / "README.md", "How it compares", "quantity").rows if "joint fit" in r[0]
    )
    assert row[1] == written("fit", figures["stoop"]["fit"])
    for tool in ("SciPy and Numba", "CasADi and IPOPT", "JAX and Diffrax"):
        assert written("fit", figures[tool]["fit"]) in row[2]


def test_what_is_said_of_the_run(content: dict[str, Any], figures: dict[str, dict[str, float]]) -> None:
    text = PAGE.read_text(encoding="utf-8")
    others = [f["fit, over that of stoop"] for tool, f in figures.items() if not tool.startswith("stoop")]
    least, most = (written("fit, over that of stoop", of(others)) for of in (min, max))
    assert f"the others take {least} to {most} as long" in text
    assert f"load {content['machine']['load'].split()[0]} at the start" in text
    for row in content["rows"]:
        if row["figure"].endswith(": fit"):
            assert all(version in text for version in row["note"].split(", "))


def test_what_is_said_of_the_problem() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert f"{4 * 751 * 12:,} readings" in text
    assert "32 coefficients" in text
    assert "36 initial states and 32 sensor biases" in text
