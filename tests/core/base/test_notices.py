"""Notices: typed, printed once, and the page that lists them."""

import importlib
import json
import math
import runpy
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from stoop.base import notices
from stoop.base.arrays import within_range
from stoop.base.notices import Notice, as_notice, attempt, detector_failed, message, notice
from stoop.errors import FlightError
from stoop.flight import Flight, describe, load_flight

ROOT = Path(__file__).parents[3]


def test_notices_survive_json() -> None:
    one = notice("lag-not-beaten", "f 1:2", role="fit", channels=("p", "q"))
    assert Notice.from_dict(one.to_dict()) == one
    assert str(one) == "f 1:2 (fit): no better than a first-order lag in p and q"
    assert (one.topic, one.severity) == ("fit", "warning")
    content = notice("stray-samples", "imu", count=2, distance=math.nan).to_dict()
    content["values"]["distance"] = None  # JSON has no NaN: results write null
    assert "more than nan s" in str(Notice.from_dict(content))
    one = notice("stray-samples", "imu", count=2, distance=-math.inf)
    assert str(Notice.from_dict(json.loads(json.dumps(one.to_dict(), allow_nan=False)))) == str(one)
    later = {"code": "of-tomorrow", "severity": "warning", "subject": "", "values": {}, "message": "Beware."}
    assert str(Notice.from_dict(later)) == "Beware.", "a code of another version keeps its sentence"
    found = notice("fly-roll", "aileron", step=notice("fly-unit-step", seconds=0.4))
    assert str(found) == "fly a bank-to-bank or doublets with aileron, unit step about 0.4 s"
    assert Notice.from_dict(json.loads(json.dumps(found.to_dict()))) == found


def test_a_sentence_without_a_code_is_a_notice_too() -> None:
    for severity, topic in (("warning", "fit"), ("info", "fit"), ("info", "flight")):
        one = as_notice("Beware of {braces}.", severity, topic)  # type: ignore[arg-type]
        assert (message(one), one.severity, one.topic) == ("Beware of {braces}.", severity, topic)
        assert as_notice(one) is one


def test_the_page_lists_the_table() -> None:
    made = runpy.run_path(str(ROOT / "scripts" / "notices.py"))["page"]()
    assert (ROOT / "docs" / "notices.md").read_text("utf-8") == made


FAILED = detector_failed  # before tests replace it


@pytest.fixture(autouse=True)
def _as_users_have_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notices, "detector_failed", FAILED)


def _empty(*_: object) -> object:
    return [][3]


def test_a_failure_is_a_notice_that_names_detector_place_and_remedy() -> None:
    failed: list[Notice] = []
    assert attempt(failed, [], _empty) == []
    (found,) = failed
    assert (found.code, found.severity) == ("detector-failed", "warning")
    assert found.subject.endswith("test_notices._empty")
    assert str(found.values["error"]).startswith("IndexError")
    assert str(found.values["place"]).startswith("test_notices.py:")
    assert "please report it" in str(found)


def test_errors_of_the_user_and_of_memory_pass() -> None:
    failed: list[Notice] = []
    for error in (FlightError, MemoryError):
        with pytest.raises(error):
            attempt(failed, 0, Mock(side_effect=error))
    assert not failed


def _flight_file(folder: Path) -> Path:
    t = np.arange(200) / 50.0
    rows = np.column_stack([t, np.sin(t), np.cos(t), 0.1 * t, np.full(t.size, np.nan)]).tolist()
    lines = ["t,p,q,r,ax", *(",".join(map(repr, row)).replace("nan", "") for row in rows)]
    (folder / "flight.csv").write_text("\n".join(lines))
    units = {"p": "rad/s", "q": "rad/s", "r": "rad/s", "ax": "m/s2"}
    table = "".join(f"{name} = {{column = '{name}', unit = '{unit}'}}\n" for name, unit in units.items())
    head = "[time]\ncolumn = 't'\nunit = 's'\n[variables]\n"
    (folder / "flight.csv.toml").write_text(head + table)
    return folder / "flight.csv"


@pytest.mark.parametrize(
    "name", ["recorded_faults", "in_flight", "check_mapping", "check_rates", "rest_faults", "with_air"]
)
def test_a_flight_is_read_whatever_detector_fails(name, tmp_path, monkeypatch):
    module = "stoop_draft.checks.mapping" if name.startswith("check") else "stoop.flight.load"
    owner = Flight if name == "in_flight" else importlib.import_module(module)
    monkeypatch.setattr(owner, name, _empty)
    flight = load_flight(_flight_file(tmp_path))
    assert [one.code for one in flight.notices].count("detector-failed") == 1
    assert {"p", "q", "r"} <= set(flight.names)
    np.testing.assert_allclose(flight.column("p"), np.sin(flight.time), atol=1e-12)
    if name == "with_air":
        monkeypatch.setattr(importlib.import_module("stoop.flight.maneuvers"), "motors_ran", _empty)
        assert [n.code for n in describe(flight).notices].count("detector-failed") == 2


def test_detectors_get_no_channel_without_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[object] = []
    checks = importlib.import_module("stoop_draft.checks.mapping")
    monkeypatch.setattr(checks, "check_mapping", lambda *a: given.extend(a) or _empty())
    load_flight(_flight_file(tmp_path))
    assert [set(table) for table in given[:2]] == [{"p", "q", "r"}] * 2


def test_numbers_beyond_any_size_are_none() -> None:
    something = np.array([np.nan, 1.0])
    assert within_range(something) is something
    np.testing.assert_array_equal(within_range(np.array([1.0, 1e300, -np.inf])), [1.0, np.nan, np.nan])
