"""The page on the hexacopter says what the notebook prints, and its files are those that the studies read."""

from __future__ import annotations

import json
from importlib.resources import files

import pytest

from docs.pages import DOCS, ROOT, table
from stoop_studies.verify.study import vehicle_text

PAGE = DOCS / "hexacopter.md"
NOTEBOOK = ROOT / "examples" / "hexacopter.ipynb"
AXES = ("ax", "ay", "az")


def printed() -> list[tuple[str, ...]]:
    """Return the rows of the tables that the notebook prints."""
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    text = "".join(
        "".join(o["text"]) for c in cells for o in c.get("outputs", ()) if o["output_type"] == "stream"
    )
    return [tuple(line.strip("| ").split(" | ")) for line in text.splitlines() if line.startswith("|")]


def residuals() -> dict[tuple[str, str], dict[str, str]]:
    """Return window and axis -> the row of the table of residuals."""
    head, *rows = printed()[:10]
    return {row[1:3]: dict(zip(head, row, strict=True)) for row in rows}


@pytest.mark.parametrize(
    ("heading", "first"),
    [
        ("Results", "fitted"),
        ("Results", "without"),
        ("Comparison with the published coefficients", "quantity"),
    ],
)
def test_the_tables_are_those_that_are_printed(heading: str, first: str) -> None:
    shown, rows = table(PAGE, heading, first), printed()
    start = rows.index(shown.head)
    assert list(shown.rows) == rows[start + 1 : start + 1 + len(shown.rows)]
    assert len(rows) == 10 + 8 + 12, "all are on the page"


def test_what_is_said_of_them() -> None:
    text, rows = " ".join(PAGE.read_text(encoding="utf-8").split()), residuals()
    for window, name in (("214:260", "model"), ("214:260", "authors here"), ("140:281", "model")):
        a, b, c = (rows[window, axis][name] for axis in AXES)
        assert f"{a} (ax), {b} (ay) and {c} (az)" in text
    sprints = [rows["214:260", axis] for axis in AXES]
    shares = [float(r["model"]) / float(r[k]) for r in sprints for k in ("constant", "static thrust")]
    assert f"at most {max(shares):.2f} is left" in text
    assert all(float(r["model"]) < float(r["authors here"]) for r in sprints)
    assert float(sprints[0]["model"]) > float(sprints[0]["authors published"]), "the page says so"
    whole = [rows["140:281", axis] for axis in AXES]
    assert all(float(r["model"]) < float(r["authors published"]) for r in whole)


def test_the_examples_are_those_of_the_studies() -> None:
    mapping = files("stoop_studies.problems").joinpath("hexacopter_mapping.toml").read_text(encoding="utf-8")
    for example, text in (
        ("hexacopter_mapping.toml", mapping),
        ("hexacopter.toml", vehicle_text("hexacopter")),
    ):
        assert (ROOT / "examples" / example).read_text(encoding="utf-8") == text
    clocks = mapping.partition('extends = "px4"')[2].strip()
    assert clocks in PAGE.read_text(encoding="utf-8").replace("   ", "")
