"""`stoop export`: what it writes and what it refuses, in one line."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from stoop.cli.main import main
from stoop.exporters.targets import TARGETS


def test_every_target(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    quadrotors = {"rotorpy", "pyflyt", "gym-pybullet-drones", "crazyflow", "isaac"}
    for target in set(TARGETS) - quadrotors:
        assert main(["export", "twin-boom", "--to", target, "-o", str(tmp_path / target)]) == 0
        said = capsys.readouterr().out
        written = [p for p in (tmp_path / target).rglob("*") if p.is_file()]
        assert said.count("wrote ") == len(written) > 0
        for path in written:
            assert str(path) in said
        assert ("JSBSim within" in said) == ("jsbsim" in target)
        channels = "stoop/channel/elevator (rad), stoop/channel/aileron (rad), stoop/channel/rudder (rad)"
        assert (f"To be set in flight: {channels}, stoop/thrust-N (N)." in said) == (target == "jsbsim")


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("nothing.toml", "--to", "jsbsim", "-o", "out"), "there is no such vehicle file"),
        (("empty", "--to", "jsbsim", "-o", "out"), "holds no result.json"),
        (("twin-boom", "--to", "jsbsim", "-o", "empty/file"), "is a file; name a folder"),
        (("twin-boom", "--to", "flightgear", "-o", "out"), "invalid choice"),
        (("twin-boom", "--to", "rotorpy", "-o", "out"), "this one has 0"),
        (("quad-x", "--to", "ardupilot-jsbsim", "-o", "out"), "and no rotors; export to px4-jsbsim"),
        (("hexa-x", "--to", "rotorpy", "-o", "out"), "this one has 6"),
        (("twin-boom", "--to", "pyflyt", "-o", "out"), "PyFlyt flies quadrotors on their rotors"),
        (
            ("quad-x", "--to", "mujoco", "--draws", "100", "-o", "out"),
            "--draws needs estimates with their errors",
        ),
        (("quad-x", "--to", "mujoco", "--draws", "0", "-o", "out"), "--draws"),
        (
            ("twin-boom", "--to", "state-space", "--airspeed", "3", "-o", "out"),
            "no steady flight found at 3 m/s",
        ),
    ],
)
def test_one_line(
    words: tuple[str, ...],
    complaint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("empty").mkdir()
    Path("empty/file").write_text("mine")
    assert main(["export", *words]) == 2
    err = capsys.readouterr().err
    assert complaint in err
    assert err.count("\n") == 1
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["empty", "file"]


def test_without_the_package_the_files_are_written_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    assert main(["export", "twin-boom", "--to", "jsbsim", "-o", str(tmp_path)]) == 0
    assert "pip install '.[jsbsim]'" in capsys.readouterr().out
    assert list(tmp_path.glob("aircraft/*/*.xml"))
    assert not (tmp_path / "export.html").exists()
