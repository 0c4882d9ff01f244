"""A real hexacopter: what its notebook prints, what it rests on, and the optimum that is found blind."""

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from stoop import optimize
from stoop.flight import Flight, load_flight
from stoop.problem.windows import Window
from stoop.strategy.run import choose_method
from stoop.vehicle import load_vehicle
from stoop_draft.checks.motors import check_motors
from stoop_plan.input_design.windows import find_windows
from stoop_studies.problems import hexacopter, pose

ROOT = Path(__file__).parents[2]
FOLDER = "altlnt-hexacopter-px4"
MAPPING = ROOT / "examples" / "hexacopter_mapping.toml"
VEHICLE = load_vehicle(ROOT / "examples" / "hexacopter.toml")


@pytest.fixture(scope="module")
def flight(shared_data: Path) -> Flight:
    return load_flight(shared_data / FOLDER, MAPPING)


def printed(path: Path) -> list[str]:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    streams = [o for c in cells for o in c.get("outputs", ()) if o["output_type"] == "stream"]
    return " ".join("".join(o["text"]) for o in streams).split()


def test_the_notebook_prints_what_is_committed(shared_data: Path, tmp_path: Path) -> None:
    """Its cells assert what the page claims: sprints predicted closer than by the model of the owners, and by how much."""
    script = ROOT / "scripts" / "execute_notebooks.py"
    own = {"STOOP_SHARED": str(shared_data.parent), "IPYTHONDIR": str(tmp_path / "ipython")}
    environment = {**os.environ, **own}
    command = [sys.executable, str(script), "hexacopter", "--into", str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert run.returncode == 0, run.stderr[-3000:]
    written, made = printed(ROOT / "examples" / "hexacopter.ipynb"), printed(tmp_path / "hexacopter.ipynb")
    for a, b in zip(written, made, strict=True):
        assert a == b or abs(float(a) - float(b)) < 0.01 * abs(float(a)) + 1e-3


def test_the_attitude_is_brought_to_the_gyros(flight: Flight) -> None:
    (moved,) = (found for found in flight.notices if found.code == "clock-aligned")
    assert moved.values["shift"] == pytest.approx(-0.168, abs=0.01)
    assert "attitude-follows-rates" in {found.code for found in flight.notices}
    # so that the command of the page needs no method, and prints the verified table
    chosen = choose_method("", VEHICLE, [flight])
    assert chosen.options.method == "equation-error"
    assert [n.code for n in chosen.notices] == ["motors-logged-slowly"]
    windows = find_windows({flight.name: flight}, VEHICLE)
    assert any(214.0 < w.start < 260.0 for w in windows.windows if w.accept), "the sprints"
    expected = {e.name: e.relative for e in windows.expected}
    assert expected["rotors.T2"] < 0.3
    assert 0.005 < expected["rotors.lag"] < 0.5


def test_its_motors_are_not_accused(flight: Flight) -> None:
    """Hover and climbs without maneuvers, commands logged at 43 Hz: they explain a third of the motion at most."""
    flights = {flight.name: flight}
    for window in ("140:214", "214:260", "140:260"):
        assert check_motors(VEHICLE, flight, [Window.parse(window, flights)]) == []
    assert check_motors(VEHICLE, flight, Window.whole(flights)) == []


def records(name: str) -> list[dict[str, str]]:
    with (ROOT / "docs" / "reproduce" / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        return [row for row in csv.DictReader(file) if row["case"] == "real"]


def test_outputs_mixed_of_moments_are_those_that_were_logged(shared_data: Path) -> None:
    """A second's mean of what the mixer makes of 236 Hz is that of the outputs, which were logged at 43 Hz."""
    mapping = Path(hexacopter.__file__).parent / "hexacopter_mapping.toml"
    flight = load_flight(shared_data / hexacopter.FOLDER, mapping, hexacopter.RATE)
    mixed, used = hexacopter.mixed(flight), (flight.time > 140.0) & (flight.time < 214.0)
    pulses = [[f.column(f"pwm_{i}") for i in range(1, 7)] for f in (flight, mixed)]
    holes = np.isnan(pulses).any(axis=1)
    assert holes[0].any()
    assert not (holes[0] & ~holes[1]).any(), "no number where no output was recorded"
    for i in range(1, 7):
        both = np.stack([flight.column(f"pwm_{i}"), mixed.column(f"pwm_{i}")])[:, used]
        both = both[:, np.isfinite(both).all(axis=0)]
        seconds = both[:, : both.shape[1] // 50 * 50].reshape(2, -1, 50).mean(axis=2)
        assert np.corrcoef(seconds)[0, 1] > 0.9
        assert np.abs(np.diff(seconds.mean(axis=1))) < 5.0, "us"


def test_the_default_finds_the_least_cost_known_blind(shared_data: Path) -> None:
    posed = pose("hexacopter", 0, data=str(shared_data))
    best = {r["parameter"]: r for r in records("multirotor-parameters") if r["method"] == "ps-gde-lm"}
    found = optimize.minimize(optimize.create(), posed.problem, seed=77)
    assert found.status == "converged"
    assert found.cost < posed.target
    least = float(next(r for r in records("multirotor") if r["method"] == "ps-gde-lm")["median_fitness"])
    assert found.cost == pytest.approx(least, rel=0.02)
    for name, value in zip(posed.parameters, posed.values(found.z), strict=True):
        row = best[name]
        assert value == pytest.approx(float(row["truth_or_best"]), abs=0.5 * float(row["deviation"]))
