"""Exported aircraft in JSBSim: how far it flies from our own simulation in thirty seconds, and why."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from stoop.simulation import Trim, trim
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop_export import jsbsim_aircraft, jsbsim_flight
from stoop_studies.findings import Findings, Setting, holds, number
from stoop_studies.verify.scenes import ALTITUDE, multisine_maneuver
from stoop_studies.verify.study import Samples, Verification, records_of, vehicle_text

DURATION: Final = 30.0  #: s
VEHICLES: Final = ("twin-boom", "v-tail", "flying-wing", "crooked")
DIFFERENCE_LIMIT: Final = 1e-3  #: of each channel's maximum
FASTER: Final = 4.0  #: times the frames of JSBSim
DIFFERENCES: Final = ("difference", "difference_4000_hz", "difference_on_frames", "difference_earth")
#: of our simulation from JSBSim, from a faster JSBSim, on JSBSim's frames, and from JSBSim on its Earth
FLAT, _, FRAMES, _ = DIFFERENCES


def load(name: str) -> Vehicle:
    """Return a vehicle of the experiment."""
    if name == VEHICLES[0]:
        return builtin_vehicle(name)
    return parse_vehicle(vehicle_text(name.replace("-", "_")), name)


def multisines(vehicle: Vehicle, point: Trim) -> Maneuver:
    """Return harmonics from 0.1 to 2 Hz on all controls at once, each control its own."""
    amplitudes = {c: (jsbsim_flight.AMPLITUDE, 2 + i) for i, c in enumerate(vehicle.controls)}
    return multisine_maneuver(amplitudes, DURATION, jsbsim_flight.RATE, 2.0, (1.0, 20.0))


def pulses(vehicle: Vehicle, point: Trim) -> Maneuver:
    """Return a second and a half on each control, after which the aircraft is left to itself."""
    common = {"shape": "pulse", "duration": 1.5, "amplitude": jsbsim_flight.AMPLITUDE}
    inputs = [{**common, "control": c, "start": 1.0 + 3.0 * i} for i, c in enumerate(vehicle.controls)]
    return Maneuver.model_validate({"duration": DURATION, "rate": jsbsim_flight.RATE, "input": inputs})


INPUTS: Final[dict[str, Callable[[Vehicle, Trim], Maneuver]]] = {
    "3-2-1-1, doublets": jsbsim_flight.every_control,
    "multisines": multisines,
    "pulses": pulses,
}


def compare(vehicle_name: str, inputs: str) -> pd.DataFrame:
    """Export a vehicle, fly it by both simulators, and return a row for each of its channels."""
    vehicle = load(vehicle_name)
    point = trim(vehicle, None, ALTITUDE)
    record = jsbsim_flight.maneuver_record(vehicle, point, INPUTS[inputs](vehicle, point))
    own, fine = (
        jsbsim_flight.own_readings(record),
        jsbsim_flight.own_readings(record, jsbsim_flight.frames_per_sample(record.dt)),
    )
    with tempfile.TemporaryDirectory(prefix="stoop-export-") as folder:
        root = Path(folder)
        for place, text in jsbsim_aircraft.folder(record.vehicle, None).items():
            (root / place).parent.mkdir(parents=True, exist_ok=True)
            (root / place).write_text(text, encoding="utf-8")
        planet, name = root / jsbsim_flight.PLANET, jsbsim_flight.file_name(vehicle.name)
        faster_host = jsbsim_flight.Host(FASTER * jsbsim_flight.FRAME_RATE)
        flat = jsbsim_flight.jsbsim_readings(root, name, record, planet)
        faster = jsbsim_flight.jsbsim_readings(root, name, record, planet, faster_host)
        earth = jsbsim_flight.jsbsim_readings(root, name, record, None)
    pairs = ((own, flat), (own, faster), (fine, flat), (own, earth))
    differences = {
        n: jsbsim_flight.relative_differences(record.vehicle.outputs, *pair)
        for n, pair in zip(DIFFERENCES, pairs, strict=True)
    }
    table = pd.DataFrame(differences).rename_axis("channel").reset_index()
    table.insert(1, "largest", np.abs(own).max(axis=0))
    table.insert(0, "inputs", inputs)
    table.insert(0, "vehicle", vehicle_name)
    return table


def show(setting: Setting, samples: Samples) -> Findings:
    """Fly every vehicle through every set of inputs; nothing is drawn by chance."""
    table = pd.concat([compare(vehicle, i) for vehicle in VEHICLES for i in INPUTS], ignore_index=True)
    flights, columns = table.groupby(["vehicle", "inputs"], sort=False), list(DIFFERENCES)
    worst = table.loc[flights[FRAMES].idxmax()].reset_index(drop=True)
    worst[columns] = flights[columns].max().to_numpy()
    whole = worst[worst["vehicle"] != "crooked"]
    flat, frames = float(whole[FLAT].max()), float(worst[FRAMES].max())
    claims = (
        holds(
            "JSBSim within 1e-3 of every channel's maximum over 30 s, where delays are whole samples",
            flat <= DIFFERENCE_LIMIT,
            f"{number(flat, 2)} at most, over {len(whole)} flights",
        ),
        holds(
            "Within 1e-3 on the same points, whatever the delays",
            frames <= DIFFERENCE_LIMIT,
            f"{number(frames, 2)} at most, over {len(worst)} flights",
        ),
    )
    for name, digits in (("largest", 6), *dict.fromkeys(columns, 2).items()):
        table[name] = [float(f"{value:.{digits}g}") for value in table[name]]
    return Findings.of(
        "Exported aircraft flown by JSBSim", claims, records_of(table), summary=records_of(worst)
    )


EXPERIMENT: Final = Verification("export", show)
