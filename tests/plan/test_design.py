"""`stoop design` and `stoop simulate`: what they write and say; their refusals stand in test_bad_input."""

import json
import re
import shlex
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from helpers.command_line import Cli, Done, Refused

from stoop.cli.main import main, parser_for
from stoop.cli.options import with_free
from stoop.flight import Flight, load_flight
from stoop.simulation.maneuver import load_maneuver, parse_maneuver
from stoop.vehicle import load_vehicle
from stoop.workflow import FittedModel
from stoop.workflow.load import load as load_model
from stoop_plan.design import DESIGN_FILES, known_before, maneuver_toml
from stoop_plan.targets import flown_by

QUICK = shlex.split("design twin-boom --duration 6 --evaluations 8 --shape square 3-2-1-1")
QUICK += ["--fix", "CLV", "CDV", "CmV", "CQV", "-o"]


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
    known = dict(zip(knowledge.names, np.sqrt(np.diag(np.linalg.inv(knowledge.information))), strict=True))
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

    monkeypatch.setattr("stoop_plan.input_design.optimization.design", stop)
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


TWIN_BOOM = (files("stoop.data") / "twin_boom.toml").read_text()


def fly(examples: Path, target: Path, *words: str) -> Flight:
    maneuver = str(examples / "maneuver_3211.toml")
    assert main(["simulate", "twin-boom", "--maneuver", maneuver, "-o", str(target), *words]) == 0
    return load_flight(target)


def test_flies_the_papers_maneuver_with_noise_by_seed(examples: Path, tmp_path: Path) -> None:
    flight = fly(examples, tmp_path / "a.nc", "--no-noise")
    t, elevator, alpha = flight.time, *(np.degrees(flight.column(n)) for n in ("elevator", "alpha"))
    assert t[[0, -1]] == pytest.approx([0.0, 30.0])
    assert np.ptp(elevator) == pytest.approx(2 * 11.46, abs=0.02)
    assert np.count_nonzero((np.abs(elevator - elevator[0]) > 1e-9) & (t > 5.0)) == 300  # a pulse of 3 s
    assert alpha[t < 1.0] == pytest.approx(5.88, abs=0.005)
    assert 1.7 < alpha.min() < alpha.max() < 10.3  # the paper's Fig. 3 stays within 1.8 and 10.2 deg
    one, other = (fly(examples, tmp_path / f"{n}.nc", "--seed", n).column("alpha") for n in "34")
    assert np.std(one - flight.column("alpha")) == pytest.approx(0.005, rel=0.1)
    assert np.any(one != other)


def test_tells_what_it_wrote_and_what_to_do_next(examples: Path, tmp_path: Path, done: Done) -> None:
    target = tmp_path / "a flight's log.nc"
    command = ["simulate", "twin-boom", "--maneuver", examples / "maneuver_lateral.toml", "-o", target]
    wrote, after = done(command).splitlines()
    summary = r": 20 s at 100 Hz, \d+ channels, sensor noise of seed 0"
    assert re.fullmatch(re.escape(f"wrote {target}") + summary, wrote)
    start, *words = shlex.split(after)
    assert start == "next:"
    parsed = parser_for(words[1:]).parse_args(words[1:])
    assert parsed.flight == [target]
    (line,) = (line for line in done(["info", target]).splitlines() if line.startswith("next: "))
    informed = parser_for(words[1:]).parse_args(shlex.split(line)[2:])
    assert (parsed.maneuver, parsed.validate) == (informed.maneuver, informed.validate)
    assert [float(w.split(":")[0]) for w in parsed.maneuver] == pytest.approx([0.5, 9.5], abs=0.11)
    target.write_text("precious")
    assert main([*map(str, command)]) == 2
    assert target.read_text() == "precious"
    done([*command, "--overwrite"])
    assert load_flight(target).rate == 100.0


@pytest.mark.parametrize(
    ("thrust", "free", "first"),
    [
        ("220.87", [], False), ("{ value = 200.0, bounds = [100.0, 400.0] }", ["propulsion.thrust"], False),
        ("200.0", ["propulsion.thrust"], False), ("{ value = 200.0, bounds = [100.0, 210.0] }", [], True),
        ("{ value = 200.0, bounds = [100.0, 400.0], free = true }", [], False),
    ],
)  # fmt: skip
def test_a_thrust_that_the_trim_set_is_fitted_or_to_be_written(
    thrust: str, free: list[str], first: bool, examples: Path, tmp_path: Path, done: Done
) -> None:
    file, maneuver = tmp_path / "v.toml", examples / "maneuver_3211.toml"
    file.write_text(TWIN_BOOM.replace("thrust = { value = 220.87, free = false }", f"thrust = {thrust}"))
    *said, after = done(f"simulate {file} --maneuver {maneuver} -o {tmp_path / 'a.nc'}").splitlines()
    words = shlex.split(after)[2:]
    parsed = parser_for(words).parse_args(words)
    assert parsed.free == free
    with_free(load_vehicle(file), parsed.free, parsed.fix)  # would refuse a number without bounds
    assert any(line.startswith("first: write thrust = 220.8") for line in said) == first


def test_input_that_a_flight_cannot_hold_is_refused(examples: Path, refused: Refused) -> None:
    Path("v.toml").write_text((examples / "vtail.toml").read_text().replace("control_pitch", "my_servo"))
    said = refused(f"simulate v.toml --maneuver {examples / 'maneuver_3211.toml'} -o a.nc")
    assert "v.toml: the input 'my_servo' is no variable of stoop" in said


def test_a_quadrotor_is_identified_if_an_input_moves_it(examples: Path, tmp_path: Path, done: Done) -> None:
    log, file = tmp_path / "quad.nc", tmp_path / "hover.toml"
    wrote, after = done(f"simulate quad-x --maneuver {examples / 'maneuver_quad.toml'} -o {log}").splitlines()
    assert wrote == f"wrote {log}: 60 s at 100 Hz, 24 channels, sensor noise of seed 0"
    assert "--vehicle quad-x --maneuver 0.4:3.1 4.4:7.1 19.5:37.0 --validate 8.4:12.7 -o quad-result" in after
    assert {"vn", "ve", "vd", "pn", "pe", "pd", "motor_1", "motor_4"} <= set(load_flight(log).data.data_vars)
    file.write_text("duration = 5.0\n")
    *_, why, after = done(f"simulate quad-x --maneuver {file} -o {log} --overwrite").splitlines()
    assert why == f"no input moves the vehicle: to identify it, add [[input]] tables to {file}"
    assert after == f"next: stoop info {log}"


def test_a_design_asks_for_what_was_estimated(job: FittedModel, blank_page: None, tmp_path: Path) -> None:
    """The file leaves free what --fix held: the design would chase it, and not what was asked for."""
    free = {p.name: p for p in known_before(load_model(job.save(tmp_path / "r")))[0].parameters if p.free}
    estimated = job.result.parameters
    assert set(free) == set(estimated)
    assert all((free[n].lower, free[n].upper) == (p.bound_lower, p.bound_upper) for n, p in estimated.items())
