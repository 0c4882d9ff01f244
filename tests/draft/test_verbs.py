"""`stoop map` and `stoop vehicle new`: mappings and vehicle files, printed or written, and never over another."""

import json
import sys
import tomllib
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from helpers.command_line import Done, Refused

from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.cli.main import main
from stoop.vehicle.builtin import resolve_vehicle
from stoop_draft.vehicle_draft import aerosandbox, handbook
from stoop_draft.vehicle_draft.geometry import Geometry
from stoop_draft.vehicle_draft.request import Evidence, Request
from stoop_draft.vehicle_new import asked


def test_printed_written_and_read(tmp_path: Path, done: Done) -> None:
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


GIVEN = ["--template", "glider", "--mass", "2.1", "--span", "2.5", "--area", "0.4"]


def geometry(folder: Path) -> Path:
    path = folder / "g.toml"
    path.write_text('template = "conventional"\nmass = 3.0\n[wing]\nspan = 2.0\nchord = 0.25\n', "utf-8")
    return path


def test_from_dimensions_or_a_geometry(tmp_path: Path, done: Done) -> None:
    target = tmp_path / "glider.toml"
    assert f"stoop trim {target}" in done(["vehicle", "new", *GIVEN, "-o", target])
    vehicle = resolve_vehicle(target)
    assert vehicle.file.propulsion is None
    assert vehicle.value("reference.chord") == pytest.approx(0.16)
    assert main(["vehicle", "new", *GIVEN, "-o", str(target)]) == 2
    done(["vehicle", "new", "--geometry", geometry(tmp_path), "-o", tmp_path / "v.toml"])
    assert resolve_vehicle(tmp_path / "v.toml").value("mass.mass") == 3.0


def test_derivatives_of_a_geometry_by_the_vortex_lattice(here: Path, done: Done) -> None:
    pytest.importorskip("aerosandbox")
    path = geometry(here)
    done(f"vehicle new -o v.toml --aerodynamics aerosandbox --geometry {path}")
    assert Path("v.toml").read_text("utf-8").count(aerosandbox.SOURCE) == 1
    vehicle, table = resolve_vehicle("v.toml"), Geometry.load(path)
    found = aerosandbox.derivatives(table, vehicle.value("reference.airspeed"))
    expected = handbook.with_curved_path(table, SEA_LEVEL_DENSITY, found)
    for name in ("CLalpha", "Cmq", "Clp", "Cnbeta"):
        assert vehicle.value(name) == pytest.approx(expected[name].value, rel=1e-3)


def test_without_the_vortex_lattice(here: Path, monkeypatch: pytest.MonkeyPatch, refused: Refused) -> None:
    monkeypatch.setitem(sys.modules, "aerosandbox", None)
    command = f"vehicle new --geometry {geometry(here)} --aerodynamics aerosandbox -o v.toml"
    assert "pip install '.[geometry]'" in refused(command)


def test_questions() -> None:
    answers = iter(["kite", "conventional", "eight", "8.5", "2.3", "0.28", ""])
    shown: list[str] = []
    told: list[str] = []
    found = asked(Request(), Evidence(), lambda text: shown.append(text) or next(answers), told.append)
    assert (found.template, found.mass, found.span, found.chord) == ("conventional", 8.5, 2.3, 0.28)
    assert (found.engine, len(told)) == ("electric", 2)
    assert "usual" in shown[4]  # a span for this mass
    assert list(answers) == []


def test_the_end_of_the_answers_is_an_interruption() -> None:
    with pytest.raises(KeyboardInterrupt):
        asked(Request(), Evidence(), Mock(side_effect=EOFError), print)
