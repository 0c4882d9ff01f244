import numpy as np
import pytest

from stoop import optimize
from stoop_studies.problems import pose
from stoop_studies.search import search

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
