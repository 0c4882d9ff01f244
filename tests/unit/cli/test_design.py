from __future__ import annotations

import argparse
import json
import re
from pathlib import Path

import numpy as np
import pytest

from stoop.base.verbs import verbs
from stoop.cli.main import main
from stoop.cli.options import add_options
from stoop.exporters.targets import flown_by
from stoop.simulation.maneuver import load_maneuver, parse_maneuver
from stoop.vehicle import load_vehicle
from stoop.workflow.design import DESIGN_FILES, known_before, maneuver_toml

QUICK = (
    "--duration",
    "6",
    "--evaluations",
    "30",
    "--shape",
    "square",
    "3-2-1-1",
    "--fix",
    "CLV",
    "CDV",
    "CmV",
    "CQV",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("design") / "next"
    assert main(["design", "twin-boom", *QUICK, "-o", str(out)]) == 0
    return out


def test_writes_what_it_says(folder: Path) -> None:
    assert sorted(path.name for path in folder.iterdir()) == sorted(DESIGN_FILES)
    found = json.loads((folder / "design.json").read_text())
    assert found["format"] == "stoop-design/1"
    assert set(found["designs"]) == {"square", "3-2-1-1"}
    assert found["designs"][found["shape"]]["gain"] == max(one["gain"] for one in found["designs"].values())
    assert set(found["standard_errors"]["CLalpha"]) == {"value", "now", "reference", "square", "3-2-1-1"}
    assert "CLV" not in found["standard_errors"]


def test_the_maneuver_is_what_the_table_says_and_can_be_flown(folder: Path, tmp_path: Path) -> None:
    maneuver = load_maneuver(folder / "maneuver.toml")
    head, *rows = (folder / "maneuver.csv").read_text().splitlines()
    assert head == "time_s,elevator_rad,aileron_rad,rudder_rad"
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    moves = maneuver.deflections()
    for i, control in enumerate(("elevator", "aileron", "rudder"), 1):
        assert np.allclose(table[:, i], moves[control], atol=1e-9)
    flown = [
        "simulate",
        "twin-boom",
        "--maneuver",
        str(folder / "maneuver.toml"),
        "-o",
        str(tmp_path / "f.nc"),
    ]
    assert main(flown) == 0


def test_maneuver_files_read_back_as_they_were(folder: Path) -> None:
    for name in ("maneuver.toml", "reference.toml"):
        maneuver = load_maneuver(folder / name)
        assert parse_maneuver(maneuver_toml(maneuver, "once -- more"), "again") == maneuver


def test_says_what_it_will_tell(folder: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["design", "twin-boom", *QUICK, "-o", str(tmp_path / "again")]) == 0
    said = capsys.readouterr().out
    assert "error bars together (D-optimality)" in said
    assert "stoop simulate twin-boom --maneuver" in said
    both = [(f / "maneuver.toml").read_text().splitlines()[1:] for f in (folder, tmp_path / "again")]
    assert both[0] == both[1], "same seed, same design"


def test_page_shows_text_as_text(folder: Path) -> None:
    page = (folder / "design.html").read_text()
    assert "What to fly next" in page
    assert "<b>" not in re.sub(r"<(figcaption|script).*?</\1>", "", page, flags=re.DOTALL)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["twin-boom", "--amplitude", "flap=3"], "there is no control 'flap'"),
        (["twin-boom", "--amplitude", "three"], "'three' is not a number; write DEG or CONTROL=DEG"),
        (["twin-boom", "--amplitude", "100"], "not between 0 and 90 degrees"),
        (["twin-boom", "--amplitude", "0"], "give one an amplitude above zero"),
        (["twin-boom", "--within", "alpha=5"], "write CHANNEL=LOW:HIGH"),
        (["twin-boom", "--within", "alpha=9:5"], "LOW below HIGH"),
        (["twin-boom", "--within", "alpha=-9:-5"], "widen that limit or choose another airspeed"),
        (["twin-boom", "--duration", "1"], "is too short"),
        (["twin-boom", "--optimizer", "best"], "there is none of that name"),
        (["twin-boom", "--optimizer", "ps-gde-lm"], "take an optimizer that needs none"),
        (["nowhere.json"], "name the folder that stoop identify wrote"),
        (["."], "name the folder that stoop identify wrote"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str],
    says: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["design", *words, "--evaluations", "10", "-o", "out"]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert says in said
    assert not (tmp_path / "out").exists()


