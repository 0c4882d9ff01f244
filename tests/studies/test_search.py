"""One search as a campaign runs it: stops share one run, what is told is what `minimize` says."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from stoop import optimize
from stoop.errors import IdentificationError
from stoop_studies.problems import pose
from stoop_studies.search import search, thinned

PLAN = {"problem": "paper-N", "seed": 3}


def test_stops_are_those_of_one_undisturbed_run_in_the_order_asked() -> None:
    late, early = search({**PLAN, "optimizer": "ps-gde"}, [24, 10])
    assert [early, late] == [search({**PLAN, "optimizer": "ps-gde"}, [n])[0] for n in (10, 24)]
    problem = pose("paper-N", 3).problem
    stop = optimize.Stop(generations=24)
    outcome = optimize.minimize(optimize.create("ps-gde"), problem, seed=3, stop=stop)
    assert isinstance(late, dict)
    assert (late["cost"], late["evaluations"]) == (outcome.cost, outcome.trajectories)
    assert (late["status"], late["generation"]) == ("generations", 24)


def test_a_run_that_ends_by_itself_stands_for_all_later_stops() -> None:
    first, second = search({**PLAN, "optimizer": "ps-gde-lm"}, [500, None])
    assert first == second
    assert isinstance(first, dict)
    assert first["status"] == "converged"
    truth = pose("paper-N", 3).truth
    assert np.array(first["values"]) == pytest.approx(truth, rel=1e-6)
    assert 0.0 < first["hit"] <= first["evaluations"]


def test_results_are_plain_numbers() -> None:
    (result,) = search({**PLAN, "optimizer": "de-rand-1-bin", "history": 3}, [15])
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    assert isinstance(result, dict)
    assert len(result["history"]) <= 3
    assert result["hit"] is None


def test_budget_and_target_end_a_run() -> None:
    plan: dict[str, Any] = {**PLAN, "optimizer": "de-rand-1-bin", "budget": 120.0}
    (result,) = search(plan, [None])
    assert isinstance(result, dict)
    assert (result["status"], result["evaluations"]) == ("budget", 120.0)
    (result,) = search({**PLAN, "optimizer": "ps-gde-lm", "to_target": True}, [None])
    assert isinstance(result, dict)
    assert (result["status"], result["hit"]) == ("target", result["evaluations"])


def test_history_is_thinned_to_improvements_and_keeps_both_ends() -> None:
    costs = np.exp(-np.linspace(0.0, 40.0, 5000))
    history = np.column_stack([np.arange(5000.0), costs])
    kept = thinned(history, 200)
    assert 50 < len(kept) <= 200
    assert (kept[0] == history[0]).all()
    assert (kept[-1] == history[-1]).all()
    steps = np.diff(np.log(kept[:-1, 1]))
    assert np.ptp(steps) < 0.05, "rows are equally far apart in the logarithm"
    assert len(thinned(history, 0)) == 0
    assert len(thinned(history, 1)) == 2
    assert len(thinned(history[:0], 5)) == 0


def test_unknown_names_are_refused() -> None:
    with pytest.raises(IdentificationError, match="optimizer nope: there is none"):
        search({**PLAN, "optimizer": "nope"}, [1])
