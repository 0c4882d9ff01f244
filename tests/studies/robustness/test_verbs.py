"""Hostile numbers through complete commands, in little; and those who watch over them see what breaks a promise."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from studies.robustness import commands, hostile_flights
from studies.robustness.commands import VERBS, try_command
from studies.robustness.trials import READ, BrokenPromiseError
from studies.robustness.verb_outputs import check_outputs

from stoop.errors import StoopError


@pytest.mark.parametrize("edit", [*hostile_flights.CHANNEL_EDITS, *hostile_flights.FLIGHT_EDITS])
def test_every_edit_of_a_flight_leaves_a_table(edit: str) -> None:
    for seed in range(3):
        d = hostile_flights.SoundChoices(seed)
        changed = hostile_flights.edited(d, hostile_flights.record("short"), edit)
        assert {x.shape for x in changed.columns.values()} <= {changed.time.shape}
        again = hostile_flights.edited(d, changed, edit)
        assert hostile_flights.as_files(d, again, "flight")["flight.csv"].count(b"\n") == again.time.size + 1


def test_an_empty_flight_can_be_edited() -> None:
    nothing = hostile_flights.Record(np.empty(0), {})
    for edit in ("few samples", "ramp", "duplicate"):
        assert hostile_flights.edited(hostile_flights.SoundChoices(1), nothing, edit).columns == {}


@pytest.mark.parametrize("name", ["trim", "vehicle new", "simulate", "agreement", "derivatives", "propagate"])
def test_sound_commands_are_done(name: str, tmp_path: Path) -> None:
    words, files = commands.sound_command(name, name)
    assert try_command(tmp_path, words, files, VERBS[name].written) == READ


def _prints(code: int, out: str = "", errors: str = "") -> Callable[..., tuple[int, str, str]]:
    return lambda *_: (code, out, errors)


@pytest.mark.parametrize(
    ("printed", "says"),
    [
        (_prints(0, "\x1b[31mred"), "prints"),
        (_prints(1, "", "Traceback (most recent call last):\nKeyError: 'a'\n\nstoop: this is a bug"), "KeyError: 'a'"),
        (_prints(2, "", "stoop: error: one\nstoop: error: two\n"), "ends with 2"),
        (_prints(2), "ends with 2"),
        (_prints(0, "", "stoop: error: one\n"), "ends with 0"),
        (_prints(0, '{"a": NaN}'), "holds NaN"),
        (_prints(0, "{}"), "out/page.html was not written"),
    ],
)  # fmt: skip
def test_a_command_that_breaks_a_promise_is_seen(
    printed: Callable[..., tuple[int, str, str]], says: str, tmp_path: Path
) -> None:
    with (
        mock.patch.object(commands, "run_quietly", printed),
        pytest.raises(BrokenPromiseError, match=says),
    ):
        try_command(tmp_path, ["trim", "--json"], {}, ("out/page.html",))


def test_an_error_of_ours_is_one(tmp_path: Path) -> None:
    printed = _prints(2, "", "stoop: a doubt\nstoop: error: no such file; check the name\n")
    with (
        mock.patch.object(commands, "run_quietly", printed),
        pytest.raises(StoopError, match=r"^no such file"),
    ):
        try_command(tmp_path, ["trim"], {})


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("page.html", "<!doctype html><html>", "cut off"),
        ("numbers.json", '{"a": Infinity}', "holds Infinity"),
        ("result.json", "{}", "cannot be read"),
        ("vehicle.toml", "a =", "cannot be read"),
        ("aircraft.xml", "<a>", "cannot be read"),
        (".stoop-1", "left", "left behind"),
        ("table.csv", "", "is empty"),
    ],
)
def test_an_output_that_is_not_whole_is_seen(name: str, content: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).write_text(content)
    with pytest.raises(BrokenPromiseError, match=says):
        check_outputs(VERBS["trim"].written, tmp_path)


def test_estimates_that_no_file_may_hold_are_said_in_the_result(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "vehicle.toml").write_text("a =")
    for path, content in commands.identified("short").items():
        if path == "result.json":
            document = json.loads(content)
            document["notices"].append(
                {"code": "estimates-refused", "severity": "warning", "subject": "", "values": {"text": "a"}, "message": "a"}
            )  # fmt: skip
            (tmp_path / "out" / path).write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n")
    with pytest.raises(BrokenPromiseError, match=r"result\.json reads as another"):
        check_outputs(VERBS["trim"].written, tmp_path)  # what is said is read, but not the vehicle
