"""`stoop map`: printed or written, and what it writes can be read."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from stoop.cli.main import main


@pytest.fixture
def log(tmp_path: Path) -> Path:
    t = 0.02 * np.arange(500)
    rows = np.column_stack([t, 20.0 * np.sin(t), 20.0 * np.cos(t)])
    np.savetxt(tmp_path / "f.csv", rows, delimiter=",", header="t_s,roll,roll_rate", comments="")
    return tmp_path / "f.csv"


def test_printed(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", str(log)]) == 0
    found = tomllib.loads(capsys.readouterr().out)
    assert found["time"] == {"column": "t_s", "unit": "s"}
    assert found["variables"]["p"] == {"column": "roll_rate", "unit": "deg/s"}


def test_written_and_read(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = log.with_name("m.toml")
    assert main(["map", str(log), "-o", str(target)]) == 0
    said = capsys.readouterr().out
    assert "m.toml: 2 variables, 0 of them unsure" in said
    assert main(["map", str(log), "-o", str(target)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["map", str(log), "-o", str(target), "--overwrite"]) == 0
    assert main(["info", str(log), "--mapping", str(target)]) == 0


def test_the_columns_as_json(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = log.with_name("m.toml")
    assert main(["map", str(log), "--json", "-o", str(target)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["mapping"] == target.read_text("utf-8")
    t, roll, _ = found["columns"]
    assert (t["column"], t["low"], t["high"]) == ("t_s", 0.0, 9.98)
    assert t["samples"] == sorted(t["samples"])
    assert (roll["stream"], roll["unit"]) == ("f.csv", "")
    assert roll["high"] == pytest.approx(20.0, abs=0.01)


def test_no_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", str(tmp_path / "no.csv")]) == 2
    assert "no.csv" in capsys.readouterr().err
