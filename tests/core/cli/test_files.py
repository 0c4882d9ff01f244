"""Mappings, models, examples and vehicle files: printed or written as they stand, and never over another."""

import json
import re
import shlex
import shutil
import sys
import tomllib
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from helpers.command_line import Done, Refused

import stoop.data
from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.cli.main import main
from stoop.vehicle.builtin import BUILT_IN, resolve_vehicle
from stoop.workflow import examples as listed
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


def test_a_model_exported_without_jsbsim(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, done: Done) -> None:
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    said = done(f"export twin-boom --to jsbsim -o {tmp_path}")
    assert "pip install '.[jsbsim]'" in said
    channels = ", ".join(f"stoop/channel/{name} (rad)" for name in ("elevator", "aileron", "rudder"))
    assert f"To be set in flight: {channels}, stoop/thrust-N (N)." in said
    written = [p for p in tmp_path.rglob("*") if p.is_file()]
    assert said.count("wrote ") == len(written) > 0
    assert all(str(path) in said for path in written)
    assert list(tmp_path.glob("aircraft/*/*.xml"))
    assert not (tmp_path / "export.html").exists()


ROOT = Path(__file__).parents[3]


def test_all_are_listed_and_their_files_copied(done: Done, here: Path) -> None:
    said, names = done("example"), listed.examples()
    assert {path.stem for path in (ROOT / "examples").glob("*.ipynb")} == set(names)
    assert all(name in said for name in names)
    for name in names:
        assert ("flight2" in done(f"example {name}")) == (name == "vtail"), "a flight that is needed"
        wanted = listed.example(name).names
        assert sorted(path.name for path in Path(name).iterdir()) == sorted(wanted)
        for file in wanted:
            assert Path(name, file).read_bytes() == (ROOT / "examples" / file).read_bytes()
        cells = json.loads(Path(name, f"{name}.ipynb").read_text("utf-8"))["cells"]
        text = "".join("".join(cell["source"]) for cell in cells)
        assert all(file in text for file in wanted[1:]), "nothing that the notebook does not read"
    Path("error_bars/maneuver_3211.toml").write_text("mine")
    assert main(["example", "error_bars"]) == 2
    assert Path("error_bars/maneuver_3211.toml").read_text() == "mine"
    done("example error_bars --overwrite")
    assert Path("error_bars/maneuver_3211.toml").read_text() != "mine"


def test_an_installation_without_examples_says_so(monkeypatch: pytest.MonkeyPatch, refused: Refused) -> None:
    monkeypatch.setattr(listed, "folder", Path)
    assert "no examples" in refused("example")


def test_commands_of_the_readme(examples: Path, here: Path) -> None:
    text = (examples / "README.md").read_text()
    commands = [shlex.split(line) for line in re.findall(r"^\$ stoop (.*)$", text, re.MULTILINE)]
    assert {words[0] for words in commands} >= {"trim", "linearize", "simulate", "info"}
    shutil.copytree(examples, here, dirs_exist_ok=True)
    for words in commands:
        assert main(words) == 0, words


DATA = Path(next(iter(stoop.data.__path__)))


def test_listed_printed_and_written_as_they_stand(tmp_path: Path, done: Done) -> None:
    _, *lines, own, example = done("vehicle").splitlines()
    assert "stoop vehicle new LOG" in own
    assert [line.split()[0] for line in lines] == list(BUILT_IN)
    assert all(len(line.split()) > 2 for line in lines)
    assert "stoop vehicle quad-x -o my.toml" in example
    for name, file in BUILT_IN.items():
        target = tmp_path / f"{name}.toml"
        assert f"stoop trim {target}" in done(f"vehicle {name} -o {target}")
        assert target.read_bytes() == (DATA / file).read_bytes()
        assert done(["vehicle", name]).encode() == target.read_bytes()
        assert target.read_text(encoding="utf-8").startswith("# ")
    target.write_text("mine", encoding="utf-8")
    assert main(["vehicle", "quad-x", "-o", str(target)]) == 2
    assert target.read_text(encoding="utf-8") == "mine"
    done(f"vehicle quad-x -o {target} --overwrite")
    assert target.read_bytes() == (DATA / "quad_x.toml").read_bytes()
    assert len([*tmp_path.iterdir()]) == len(BUILT_IN)


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
