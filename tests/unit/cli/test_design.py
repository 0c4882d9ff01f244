"""`stoop design`: what it writes, says and can be flown; its refusals stand in test_bad_input."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from unit.cli.conftest import Cli, Done

from stoop.cli.main import main, parser_for
from stoop.exporters.targets import flown_by
from stoop.simulation.maneuver import load_maneuver, parse_maneuver
from stoop.vehicle import load_vehicle
from stoop.workflow.design import DESIGN_FILES, known_before, maneuver_toml

QUICK = shlex.split(
    "design twin-boom --duration 6 --evaluations 8 --shape square 3-2-1-1 --fix CLV CDV CmV CQV -o"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("design") / "next"
    assert main([*QUICK, str(out)]) == 0
    return out


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_writes_what_it_says(folder: Path) -> None:
    assert names(folder) == set(DESIGN_FILES)
    found = json.loads((folder / "design.json").read_text())
    assert found["format"] == "stoop-design/1"
    assert set(found["designs"]) == {"square", "3-2-1-1"}
    assert found["designs"][found["shape"]]["gain"] == max(one["gain"] for one in found["designs"].values())
    assert set(found["standard_errors"]["CLalpha"]) == {"value", "now", "reference", "square", "3-2-1-1"}
    assert "CLV" not in found["standard_errors"]
    page = (folder / "design.html").read_text()
    assert "What to fly next" in page
    assert "<b>" not in re.sub(r"<(figcaption|script).*?</\1>", "", page, flags=re.DOTALL), "text is text"
    before = (folder / "design.json").read_bytes()
    assert main([*QUICK, str(folder)]) == 2
    assert (folder / "design.json").read_bytes() == before


def test_the_maneuver_is_that_of_the_table_and_can_be_flown(folder: Path, tmp_path: Path, done: Done) -> None:
    maneuver = load_maneuver(folder / "maneuver.toml")
    head, *rows = (folder / "maneuver.csv").read_text().splitlines()
    assert head == "time_s,elevator_rad,aileron_rad,rudder_rad"
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    moves = maneuver.deflections()
    for i, control in enumerate(("elevator", "aileron", "rudder"), 1):
        assert np.allclose(table[:, i], moves[control], atol=1e-9)
    done(["simulate", "twin-boom", "--maneuver", folder / "maneuver.toml", "-o", tmp_path / "f.nc"])
    for name in ("maneuver.toml", "reference.toml"):
        maneuver = load_maneuver(folder / name)
        assert parse_maneuver(maneuver_toml(maneuver, "once -- more"), "again") == maneuver


def test_priors_are_what_a_vehicle_file_knows(examples: Path) -> None:
    _, knowledge, *_ = known_before(load_vehicle(examples / "vtail.toml"))
    stds = np.sqrt(np.diag(np.linalg.inv(knowledge.information)))
    known = dict(zip(knowledge.names, stds, strict=True))
    assert known["CLalpha"] == pytest.approx(1.0)
    assert known["mass.inertia.xx"] == pytest.approx(0.2)
    assert "Cm0" not in known


def test_an_option_given_twice_counts_twice() -> None:
    words = ["design", "twin-boom", "-o", "out", "--amplitude", "elevator=3", "--amplitude", "rudder=5"]
    assert parser_for(words).parse_args(words).amplitude == ["elevator=3", "rudder=5"]


def test_ctrl_c_ends_all_families(tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(setup: object, plan: object, family: str, callback: object) -> None:
        print(family)
        raise KeyboardInterrupt

    monkeypatch.setattr("stoop.input_design.optimization.design", stop)
    code, out, _ = cli([*QUICK, tmp_path / "out"])
    assert (code, out.split()) == (130, ["square"])
    assert not (tmp_path / "out").exists()


def test_files_for_an_autopilot(tmp_path: Path, done: Done) -> None:
    out = tmp_path / "next"
    throws = ["--throw", "elevator=25", "aileron=20", "rudder=30"]
    assert "fly_px4.py" in done([*QUICK, out, "--for", "px4", *throws])
    assert names(out) == {*DESIGN_FILES, *flown_by("px4").names}
    assert "How to fly it" in (out / "design.html").read_text()
    document = json.loads((out / "design.json").read_text())
    assert document["limits"]["min_amplitude"]["elevator"] == pytest.approx(np.radians(0.5))
    done([*QUICK, out, "--for", "ardupilot", *throws, "--overwrite"])
    assert names(out) == {*DESIGN_FILES, "maneuver.lua", "ardupilot.param"}, "files of the first target go"


def test_files_of_the_textbook_where_no_design_is_better(tmp_path: Path, done: Done) -> None:
    out = tmp_path / "next"
    said = done(f"design twin-boom --duration 12 --evaluations 1 --shape doublet -o {out}")
    found, shown = json.loads((out / "design.json").read_text()), (out / "design.html").read_text()
    assert found["designs"]["doublet"]["ratio"] > 1.0
    assert found["designs"]["textbook"]["ratio"] == 1.0
    assert found["shape"] == "textbook"
    assert load_maneuver(out / "maneuver.toml").input == load_maneuver(out / "reference.toml").input
    assert "the files fly the textbook's" in said
    assert "the files fly the textbook&#39;s" in shown
