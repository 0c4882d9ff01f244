"""The section on flights of other people's models says what the committed tables say."""

from __future__ import annotations

import csv

from docs.pages import DOCS, table

PAGE = DOCS / "defaults.md"


def rows(name: str) -> list[dict[str, str]]:
    with (DOCS / "verify" / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def figures(name: str) -> tuple[dict[str, str], float]:
    """Return the figures of a run as the page prints them, and the rms error in standard errors."""
    vehicles, flights, planted = (rows(f"{name}{part}") for part in ("", "-flights", "-planted"))
    numbers = [int(row["numbers"]) for row in vehicles]
    held = sum(n * float(row["coverage"]) for n, row in zip(numbers, vehicles, strict=True)) / sum(numbers)
    lowest = min(vehicles, key=lambda row: float(row["coverage"]))
    named = [row for row in planted if row["said"] == "named"]
    count = len(flights)
    expected = {
        "numbers within 95 %": f"{100.0 * held:.1f} % of {sum(numbers)}",
        "lowest vehicle": f"{100.0 * float(lowest['coverage']):.0f} % ({lowest['case']})",
        "verdict right": f"{sum(int(row['right']) for row in vehicles)} of {count}",
        "wrong line named": f"{len(named)} of {count}",
        "of these right by the advice": f"{sum(not row['left'] for row in named)} of {len(named)}",
        "sound flights accused": f"{sum(int(row['accused']) for row in vehicles)} of {count}",
        "written vehicle files that load": f"{sum(not row['refused'] for row in flights)} of {count}",
        "nothing edited by hand": f"{sum(int(row['unedited']) for row in vehicles)} of {count}",
        "log to report within 60 s": f"{sum(float(row['seconds']) <= 60.0 for row in flights)} of {count}",
    }
    squares = sum(
        (n - int(row["at_bound"])) * float(row["rms"]) ** 2 for n, row in zip(numbers, vehicles, strict=True)
    )
    inner = sum(n - int(row["at_bound"]) for n, row in zip(numbers, vehicles, strict=True))
    return expected, (squares / inner) ** 0.5


def test_figures_of_the_page() -> None:
    expected, rms = figures("outside")
    shown = table(PAGE, "Flights of other people's models", "figure")
    printed = {name: measured for name, _, measured in shown.rows}
    assert printed.items() >= expected.items()
    assert printed["rms error, standard errors"] == f"{rms:.2f}"


def test_figures_of_the_development() -> None:
    (paragraph,) = [
        p for p in PAGE.read_text("utf-8").split("\n\n") if p.startswith("The two thirds of development")
    ]
    text = paragraph.replace("\n", " ")
    expected, rms = figures("outside-development")
    held, lowest, right, named, followed, accused, loaded, unedited, soon = expected.values()
    assert (
        f": {held} numbers, the lowest vehicle {lowest}, rms error {rms:.2f}, verdict right in {right}, {named} lines named"
        in text
    )
    advice = followed.partition(" of ")[0]
    assert (
        f"of these {advice} right by the advice, {accused} sound flights accused, {loaded} vehicle files load"
        in text
    )
    assert f"nothing edited by hand in {unedited}, within 60 s {soon} " in text
