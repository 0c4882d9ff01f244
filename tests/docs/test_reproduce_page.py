"""The page on the paper's experiments says what the committed table says."""

from __future__ import annotations

import csv

import numpy as np
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
    written = records("table1")
    shown = table(PAGE, "What table 1 shows", "method").rows
    assert len(shown) == len(written)
    for (method, *cells), row in zip(shown, written, strict=True):
        assert method == SHOWN[row["method"]]
        counts = [row["iterations"], row["successful"], row["within_1e-6"]]
        numbers = [100.0 * float(row["mean_error"]), float(row["median_fitness"])]
        assert cells == [*counts, *(f"{x:.2g}" for x in numbers), row["median_evaluations_to_target"]]


def test_what_is_said_of_it() -> None:
    rows = {(r["method"], int(r["iterations"])): r for r in records("table1")}
    for iterations in (500, 1000, 1500, 2000):
        errors = [float(rows[m, iterations]["mean_error"]) for m in ("ga", "pso", "ps-gde")]
        assert errors == sorted(errors, reverse=True)
        assert (
            rows["ps-gde", iterations]["within_1e-6"] == rows["ps-gde-lm", iterations]["within_1e-6"] == "50"
        )
    assert rows["pso", 1500]["successful"] == "50"
    hits = float(rows["ps-gde", 500]["median_evaluations_to_target"])
    assert hits == pytest.approx(5752.0, rel=0.1), "the prototype's"


def test_ablation_is_the_one_that_was_written() -> None:
    written = records("ablation")
    assert list(table(PAGE, "Which idea helps", "variant").rows) == [
        (
            r["variant"], r["reached"], r["median_evaluations"], rounded(r["expected_running_time"], ".0f"),
            rounded(r["p_holm"], ".1g"),
        )
        for r in written
    ]  # fmt: skip
    by_name = {r["variant"]: r for r in written}
    medians = {name: float(r["median_evaluations"] or "inf") for name, r in by_name.items()}
    whole = medians["PS-GDE"]
    assert medians["without chaos"] < whole
    assert medians["without dive"] < whole
    assert whole < medians["without sorting"]
    assert medians["Levenberg-Marquardt dive"] < 0.2 * whole
    plain = {n: m for n, m in medians.items() if n != "Levenberg-Marquardt dive"}
    assert min(plain, key=lambda n: plain[n]) == "sorting alone"
    assert all(float(r["p_holm"]) < 0.05 for r in written if r["p_holm"])


def test_sweep_says_what_was_written() -> None:
    rows = {(r["parameter"], r["value"]): r for r in records("sweep")}
    assert (rows["F", "0.5"]["reached"], rows["F", "0.4"]["reached"]) == ("14", "0")
    assert float(rows["F", "0.7"]["median_evaluations"]) > 1.5 * float(rows["F", "0.6"]["median_evaluations"])
    assert float(rows["CR", "0.95"]["median_evaluations"]) < float(rows["CR", "0.9"]["median_evaluations"])
    assert rows["CR", "1"]["reached"] == "14"
    nc = [float(rows["NC", n]["expected_running_time"]) for n in ("2", "5", "10", "20", "40", "80")]
    assert nc == sorted(nc, reverse=True), "the less is dived, the better"


def test_noise_is_the_one_that_was_written() -> None:
    written = [r for r in records("noise") if r["method"] == "ps-gde-lm"]
    shown = table(PAGE, "What noise does", "method").rows
    assert [row[1:] for row in shown] == [
        (
            r["parameter"],
            f"{100.0 * float(r['bound']) / abs(float(r['truth'])):.2f}",
            f"{float(r['scatter_over_bound']):.3f}",
            f"{float(r['mean_error_over_standard_error']):.2f}",
        )
        for r in written
    ]
    ratios = np.array([float(r["scatter_over_bound"]) for r in written])
    assert f"{np.sqrt(np.mean(ratios**2)):.3f}" == "1.009"
    assert ratios.min() > 0.85
    assert ratios.max() < 1.15


def records(name: str) -> list[dict[str, str]]:
    with (DOCS / "reproduce" / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def rounded(text: str, how: str) -> str:
    return format(float(text), how) if text else ""
