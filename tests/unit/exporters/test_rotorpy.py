"""RotorPy flies the identified equations as the kernel does, and its own model with the parameters of a hover."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.errors import SimulationError
from stoop.exporters import exporter, rotorpy_flight, rotorpy_model
from stoop.exporters.agreement import omission, omitted_shares
from stoop.exporters.jsbsim_flight import relative_differences
from stoop.exporters.reference_flight import ReferenceFlight, reference_flight
from stoop.simulation import trim
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_text, builtin_vehicle
from stoop.vehicle.load import parse_vehicle

pytest.importorskip("rotorpy")
SECONDS = 3  #: of the flight that the tests repeat; the page shows 30


def script_of(vehicle: Vehicle, folder: Path) -> Any:
    made = rotorpy_model.rotorpy_model(vehicle, trim(vehicle))
    for name, text in made.texts.items():
        (folder / name).write_text(text)
    return exporter.load_script(folder / f"{made.name}_rotorpy.py")


def short(vehicle: Vehicle) -> ReferenceFlight:
    flight = reference_flight(vehicle, trim(vehicle))
    assert flight is not None
    n = SECONDS * 100 + 1
    parts = {k: getattr(flight, k)[:n] for k in ("time", "inputs", "states", "readings")}
    return replace(flight, **parts, restarts=flight.restarts[:SECONDS])


def test_the_identified_equations_fly_as_the_kernel_does(tmp_path: Path) -> None:
    vehicle = builtin_vehicle("quad-x")
    flight, script = short(vehicle), script_of(vehicle, tmp_path)
    ours = rotorpy_flight.motion(rotorpy_flight.held_flight(flight))
    found = relative_differences(
        rotorpy_flight.CHANNELS, ours, rotorpy_flight.fly_rotorpy(script, flight, stock=False)
    )
    moving = [n for n in found if n not in ("r", "psi", "vd", "fy", "p", "phi", "ve")]  # others rest yet
    assert max(found[n] for n in moving) < 1e-3


def test_its_own_model_holds_a_vehicle_of_its_own_terms(tmp_path: Path) -> None:
    """Speeds of rotation, thrust and torque by their squares, drag and inflow: nothing is lost but the torque of inflow."""
    text = builtin_text("quad-x").replace('drive = "command"', 'drive = "speed"\ngain = 1000.0')
    for old, new in {"T1 = 2.5": "", "T2 = 6.0": "T2 = 8.5e-6", "inflow = 0.25": "inflow = 2.5e-4",
                     "drag = 0.08": "drag = 8e-5", "torque_ratio = 0.016": "Q2 = 1.4e-7",
                     "[body_drag]": "[environment]\ndensity = 1.225", "quadratic = [0.02, 0.02, 0.03]": ""}.items():  # fmt: skip
        assert old in text
        text = text.replace(old, new)
    vehicle = parse_vehicle(text, "quad")
    made = rotorpy_model.rotorpy_model(vehicle, trim(vehicle)).parameters["quad_params"]
    assert made["k_eta"] == pytest.approx(8.5e-6, rel=1e-6)
    assert made["k_m"] == pytest.approx(1.4e-7, rel=1e-6)
    assert made["k_d"] == pytest.approx(8e-5, rel=1e-6)
    assert made["k_z"] == pytest.approx(2.5e-4, rel=1e-6)
    assert made["rotor_directions"] == [-1, -1, 1, 1]
    assert made["rotor_pos"]["m1"] == [0.177, -0.177, 0.03]
    flight, script = short(vehicle), script_of(vehicle, tmp_path)
    ours = rotorpy_flight.motion(rotorpy_flight.held_flight(flight))
    found = relative_differences(
        rotorpy_flight.CHANNELS, ours, rotorpy_flight.fly_rotorpy(script, flight, stock=True)
    )
    assert max(found[n] for n in ("vn", "q", "theta", "fz")) < 1e-3
    assert rotorpy_model.limits(vehicle) == {}


def test_what_is_left_out_is_measured() -> None:
    quad = builtin_vehicle("quad-x")
    text = builtin_text("quad-x").replace("[body_drag]", "[body_drag]\nrotation = [0.01, 0.0, 0.0]")
    vehicle = parse_vehicle(text, "quad")
    lost = rotorpy_model.limits(vehicle)
    assert list(lost) == ["body_drag.rotation.x"]
    assert rotorpy_model.limits(quad) == {}
    flight = reference_flight(vehicle, trim(vehicle))
    assert flight is not None
    shares = omitted_shares(flight, lost)["body_drag.rotation.x"]
    p, q, r = (flight.states[:, vehicle.states.index(n)] for n in "pqr")
    # rolling moment by hand: -0.01 p of Ixx pdot + (Izz - Iyy) q r
    rows = np.repeat(vehicle.values[:, None], len(p), axis=1)
    rates = vehicle.kernel().evaluate(rows, flight.states.T.copy(), flight.inputs.T.copy())[0]
    xx, yy, zz = (vehicle.value(f"mass.inertia.{a}") for a in ("xx", "yy", "zz"))
    rolling = xx * rates[vehicle.states.index("p")] + (zz - yy) * q * r
    assert shares[3] == pytest.approx(np.sqrt(np.mean((0.01 * p) ** 2)) / rolling.std(), rel=1e-9)
    assert np.nan_to_num(np.delete(shares, 3)) == pytest.approx(0.0, abs=1e-12)
    assert ", 0 % of My, 0 % of Mz (rms" in omission("A tool", "this", shares), "rounding prints as 0"


def test_refusals() -> None:
    hexa = builtin_vehicle("hexa-x")
    with pytest.raises(SimulationError, match="flies vehicles of 4 rotors"):
        rotorpy_model.rotorpy_model(hexa, trim(hexa))
