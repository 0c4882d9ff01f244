from itertools import product
from typing import Any

import numpy as np
import pytest

from stoop_studies.findings import Setting
from stoop_studies.problems import pose
from stoop_studies.problems.paper import paper
from stoop_studies.reproduce.noise import Noise, scatter
from stoop_studies.reproduce.suite import METHODS, bound_deviations
from stoop_studies.reproduce.table1 import ITERATIONS, Table1, columns, printed_costs

SETTING = Setting(runs=3)


def made_up(errors: dict[str, float], costs: dict[str, float]) -> dict[str, Any]:
    truth = paper().truth[np.argsort(columns())]
    found = {}
    for m, s, n in product(METHODS, SETTING.seeds, ITERATIONS):
        told = {"values": (truth * (1.0 + errors[m])).tolist(), "cost": costs[m], "hit": 100.0}
        found[f"{METHODS[m]}/{s:06d}/{n:05d}"] = told | {"evaluations": 1e5}
    return found


def test_table_1_as_it_should_be() -> None:
    errors = {"GA": 0.03, "PSO": 0.02, "PS-GDE": 1e-8, "default": 1e-9}
    costs = {"GA": 121.57, "PSO": 289.38, "PS-GDE": 84.26, "default": 0.0}
    found = Table1().findings(SETTING, made_up(errors, costs))
    assert len(found.rows) == len(METHODS) * len(ITERATIONS)
    assert {claim.statement.split(":")[0][:22]: claim.verdict for claim in found.claims} == {
        "The mean error falls f": "reproduces", "PS-GDE's mean values a": "reproduces", "Mean fitness is 121.57": "reproduces",
        "GA's printed column fi": "does not reproduce", "Cmalpha = -2.32 in the": "holds", "GA's printed means are": "holds",
        "PSO is caught in local": "reproduces", "PS-GDE": "holds", "The default": "holds",
    }  # fmt: skip


def test_the_printed_columns_cost_what_a_hand_made_residual_says() -> None:
    costs = printed_costs()
    assert costs["GA"].sum() == pytest.approx(2.243e5, rel=1e-3)
    assert costs["PSO"].sum() / costs["PSO, mended"].sum() == pytest.approx(208.0, abs=1.0)
    assert (costs["GA"] > costs["PSO"]).all()
    assert costs["proposed"].sum() < 1.0


def test_scatter_of_a_normal_sample_is_the_bound() -> None:
    rng, sigma = np.random.default_rng(5), np.array([0.1, 3.0])
    found = scatter(1.0 + sigma * rng.standard_normal((20_000, 2)), np.ones(2), sigma)
    assert found.pooled == pytest.approx(1.0, abs=0.02)
    assert np.abs(found.bias).max() < 4.0
    biased = scatter(1.0 + sigma * (0.5 + rng.standard_normal((400, 2))), np.ones(2), sigma)
    assert biased.bias == pytest.approx(10.0, abs=2.0), "half a sigma is ten standard errors of 400"
    assert biased.pooled == pytest.approx(np.sqrt(1.25), abs=0.1)


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
