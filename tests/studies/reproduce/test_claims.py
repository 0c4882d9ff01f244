"""Claims follow the numbers: made-up runs turn every verdict round."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from docs.pages import DOCS

from stoop.workflow.demo import TABLE_1
from stoop_studies.findings import Setting, number
from stoop_studies.problems import pose
from stoop_studies.problems.paper import paper
from stoop_studies.reproduce.noise import Noise, scatter
from stoop_studies.reproduce.suite import METHODS, bound_deviations
from stoop_studies.reproduce.table1 import ITERATIONS, Table1, columns, printed_costs

SETTING = Setting(runs=3)


def made_up(errors: dict[str, float], costs: dict[str, float]) -> dict[str, Any]:
    """Return results in which every value of a method is off by the same share."""
    truth = paper().truth[np.argsort(columns())]
    return {
        f"{METHODS[m]}/{s:06d}/{n:05d}": {
            "values": (truth * (1.0 + errors[m])).tolist(),
            "cost": costs[m],
            "hit": 100.0,
            "evaluations": 1e5,
        }
        for m in METHODS
        for s in SETTING.seeds
        for n in ITERATIONS
    }


def by_words(results: dict[str, Any]) -> dict[str, str]:
    found = Table1().findings(SETTING, results)
    assert len(found.rows) == len(METHODS) * len(ITERATIONS)
    return {claim.statement.split(":")[0][:22]: claim.verdict for claim in found.claims}


def test_table_1_as_it_should_be() -> None:
    errors = {"GA": 0.03, "PSO": 0.02, "PS-GDE": 1e-8, "default": 1e-9}
    said = by_words(made_up(errors, {"GA": 121.57, "PSO": 289.38, "PS-GDE": 84.26, "default": 0.0}))
    assert said == {
        "The mean error falls f": "reproduces",
        "PS-GDE's mean values a": "reproduces",
        "Mean fitness is 121.57": "reproduces",
        "GA's printed column fi": "does not reproduce",
        "Cmalpha = -2.32 in the": "holds",
        "GA's printed means are": "holds",
        "PSO is caught in local": "reproduces",
        "PS-GDE": "holds",
        "The default": "holds",
    }


def test_table_1_turned_round() -> None:
    errors = {"GA": 0.001, "PSO": 0.002, "PS-GDE": 0.003, "default": 1e-5}
    said = by_words(made_up(errors, dict.fromkeys(METHODS, 1.0)))
    assert said["The mean error falls f"] == "does not reproduce"
    assert said["PS-GDE's mean values a"] == "does not reproduce"
    assert said["Mean fitness is 121.57"] == "does not reproduce"
    assert said["PSO is caught in local"] == "does not reproduce"
    assert said["PS-GDE"] == said["The default"] == "does not hold"


def test_the_printed_columns_cost_what_a_hand_made_residual_says() -> None:
    costs = printed_costs()
    assert costs["GA"].sum() == pytest.approx(2.243e5, rel=1e-3)
    assert costs["PSO"].sum() / costs["PSO, mended"].sum() == pytest.approx(208.0, abs=1.0)
    assert (costs["GA"] > costs["PSO"]).all()
    assert costs["proposed"].sum() < 1.0


def test_columns_are_those_of_the_papers_table() -> None:
    names = [p.name for p in paper().vehicle.parameters if p.name in TABLE_1]
    assert [names[i] for i in columns()] == list(TABLE_1)


def test_scatter_of_a_normal_sample_is_the_bound() -> None:
    rng, sigma = np.random.default_rng(5), np.array([0.1, 3.0])
    found = scatter(1.0 + sigma * rng.standard_normal((20_000, 2)), np.ones(2), sigma)
    assert found.pooled == pytest.approx(1.0, abs=0.02)
    assert np.abs(found.bias).max() < 4.0
    biased = scatter(1.0 + sigma * (0.5 + rng.standard_normal((400, 2))), np.ones(2), sigma)
    assert biased.bias == pytest.approx(10.0, abs=2.0), "half a sigma is ten standard errors of 400"
    assert biased.pooled == pytest.approx(np.sqrt(1.25), abs=0.1)


def test_noise_asks_for_the_optimum_of_every_seed() -> None:
    plan = Noise().plan(Setting(runs=2, seed=7))
    assert [run.key for run in plan.runs] == [
        f"{who}/{seed:06d}" for who in ("ps-gde-lm", "ps-gde", "truth") for seed in (7, 8)
    ]


def test_noise_tells_who_ended_elsewhere_and_how_far_the_methods_are_apart() -> None:
    truth = np.array(pose("paper-W", 0).truth)
    sigma = bound_deviations(pose("paper-W", 0))
    z = {"ps-gde-lm": (1.0, -1.0), "ps-gde": (1.25, -1.0)}
    results: dict[str, Any] = {f"truth/{s:06d}": {"cost": 9000.0} for s in (0, 1)}
    for method, scores in z.items():
        for s, score in enumerate(scores):
            cost = 9000.0 if (method, s) != ("ps-gde", 1) else 9010.0
            told = {"values": (truth + score * sigma).tolist(), "cost": cost, "evaluations": 30.0}
            results[f"{method}/{s:06d}"] = told
    found = Noise().findings(Setting(runs=2, box=Noise().box), results)
    rows = [dict(zip(found.head, row, strict=True)) for row in found.rows]
    pooled = {r["method"]: r for r in rows if r["parameter"] == "pooled"}
    assert len(rows) == 22
    assert [r["elsewhere"] for r in pooled.values()] == [0, 1]
    assert pooled["ps-gde"]["largest_difference_over_bound"] == pytest.approx(0.25)
    assert pooled["ps-gde-lm"]["scatter_over_bound"] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("value", "text"), [(None, "–"), (np.nan, "–"), (1234567.0, "1.23e6"), (-2e-7, "−2e−7"), (0.25, "0.25")]
)
def test_numbers_are_short(value: float | None, text: str) -> None:
    assert number(value) == text


@pytest.mark.parametrize(
    "words", ["189.40 kg", "2.8667 m2", "0.55 m", "120 kg m2", "Q is not printed", "F = 0.6, CR = 0.9", "NC = 20", "Bounds"]
)  # fmt: skip
def test_every_reconstruction_is_stated(words: str) -> None:
    text = (DOCS / "studies.md").read_text(encoding="utf-8")
    assert words in text.partition("## What the paper leaves open")[2]
