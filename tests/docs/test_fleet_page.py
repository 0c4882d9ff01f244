"""The example of the page of fleets: its code makes the tables, its command prints what stands there."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import stoop
from docs.pages import DOCS
from stoop.cli.main import main
from stoop.fleet.log_figures import groups
from stoop.fleet.vibration import NO_VIBRATION

TEXT = (DOCS / "fleet.md").read_text("utf-8")
NUMBER = re.compile(r"[-+]?\d+\.\d+")
GRAVITY = "center of gravity 3 mm, step"
#: of a share of four rotors, of which one gives 3 % less thrust at the same command
SHARE = (1.0 / 0.97) / np.mean([1.0 / 0.97, 1.0, 1.0, 1.0]) - 1.0


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


def test_the_example(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    example, of_logs, in_python, *queries = blocks("python")
    compile(of_logs, "fleet.md", "exec")
    subprocess.run([sys.executable, "-c", example], check=True)
    install, command = blocks("text")[0].splitlines()
    assert install == "pip install '.[fleet]'"
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
    assert len(queries) == 3, "in pandas, Polars and DuckDB"
    for query in queries:
        lines = subprocess.run(
            [sys.executable, "-c", query], check=True, capture_output=True, text=True
        ).stdout.splitlines()
        vehicles = [found[0] for line in lines if (found := re.findall(r"drone-\d", line))]
        assert len(set(vehicles)) == 8, query
        assert vehicles[0] == "drone-3", "of the weak propeller"


def test_the_made_up_fleet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Through whole logs: nothing is told where nothing changed, and of the same fleet with a weak rotor its part is told first.

    Logs are the same to the last bit but for those of the changed vehicle, which alone are read again.
    """
    monkeypatch.chdir(tmp_path)
    (made,) = blocks("toml")
    texts = blocks("text")
    k = next(k for k, text in enumerate(texts) if text.startswith("stoop simulate"))
    simulate, fleet = (line.split() for line in texts[k].splitlines())
    kept = made.partition("[[change]]")[0]
    told = {}
    for name, text in (("healthy", kept), ("changed", made)):
        Path("fleet.toml").write_text(text)
        assert main([*simulate[1:], "--overwrite"]) == 0
        logs = sorted(map(str, Path("logs").glob("*.ulg")))
        capsys.readouterr()
        told[name] = main(["fleet", *logs, *fleet[3:], "--workers", "2"]), capsys.readouterr().out
    assert told["healthy"][0] == 0
    assert "no new alarm; 0 earlier ones" in told["healthy"][1]
    code, printed = told["changed"]
    assert code == 3
    for begin in ("4 vehicles", "V2 share.m1"):
        (own,), (shown,) = (
            [line for line in text.splitlines() if line.startswith(begin)] for text in (printed, texts[k + 1])
        )
        assert re.sub(r"[\d.]+", "#", own.partition(" %")[0]) == re.sub(
            r"[\d.]+", "#", shown.partition(" %")[0]
        )
    fleet_now = stoop.open_fleet("store")
    assert {alarm.vehicle for alarm in fleet_now.alarms} == {"V2"}
    (first,) = [alarm for alarm in fleet_now.alarms if alarm.figure == "share.m1"]
    assert first.since.startswith("V2-006 ")
    assert first.causes[0].what == "m1: m1-2-2 for m1-2-1"
    assert abs(first.size - SHARE) < 3.0 * first.std_error


def test_the_table_of_figures_is_the_registry() -> None:
    (table,) = re.findall(r"^\| group .*\n\|[-| ]+\|\n((?:\|.*\n)+)", TEXT, re.MULTILINE)
    rows = [[cell.strip() for cell in row.split("|")[1:-1]] for row in table.splitlines()]
    assert [row[0] for row in rows] == list(groups(NO_VIBRATION))
    assert all(len(row) == 4 and all(row[:3]) for row in rows)


def test_the_example_of_the_statistics() -> None:
    page = (DOCS / "fleet-statistics.md").read_text("utf-8")
    (code,), (shown,) = (
        re.findall(rf"^```{kind}\n(.*?)^```", page, re.MULTILINE | re.DOTALL) for kind in ("python", "text")
    )
    printed = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert NUMBER.sub("#", printed) == NUMBER.sub("#", shown)
    assert [float(x) for x in NUMBER.findall(printed)] == pytest.approx(
        [float(x) for x in NUMBER.findall(shown)], rel=0.02
    )


def test_the_figures_of_the_study() -> None:
    with (DOCS / "verify" / "fleet.csv").open(newline="", encoding="utf-8") as file:
        rows = {row["case"]: row for row in csv.DictReader(file)}
    words = " ".join(TEXT.split())
    assert f"{rows['nothing']['fleets']} in which nothing changes" in words
    assert f"{float(rows['nothing']['told']):.2f} alarms are told in a year" in words
    changed = {case: row for case, row in rows.items() if row["delay"]}
    missed = {case: row for case, row in changed.items() if float(row["found"]) < 1.0}
    assert list(missed) == [GRAVITY]
    found, possible = (100.0 - 100.0 * float(missed[GRAVITY][name]) for name in ("found", "possible"))
    assert f"all are found but {found:.0f} % of the centers of gravity" in words
    assert f"does not find {possible:.0f} % of them either" in words
    flights = {case: (float(row["delay"]), float(row["least"])) for case, row in changed.items()}
    step, drift = (
        [least for case, (_, least) in flights.items() if case.endswith(how)] for how in ("step", "drift")
    )
    assert f"takes {min(step):.1f} to {max(step):.1f} flights to tell a step" in words
    assert f"and {min(drift):.0f} to {max(drift):.0f} to tell a drift" in words
    ratios = {case: told / least for case, (told, least) in flights.items()}
    assert f"takes {min(ratios.values()):.1f} to {max(ratios.values()):.1f} times as many" in words
    beyond = [c for c, (told, least) in flights.items() if told - 1.0 > 1.3 * (least - 1.0) + 1e-9]
    assert f"above 1.3 for {('no', 'one', 'two', 'three', 'four', 'five')[len(beyond)]} of ten steps" in words

    def shares(name: str, how: str) -> list[int]:
        return sorted(
            {round(100.0 * float(row[name])) for case, row in changed.items() if case.endswith(how)}
        )

    assert [case.removesuffix(", drift") for case, row in changed.items() if float(row["named"]) < 0.9] == [
        "center of gravity 3 mm", "drag +10 %",
    ]  # fmt: skip
    for how in ("step", "drift"):
        for name in ("named", "event"):
            low, *_, high = shares(name, how)
            assert f"in {low} to {high} % of the {how}s" in words
    assert float(rows["rolled back"]["dated"]) == 1.0
