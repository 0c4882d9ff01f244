"""MuJoCo flies an export as our own simulation does: 10 s from the same state under the same commands, not restarted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stoop.exporters import exporter, mujoco_flight, mujoco_model
from stoop.exporters.agreement import AXES, Compared, loads_along
from stoop.exporters.reference_flight import ReferenceFlight, reference_flight
from stoop.exporters.rotorpy_flight import CHANNELS, motion
from stoop.simulation import trim
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle

pytest.importorskip("mujoco")
EXAMPLES = Path(__file__).parents[2] / "examples"
SECONDS = 10.0


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


@pytest.mark.parametrize(
    ("name", "airspeed"),
    [
        ("quad-x", None),
        ("hexacopter.toml", None),
        ("twin-boom", None),
        ("vtail.toml", None),
        ("quadplane", None),
        ("quadplane", 18.0),
    ],
)
def test_ten_seconds(name: str, airspeed: float | None, tmp_path: Path) -> None:
    vehicle = resolve_vehicle(EXAMPLES / name if name.endswith(".toml") else name)
    flight, made = open_loop(vehicle, airspeed), mujoco_model.mujoco_model(vehicle, trim(vehicle, airspeed))
    for place, text in made.texts.items():
        (tmp_path / place).write_text(text)
    script = exporter.load_script(tmp_path / f"{made.name}_mujoco.py")
    found = shares_of_range(motion(flight), mujoco_flight.fly_mujoco(script, flight))
    assert max(found.values()) < 1e-2, "asked: 2e-2"
    loads = Compared("", "", tuple(AXES), loads_along(flight), mujoco_flight.mujoco_loads(script, flight))
    assert np.nanmax(loads.statistics["share"]) < 1e-5, "the same equations at the same states"
