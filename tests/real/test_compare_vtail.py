"""The V-tail as a problem of comparison: what counts as solved is what the main job finds, and the default finds it blind."""

from __future__ import annotations

from pathlib import Path

import pytest

from stoop import optimize
from stoop_studies.problems import Posed, pose

EXAMPLE = Path(__file__).parents[2] / "examples" / "vtail.toml"
WINDOWS = ["140:145", "146:152", "160:168.3"]


@pytest.fixture(scope="module")
def log(shared_data: Path) -> Path:
    return shared_data / "altlnt-vtail-8kg-px4" / "flight2"


@pytest.fixture(scope="module")
def posed(log: Path) -> Posed:
    return pose("flight", 1, flight=str(log), vehicle=str(EXAMPLE), maneuvers=WINDOWS)


def test_the_default_gets_there_without_starting_values(posed: Posed) -> None:
    """Initial states and biases are searched with the parameters."""
    assert posed.problem.extra == 0
    assert posed.problem.dimension == len(posed.parameters) > 100
    assert {"CLalpha", "V of maneuver 1"} <= set(posed.parameters)
    assert posed.target < 0.01 * posed.reference
    stop = optimize.Stop(generations=10**9, budget=50_000.0, target_cost=posed.target)
    outcome = optimize.minimize(optimize.create(), posed.problem, seed=1001, stop=stop)
    assert outcome.status == "target"
    found = dict(zip(posed.parameters, posed.values(outcome.z), strict=True))
    assert found["CLalpha"] > 0.0 > found["Cmalpha"]
