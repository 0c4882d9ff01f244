"""Frequency responses: the commands run, the figures are what they print, the table is the one that was measured."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest

from docs.pages import DOCS, blocks, commands, run_python, table, tables
from stoop.cli.main import main, one_verb

PAGE = DOCS / "frequency.md"
ROWS = list(csv.DictReader((DOCS / "verify" / "frequency.csv").read_text(encoding="utf-8").splitlines()))


def numbers(text: str) -> list[float]:
    return [float(x.replace("\N{MINUS SIGN}", "-")) for x in re.findall("[-\N{MINUS SIGN}]?[0-9.]+", text)]


def test_from_log_to_bode_plot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("sweep.toml").write_text(blocks(PAGE, "toml")[0], encoding="utf-8")
    for command in commands(PAGE):
        capsys.readouterr()
        assert main(one_verb(command.split()[1:])) == 0
    printed = capsys.readouterr().out
    assert "rudder" in printed
    for system, parameter, *both in table(PAGE, "4. Compare", "system").rows:
        for source, cell in zip(("flight", "model"), both, strict=True):
            line = re.search(rf"^{system}, \S+ +{source} +{parameter} +(.*\))", printed, re.MULTILINE)
            assert line is not None
            assert numbers(line[1]) == pytest.approx(numbers(cell), rel=0.05), (system, source)
    assert "<svg" in Path("frequency.html").read_text(encoding="utf-8")
    assert run_python(PAGE, tmp_path) == blocks(PAGE, "text")[0]


def test_the_table_is_the_one_that_was_measured() -> None:
    (shown,) = (t for t in tables(PAGE) if "flown" in t.head)
    names = ("magnitude", "phase", "unconditioned", "frequency", "damping")
    for cells, row in zip(shown.rows, ROWS, strict=True):
        assert list(cells) == [row["flown"], *(f"{100 * float(row[n]):.1f}" for n in names)]


def test_bands_hold_what_they_say() -> None:
    points = [int(r["points"]) for r in ROWS]
    for name in ("magnitude", "phase"):
        held = sum(p * float(r[name]) for p, r in zip(points, ROWS, strict=True)) / sum(points)
        assert 0.93 <= held <= 0.97
    assert all(int(r["flights"]) >= 200 for r in ROWS)
