"""`stoop vehicle new`: what it writes, what it asks, what it refuses."""

from __future__ import annotations

import sys
from collections.abc import Callable
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


def geometry(folder: Path) -> Path:
    path = folder / "g.toml"
    path.write_text('template = "conventional"\nmass = 3.0\n[wing]\nspan = 2.0\nchord = 0.25\n', "utf-8")
    return path


def test_from_dimensions_or_a_geometry(tmp_path: Path, done: Callable[..., str]) -> None:
    target = tmp_path / "glider.toml"
    assert f"stoop trim {target}" in done(["vehicle", "new", *GIVEN, "-o", target])
    vehicle = resolve_vehicle(target)
    assert vehicle.file.propulsion is None
    assert vehicle.value("reference.chord") == pytest.approx(0.16)
    assert main(["vehicle", "new", *GIVEN, "-o", str(target)]) == 2
    done(["vehicle", "new", "--geometry", geometry(tmp_path), "-o", tmp_path / "v.toml"])
    assert resolve_vehicle(tmp_path / "v.toml").value("mass.mass") == 3.0


def test_derivatives_of_a_geometry_by_the_vortex_lattice(tmp_path: Path) -> None:
    """The file's derivatives are those of the method asked for, and it says so."""
    pytest.importorskip("aerosandbox")
    path = geometry(tmp_path)
    words = ["vehicle", "new", "-o", tmp_path / "v.toml", "--aerodynamics", "aerosandbox", "--geometry", path]
    assert main([*map(str, words)]) == 0
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


def test_without_the_vortex_lattice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
) -> None:
    monkeypatch.setitem(sys.modules, "aerosandbox", None)
    path = geometry(tmp_path)
    command = f"vehicle new --geometry {path} --aerodynamics aerosandbox -o v.toml"
    assert "pip install '.[geometry]'" in refused(command)


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
