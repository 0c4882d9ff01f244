"""Those who watch over hostile inputs see a crash, a hang, hunger for memory and an error of another kind."""

from __future__ import annotations

import csv
import os
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from studies.robustness import campaign
from studies.robustness.trials import (
    BAD,
    LIMIT,
    READ,
    REFUSED,
    Bounds,
    BrokenPromiseError,
    Child,
    Ended,
    try_case,
)

from stoop.errors import LogError


def _tried(bad: Callable[[], Any], bounds: Bounds | None = None) -> list[Ended]:
    """Try four cases, of which one, the second, ends badly."""

    def run(_: Path, number: int) -> str:
        if number == 1:
            bad()
        return READ

    with closing(Child(run, bounds)) as child:
        return [child(number) for number in range(4)]


def _loop() -> None:
    while True:
        pass


def test_a_crash_is_seen_and_the_others_are_tried() -> None:
    tried = _tried(os.abort)
    assert [t.outcome for t in tried] == [READ, "crash", READ, READ]
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

    assert try_case(run, tmp_path).outcome in BAD


@pytest.mark.parametrize(
    ("message", "outcome"), [("a.ulg: cut", REFUSED), ("more memory than there is", LIMIT)]
)
def test_an_error_of_ours_is_none(tmp_path: Path, message: str, outcome: str) -> None:
    def run(folder: Path) -> str:
        raise LogError(f"{folder}{message}")

    assert try_case(run, tmp_path) == Ended(outcome, message)


def test_the_folder_is_empty_for_every_case(tmp_path: Path) -> None:
    def run(folder: Path) -> str:
        assert not list(folder.iterdir())
        (folder / "deep" / "er").mkdir(parents=True)
        (folder / "link").symlink_to(folder / "deep")
        (folder / "file").write_text("x")
        return READ

    assert [try_case(run, tmp_path).outcome for _ in range(2)] == [READ, READ]


def test_counts_are_those_of_the_cases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, "COUNTS", Counter())
    for outcome in (READ, READ, REFUSED):
        campaign.check("a", "b", Ended(outcome))
    with pytest.raises(AssertionError, match="crash: signal 6"):
        campaign.check("a", "b", Ended("crash", "signal 6"))
    campaign.write_counts(tmp_path / "a.csv")
    (row,) = csv.DictReader((tmp_path / "a.csv").read_text().splitlines())
    assert [row[name] for name in ("surface", "cases", READ, REFUSED, "failed")] == ["b", "4", "2", "1", "1"]
