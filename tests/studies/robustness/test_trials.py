"""Those who watch over hostile inputs see a crash, a hang, hunger for memory and an error of another kind."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.errors import LogError
from stoop_studies.robustness.trials import (
    BAD,
    LIMIT,
    READ,
    REFUSED,
    Bounds,
    BrokenPromiseError,
    Case,
    Tried,
    count_outcomes,
    try_all,
    try_case,
)


def _read(_: Path) -> str:
    return READ


def _tried(bad: Callable[[], Any], bounds: Bounds | None = None) -> list[Tried]:
    """Try four cases, of which one, the second, ends badly."""

    def run(_: Path) -> str:
        bad()
        return READ

    return list(try_all(lambda n: Case(n, "a", "b", run if n == 1 else _read), range(4), bounds or Bounds()))


def _loop() -> None:
    while True:
        pass


def test_a_crash_is_seen_and_the_others_are_tried() -> None:
    tried = _tried(os.abort)
    assert [t.outcome for t in tried] == [READ, "crash", READ, READ]
    assert [t.number for t in tried] == [0, 1, 2, 3]
    assert tried[1].message == "signal 6"


def test_a_hang_is_seen() -> None:
    assert _tried(_loop, Bounds(seconds=0))[1].outcome == "hang"


def test_what_does_not_hang_again_is_no_hang(tmp_path: Path) -> None:
    def once() -> None:
        if not (tmp_path / "mark").exists():
            (tmp_path / "mark").touch()
            _loop()

    assert [t.outcome for t in _tried(once, Bounds(seconds=0))] == [READ] * 4


def test_silence_is_seen() -> None:
    assert _tried(lambda: os.read(os.pipe()[0], 1), Bounds(wall=0.5))[1].outcome == "hang"


def test_hunger_is_seen() -> None:
    assert _tried(lambda: np.ones(2**23), Bounds(memory=2**25))[1].outcome == "memory"
    assert _tried(lambda: np.ones(2**28), Bounds(address_space=2**29))[1].outcome == "memory"


@pytest.mark.parametrize(
    "raised",
    [ValueError("x"), ZeroDivisionError(), LogError(""), MemoryError(),
     RecursionError(), BrokenPromiseError("x")],
)  # fmt: skip
def test_what_is_no_error_of_ours_is_a_failure(tmp_path: Path, raised: Exception) -> None:
    def run(_: Path) -> str:
        raise raised

    assert try_case(Case(0, "a", "b", run), tmp_path).outcome in BAD


@pytest.mark.parametrize(
    ("message", "outcome"), [("a.ulg: cut", REFUSED), ("more memory than there is", LIMIT)]
)
def test_an_error_of_ours_is_none(tmp_path: Path, message: str, outcome: str) -> None:
    def run(folder: Path) -> str:
        raise LogError(f"{folder}{message}")

    assert try_case(Case(0, "a", "b", run), tmp_path) == Tried(0, "a", "b", outcome, message)


def test_the_folder_is_empty_for_every_case(tmp_path: Path) -> None:
    def run(folder: Path) -> str:
        assert not list(folder.iterdir())
        (folder / "deep" / "er").mkdir(parents=True)
        (folder / "link").symlink_to(folder / "deep")
        (folder / "file").write_text("x")
        return READ

    assert [try_case(Case(n, "a", "b", run), tmp_path).outcome for n in range(2)] == [READ, READ]


def test_counts_are_those_of_the_cases() -> None:
    result = count_outcomes(Tried(n, "w", "d", "crash" if n == 3 else READ, "") for n in range(5))
    assert result["counts"] == {"w/d/crash": 1, "w/d/read": 4}
    assert [one["number"] for one in result["found"]] == [3]
