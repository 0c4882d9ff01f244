"""Comparisons from plan to page, on problems that cost nothing."""

from __future__ import annotations

import csv
import re
import sqlite3
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from stoop import optimize
from stoop.errors import IdentificationError, OutputError, StoopError
from stoop.parallel import Given, execute
from stoop.report.sheet import render_sheet
from stoop_studies.compare.field import Field, check_optimizers, check_problems, installed
from stoop_studies.compare.page import STORE, conclude, page, prepare, races_text, scored
from stoop_studies.compare.race import Race, race
from stoop_studies.problems import pose

COMMAND = "stoop compare -o out"


def field(**changes: object) -> Field:
    given = {
        "optimizers": ("ps-gde-lm", "ps-gde", "de-rand-1-bin"),
        "problems": ("paper-N", "bbob-01"),
        "seeds": range(5, 7),
        "budget": 400.0,
    }
    return Field(**{**given, **changes})  # type: ignore[arg-type]


def run(it: Field, folder: Path) -> list[dict[str, str]]:
    with ThreadPoolExecutor(1) as threads:
        results = execute(it.plan(), folder / STORE, Given(threads))
    conclude(it, results, folder, COMMAND)
    with (folder / "compare.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("compare") / "out"
    run(field(), folder)
    return folder


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_whoever_needs_residuals_is_left_out_where_there_are_none() -> None:
    assert field().impossible == [("bbob-01", "ps-gde-lm")]
    assert ("bbob-01", "ps-gde-lm") not in field().pairs
    assert len(field().pairs) == 5
    assert field().baseline("paper-N") == "ps-gde-lm"
    assert field().baseline("bbob-01") == "ps-gde"


def test_a_field_without_any_pair_is_refused() -> None:
    with pytest.raises(IdentificationError, match="none of these optimizers"):
        field(optimizers=("ps-gde-lm",), problems=("bbob-01",)).plan()


def test_every_run_has_its_own_seed_and_the_same_budget() -> None:
    plan = field().plan()
    assert len(plan.runs) == 10
    assert {run.arguments["seed"] for run in plan.runs} == {5, 6}
    assert {run.arguments["budget"] for run in plan.runs} == {400.0}


def test_a_run_is_timed_on_its_way_to_the_target() -> None:
    arguments = {"optimizer": "ps-gde-lm", "problem": "paper-N", "seed": 5, "budget": 400.0}
    (found,) = race(arguments, [None])
    assert isinstance(found, dict)
    posed = pose("paper-N", 5)
    seen = optimize.minimize(
        optimize.create(),
        posed.problem,
        seed=5,
        stop=optimize.Stop(generations=10**9, budget=400.0, target_cost=posed.target),
    )
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


def test_the_default_solves_the_papers_problem_and_the_page_says_so(out: Path) -> None:
    first = rows(out / "compare.csv")[0]
    assert first["optimizer"] == first["baseline"] == "ps-gde-lm"
    assert first["successes"] == "2"
    text = re.sub(r"<[^>]*>", " ", (out / "compare.html").read_text(encoding="utf-8"))
    assert "No rival beats ps-gde-lm here." in text
    assert "ps-gde-lm on bbob-01: needs residuals" in text
    assert COMMAND in text
    for optimizer in field().optimizers:
        assert optimizer in text


def test_the_same_command_gives_the_same_bytes_and_runs_nothing_again(out: Path, tmp_path: Path) -> None:
    before = {p.name: p.read_bytes() for p in out.iterdir() if p.suffix != ".sqlite"}
    run(field(), out)
    run(field(), tmp_path / "elsewhere")
    for name, content in before.items():
        assert (out / name).read_bytes() == content
        assert (tmp_path / "elsewhere" / name).read_bytes() == content


def test_more_seeds_extend_the_store_and_another_budget_is_refused(tmp_path: Path) -> None:
    small = {"optimizers": ("ps-gde-lm",), "problems": ("paper-N",)}
    assert run(field(**small, seeds=range(5, 6)), tmp_path)[0]["runs"] == "1"
    assert run(field(**small, seeds=range(5, 7)), tmp_path)[0]["runs"] == "2"
    with pytest.raises(StoopError) as refusal:
        run(field(**small, budget=300.0), tmp_path)
    assert "\n" not in str(refusal.value)
    assert rows(tmp_path / "compare.csv")[0]["runs"] == "2"


def test_where_a_rival_is_ahead_the_page_says_by_how_much() -> None:
    it = field(optimizers=("ps-gde", "de-rand-1-bin"), problems=("bbob-01",), seeds=range(1, 7))
    results = {
        run.key: {
            "hit": hit, "hits": [hit], "evaluations": hit, "cost": 0.0, "status": "target", "target": 1e-8,
            "reference": 5.0,
        }
        for run in it.plan().runs
        for hit in [100.0 + run.arguments["seed"] if "rand" in run.key else 400.0]  # type: ignore[operator]
    }  # fmt: skip
    races = it.races(results)
    scores = scored(it, races)
    assert [s.optimizer for s in scores] == ["de-rand-1-bin", "ps-gde"]
    text = render_sheet(page(it, races, scores, COMMAND))
    assert "bbob-01: ps-gde is beaten: de-rand-1-bin takes 0.259× of its evaluations (clearly less)." in text
    assert races_text(r for found in races.values() for r in found).count("\r\n") == 13


def test_whoever_cannot_be_told_apart_is_named() -> None:
    it = field(optimizers=("ps-gde-lm", "ps-gde"), problems=("paper-N",), seeds=range(1, 5))
    own, rival = (10.0, 30.0, 10.0, 10.0), (20.0, 10.0, 30.0, 20.0)
    races = {
        ("paper-N", name): [
            Race("paper-N", name, seed, hit, (hit,), hit, 0.1, "target", 1.0, 9.0)
            for seed, hit in zip(it.seeds, hits, strict=True)
        ]
        for name, hits in (("ps-gde-lm", own), ("ps-gde", rival))
    }
    text = render_sheet(page(it, races, scored(it, races), COMMAND))
    assert "No rival beats ps-gde-lm here. These seeds do not tell it apart from ps-gde (" in text


def test_where_nobody_arrives_nobody_is_said_to_be_ahead() -> None:
    it = field(optimizers=("ps-gde-lm", "ps-gde"), problems=("paper-N", "paper-W"), seeds=range(1, 4))
    races = {
        (problem, name): [
            Race(problem, name, seed, hit, (hit,), 400.0, 0.1, "target" if hit else "budget", 0.01, 9.0)
            for seed in it.seeds
        ]
        for problem, name in it.pairs
        for hit in [20.0 if (problem, name) == ("paper-N", "ps-gde-lm") else None]
    }
    text = render_sheet(page(it, races, scored(it, races), COMMAND))
    assert text.count("No rival beats ps-gde-lm here.") == 1
    assert "Nobody reached the target here." in text
    assert "no rival is faster on 1 of 2 problems. Nobody reached the target on paper-W." in text


def test_a_problem_is_posed_once_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def counted(name: str, seed: int, **arguments: object) -> object:
        asked.append(name)
        return pose(name, seed, **arguments)

    monkeypatch.setattr("stoop_studies.search.pose", counted)
    race({"optimizer": "ps-gde-lm", "problem": "paper-N", "seed": 5, "budget": 40.0}, [None])
    assert asked == ["paper-N"]


def test_names_are_checked_before_anything_runs() -> None:
    with pytest.raises(IdentificationError, match="did you mean ps-gde"):
        check_optimizers(("ps-gd",))
    with pytest.raises(IdentificationError, match="paper-N"):
        check_problems(("paper-n",), flown=False)
    with pytest.raises(IdentificationError, match="--flight"):
        check_problems(("flight",), flown=False)
    check_problems(("paper-N", "bbob-24", "flight"), flown=True)


def test_a_package_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    create = optimize.create

    def lacking(name: str = "ps-gde-lm", budget: float | None = None) -> object:
        if name == "ps-gde":
            raise IdentificationError("optimizer ps-gde: needs x; install it with: pip install '.[compare]'")
        return create(name, budget)

    monkeypatch.setattr(optimize, "create", lacking)
    with pytest.raises(IdentificationError, match="pip install"):
        check_optimizers(("ps-gde",))
    there, absent = installed()
    assert "ps-gde" not in there
    assert list(absent) == ["ps-gde"]
    it = field(optimizers=("ps-gde-lm",), problems=("paper-N",), seeds=range(5, 6), absent=absent)
    only = Race("paper-N", "ps-gde-lm", 5, 7.0, (7.0,), 7.0, 0.1, "target", 1.0, 9.0)
    races = {("paper-N", "ps-gde-lm"): [only]}
    assert "pip install" in render_sheet(page(it, races, scored(it, races), COMMAND))


def test_overwriting_forgets_a_store_and_nothing_else(tmp_path: Path) -> None:
    run(field(optimizers=("ps-gde-lm",), problems=("paper-N",), seeds=range(5, 6)), tmp_path)
    mine = tmp_path / "compare.sqlite.copy"
    mine.write_text("mine", encoding="utf-8")
    prepare(tmp_path, overwrite=False)
    assert (tmp_path / "compare.sqlite").exists()
    prepare(tmp_path, overwrite=True)
    assert not (tmp_path / "compare.sqlite").exists()
    assert mine.exists()


def test_a_store_in_use_is_left_alone(tmp_path: Path) -> None:
    with closing(sqlite3.connect(tmp_path / "compare.sqlite")) as connection:
        connection.execute("CREATE TABLE t (x)")
        connection.execute("BEGIN EXCLUSIVE")
        with pytest.raises(OutputError, match="cannot be removed"):
            prepare(tmp_path, overwrite=True)
    assert (tmp_path / "compare.sqlite").exists()


def test_what_is_no_store_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "compare.sqlite").write_text("my thesis", encoding="utf-8")
    with pytest.raises(OutputError, match="no store"):
        prepare(tmp_path, overwrite=True)
    assert (tmp_path / "compare.sqlite").read_text(encoding="utf-8") == "my thesis"


def test_another_programs_database_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "compare.sqlite"
    with closing(sqlite3.connect(path)) as other, other:
        other.execute("CREATE TABLE thesis (chapter TEXT)")
    before = path.read_bytes()
    with pytest.raises(OutputError, match=r"compare\.sqlite: is no store of a campaign, and is not removed"):
        prepare(tmp_path, overwrite=True)
    assert path.read_bytes() == before


def test_tables_of_something_else_are_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "runs.csv").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match=r"runs\.csv"):
        prepare(tmp_path, overwrite=False)
    prepare(tmp_path, overwrite=True)
