"""The V-tail as a problem of comparison: what counts as solved is what the main job finds, and the default finds it blind."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from stoop import optimize
from stoop.cli.main import main
from stoop_studies.problems import Posed, pose

DOCS = Path(__file__).parents[2] / "docs"
EXAMPLE = Path(__file__).parents[2] / "examples" / "vtail.toml"
WINDOWS = ["140:145", "146:152", "160:168.3"]


@pytest.fixture(scope="module")
def log(shared_data: Path) -> Path:
    return shared_data / "altlnt-vtail-8kg-px4" / "flight2"


@pytest.fixture(scope="module")
def posed(log: Path) -> Posed:
    return pose("flight", 1, flight=str(log), vehicle=str(EXAMPLE), maneuvers=WINDOWS)


def test_initial_states_and_biases_are_searched_with_the_parameters(posed: Posed) -> None:
    assert posed.problem.extra == 0
    assert posed.problem.dimension == len(posed.parameters) > 100
    assert "CLalpha" in posed.parameters
    assert "V of maneuver 1" in posed.parameters
    assert posed.target < 0.01 * posed.reference


def test_the_default_gets_there_without_starting_values(posed: Posed) -> None:
    stop = optimize.Stop(generations=10**9, budget=50_000.0, target_cost=posed.target)
    outcome = optimize.minimize(optimize.create(), posed.problem, seed=1001, stop=stop)
    assert outcome.status == "target"
    found = dict(zip(posed.parameters, posed.values(outcome.z), strict=True))
    assert found["CLalpha"] > 0.0 > found["Cmalpha"]


def test_the_command_writes_a_page(log: Path, tmp_path: Path) -> None:
    words = ["compare", "-o", str(tmp_path), "--optimizers", "ps-gde-lm,ps-gde", "--problems", "flight"]
    flown = ["--flight", str(log), "--vehicle", str(EXAMPLE), "--maneuver", *WINDOWS]
    assert main([*words, *flown, "--seeds", "1", "--budget", "1000", "--workers", "1"]) == 0
    with (tmp_path / "compare.csv").open(encoding="utf-8", newline="") as file:
        table = list(csv.DictReader(file))
    assert [row["problem"] for row in table] == ["flight"] * 2
    assert "#compare" in (tmp_path / "compare.html").read_text(encoding="utf-8"), (
        "how the nuisances are searched"
    )
    assert "5 prior standard deviations" in (DOCS / "studies.md").read_text(encoding="utf-8")
