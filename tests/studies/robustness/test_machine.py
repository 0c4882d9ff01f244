"""Verbs that are killed, and verbs on full disks, in little; and that those who watch over them see what goes wrong."""

from __future__ import annotations

import math
import random
import signal
import time
from contextlib import closing
from pathlib import Path
from unittest import mock

import pytest
from studies.robustness import disk_full, interruptions
from studies.robustness.campaign import FACTOR, check
from studies.robustness.interruptions import INTERRUPTIONS, Kill
from studies.robustness.small_runs import COMMANDS, OUT, inputs, undisturbed
from studies.robustness.trials import REFUSED, SAME, Child, Ended

from stoop.base import files
from stoop.errors import OutputError


def full_disks(name: str, count: int) -> list[Ended]:
    undisturbed(COMMANDS[name])
    with closing(Child(disk_full.try_full_disk, disk_full.BOUNDS)) as child:
        return [child(name, number) for number in range(count)]


@pytest.mark.parametrize("name", ["maneuvers", "table", "compare"])
def test_full_disks(name: str) -> None:
    ended = full_disks(name, 8)
    assert [one for one in ended if one.outcome not in (SAME, REFUSED)] == []
    assert any(one.outcome == REFUSED for one in ended)


def test_where_no_disk_can_be_made_files_are_held_short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(disk_full, "has_name_spaces", lambda: False)
    assert {one.outcome for one in full_disks("maneuvers", 4)} == {REFUSED}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_full_disk_costs_no_file(name: str) -> None:
    """An error of one line, the old files as they were, nothing half-written; and all is done when there is space again."""
    for ended in full_disks(name, math.ceil(FACTOR)):
        check("full disks", f"{name} on a full disk", ended)


@pytest.mark.parametrize("name", INTERRUPTIONS)
def test_a_verb_that_is_killed_leaves_the_files_of_an_undisturbed_run(name: str) -> None:
    """Killed several times and started again: files are whole after each kill, and in the end those of one run, to the byte."""
    for number in range(math.ceil(FACTOR)):
        kills, problem = interruptions.killed(name, random.Random(f"kills {name} {number}"))  # noqa: S311
        check(
            "kills",
            f"{name} killed",
            Ended("fault" if problem else SAME, f"{problem} after {', '.join(map(str, kills))}"),
        )


def test_leftovers_that_pile_up_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "_lock", lambda folder, wait=False: None)
    problems = (interruptions.killed("compare", random.Random(seed))[1] for seed in range(12))  # noqa: S311
    assert any("piles up" in problem or "left" in problem for problem in problems), "up to the first"


@pytest.mark.parametrize("kill", [None, Kill(signal.SIGKILL, change=9), Kill(signal.SIGTERM, after=0.1)])
def test_a_verb_that_hangs_is_no_kill(
    kill: Kill | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hang() -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        time.sleep(60.0)

    monkeypatch.setattr(interruptions, "PATIENCE", 0.3)
    monkeypatch.setattr(interruptions, "main", hang)
    assert interruptions.run_and_kill(("a",), tmp_path, kill) == -signal.SIGALRM


def test_half_written_files_are_seen(tmp_path: Path) -> None:
    out = tmp_path / OUT
    out.mkdir()
    for name, content in {
        "t.csv": b"a,b\n1",
        "p.html": b"<html>",
        "r.json": b"{",
        "x.sqlite": b"x" * 999,
        "s.npz": b"",
    }.items():
        (out / name).write_bytes(content)
        assert name in interruptions.broken(tmp_path)
        (out / name).unlink()
    assert interruptions.broken(tmp_path) == ""
    assert interruptions.differences({"a": b"1", "b": b"2"}, out) == "missing: a, b"


def test_a_file_left_half_written_on_a_full_disk_is_seen() -> None:
    """A writer that writes in place: the old file is lost when the disk is full."""

    def in_place(folder: Path, content: dict[str, bytes | str], obsolete: object = ()) -> None:
        for name, text in content.items():
            try:
                (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
            except OSError as error:
                raise OutputError(f"{name}: {error.strerror}") from None

    undisturbed(COMMANDS["maneuvers"])
    with mock.patch("stoop.workflow.design.write_files", in_place):
        ended = full_disks("maneuvers", 20)
    assert any("old files changed" in one.message for one in ended)
    assert any("left" in one.message for one in ended)


def test_the_inputs_are_whole() -> None:
    assert {"sim.nc", "table.csv", "v.toml", "m.toml", "model/result.json"} <= set(inputs())
