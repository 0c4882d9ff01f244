"""A real hexacopter: what its notebook prints, and what it rests on."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from stoop.checks.motors import check_motors
from stoop.flight import Flight, load
from stoop.problem.windows import parse_window, whole
from stoop.strategy.run import choose_method
from stoop.vehicle.load import load_vehicle

ROOT = Path(__file__).parents[2]
FOLDER = "altlnt-hexacopter-px4"
MAPPING = ROOT / "examples" / "hexacopter_mapping.toml"
VEHICLE = load_vehicle(ROOT / "examples" / "hexacopter.toml")


@pytest.fixture(scope="module")
def flight(shared_data: Path) -> Flight:
    return load(shared_data / FOLDER, MAPPING)


def printed(path: Path) -> list[str]:
    """Return the words that the cells of a notebook print."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    streams = [o for c in cells for o in c.get("outputs", ()) if o["output_type"] == "stream"]
    return " ".join("".join(o["text"]) for o in streams).split()


def test_the_notebook_prints_what_is_committed(shared_data: Path, tmp_path: Path) -> None:
    """Its cells assert what the page claims: sprints predicted closer than by the model of the owners, and by how much."""
    script = ROOT / "scripts" / "execute_notebooks.py"
    environment = {
        **os.environ,
        "STOOP_SHARED": str(shared_data.parent),
        "IPYTHONDIR": str(tmp_path / "ipython"),
    }
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


def test_its_motors_are_not_accused(flight: Flight) -> None:
    """Hover and climbs without maneuvers, commands logged at 43 Hz: they explain a third of the motion at most."""
    flights = {flight.name: flight}
    for window in ("140:214", "214:260", "140:260"):
        assert check_motors(VEHICLE, flight, [parse_window(window, flights)]) == []
    assert check_motors(VEHICLE, flight, whole(flights)) == []


def test_its_motors_choose_the_method(flight: Flight) -> None:
    """So that the command of the page needs none, and prints the verified table."""
    found = choose_method("", VEHICLE, [flight])
    assert found.options.method == "equation-error"
    assert [n.code for n in found.notices] == ["motors-logged-slowly"]


def test_velocity_and_accelerometers_agree_then(shared_data: Path, flight: Flight) -> None:
    """The time derivative of the velocity is gravity and specific force, turned by the attitude; nothing is fitted."""
    assert disagreement(flight) < 0.5 * disagreement(load(shared_data / FOLDER)), "m/s2, horizontal"


def disagreement(flight: Flight) -> float:
    from scipy.signal import butter, sosfiltfilt

    q = np.column_stack([flight.column(f"q{i}") for i in range(4)])
    felt = np.column_stack([flight.column(c) for c in ("ax", "ay", "az")])
    velocity = np.column_stack([flight.column(c) for c in ("vn", "ve", "vd")])
    inside = (flight.time > 225.0) & (flight.time < 240.0)
    w, x, y, z = q[inside].T
    north = np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)])
    east = np.column_stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)])
    felt, velocity = felt[inside], velocity[inside]
    turned = np.column_stack([(north * felt).sum(axis=1), (east * felt).sum(axis=1)])
    sos = butter(2, 2.0, fs=flight.rate, output="sos")
    gained = np.gradient(velocity[:, :2], 1.0 / flight.rate, axis=0)
    off = sosfiltfilt(sos, turned - gained, axis=0)
    return float(np.std(off[50:-50]))
