"""The page on gains says what the committed tables of `stoop verify gains` say."""

from __future__ import annotations

import csv

from docs.pages import DOCS, table
from stoop_studies.verify.gains import CASES, REJECTION

PAGE = DOCS / "tune.md"


def rows(name: str) -> list[dict[str, str]]:
    with (DOCS / "verify" / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def figures(row: dict[str, str]) -> tuple[str, ...]:
    """Return a line of the page's table."""
    made, alone = row["proposed"], row["estimates"]
    return (
        CASES[row["case"]],
        row["vehicles"],
        f"{100 * float(row['coverage']):.1f} of {row['intervals']}",
        f"{row['proposed_kept']} of {made}",
        f"{row['estimates_kept']} of {alone}",
        f"{row['back_off_kept']} of {row['back_off']}",
        f"{row['minimum_variance_kept']} of {row['minimum_variance']}",
        *(f"{float(row[f'{way}_rejection']):.2f}" for way in ("proposed", "back_off", "minimum_variance")),
        f"{row['lost']} of {row['flown']}",
        row["spoken_against"],
    )


def test_the_table_is_the_one_that_was_written() -> None:
    shown = table(PAGE, "How good", "vehicles")
    assert [figures(row) for row in rows("gains")] == list(shown.rows)


def test_what_is_missed_is_said() -> None:
    """Proposals keep more than gains by the estimates alone, if not all that is asked; each vehicle has its row."""
    kept, made, alone = (
        sum(int(row[n]) for row in rows("gains")) for n in ("proposed_kept", "proposed", "estimates_kept")
    )
    assert f"{kept} of {made} proposals keep" in PAGE.read_text("utf-8")
    assert f"without the draws it is {alone} of {made}" in PAGE.read_text("utf-8")
    assert alone < kept
    for row in rows("gains"):
        assert float(row["proposed_rejection"]) >= REJECTION
        own = [one for one in rows("gains-vehicles") if one["case"] == row["case"]]
        assert len(own) == int(row["vehicles"])
