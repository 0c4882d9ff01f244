"""Notices: typed, printed once, and the page that lists them."""

from __future__ import annotations

import json
import math
import runpy
from pathlib import Path

from stoop.base.notices import as_notice, from_dict, message, notice

ROOT = Path(__file__).parents[3]


def test_notices_survive_json() -> None:
    one = notice("lag-not-beaten", "f 1:2", role="fit", channels=("p", "q"))
    assert from_dict(one.to_dict()) == one
    assert str(one) == "f 1:2 (fit): no better than a first-order lag in p and q"
    assert (one.topic, one.severity) == ("fit", "warning")
    content = notice("stray-samples", "imu", count=2, distance=math.nan).to_dict()
    content["values"]["distance"] = None  # JSON has no NaN: results write null
    assert "more than nan s" in str(from_dict(content))
    one = notice("stray-samples", "imu", count=2, distance=-math.inf)
    assert str(from_dict(json.loads(json.dumps(one.to_dict(), allow_nan=False)))) == str(one)
    later = {"code": "of-tomorrow", "severity": "warning", "subject": "", "values": {}, "message": "Beware."}
    assert str(from_dict(later)) == "Beware.", "a code of another version keeps its sentence"
    found = notice("fly-roll", "aileron", step=notice("fly-unit-step", seconds=0.4))
    assert str(found) == "fly a bank-to-bank or doublets with aileron, unit step about 0.4 s"
    assert from_dict(json.loads(json.dumps(found.to_dict()))) == found


def test_a_sentence_without_a_code_is_a_notice_too() -> None:
    for severity, topic in (("warning", "fit"), ("info", "fit"), ("info", "flight")):
        one = as_notice("Beware of {braces}.", severity, topic)  # type: ignore[arg-type]
        assert (message(one), one.severity, one.topic) == ("Beware of {braces}.", severity, topic)
        assert as_notice(one) is one


def test_the_page_lists_the_table() -> None:
    made = runpy.run_path(str(ROOT / "scripts" / "notices.py"))["page"]()
    assert (ROOT / "docs" / "notices.md").read_text("utf-8") == made
