"""Rounding errors are shown as 0: by `trim`, `linearize`, `derivatives` and exports, in text, JSON and CSV."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from stoop.base.numbers import without_rounding
from stoop.cli.main import main

TINY = re.compile(r"-?\d[\d.]*e-(?:1[3-9]|[2-9]\d)\b|-0\.0\b")


def test_rounding_is_relative() -> None:
    assert without_rounding(1.9e-26, 1.0) == 0.0
    assert without_rounding(1.9e-26, 1e-24) == 1.9e-26
    assert str(without_rounding(-1e-15, 9.81)) == "0.0", "no negative zero"
    matrix = np.array([[1e3, -1e-10], [2e-3, np.nan]])
    assert without_rounding(matrix, 1e3).tolist()[0] == [1e3, 0.0]
    assert without_rounding(matrix, 1e3)[1, 0] == 2e-3
    assert np.isnan(without_rounding(matrix, 1e3)[1, 1])


@pytest.mark.parametrize("vehicle", ["twin-boom", "quad-x"])
def test_verbs_show_no_rounding(vehicle: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wings = vehicle == "twin-boom"
    forms = () if wings else ("--dimensional",)
    assert main(["trim", vehicle]) == 0
    assert main(["linearize", vehicle]) == 0
    assert main(["linearize", vehicle, "--json", str(tmp_path / "linear.json")]) == 0
    for ending in ("csv", "json"):
        target = str(tmp_path / f"derivatives.{ending}")
        assert main(["derivatives", vehicle, *forms, "-o", target]) == 0
    assert main(["export", vehicle, "--to", "state-space", "-o", str(tmp_path)]) == 0
    texts = {path.name: path.read_text() for path in tmp_path.glob("*.[cj]s*")}
    texts["printed"] = capsys.readouterr().out
    assert len(texts) == 5
    for name, text in texts.items():
        kept = [line for line in text.splitlines() if "residual" not in line]
        assert not [line for line in kept if TINY.search(line)], name
