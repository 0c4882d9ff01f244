"""Verbs that are killed, and verbs on full disks, in little; and that those who watch over them see what goes wrong."""

from __future__ import annotations

import signal
import time
from collections import Counter
from pathlib import Path
from unittest import mock

import pytest

from stoop.base import files
from stoop.errors import OutputError
from stoop_studies.robustness import disk_full, interruptions
from stoop_studies.robustness.interruptions import Kill
from stoop_studies.robustness.small_runs import COMMANDS, OUT, inputs, undisturbed
from stoop_studies.robustness.trials import REFUSED, SAME


@pytest.mark.parametrize("name", ["maneuvers", "table", "compare"])
def test_full_disks(name: str) -> None:
    tried = list(disk_full.try_disk_full(name, 1, 8))
    assert [one for one in tried if one.outcome not in (SAME, REFUSED)] == []
    assert any(one.outcome == REFUSED for one in tried)


def test_where_no_disk_can_be_made_files_are_held_short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(disk_full, "has_name_spaces", lambda: False)
    outcomes = Counter(one.outcome for one in disk_full.try_disk_full("maneuvers", 3, 4))
    assert outcomes == {REFUSED: 4}


def test_leftovers_that_pile_up_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "_lock", lambda folder, wait=False: None)
    tried = interruptions.try_interruptions("compare", 4, 12)
    assert any("piles up" in one.message or "left" in one.message for one in tried), "up to the first"


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


def test_a_run_that_fails_before_its_first_kill_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interruptions, "_one_run", lambda *_: ([], "left: a"))
    monkeypatch.setattr(interruptions, "baseline", lambda _: None)
    tried = list(interruptions.try_interruptions("compare", 1, 2))
    assert [(one.number, one.damage, one.outcome) for one in tried] == [
        (n, "no kill", "fault") for n in (0, 1)
    ]


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
        tried = list(disk_full.try_disk_full("maneuvers", 5, 20))
    assert any("old files changed" in one.message for one in tried)
    assert any("left" in one.message for one in tried)


def test_the_inputs_are_whole() -> None:
    assert {"sim.nc", "table.csv", "v.toml", "m.toml", "model/result.json"} <= set(inputs())
