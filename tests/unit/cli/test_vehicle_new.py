"""`stoop vehicle new`: what it writes, what it asks, what it refuses."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.cli.main import main
from stoop.cli.vehicle_new import asked
from stoop.vehicle.builtin import resolve_vehicle
from stoop.vehicle_draft import aerosandbox, handbook
from stoop.vehicle_draft.geometry import Geometry
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


def test_derivatives_of_a_geometry_by_the_vortex_lattice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file's derivatives are those of the method asked for, and it says so; without dimensions there are none."""
    pytest.importorskip("aerosandbox")
    path = tmp_path / "g.toml"
    path.write_text('template = "conventional"\nmass = 3.0\n[wing]\nspan = 2.0\nchord = 0.25\n', "utf-8")
    geometry = ["--geometry", str(path)]
    command = ["vehicle", "new", "--overwrite", "-o", str(tmp_path / "v.toml"), "--aerodynamics"]
    assert main([*command, "aerosandbox", *geometry]) == 0
    text = (tmp_path / "v.toml").read_text("utf-8")
    assert text.count(aerosandbox.SOURCE) == 1
    vehicle = resolve_vehicle(tmp_path / "v.toml")
    table = Geometry.load(path)
    expected, other = (
        handbook.with_curved_path(table, SEA_LEVEL_DENSITY, by.derivatives(table, airspeed))
        for by, airspeed in ((aerosandbox, vehicle.value("reference.airspeed")), (handbook, 12.0))
    )
    for name in ("CLalpha", "Cmq", "Clp", "Cnbeta"):
        assert vehicle.value(name) == pytest.approx(expected[name].value, rel=1e-3)
        assert vehicle.value(name) != pytest.approx(other[name].value, rel=1e-3)
    capsys.readouterr()
    for options, said in (
        (["aerosandbox", *GIVEN], "needs dimensions"),
        (["wind-tunnel", *geometry], "choose one of handbook, aerosandbox"),
    ):
        assert main([*command, *options]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert said in line


def test_without_the_vortex_lattice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "aerosandbox", None)
    path = tmp_path / "g.toml"
    path.write_text('template = "conventional"\nmass = 3.0\n[wing]\nspan = 2.0\nchord = 0.25\n', "utf-8")
    target = tmp_path / "v.toml"
    command = ["vehicle", "new", "--geometry", str(path), "--aerodynamics", "aerosandbox", "-o", str(target)]
    assert main(command) == 2
    assert "pip install '.[geometry]'" in capsys.readouterr().err
    assert not target.exists()


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


def test_the_end_of_the_answers_is_an_interruption() -> None:
    """Ctrl-D."""

    def ask(_: str) -> str:
        raise EOFError

    with pytest.raises(KeyboardInterrupt):
        asked(Request(), Evidence(), ask, print)
