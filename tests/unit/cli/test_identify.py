"""`stoop identify` and `stoop demo` as a user meets them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stoop.cli.main import main
from stoop.flight import Flight, save
from stoop.vehicle import Vehicle

VEHICLE = Path(__file__).parents[3] / "src" / "stoop" / "data" / "twin_boom.toml"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory, flight: Flight) -> Path:
    folder = tmp_path_factory.mktemp("identify")
    save(flight, folder / "sim.nc")
    text = VEHICLE.read_text().replace("notes = [", 'model = { reduce = "longitudinal" }\nnotes = [')
    (folder / "v.toml").write_text(text)
    return folder


def identify(place: Path, *words: str, out: str = "out") -> list[str]:
    return [
        "identify",
        str(place / "sim.nc"),
        "--vehicle",
        str(place / "v.toml"),
        "-o",
        str(place / out),
        *words,
    ]


def test_identifies_and_tells(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(identify(place, "--maneuver", "0:20", "--validate", "20:28", out="whole")) == 0
    said = capsys.readouterr().out
    assert "CLalpha" in said
    assert "report:" in said
    document = json.loads((place / "whole" / "result.json").read_text())
    assert document["parameters"]["CLalpha"]["estimate"] == pytest.approx(4.78, rel=0.05)
    assert not (place / "whole" / "search.npz").exists()


def test_free_and_fix(place: Path) -> None:
    words = ["--maneuver", "0:28", "--fix", "CLV", "--fix", "CDV", "--free", "mass.mass", "--budget", "400"]
    assert main(identify(place, *words, out="freed")) == 0
    names = json.loads((place / "freed" / "result.json").read_text())["parameters"]
    assert "mass.mass" in names
    assert "CLV" not in names


@pytest.mark.parametrize(
    ("words", "advice"),
    [
        (["--maneuver", "100:200"], "outside the record"),
        (["--maneuver", "5:2"], "start must come before"),
        (["--maneuver", "x"], "START:STOP"),
        (["--maneuver", "0:20", "--free", "CLalfa"], "did you mean CLalpha"),
        (["--maneuver", "0:20", "--free", "CLq", "--fix", "CLq"], "keep one"),
        (["--maneuver", "0:20", "--optimizer", "magic"], "ps-gde-lm"),
        (["--maneuver", "0:20", "--noise", "/nonexistent"], "variances"),
        (["--maneuver", "0:20", "--budget", "-1"], "positive"),
        (["--maneuver", "0:20", "--seed", "x"], "whole number"),
        (["--maneuver", "0:20", "--resume"], "no interrupted search"),
        ([], "--maneuver"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    place: Path, words: list[str], advice: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(identify(place, *words, out="bad")) == 2
    error = capsys.readouterr().err
    assert advice in error
    assert error.count("\n") == 1
    assert not list((place / "bad").glob("*"))


@pytest.mark.parametrize("missing", ["sim.nc", "v.toml"])
def test_missing_files(place: Path, tmp_path: Path, missing: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = identify(place, "--maneuver", "0:20", out="missing")
    words = [w.replace(str(place / missing), str(tmp_path / missing)) for w in words]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert missing in error
    assert error.count("\n") == 1


def test_missing_channel_names_what_is_there(
    place: Path, tmp_path: Path, aircraft: Vehicle, capsys: pytest.CaptureFixture[str]
) -> None:
    controls = "\n[controls.elevator]\nmix = { pwm_3 = 0.001 }\n[controls.aileron]\n[controls.rudder]\n"
    text = (place / "v.toml").read_text() + controls
    (tmp_path / "v.toml").write_text(text)
    words = [
        "identify",
        str(place / "sim.nc"),
        "--vehicle",
        str(tmp_path / "v.toml"),
        "--maneuver",
        "0:20",
        "-o",
        str(tmp_path / "o"),
    ]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert "pwm_3" in error
    assert "elevator" in error


def test_a_result_is_not_overwritten_unasked(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (place / "old").mkdir()
    (place / "old" / "result.json").write_text("mine")
    assert main(identify(place, "--maneuver", "0:20", out="old")) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert (place / "old" / "result.json").read_text() == "mine"


@pytest.mark.slow
def test_ctrl_c_keeps_the_best_and_resume_goes_on(place: Path) -> None:
    """A long search by a slow optimizer, interrupted as a user would, then resumed to its end."""
    words = identify(
        place, "--maneuver", "0:28", "--optimizer", "de-rand-1-bin", "--budget", "60000", out="long"
    )
    command = [sys.executable, "-m", "stoop", *words]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env={**os.environ, "STOOP_THREADS": "1"}
    )
    deadline = time.monotonic() + 60.0
    while not (place / "long" / "search.npz").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=120)
    assert process.returncode == 130, error
    first = json.loads((place / "long" / "result.json").read_text())
    assert first["status"] == "interrupted"
    longer = [*words, "--generations", "60", "--resume"]
    assert main(longer) == 0
    assert json.loads((place / "long" / "result.json").read_text())["status"] != "interrupted"


def test_demo_prints_truth_beside_estimate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "-o", str(tmp_path / "demo")]) == 0
    said = capsys.readouterr().out
    assert "truth" in said
    page = (tmp_path / "demo" / "report.html").read_text()
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "3-2-1-1" in said
