"""MuJoCo, PyFlyt and drone-models fly an export as our own simulation does: 10 s under the same commands, not restarted."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.base.files import write_files
from stoop.simulation import trim
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle, load_vehicle
from stoop.vehicle.document import with_entries
from stoop_export import crazyflow, exporter, mujoco_flight, mujoco_model, pyflyt
from stoop_export.agreement import AXES, Compared, loads_along
from stoop_export.exporter import ModelData
from stoop_export.reference_flight import ReferenceFlight, reference_flight
from stoop_export.rotorpy_flight import CHANNELS, motion

EXAMPLES = Path(__file__).parents[2] / "examples"
SECONDS = 10.0
BARE = {("rotors", "inflow"): 0.0, ("rotors", "drag"): 0.0, ("environment", "density"): 1.225}
PYFLYT = BARE | {("rotors", "T1"): 0.0, ("rotors", "T2"): 8.5, ("body_drag", "quadratic"): [0.03, 0.03, 0.03]}
CRAZYFLOW = BARE | {("body_drag", "quadratic"): [0.0, 0.0, 0.0], ("body_drag", "linear"): [0.2, 0.2, 0.3]}


def open_loop(vehicle: Vehicle, airspeed: float | None = None) -> ReferenceFlight:
    flight = reference_flight(vehicle, trim(vehicle, airspeed))
    n = round(SECONDS / flight.dt) + 1
    parts = {k: getattr(flight, k)[:n] for k in ("time", "inputs", "states", "readings")}
    return replace(flight, **parts, restarts=(0,))


def shares_of_range(ours: np.ndarray, theirs: np.ndarray) -> dict[str, float]:
    shares = np.abs(theirs - ours).max(axis=0) / np.ptp(ours, axis=0)
    return dict(zip(CHANNELS, shares.tolist(), strict=False))


def written(folder: Path, files: dict[str, bytes], main: str) -> Any:
    write_files(folder, files)
    return exporter.load_script(folder / main)


@pytest.mark.parametrize(("name", "airspeed"), [
    ("hexacopter.toml", None), ("twin-boom", None), ("vtail.toml", None), ("quadplane", None), ("quadplane", 18.0),
])  # fmt: skip
def test_mujoco(name: str, airspeed: float | None, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    vehicle = load_vehicle(EXAMPLES / name if name.endswith(".toml") else name)
    flight, made = open_loop(vehicle, airspeed), mujoco_model.mujoco_model(vehicle, trim(vehicle, airspeed))
    texts = {place: text.encode() for place, text in made.texts.items()}
    script = written(tmp_path, texts, f"{made.name}_mujoco.py")
    found = shares_of_range(motion(flight), mujoco_flight.fly_mujoco(script, flight))
    assert max(found.values()) < 1e-2, "asked: 2e-2"
    loads = Compared("", "", tuple(AXES), loads_along(flight), mujoco_flight.mujoco_loads(script, flight))
    assert np.nanmax(loads.statistics["share"]) < 1e-5, "the same equations at the same states"


SIMULATORS = {
    "PyFlyt": (pyflyt.PyFlyt, PYFLYT, lambda s, f: pyflyt.fly_pyflyt(s, f, 2400), 9, 2e-2),
    "drone_models": (crazyflow.Crazyflow, CRAZYFLOW, crazyflow.fly_drone_models, None, 1e-3),
}


@pytest.mark.parametrize("package", SIMULATORS)
def test_a_quadrotor_of_the_terms_of_a_simulator(package: str, tmp_path: Path) -> None:
    of, changes, fly, channels, most = SIMULATORS[package]
    if not exporter.installed(package):  # the script sets what drone_models asks for beside an imported SciPy
        pytest.skip(f"{package} is not installed")
    vehicle = with_entries(builtin_vehicle("quad-x"), changes)
    target, flight = of(ModelData(vehicle)), open_loop(vehicle)
    made = target.files()
    theirs = fly(written(tmp_path, made.files, made.main), flight)
    found = shares_of_range(motion(flight)[:, :channels], theirs)
    assert target.omitted == {}
    assert max(found.values()) < most