def test_does_not_write_over_a_design_unasked(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (folder / "design.json").read_bytes()
    assert main(["design", "twin-boom", *QUICK, "-o", str(folder)]) == 2
    assert "add --overwrite (in Python overwrite=True) to replace it" in capsys.readouterr().err
    assert (folder / "design.json").read_bytes() == before


def test_priors_are_what_a_vehicle_file_knows(examples: Path) -> None:
    _, knowledge, *_ = known_before(load_vehicle(examples / "vtail.toml"))
    stds = np.sqrt(np.diag(np.linalg.inv(knowledge.information)))
    known = dict(zip(knowledge.names, stds, strict=True))
    assert known["CLalpha"] == pytest.approx(1.0)
    assert known["mass.inertia.xx"] == pytest.approx(0.2)
    assert "Cm0" not in known


def test_an_option_given_twice_counts_twice() -> None:
    parser = argparse.ArgumentParser()
    add_options(parser, verbs()["design"].options)
    words = [
        "--amplitude",
        "elevator=3",
        "--amplitude",
        "rudder=5",
        "--within",
        "alpha=-5:10",
        "--within",
        "V=20:40",
    ]
    told = parser.parse_args(["twin-boom", "-o", "out", *words])
    assert told.amplitude == ["elevator=3", "rudder=5"]
    assert told.within == ["alpha=-5:10", "V=20:40"]


def test_ctrl_c_ends_all_families_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(setup: object, plan: object, family: str, callback: object) -> None:
        print(family)
        raise KeyboardInterrupt

    monkeypatch.setattr("stoop.input_design.optimization.design", stop)
    assert main(["design", "twin-boom", *QUICK, "--evaluations", "500", "-o", str(tmp_path / "out")]) == 130
    assert capsys.readouterr().out.split() == ["square"]
    assert not (tmp_path / "out").exists()


def test_files_for_an_autopilot_and_their_refusal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["design", "twin-boom", *QUICK, "--for", "px4", "-o", str(tmp_path / "next")]
    assert main(command) == 2
    assert "how far elevator, aileron, rudder move at full output is not known" in capsys.readouterr().err
    assert not (tmp_path / "next").exists()
    throws = ["--throw", "elevator=25", "aileron=20", "rudder=30"]
    assert main([*command, *throws]) == 0
    assert "fly_px4.py" in capsys.readouterr().out
    names = {path.name for path in (tmp_path / "next").iterdir()}
    assert names == {*DESIGN_FILES, *flown_by("px4").names}
    assert "How to fly it" in (tmp_path / "next" / "design.html").read_text()
    document = json.loads((tmp_path / "next" / "design.json").read_text())
    assert document["limits"]["min_amplitude"]["elevator"] == pytest.approx(np.radians(0.5))
    # another target in the same folder: files of the first one go
    command[command.index("px4")] = "ardupilot"
    assert main([*command, *throws, "--overwrite"]) == 0
    names = {path.name for path in (tmp_path / "next").iterdir()}
    assert names == {*DESIGN_FILES, "maneuver.lua", "ardupilot.param"}


def test_a_card_for_a_pilot_is_on_the_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "card"
    command = [
        "design",
        "twin-boom",
        "--for",
        "pilot",
        "--duration",
        "30",
        "--evaluations",
        "4",
        "--shape",
        "doublet",
    ]
    assert main([*command, "--min-amplitude", "elevator=1", "-o", str(out)]) == 0
    text, found = (out / "card.txt").read_text(), json.loads((out / "design.json").read_text())
    shown = (out / "design.html").read_text()
    assert "Flight card" in shown
    assert found["beat"] == 0.5
    # the procedure of the card is that of the prediction
    assert found["retrim"] == 1.0
    assert "then trim again" in text
    assert "each flown once, from trim" in text
    assert "each once, with the whole stop and from trim" in shown
    # the ellipsoid of the doublets is smaller, which decides, though their standard errors are larger in the mean
    assert found["shape"] == "doublet"
    assert 0.9 < found["designs"]["doublet"]["ratio"] < 1.0
    errors = found["standard_errors"].values()
    assert np.mean([e["doublet"] / e["reference"] for e in errors]) > 1.0
    assert "the files fly the textbook's" not in capsys.readouterr().out
    # the files are the lines of the card, each from trim
    names = sorted(path.name for path in out.glob("maneuver*.toml"))
    assert names == [f"maneuver_{i}.toml" for i in (1, 2, 3)]
    assert [load_maneuver(out / name).input[0].start for name in names][1:] == [1.0, 1.0]
    assert {path.name for path in out.glob("reference*.toml")} == {f"reference_{i}.toml" for i in (1, 2, 3)}
    again = [*command[:1], *command[1:2], "--duration", "8", "--evaluations", "1", "--shape", "doublet"]
    assert main([*again, "-o", str(out), "--overwrite"]) == 0
    assert {path.name for path in out.iterdir()} == set(DESIGN_FILES), "lines of the earlier design are gone"


def test_files_of_the_textbook_where_no_design_is_better(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "next"
    command = ["design", "twin-boom", "--duration", "12", "--evaluations", "1", "--shape", "doublet"]
    assert main([*command, "-o", str(out)]) == 0
    found, shown = json.loads((out / "design.json").read_text()), (out / "design.html").read_text()
    assert found["designs"]["doublet"]["ratio"] > 1.0
    assert found["designs"]["textbook"]["ratio"] == 1.0
    assert found["shape"] == "textbook"
    assert load_maneuver(out / "maneuver.toml").input == load_maneuver(out / "reference.toml").input
    said = capsys.readouterr().out
    assert "the files fly the textbook's" in said
    assert "the files fly the textbook&#39;s" in shown
    words = "error bars together (D-optimality)"
    assert words in said
    assert words in shown


def test_a_search_tells_how_far_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["design", "quad-x", "--duration", "4", "--evaluations", "4", "--shape", "3-2-1-1", "doublet"]
    assert main([*command, "-o", str(tmp_path / "next")]) == 0
    told = capsys.readouterr().err.splitlines()
    assert told == [f"designing: {stage}" for stage in ("textbook", "3-2-1-1", "doublet", "robustness")]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--for", "crazyflie"], "this flight is on wings; choose --for pilot"),
        (["--throw", "elevator=x"], "'x' is not a number; write DEG or CONTROL=DEG"),
        (
            ["--min-amplitude", "elevator=4"],
            "the amplitude of elevator, 3 deg, is below the smallest that can be flown, 4 deg",
        ),
        (["--for", "pilot", "--duration", "9"], "takes 20.5 s at least"),
        (
            ["--for", "ardupilot", "--throw", "flap=20"],
            "there is no such surface; choose from elevator, aileron, rudder",
        ),
    ],
)
def test_what_cannot_be_flown_is_one_line(
    options: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["design", "twin-boom", *options, "--evaluations", "4", "-o", str(tmp_path / "x")]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "x").exists()
