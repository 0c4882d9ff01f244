"""`stoop map`: printed or written, and what it writes can be read."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stoop.cli.main import main


def test_printed_written_and_read(tmp_path: Path, done: Callable[..., str]) -> None:
    t, log, target = 0.02 * np.arange(500), tmp_path / "f.csv", tmp_path / "m.toml"
    rows = np.column_stack([t, 20.0 * np.sin(t), 20.0 * np.cos(t)])
    np.savetxt(log, rows, delimiter=",", header="t_s,roll,roll_rate", comments="")
    mapping = tomllib.loads(done(["map", log]))
    assert mapping["time"] == {"column": "t_s", "unit": "s"}
    assert mapping["variables"]["p"] == {"column": "roll_rate", "unit": "deg/s"}
    assert "m.toml: 2 variables, 0 of them unsure" in done(["map", log, "-o", target])
    assert main(["map", str(log), "-o", str(target)]) == 2
    found = json.loads(done(["map", log, "--json", "-o", target, "--overwrite"]))
    assert found["mapping"] == target.read_text("utf-8")
    time, roll, _ = found["columns"]
    assert (time["column"], time["low"], time["high"]) == ("t_s", 0.0, 9.98)
    assert time["samples"] == sorted(time["samples"])
    assert (roll["stream"], roll["unit"]) == ("f.csv", "")
    assert roll["high"] == pytest.approx(20.0, abs=0.01)
    done(["info", log, "--mapping", target])
