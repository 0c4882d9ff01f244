import csv
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from stoop import optimize
from stoop.parallel import Given, execute
from stoop_studies.compare.field import Field
from stoop_studies.compare.page import STORE, conclude
from stoop_studies.compare.race import race
from stoop_studies.problems import pose

FIELD = Field(
    optimizers=("ps-gde-lm", "ps-gde", "de-rand-1-bin"), problems=("paper-N", "bbob-01"), seeds=range(5, 7), budget=400.0
)  # fmt: skip


def run(folder: Path) -> None:
    with ThreadPoolExecutor(1) as threads:
        results = execute(FIELD.plan(), folder / STORE, Given(threads))
    conclude(FIELD, results, folder, "stoop compare -o out")


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("compare") / "out"
    run(folder)
    return folder


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_whoever_needs_residuals_is_left_out_where_there_are_none() -> None:
    assert FIELD.impossible == [("bbob-01", "ps-gde-lm")]
    assert ("bbob-01", "ps-gde-lm") not in FIELD.pairs
    assert len(FIELD.pairs) == 5
    assert [FIELD.baseline(name) for name in ("paper-N", "bbob-01")] == ["ps-gde-lm", "ps-gde"]


def test_a_run_is_timed_on_its_way_to_the_target() -> None:
    arguments = {"optimizer": "ps-gde-lm", "problem": "paper-N", "seed": 5, "budget": 400.0}
    (found,) = race(arguments, [None])
    assert isinstance(found, dict)
    posed = pose("paper-N", 5)
    stop = optimize.Stop(generations=10**9, budget=400.0, target_cost=posed.target)
    seen = optimize.minimize(optimize.create(), posed.problem, seed=5, stop=stop)
    assert found["status"] == "target"
    assert found["hit"] == seen.trajectories == found["evaluations"]
    times = np.array(found["hits"], dtype=float)
    assert (np.diff(times) >= 0.0).all()
    assert times[-1] == found["hit"]


def test_tables_agree_with_each_other(out: Path) -> None:
    scores, races = rows(out / "compare.csv"), rows(out / "runs.csv")
    assert len(scores) == 5
    assert len(races) == 10
    for row in scores:
        own = [r for r in races if (r["problem"], r["optimizer"]) == (row["problem"], row["optimizer"])]
        hits = [float(r["hit"]) for r in own if r["hit"]]
        assert int(row["runs"]) == len(own)
        assert int(row["successes"]) == len(hits)
        spent = sum(float(r["hit"] or r["evaluations"]) for r in own)
        assert float(row["ert"]) == pytest.approx(spent / len(hits) if hits else np.inf, rel=1e-8)


def test_the_same_command_gives_the_same_bytes_and_runs_nothing_again(out: Path, tmp_path: Path) -> None:
    before = {p.name: p.read_bytes() for p in out.iterdir() if p.suffix != ".sqlite"}
    run(out)
    run(tmp_path / "elsewhere")
    for name, content in before.items():
        assert (out / name).read_bytes() == content
        assert (tmp_path / "elsewhere" / name).read_bytes() == content
