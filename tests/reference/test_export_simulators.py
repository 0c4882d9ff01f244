"""MuJoCo, PyFlyt and drone-models fly an export as our own simulation does: 10 s under the same commands, not restarted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.exporters import crazyflow, exporter, mujoco_flight, mujoco_model, pyflyt
from stoop.exporters.agreement import AXES, Compared, loads_along
from stoop.exporters.exporter import ModelData
from stoop.exporters.reference_flight import ReferenceFlight, reference_flight
from stoop.exporters.rotorpy_flight import CHANNELS, motion
from stoop.simulation import trim
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_text, resolve_vehicle

EXAMPLES = Path(__file__).parents[2] / "examples"
SECONDS = 10.0
PYFLYT = {
    "T1 = 2.5\nT2 = 6.0\ninflow = 0.25\ndrag = 0.08": "T2 = 8.5",
    "[body_drag]\nquadratic = [0.02, 0.02, 0.03]": "[body_drag]\nquadratic = [0.03, 0.03, 0.03]\n[environment]\ndensity = 1.225",
}
CRAZYFLOW = {
    "inflow = 0.25\ndrag = 0.08\n": "",
    "quadratic = [0.02, 0.02, 0.03]": "linear = [0.2, 0.2, 0.3]\n[environment]\ndensity = 1.225",
}


def open_loop(vehicle: Vehicle, airspeed: float | None = None) -> ReferenceFlight:
    """Return the first seconds of the reference flight, without restarts."""
    flight = reference_flight(vehicle, trim(vehicle, airspeed))
    assert flight is not None
    n = round(SECONDS / flight.dt) + 1
    parts = {k: getattr(flight, k)[:n] for k in ("time", "inputs", "states", "readings")}
    return replace(flight, **parts, restarts=(0,))


def shares_of_range(ours: np.ndarray, theirs: np.ndarray) -> dict[str, float]:
    """Return the largest difference of each channel over its range."""
    shares = np.abs(theirs - ours).max(axis=0) / np.ptp(ours, axis=0)
    return dict(zip(CHANNELS, shares.tolist(), strict=False))


def written(folder: Path, files: dict[str, bytes], main: str) -> Any:
    for place, content in files.items():
        (folder / place).parent.mkdir(exist_ok=True)
        (folder / place).write_bytes(content)
    return exporter.load_script(folder / main)


@pytest.mark.parametrize(
    ("name", "airspeed"),
    [("hexacopter.toml", None), ("twin-boom", None), ("vtail.toml", None), ("quadplane", None), ("quadplane", 18.0)],
)  # fmt: skip
def test_mujoco(name: str, airspeed: float | None, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    vehicle = resolve_vehicle(EXAMPLES / name if name.endswith(".toml") else name)
    flight, made = open_loop(vehicle, airspeed), mujoco_model.mujoco_model(vehicle, trim(vehicle, airspeed))
    texts = {place: text.encode() for place, text in made.texts.items()}
    script = written(tmp_path, texts, f"{made.name}_mujoco.py")
    found = shares_of_range(motion(flight), mujoco_flight.fly_mujoco(script, flight))
    assert max(found.values()) < 1e-2, "asked: 2e-2"
    loads = Compared("", "", tuple(AXES), loads_along(flight), mujoco_flight.mujoco_loads(script, flight))
    assert np.nanmax(loads.statistics["share"]) < 1e-5, "the same equations at the same states"


@pytest.mark.parametrize(
    ("package", "of", "changes", "fly", "channels", "most"),
    [
        ("PyFlyt", pyflyt.PyFlyt, PYFLYT, lambda s, f: pyflyt.fly_pyflyt(s, f, 2400), 9, 2e-2),
        ("drone_models", crazyflow.Crazyflow, CRAZYFLOW, crazyflow.fly_drone_models, None, 1e-3),
    ],
)
def test_a_quadrotor_of_the_terms_of_a_simulator(
    package: str, of: Any, changes: dict[str, str], fly: Callable[..., Any], channels: int | None, most: float,
    tmp_path: Path,
) -> None:  # fmt: skip
    if not exporter.installed(package):  # the script sets what drone_models asks for beside an imported SciPy
        pytest.skip(f"{package} is not installed")
    text = builtin_text("quad-x")
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    vehicle = parse_vehicle(text, "quad")
    target = of(ModelData(vehicle))
    made = target.files()
    flight = open_loop(vehicle)
    found = shares_of_range(
        motion(flight)[:, :channels], fly(written(tmp_path, made.files, made.main), flight)
    )
    assert target.omitted == {}
    assert max(found.values()) < most
