"""The example of the page of fleets: its code makes the tables, its command prints what stands there."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from docs.pages import DOCS
from stoop.cli.main import main

TEXT = (DOCS / "fleet.md").read_text("utf-8")
NUMBER = re.compile(r"[-+]?\d+\.\d+")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


def test_the_example(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    example, in_python, *queries = blocks("python")
    subprocess.run([sys.executable, "-c", example], check=True)
    install, command = blocks("text")[0].splitlines()
    assert install == "pip install '.[parquet]'"
    assert main(command.split()[1:]) == 3
    printed, shown = capsys.readouterr().out, blocks("text")[1]
    assert NUMBER.sub("#", printed) == NUMBER.sub("#", shown)
    assert [float(x) for x in NUMBER.findall(printed)] == pytest.approx(
        [float(x) for x in NUMBER.findall(shown)], rel=0.02
    )
    told = subprocess.run(
        [sys.executable, "-c", in_python], check=True, capture_output=True, text=True
    ).stdout
    assert told.startswith("drone-3 thrust -0.04")
    asked = [query for query in queries if find_spec(query.split()[1])]
    assert asked, "pandas at least"
    for query in asked:
        lines = subprocess.run(
            [sys.executable, "-c", query], check=True, capture_output=True, text=True
        ).stdout.splitlines()
        vehicles = [found[0] for line in lines if (found := re.findall(r"drone-\d", line))]
        assert len(set(vehicles)) == 8, query
        assert vehicles[0] == "drone-3", "of the weak propeller"


def test_the_figures_of_the_study() -> None:
    with (DOCS / "verify" / "fleet.csv").open(newline="", encoding="utf-8") as file:
        rows = {row["case"]: row for row in csv.DictReader(file)}
    assert f"{float(rows['nothing']['told']):.2f} alarms are told in a year" in TEXT
    changed = {case: row for case, row in rows.items() if row["delay"]}
    missed = {case for case, row in changed.items() if float(row["found"]) < 1.0}
    assert missed == {"servo trim 1 deg, step", "IMU turned by 0.5 deg, step"}
    assert all(float(changed[case]["found"]) == 0.5 for case in missed)
    late = {
        case: (float(row["delay"]), float(row["least"]))
        for case, row in changed.items()
        if "servo" not in case
    }
    assert all(
        found <= max(1.2 * least, least + 1.0) for case, (found, least) in late.items() if "step" in case
    )
    assert (
        f"drifts up to {max(found / least for case, (found, least) in late.items() if 'drift' in case):.1f} times"
        in TEXT
    )
    for how, words in (
        ("step", "of a step is named first in {} to {} %"),
        ("drift", "of a drift in {} to {} %"),
    ):
        named = [round(100.0 * float(row["named"])) for case, row in changed.items() if case.endswith(how)]
        assert words.format(min(named), max(named)).removeprefix("a ") in TEXT.replace("\n", " ")
    assert float(rows["rolled back"]["dated"]) == 1.0
