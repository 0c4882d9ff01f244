"""The pages of other simulators and of derivatives: their examples run, and their figures are those of an export."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import stoop
from docs.pages import DOCS, ROOT, run_python, table
from stoop.cli.main import main
from stoop.exporters import fmu, fmu_target
from stoop.exporters.agreement import agreement_table
from stoop.exporters.reference_flight import reference_flight
from stoop.exporters.targets import TARGETS
from stoop.simulation import trim
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.load import load_vehicle


def test_the_unit_flies(tmp_path: Path) -> None:
    pytest.importorskip("fmpy")
    said = run_python(DOCS / "fmi.md", tmp_path)
    apart = [float(x) for x in re.findall(r"within (\S+) of each channel", said)]
    assert len(apart) == 2
    assert max(apart) < 1e-11
    assert re.search(r"^3\d\.\d m/s after 1\d\d\d m$", said, re.MULTILINE)


def test_held_inputs_cost_what_the_page_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("fmpy")
    monkeypatch.setattr(fmu_target, "slopes", lambda inputs, dt: np.zeros_like(inputs))
    channels, pitch = ("p", "q", "r", "theta"), []
    for name, *shown in table(DOCS / "fmi.md", "Inputs that are held", "vehicle").rows:
        vehicle = load_vehicle(ROOT / name) if name.endswith(".toml") else builtin_vehicle(name)
        point = trim(vehicle)
        flight, place = reference_flight(vehicle, point), tmp_path / f"{len(pitch)}.fmu"
        assert flight is not None
        assert flight.dt == 0.01
        place.write_bytes(fmu.unit_bytes(fmu.make_unit(vehicle, point), "3.0", fmu.find_compiler()))
        found = flight.differences(fmu_target.fly_unit(place, flight))
        assert [100.0 * found[c] for c in channels] == pytest.approx([float(x) for x in shown], rel=0.03)
        pitch.append(100.0 * found["q"])
    said = re.search(r"costs (\d) to (\d) % of q at a step of 10 ms", (DOCS / "fmi.md").read_text())
    assert said is not None
    assert [float(x) for x in said.groups()] == [round(min(pitch)), round(max(pitch))]


def test_derivatives_and_linear_systems(tmp_path: Path) -> None:
    pytest.importorskip("control")
    first, second = run_python(DOCS / "derivatives.md", tmp_path).strip().splitlines()
    assert first == "['elevator', 'aileron', 'rudder'] 10"
    assert re.fullmatch(r"pitch rate 0\.\d+ rad/s", second)


def test_the_quadrotor_flies_in_rotorpy(tmp_path: Path) -> None:
    pytest.importorskip("rotorpy")
    said = run_python(DOCS / "rotorpy.md", tmp_path)
    apart = [float(x) for x in re.findall(r"within (\S+) of each channel", said)]
    shown = [float(x) for x in table(DOCS / "rotorpy.md", "Accuracy", "vehicle").column("largest difference")]
    assert apart == pytest.approx(shown, rel=0.1)
    assert apart[0] < 1e-3
    assert re.search(r"climbs at \d\.\d\d m/s after 1 s", said)
    assert "to [1. 1. 3.] by RotorPy's controller" in said


def test_the_quadrotor_flies_in_mujoco(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    said = run_python(DOCS / "learning-simulators.md", tmp_path)
    (apart,) = [float(x) for x in re.findall(r"MuJoCo, .* within (\S+) of each channel", said)]
    assert apart < 1e-3
    slower, faster = [float(x) for x in re.findall(r"climbs at (\S+) m/s after 1 s", said)]
    assert faster > slower + 0.1, "with more thrust"
    found = table(DOCS / "learning-simulators.md", "The targets", "--to").rows
    assert {row[0].strip("`") for row in found} < set(TARGETS)


def test_the_models_fly_by_the_equations_of_gazebo(tmp_path: Path) -> None:
    said = run_python(DOCS / "gazebo.md", tmp_path)
    apart = [float(x) for x in re.findall(r"within (\S+) of each channel", said)]
    found = table(DOCS / "gazebo.md", "Accuracy", "vehicle")
    shown = zip(
        *(map(float, found.column(f"for {autopilot}")) for autopilot in ("PX4", "ArduPilot")), strict=True
    )
    assert apart == pytest.approx([x for row in shown for x in row], rel=0.1)
    assert re.search(r"thrust over the square of the speed: 8\.\d+e-06 N s2", said)


def test_axes_of_the_hexacopter_in_gazebo() -> None:
    made = stoop.export(str(ROOT / "examples/hexacopter.toml"), "gazebo")
    px4, ardupilot = (agreement_table(compared).rows for compared in made.compared)
    shown = table(DOCS / "gazebo.md", "Accuracy", "axis").rows
    assert list(shown) == [(a[0], a[3], a[5], b[3], b[5]) for a, b in zip(px4, ardupilot, strict=True)][:6]
    (omitted,) = [note for note in made.notes if "rotors.drag_inflow" in note]
    assert "11 % of Fx, 11 % of Fy, 0 % of Fz" in omitted


@pytest.mark.parametrize("ending", [".csv", ".json"])
def test_derivatives_are_written(ending: str, tmp_path: Path) -> None:
    place = tmp_path / f"out{ending}"
    assert main(["derivatives", "twin-boom", "--axes", "body", "--dimensional", "-o", str(place)]) == 0
    text = place.read_text()
    assert "M_q" in text
    assert main(["derivatives", "twin-boom", "-o", str(tmp_path / "out.txt")]) == 2


def test_rotors_in_jsbsim(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    for name, _, worst, shown, _ in table(DOCS / "export.md", "Rotors", "vehicle", "flight").rows:
        vehicle, _, speed = name.replace("`", "").partition(" at ")
        place = str(ROOT / vehicle) if vehicle.endswith(".toml") else vehicle
        words = ["export", place, "--to", "jsbsim", "-o", str(tmp_path), "--overwrite"]
        assert main([*words, *(("--airspeed", speed.split()[0]) if speed else ())]) == 0
        (found,) = re.findall(
            r"JSBSim within (\S+) of each channel's maximum \(largest in (\w+)\)", capsys.readouterr().out
        )
        assert float(found[0]) == pytest.approx(float(shown), rel=0.1)
        assert float(found[0]) < 1e-3
        assert found[1] == worst


def test_autopilots_in_the_loop(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    rows = table(DOCS / "sitl.md", "Accuracy", "vehicle", "under").rows
    for name, title in dict.fromkeys((row[0].replace("`", ""), row[1]) for row in rows):
        target = f"{title.lower()}-jsbsim"
        assert main(["export", name, "--to", target, "-o", str(tmp_path / target / name)]) == 0
        said = re.findall(r"JSBSim within (\S+) of .* Earth (\S+)\.$", capsys.readouterr().out, re.MULTILINE)
        shown = [row[3:] for row in rows if (row[0].replace("`", ""), row[1]) == (name, title)]
        assert len(said) == len(shown)
        for found, stated in zip(said, shown, strict=True):
            assert [float(x) for x in found] == pytest.approx([float(x) for x in stated], rel=0.1)
