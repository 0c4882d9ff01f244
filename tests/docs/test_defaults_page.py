"""The page on the defaults says what the committed tables say."""

from __future__ import annotations

import csv

from docs.pages import DOCS, table
from stoop_studies.verify.defaults import FILES, GRADES, LIMITS, TITLES
from stoop_studies.verify.made_up import KINDS

PAGE = DOCS / "defaults.md"


def rows(name: str) -> list[dict[str, str]]:
    with (DOCS / "verify" / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def figures(row: dict[str, str]) -> dict[str, str]:
    """Return a column of the page's table."""
    return {
        "figure": TITLES[row["case"]],
        "flights": row["flights"],
        "stopped on the way": row["stopped"],
        "numbers compared": row["numbers"],
        "95 % intervals that hold the truth, %": f"{100 * float(row['coverage']):.1f}",
        "rms error, standard errors": f"{float(row['rms']):.2f}",
        "errors above 5 standard errors": row["far"],
        "intervals over inertia that hold the truth, %": f"{100 * float(row['inertia_coverage']):.1f}",
        "rms error over inertia": f"{float(row['inertia_rms']):.2f}",
        "held-back curves better than a lag": f"{row['won']} of {row['curves']}",
        "verdicts right": f"{row['right']} of {int(row['flights']) - int(row['stopped'])}",
        "trusted, usable, do not use": ", ".join(row[grade] for grade in GRADES),
        "log to report, s (median, most)": f"{float(row['seconds']):.0f}, {float(row['slowest']):.0f}",
    }


def test_the_table_is_the_one_that_was_written() -> None:
    shown = table(PAGE, "What was found", "figure")
    columns = [figures(row) for row in rows("defaults")]
    assert [shown.head, *shown.rows] == [(name, *(one[name] for one in columns)) for name in columns[0]]
    assert [r["case"] for r in rows("defaults")] == list(FILES)


def test_every_flight_has_a_row() -> None:
    flights, summary = rows("defaults-flights"), {r["case"]: r for r in rows("defaults")}
    for case in FILES:
        own = [r for r in flights if r["case"] == case]
        assert len(own) == int(summary[case]["flights"])
        assert all(r["template"] == KINDS[int(r["flight"]) // 2][0] for r in own)


def test_what_drafted_files_hold_and_what_not() -> None:
    """Coverage and a way without stops; what does not hold is told on the page, with the flights to blame."""
    (own,) = (r for r in rows("defaults") if r["case"] == "new")
    low, high = LIMITS.coverage
    assert low <= float(own["coverage"]) <= high
    assert int(own["stopped"]) == 0
    assert float(own["rms"]) <= LIMITS.rms
    flights = [r for r in rows("defaults-flights") if r["case"] == "new"]
    assert sorted(r["flight"] for r in flights if abs(float(r["worst"])) > LIMITS.far) == ["33", "38", "7"]
    wrong = [r for r in flights if r["right"] == "no"]
    assert {r["grade"] for r in wrong} == {"do not use"}
    assert len(wrong) == 40 - int(own["right"])
