"""The page of optimizers: every name, the numbers and pieces that it says, and its own mutation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from docs.pages import DOCS, run_python, table
from stoop import optimize
from stoop.optimize import population
from stoop_studies.optimizers import evolution, local_search, mutation, shade
from stoop_studies.optimizers.evolution import DifferentialEvolution
from stoop_studies.optimizers.mutation import Fixed

PAGE = DOCS / "optimizers.md"
EVOLUTIONS = [n for n in optimize.names() if isinstance(optimize.create(n), DifferentialEvolution)]


def test_every_name_is_on_the_page() -> None:
    assert table(PAGE, "By name", "name").column("name") == list(optimize.names())
    assert table(PAGE, "The differential evolutions", "name").column("name") == EVOLUTIONS


@pytest.mark.parametrize("name", EVOLUTIONS)
def test_compositions_are_what_the_page_says(name: str) -> None:
    said = table(PAGE, "The differential evolutions", "name")
    row = dict(zip(said.head, next(r for r in said.rows if r[0] == name), strict=True))
    made = optimize.create(name)
    assert row["mutation"] == getattr(made.mutation, "__name__", type(made.mutation).__name__)
    assert made.members == 50
    if isinstance(made.control, Fixed):
        assert (float(row["F"]), float(row["CR"])) == (made.control.scale, made.control.rate)
    else:
        scale, rate = made.control.sample(None, np.arange(9.0), np.random.default_rng(0))
        assert np.abs(scale).max() <= max(_numbers(row["F"]))
        assert (np.min(rate), np.max(rate)) == (min(_numbers(row["CR"])), max(_numbers(row["CR"])))
    assert bool(row["besides"]) == bool(
        made.after_selection or made.prey or hasattr(made.mutation, "probability")
    )


def _numbers(cell: str) -> list[float]:
    return [float(word.strip(",")) for word in cell.split() if word[0].isdigit()]


def test_every_piece_that_is_named_exists() -> None:
    known = {
        name for module in (population, evolution, local_search, mutation, shade) for name in dir(module)
    }
    for row in table(PAGE, "The differential evolutions", "piece").rows:
        assert not set(row[2].split(", ")) - known, row[0]


def test_a_mutation_of_ones_own(tmp_path: Path) -> None:
    problems = ("paper-N", "paper-S", "paper-W", "paper-W+noise")
    assert run_python(PAGE, tmp_path) == "".join(f"{name} target\n" for name in problems)
