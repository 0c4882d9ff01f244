"""`stoop trim`: the paper's (14), options that reach the equations, JSON."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from stoop.cli.main import main


def document(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    assert main(["trim", *words, "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return dict(json.loads(out))


def test_reproduces_the_paper(capsys: pytest.CaptureFixture[str]) -> None:
    """Eq. (14): alpha = 5.88 deg, elevator = -1.70 deg, thrust = 220.87 N at 35 m/s and 200 m.

    Table 1 is printed with three digits, which leaves its own moment balance open by 2e-4 (0.014 deg of
    elevator); hence the tolerance.
    """
    found = document(capsys, "twin-boom", "--reduce", "longitudinal")
    assert math.degrees(found["angles"]["alpha"]) == pytest.approx(5.88, abs=0.005)
    assert found["angles"]["theta"] == pytest.approx(found["angles"]["alpha"], abs=1e-9)
    assert math.degrees(found["controls"]["elevator"]) == pytest.approx(-1.70, abs=0.015)
    assert found["thrust"]["propulsion.thrust"]["value"] == pytest.approx(220.87, abs=0.02)
    assert found["thrust"]["propulsion.thrust"]["unit"] == "N"
    assert found["residual"] < 1e-9


def test_prints_degrees_radians_and_thrust(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["trim", "twin-boom", "--reduce", "longitudinal"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["alpha", "5.8794", "0.102615"] in lines
    assert any(line[:2] == ["220.86", "N"] for line in lines)


def test_options_reach_the_equations(capsys: pytest.CaptureFixture[str]) -> None:
    level = document(capsys, "twin-boom")
    fast = document(capsys, "twin-boom", "--airspeed", "45")
    climbing = document(capsys, "twin-boom", "--climb-angle", "3")
    thin = document(capsys, "twin-boom", "--density", "1.0", "--altitude", "2000")
    assert fast["airspeed"] == 45.0
    assert fast["angles"]["alpha"] < level["angles"]["alpha"]
    pitch, incidence = climbing["angles"]["theta"], climbing["angles"]["alpha"]
    assert math.degrees(pitch - incidence) == pytest.approx(3.0, abs=0.01)
    assert thin["altitude"] == 2000.0
    assert thin["angles"]["alpha"] > level["angles"]["alpha"]


def test_density_of_a_log_is_given_or_of_the_standard_atmosphere_at_the_altitude(
    examples: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    vehicle = str(examples / "vtail.toml")
    thin = document(capsys, vehicle, "--airspeed", "20", "--density", "1.0")
    assert thin["inputs"]["density"] == 1.0
    assert main(["trim", vehicle, "--airspeed", "20", "--altitude", "2000"]) == 0
    assert "density 1.007 kg/m3 (standard atmosphere at this altitude" in capsys.readouterr().out
    high = document(capsys, vehicle, "--airspeed", "20", "--altitude", "2000")
    assert high["inputs"]["density"] == pytest.approx(1.0065, abs=1e-4), "ISO 2533 at 2000 m"
    low = document(capsys, vehicle, "--airspeed", "20", "--altitude", "0")
    assert low["inputs"]["density"] == pytest.approx(1.225)
    assert high["angles"]["alpha"] > low["angles"]["alpha"]


def test_standard_atmosphere_can_be_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from importlib.resources import files

    text = (files("stoop.data") / "twin_boom.toml").read_text()
    path = tmp_path / "standard.toml"
    path.write_text(text.replace("density = 1.20165 # ISA at 200 m", 'density = "standard"'))
    standard = document(capsys, str(path), "--reduce", "longitudinal")
    assert math.degrees(standard["angles"]["alpha"]) == pytest.approx(5.88, abs=0.005)
    thin = document(capsys, str(path), "--reduce", "longitudinal", "--density", "1.0")
    assert thin["angles"]["alpha"] > standard["angles"]["alpha"] + 0.01


def test_mixed_channels_are_shown(examples: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["trim", str(examples / "vtail.toml"), "--airspeed", "20"]) == 0
    out = capsys.readouterr().out
    assert "control_throttle" in out
    assert "control_pitch" in out
    assert "-0.000" not in out


def test_lateral_file_flies_at_the_trim_of_the_full_equations(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from importlib.resources import files

    path = tmp_path / "lateral.toml"
    text = (files("stoop.data") / "twin_boom.toml").read_text()
    path.write_text(text.replace("[mass]", '[model]\nreduce = "lateral"\n\n[mass]', 1))
    lateral, full = document(capsys, str(path)), document(capsys, "twin-boom")
    assert lateral["angles"] == pytest.approx(full["angles"], abs=1e-9)


def test_a_hover_in_the_wind(capsys: pytest.CaptureFixture[str]) -> None:
    found = document(
        capsys, "quad-x", "--wind", "5", "0", "0", "--velocity", "0", "-1", "-1", "--heading", "90"
    )
    assert found["velocity"] == [0.0, -1.0, -1.0]
    assert found["wind"] == [5.0, 0.0, 0.0]
    assert found["heading"] == pytest.approx(math.pi / 2.0)
    assert found["angles"]["phi"] > 0.01, "heading east, the wind from the right hand pushes left"
    assert set(found["inputs"]) == {"motor_1", "motor_2", "motor_3", "motor_4"}
    assert main(["trim", "quad-x", "--wind", "5", "0", "0"]) == 0
    out = capsys.readouterr().out
    assert "hover at 200 m, heading 0 deg, wind 5 0 0 m/s (north east down), standard atmosphere" in out
    assert "Thrust" not in out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            ["quad-x", "--climb-angle", "5"],
            "--climb-angle: quad-x flies on its rotors here; write --velocity",
        ),
        (["twin-boom", "--wind", "5", "0", "0"], "--wind: twin-boom flies on its wings here"),
        (["twin-boom", "--velocity", "5", "0", "0"], "--velocity: twin-boom flies on its wings here"),
        (["quad-x", "--airspeed", "9"], "quad-x: it has no wings to fly 9 m/s on"),
        (["quad-x", "--wind", "30", "0", "0"], "and its range ends at 1; make it lighter"),
    ],
)
def test_what_only_rotors_or_only_wings_can_do(
    words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["trim", *words]) == 2
    assert says in capsys.readouterr().err
