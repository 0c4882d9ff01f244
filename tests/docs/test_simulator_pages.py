"""The pages of FMI, RotorPy and derivatives: their examples run, and their figures are those of an export."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from docs.pages import DOCS, run_python, table
from stoop.cli.main import main


def test_the_unit_flies(tmp_path: Path) -> None:
    pytest.importorskip("fmpy")
    said = run_python(DOCS / "fmi.md", tmp_path)
    apart = [float(x) for x in re.findall(r"within (\S+) of each channel", said)]
    assert len(apart) == 2
    assert max(apart) < 1e-11
    assert re.search(r"^3\d\.\d m/s after 1\d\d\d m$", said, re.MULTILINE)


def test_derivatives_and_linear_systems(tmp_path: Path) -> None:
    pytest.importorskip("control")
    first, second = run_python(DOCS / "derivatives.md", tmp_path).strip().splitlines()
    assert first == "['elevator', 'aileron', 'rudder'] 10"
    assert re.fullmatch(r"pitch rate 0\.\d+ rad/s", second)


@pytest.mark.slow
def test_the_quadrotor_flies_in_rotorpy(tmp_path: Path) -> None:
    pytest.importorskip("rotorpy")
    said = run_python(DOCS / "rotorpy.md", tmp_path)
    apart = [float(x) for x in re.findall(r"within (\S+) of each channel", said)]
    shown = [float(x) for x in table(DOCS / "rotorpy.md", "Accuracy", "vehicle").column("largest difference")]
    assert apart == pytest.approx(shown, rel=0.1)
    assert apart[0] < 1e-3
    assert re.search(r"climbs at \d\.\d\d m/s after 1 s", said)
    assert "to [1. 1. 3.] by RotorPy's controller" in said


@pytest.mark.parametrize("ending", [".csv", ".json"])
def test_derivatives_are_written(ending: str, tmp_path: Path) -> None:
    place = tmp_path / f"out{ending}"
    assert main(["derivatives", "twin-boom", "--axes", "body", "--dimensional", "-o", str(place)]) == 0
    text = place.read_text()
    assert "M_q" in text
    assert main(["derivatives", "twin-boom", "-o", str(tmp_path / "out.txt")]) == 2
