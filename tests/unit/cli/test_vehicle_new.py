"""`stoop vehicle new`: what it writes, what it asks, what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest

from stoop.cli.main import main
from stoop.cli.vehicle_new import asked
from stoop.vehicle.builtin import resolve_vehicle
from stoop.vehicle_draft.request import Evidence, Request

GIVEN = ["--template", "glider", "--mass", "2.1", "--span", "2.5", "--area", "0.4"]


def test_from_dimensions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "glider.toml"
    assert main(["vehicle", "new", *GIVEN, "-o", str(target)]) == 0
    assert f"stoop trim {target}" in capsys.readouterr().out
    vehicle = resolve_vehicle(target)
    assert vehicle.file.propulsion is None
    assert vehicle.value("reference.chord") == pytest.approx(0.16)
    assert main(["vehicle", "new", *GIVEN, "-o", str(target)]) == 2
    assert "exists already" in capsys.readouterr().err


def test_what_is_missing_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main(["vehicle", "new", "--template", "v-tail", "--span", "2.3", "-o", str(tmp_path / "v.toml")]) == 2
    )
    (line,) = capsys.readouterr().err.splitlines()
    assert "--mass" in line
    assert "--chord" in line
    assert "usual" in line


def test_a_geometry_that_contradicts_the_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    geometry = tmp_path / "g.toml"
    geometry.write_text('template = "conventional"\nmass = 3.0\n[wing]\nspan = 2.0\nchord = 0.25\n', "utf-8")
    command = ["vehicle", "new", "--geometry", str(geometry), "-o", str(tmp_path / "v.toml")]
    assert main([*command, "--mass", "9"]) == 2
    assert "--mass: is 9" in capsys.readouterr().err
    assert main(command) == 0
    assert resolve_vehicle(tmp_path / "v.toml").value("mass.mass") == 3.0


def test_questions() -> None:
    """Answers are read until they can be; an empty one takes the default."""
    answers = iter(["kite", "conventional", "eight", "8.5", "2.3", "0.28", ""])
    shown: list[str] = []
    told: list[str] = []

    def ask(text: str) -> str:
        shown.append(text)
        return next(answers)

    found = asked(Request(), Evidence(), ask, told.append)
    assert (found.template, found.mass, found.span, found.chord) == ("conventional", 8.5, 2.3, 0.28)
    assert found.engine == "electric"
    assert len(told) == 2
    assert "usual" in shown[4]  # a span for this mass
    assert list(answers) == []
