"""The page on windows says what the committed tables say, and the tables what is claimed."""

from __future__ import annotations

import csv

import pytest

from docs.pages import DOCS, table
from stoop_studies.verify.windows import CASES, RATIO, REAL

PAGE = DOCS / "windows.md"
NOTHING = "–"


def records(name: str) -> list[dict[str, str]]:
    with (DOCS / "verify" / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_simulated_flights() -> None:
    shown = {row[0]: list(row[1:]) for row in table(PAGE, "What holds", "case").rows}
    written = {r["case"]: r for r in records("windows")}
    assert list(shown) == list(written) == list(CASES)
    for case, r in written.items():
        median = f"{float(r['median']):.2f}" if r["median"] else NOTHING
        coverage = f"{100.0 * float(r['coverage']):.1f}" if r["coverage"] else NOTHING
        false = int(r["false"]) + int(r["bare_false"])
        counted = [r["flights"], r["maneuvers"], r["found"], str(false), r["beside"], median, coverage]
        assert shown[case] == counted
        assert false == 0
        assert case.startswith("quadrotor-steps") or r["beside"] == "0"
        assert r["found"] == r["maneuvers"]
        assert int(r["proposing"]) == (int(r["flights"]) if int(r["maneuvers"]) else 0)
        assert not r["median"] or 1.0 / RATIO < float(r["median"]) < RATIO
    inside, estimates = (sum(int(r[k]) for r in written.values()) for k in ("inside", "estimates"))
    assert inside / estimates == pytest.approx(0.95, abs=0.05)


def test_real_flights() -> None:
    written = records("windows-real")
    assert [r["case"] for r in written] == list(REAL)
    keys = ("words", "windows", "by_hand", "median", "agree", "compared")
    expected = [[f"{float(r[k]):.2f}" if k == "median" else r[k] for k in keys] for r in written]
    assert [list(row) for row in table(PAGE, "Real flights", "flight").rows] == expected
    assert int(written[0]["agree"]) >= 0.9 * int(written[0]["compared"])
