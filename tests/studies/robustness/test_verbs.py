"""Hostile numbers through complete commands, in little; and those who watch over them see what breaks a promise."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from random import Random
from unittest import mock

import numpy as np
import pytest

from stoop.errors import StoopError
from stoop_studies.robustness import hostile_numbers, verbs
from stoop_studies.robustness.trials import READ, BrokenPromiseError
from stoop_studies.robustness.verb_outputs import check_outputs
from stoop_studies.robustness.verbs import VERBS, Choices, Verb, try_command


def choices(seed: int | str) -> Random:
    return Random(seed)  # noqa: S311  no secret


@pytest.mark.parametrize("name", ["info", "trim", "agreement", "simulate"])
def test_the_same_number_gives_the_same_command(name: str) -> None:
    def drawn() -> tuple[object, dict[str, bytes]]:
        files: dict[str, bytes] = {}
        return VERBS[name].draw(Choices(choices("3"), files)), files

    assert drawn() == drawn()


@pytest.mark.parametrize("edit", hostile_numbers.FLIGHT_EDITS)
@np.errstate(all="ignore")
def test_every_edit_of_a_flight_leaves_a_table(edit: str) -> None:
    for number in range(3):
        changed = hostile_numbers.FLIGHT_EDITS[edit](choices(number), hostile_numbers.record("short"))
        assert {x.shape for x in changed.columns.values()} <= {changed.time.shape}
        again = hostile_numbers.FLIGHT_EDITS[edit](choices(number), changed)
        files = hostile_numbers.as_files(choices(number), again, "flight", 0.0)
        assert files["flight.csv"].count(b"\n") == again.time.size + 1


@np.errstate(all="ignore")
def test_an_empty_flight_can_be_edited() -> None:
    nothing = hostile_numbers.Record(np.empty(0), {})
    for edit in hostile_numbers.FLIGHT_EDITS.values():
        assert edit(choices(1), nothing).columns == {}


def test_sound_commands_are_done(tmp_path: Path) -> None:
    for name in ("trim", "vehicle new", "simulate", "agreement", "derivatives", "propagate"):
        files: dict[str, bytes] = {}
        _, words = VERBS[name].draw(Choices(choices(name), files, tame=True))
        (tmp_path / name).mkdir()
        assert try_command(VERBS[name], words, files, tmp_path / name) == READ


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
        mock.patch.object(verbs, "run_quietly", printed),
        pytest.raises(BrokenPromiseError, match=says),
    ):
        try_command(Verb(VERBS["trim"].draw, 1, ("out/page.html",)), ["trim", "--json"], {}, tmp_path)


def test_an_error_of_ours_is_one(tmp_path: Path) -> None:
    printed = _prints(2, "", "stoop: a doubt\nstoop: error: no such file; check the name\n")
    with mock.patch.object(verbs, "run_quietly", printed), pytest.raises(StoopError, match=r"^no such file"):
        try_command(VERBS["trim"], ["trim"], {}, tmp_path)


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
    for path, content in verbs.identified("short").items():
        if path == "result.json":
            document = json.loads(content)
            document["notices"].append(
                {"code": "estimates-refused", "severity": "warning", "subject": "", "values": {"text": "a"}, "message": "a"}
            )  # fmt: skip
            (tmp_path / "out" / path).write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n")
    with pytest.raises(BrokenPromiseError, match=r"result\.json reads as another"):
        check_outputs(VERBS["trim"].written, tmp_path)  # what is said is read, but not the vehicle
