"""The page of the comparison says what its committed results hold, and nothing that they do not."""

from __future__ import annotations

import csv
import re
from math import inf
from pathlib import Path

import pytest

from docs.pages import DOCS, commands, table
from stoop.base.numbers import number

PAGE = DOCS / "comparison.md"
RESULTS = DOCS / "results"
DEFAULT = "ps-gde-lm"


def rows(name: str) -> dict[tuple[str, str], dict[str, str]]:
    """Return by problem and optimizer what a comparison found."""
    with (RESULTS / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return {(row["problem"], row["optimizer"]): row for row in csv.DictReader(file)}


def ert(row: dict[str, str]) -> str:
    return number(float(row["ert"]), 3)


def ratio(row: dict[str, str]) -> str:
    """Return the ratio to the default, and the share of successes where some runs failed."""
    share = float(row["successes"]) / float(row["runs"])
    if share == 0.0:
        return "0 %"
    return f"{number(float(row['ratio']), 3)}×" + ("" if share == 1.0 else f" ({100.0 * share:.0f} %)")


@pytest.mark.parametrize(("heading", "name"), [("Boxes", "boxes"), ("A real flight", "vtail")])
def test_table_of_rivals(heading: str, name: str) -> None:
    found, written = rows(name), table(PAGE, heading, "problem", DEFAULT)
    assert [row[0] for row in written.rows] == list(dict.fromkeys(problem for problem, _ in found))
    assert set(written.head[1:]) == {optimizer for _, optimizer in found}
    for problem, own, *others in written.rows:
        assert own == ert(found[problem, DEFAULT])
        assert others == [ratio(found[problem, o]) for o in written.head[2:]]


def test_table_of_everyone() -> None:
    found, written = rows("everyone"), table(PAGE, "Everyone", "optimizer")
    assert {(p, row[0]) for row in written.rows for p in written.head[1:]} == set(found)
    for optimizer, *cells in written.rows:
        assert cells == [ratio(found[problem, optimizer]) for problem in written.head[1:]]


def test_what_the_default_was_asked_for() -> None:
    """Under noise 1.5 (N) and 8 times (W) below SciPy's least squares, everywhere 40 times below CMA-ES."""
    found = rows("boxes")
    assert all(int(row["runs"]) >= 100 for row in found.values())
    assert float(found["paper-N+noise", "scipy-least-squares"]["ratio_low"]) >= 1.5
    assert float(found["paper-W+noise", "scipy-least-squares"]["ratio_low"]) >= 8.0
    boxes = [f"paper-{box}{noise}" for box in "NSW" for noise in ("", "+noise")]
    assert all(float(found[box, "cma"]["ratio"]) >= 40.0 for box in boxes)


@pytest.mark.parametrize("name", ["boxes", "everyone", "vtail"])
def test_whoever_is_ahead_or_wrong_is_named(name: str) -> None:
    text = PAGE.read_text(encoding="utf-8")
    for (problem, optimizer), row in rows(name).items():
        if optimizer != DEFAULT and row["baseline"] == DEFAULT and float(row["ratio"] or inf) < 1.0:
            assert f"**{optimizer} on {problem}**" in text
        if int(row["wrong_optima"]):
            assert f"**{optimizer} on {problem}** claims a wrong optimum" in text
        if int(row["ended_short"]):
            assert f"**{optimizer} on {problem}** ends short" in text


@pytest.mark.parametrize("name", ["boxes", "everyone", "vtail"])
def test_each_page_holds_its_command_and_its_table(name: str) -> None:
    html = (RESULTS / f"{name}.html").read_text(encoding="utf-8")
    written = [c for c in commands(PAGE) if f"-o {name}" in c]
    assert len(written) == 1
    said = re.search(r"<pre[^>]*>(.*?)</pre>", html, re.DOTALL)
    assert said is not None
    # the folder does not change the page
    assert said[1].replace("&#39;", "'") == written[0].replace(f" -o {name}", "")
    plain = re.sub(r"<[^>]*>", " ", html)
    for (_, optimizer), row in rows(name).items():
        assert optimizer in plain
        if row["successes"] != "0":
            assert ert(row) in plain


def test_results_are_small() -> None:
    assert sum(path.stat().st_size for path in Path(RESULTS).iterdir()) < 1_500_000


def test_multiples_in_the_text_stand_in_the_tables() -> None:
    text = PAGE.read_text(encoding="utf-8")
    prose = "\n".join(line for line in text.splitlines() if not line.startswith("|"))
    cells = "\n".join(line for line in text.splitlines() if line.startswith("|"))
    said = re.findall(r"\d[\d.]*×", prose)
    assert said
    assert not [multiple for multiple in said if f" {multiple}" not in cells]


def test_what_is_said_of_the_flight() -> None:
    found = rows("vtail")
    close = found["flight", "ordered-shade"]
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert (
        f"interval from {number(float(close['ratio_low']), 3)} to {number(float(close['ratio_high']), 3)}"
        in text
    )
    arrived = {optimizer: int(row["successes"]) for (_, optimizer), row in found.items()}
    assert arrived.pop(DEFAULT) == int(close["runs"]) == 10
    assert arrived.pop("ordered-shade") == 9
    assert set(arrived.values()) == {0}
