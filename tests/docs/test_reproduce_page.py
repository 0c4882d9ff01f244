"""The page on the paper's experiments says what the committed table says."""

from __future__ import annotations

import csv

import pytest

from docs.pages import DOCS, table
from stoop.cli.reproduce import NAMES
from stoop.study.reproduce.registry import EXPERIMENTS
from stoop.study.reproduce.table1 import METHODS

PAGE = DOCS / "reproduce.md"
SHOWN = {registered: shown for shown, registered in METHODS.items()}


def test_experiments_and_their_runs() -> None:
    listed = table(PAGE, "The paper, run again", "experiment")
    assert listed.column("experiment") == list(NAMES)
    assert listed.column("runs") == [str(EXPERIMENTS[name].runs) for name in NAMES]


def test_table_1_is_the_one_that_was_written() -> None:
    with (DOCS / "reproduce" / "table1.csv").open(newline="", encoding="utf-8") as file:
        written = list(csv.DictReader(file))
    shown = table(PAGE, "What table 1 shows", "method").rows
    assert len(shown) == len(written)
    for (method, *cells), row in zip(shown, written, strict=True):
        assert method == SHOWN[row["method"]]
        counts = [row["iterations"], row["successful"], row["within_1e-6"]]
        numbers = [100.0 * float(row["mean_error"]), float(row["median_fitness"])]
        assert cells == [*counts, *(f"{x:.2g}" for x in numbers), row["median_evaluations_to_target"]]


def test_what_is_said_of_it() -> None:
    with (DOCS / "reproduce" / "table1.csv").open(newline="", encoding="utf-8") as file:
        rows = {(r["method"], int(r["iterations"])): r for r in csv.DictReader(file)}
    for iterations in (500, 1000, 1500, 2000):
        errors = [float(rows[m, iterations]["mean_error"]) for m in ("ga", "pso", "ps-gde")]
        assert errors == sorted(errors, reverse=True)
        assert (
            rows["ps-gde", iterations]["within_1e-6"] == rows["ps-gde-lm", iterations]["within_1e-6"] == "50"
        )
    assert rows["pso", 1500]["successful"] == "50"
    hits = float(rows["ps-gde", 500]["median_evaluations_to_target"])
    assert hits == pytest.approx(5752.0, rel=0.1), "the prototype's"
