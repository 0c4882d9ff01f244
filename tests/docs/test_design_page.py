"""The table of designed inputs says what the committed numbers say, and they bear out what is claimed."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

from docs.pages import DOCS, ROOT, run_python, table
from stoop.exporters.targets import FLOWN_BY, flown_by

PAGE = DOCS / "design.md"
COLUMNS = (
    "textbook_predicted", "designed_predicted", "textbook_achieved", "designed_achieved", "ratio_predicted", "ratio_achieved",
)  # fmt: skip


def records() -> dict[str, dict[str, str]]:
    with (DOCS / "verify" / "design.csv").open(newline="", encoding="utf-8") as file:
        return {row["parameter"]: row for row in csv.DictReader(file)}


def test_the_table_is_the_one_that_was_written() -> None:
    shown = table(PAGE, "Benefit", "parameter").rows
    assert len(shown) > 10
    for name, *cells in shown:
        row = records()[name]
        assert cells == [f"{float(row[c]):.3g}" if row[c] else "" for c in COLUMNS], name


def test_error_bars_come_down_by_thirty_percent_as_promised() -> None:
    mean = records()["mean"]
    assert float(mean["ratio_predicted"]) < 0.7
    assert float(mean["ratio_achieved"]) < 0.7
    assert mean["flights"] == "100"
    assert "100 flights of each input" in PAGE.read_text(encoding="utf-8")


def test_the_loop_is_as_good_as_its_notebook_says() -> None:
    content = json.loads((ROOT / "examples" / "loop.ipynb").read_text(encoding="utf-8"))
    outputs = [o for c in content["cells"] for o in c.get("outputs", ()) if o["output_type"] == "stream"]
    printed = "".join("".join(o["text"]) for o in outputs)
    before, after = re.findall(r"median error ([\d.]+)%", printed)
    assert f"median error of {before} %, the designed maneuver of {after} %" in PAGE.read_text(
        encoding="utf-8"
    )


def test_files_are_those_that_are_written() -> None:
    rows = table(PAGE, "Files to fly it with", "--for").rows
    for name, target in ((name, flown_by(name)) for name in FLOWN_BY):
        named = {
            file for row in rows if row[0].strip("`") == name for file in re.findall(r"`([\w.]+)`", row[2])
        }
        assert named == {file for file in target.names if not file.startswith("sid_")} | (
            {"sid_roll.param"} if name == "ardupilot" else set()
        )


def test_python_of_the_page(tmp_path: Path) -> None:
    assert "Cmelevator" in run_python(PAGE, tmp_path)
