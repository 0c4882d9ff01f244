"""An unfinished search goes on where it was, and only if it is the same."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stoop import optimize
from stoop.errors import OutputError
from stoop.estimate.fit import Options
from stoop.flight import Flight
from stoop.vehicle import Vehicle
from stoop.workflow import checkpoint as module
from stoop.workflow import identify
from stoop.workflow.checkpoint import Checkpoint, identity

State = optimize.State


@pytest.fixture(scope="module")
def outcome(wrong: Vehicle, flight: Flight) -> optimize.Outcome:
    """Return how a search ended that ran out of generations."""
    found = identify(wrong, flight, ["0:20"], options=Options("de-rand-1-bin", generations=2))
    return found.estimate.outcome


@pytest.fixture
def state(outcome: optimize.Outcome) -> State:
    assert outcome.state is not None
    return outcome.state


@pytest.fixture
def told() -> list[str]:
    return []


def test_one_file_holds_the_state_and_what_it_belongs_to(
    tmp_path: Path, state: State, told: list[str]
) -> None:
    checkpoint = Checkpoint(tmp_path, "this", told.append)
    checkpoint.keep(state)
    assert [p.name for p in tmp_path.iterdir()] == ["search.npz"]
    assert Checkpoint(tmp_path, "this", told.append).load().evaluations.cost == state.evaluations.cost
    with pytest.raises(OutputError, match=r"another one \(.*windows, decisions, method"):
        Checkpoint(tmp_path, "that", told.append).load()
    (tmp_path / "search.npz").write_bytes(b"damaged")
    with pytest.raises(OutputError, match="--resume"):
        checkpoint.load()
    (tmp_path / "search.npz").unlink()
    with pytest.raises(OutputError, match="no interrupted search"):
        checkpoint.load()
    assert not told


def test_a_search_that_ran_out_keeps_its_last_state(
    tmp_path: Path, outcome: optimize.Outcome, state: State, told: list[str]
) -> None:
    checkpoint = Checkpoint(tmp_path, "this", told.append)
    checkpoint.keep(replace(state, generation=0))
    checkpoint.keep(replace(state, generation=1))  # too soon after the first
    assert checkpoint.load().generation == 0
    checkpoint.keep_last(outcome)
    checkpoint.forget(outcome.status)
    assert outcome.status == "generations"
    assert checkpoint.load().generation == state.generation == 2
    checkpoint.forget("converged")
    assert not list(tmp_path.iterdir())


def test_a_state_that_cannot_be_saved_is_told_once(
    tmp_path: Path,
    outcome: optimize.Outcome,
    state: State,
    told: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "INTERVAL", 0.0)
    folder = tmp_path / "out"
    checkpoint = Checkpoint(folder, "this", told.append)
    for _ in range(3):
        checkpoint.keep(state)
    assert len(told) == 1
    assert "the search goes on" in told[0]
    assert "\n" not in told[0]
    checkpoint.keep_last(outcome)
    assert checkpoint.load().generation == state.generation
    shutil.rmtree(folder)


def test_identity_is_of_everything_that_decides_the_search(wrong: Vehicle) -> None:
    noise = np.diag(np.arange(1.0, 7.0))
    basis = identity(wrong, {"a.ulg": "1"}, ["0:20"], ["20:28"], Options(covariance=noise))
    heavier = wrong.with_numbers({"mass.mass": {"value": 200.0}})
    loaded = replace(wrong, file=wrong.file.model_copy(update={"loadings": {"full": {"mass.mass": 210.0}}}))
    others = [
        identity(heavier, {"a.ulg": "1"}, ["0:20"], ["20:28"], Options(covariance=noise)),
        identity(loaded, {"a.ulg": "1"}, ["0:20"], ["20:28"], Options(covariance=noise)),
        identity(wrong, {"a.ulg": "2"}, ["0:20"], ["20:28"], Options(covariance=noise)),
        identity(wrong, {"a.ulg": "1", "m.toml": "1"}, ["0:20"], ["20:28"], Options(covariance=noise)),
        identity(wrong, {"a.ulg": "1"}, ["0:20", "20:28"], [], Options(covariance=noise)),
        identity(wrong, {"a.ulg": "1"}, ["0:20"], ["20:28"], Options(covariance=2.0 * noise)),
        identity(wrong, {"a.ulg": "1"}, ["0:20"], ["20:28"], Options()),
        identity(wrong, {"a.ulg": "1"}, ["0:20"], ["20:28"], Options(seed=1, covariance=noise)),
        identity(wrong, {"a.ulg": "1"}, ["0:20"], ["20:28"], Options("ps-gde", covariance=noise)),
    ]
    assert len({basis, *others}) == 1 + len(others)


def test_identity_leaves_out_when_to_give_up_and_how_the_file_is_written(wrong: Vehicle) -> None:
    files, windows = {"a.ulg": "1"}, ["0:20"]
    basis = identity(wrong, files, windows, [], Options())
    assert basis == identity(wrong, files, windows, [], Options(generations=9, budget=5.0, target_cost=1.0))
    assert basis == identity(replace(wrong, text="# a remark\n" + wrong.text), files, windows, [], Options())
