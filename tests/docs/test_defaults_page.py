"""The page on the defaults says what the committed tables say."""

from __future__ import annotations

import csv

from docs.pages import DOCS, table
from stoop_studies.verify.defaults import FILES, GRADES, LIMITS, TITLES
from stoop_studies.verify.fleet import KINDS

PAGE = DOCS / "defaults.md"


def rows(name: str) -> list[dict[str, str]]:
    with (DOCS / "verify" / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_table_is_the_one_that_was_written() -> None:
    shown = [list(row) for row in table(PAGE, "What was found", "file").rows]
    assert shown == [
        [
            TITLES[r["case"]], r["flights"], r["stopped"], r["numbers"], f"{100 * float(r['coverage']):.1f}",
            f"{float(r['rms']):.2f}", r["far"], f"{100 * float(r['inertia_coverage']):.1f}",
            f"{float(r['inertia_rms']):.2f}", f"{r['won']} of {r['curves']}",
            f"{r['right']} of {int(r['flights']) - int(r['stopped'])}", ", ".join(r[grade] for grade in GRADES),
        ]
        for r in rows("defaults")
    ]  # fmt: skip
    assert [r["case"] for r in rows("defaults")] == list(FILES)


def test_every_flight_has_a_row() -> None:
    flights, summary = rows("defaults-flights"), {r["case"]: r for r in rows("defaults")}
    for case in FILES:
        own = [r for r in flights if r["case"] == case]
        assert len(own) == int(summary[case]["flights"])
        assert all(r["template"] == KINDS[int(r["flight"]) // 2][0] for r in own)


def test_drafted_files_hold_what_is_asked() -> None:
    """Of intervals; what does not hold is told on the page."""
    (own,) = (r for r in rows("defaults") if r["case"] == "new")
    low, high = LIMITS.coverage
    assert low <= float(own["coverage"]) <= high
    assert float(own["rms"]) <= LIMITS.rms
    assert int(own["far"]) == 0
    assert int(own["stopped"]) == 0
