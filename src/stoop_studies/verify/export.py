"""Exported aircraft in JSBSim: how far it flies from our own simulation in thirty seconds, and why."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.exporters import jsbsim_aircraft, jsbsim_flight
from stoop.report.sheet import Prose, Section
from stoop.simulation import Trim, trim
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop_studies.findings import Findings, Setting, holds, number
from stoop_studies.verify.scenes import ALTITUDE
from stoop_studies.verify.study import Columns, Samples, Verification, page_table, vehicle_text

DURATION: Final = 30.0  #: s
VEHICLES: Final = ("twin-boom", "v-tail", "flying-wing", "crooked")
DIFFERENCE_LIMIT: Final = 1e-3  #: of each channel's maximum
FASTER: Final = 4.0  #: times the frames of JSBSim
LEAD: Final = """\
Each vehicle is exported, trimmed at its reference airspeed and 200 m, and flown for 30 s through recorded inputs, open \
loop, by JSBSim and by our own simulation. Differences are the largest of each channel over the channel's largest \
magnitude."""
WORDS: Final = """\
On the flat planet (no rotation, a radius of 10¹⁰ m, gravity as the vehicle file says) only integration, rounding and \
the density tables are different. Our simulation takes one Runge-Kutta step of order four per sample of 10 ms; JSBSim \
1000 steps a second, Adams-Bashforth of order four. With 4000 steps a second it comes closer still; our own simulation \
with a step of 1 ms shows what is left of it.

The crooked aircraft has delays that are no whole number of samples: our simulation interpolates those with a cubic \
through the samples, JSBSim along the line between them, so it is compared with our simulation on the same points.

JSBSim's Earth, at 45 degrees of latitude, turns and is round."""
DIFFERENCES: Final = ("difference", "difference_4000_hz", "difference_on_frames", "difference_earth")
#: of our simulation from JSBSim, from a faster JSBSim, on JSBSim's frames, and from JSBSim on its Earth
FLAT, _, FRAMES, _ = DIFFERENCES
SHOWN: Final[Columns] = {
    "vehicle": ("vehicle", str),
    "inputs": ("inputs", str),
    "channel": ("largest in", str),
    "difference": ("JSBSim", ".1e"),
    "difference_4000_hz": ("4000 steps a second", ".1e"),
    "difference_on_frames": ("on JSBSim's frames", ".1e"),
    "difference_earth": ("on the Earth", ".1e"),
}


def load(name: str) -> Vehicle:
    """Return a vehicle of the experiment."""
    if name == VEHICLES[0]:
        return builtin_vehicle(name)
    return parse_vehicle(vehicle_text(name.replace("-", "_")), name)


def _maneuver(point: Trim, inputs: list[dict[str, Any]]) -> Maneuver:
    start = {"airspeed": point.start["V"], "altitude": point.start["h"]}
    return Maneuver.model_validate(
        {"duration": DURATION, "rate": jsbsim_flight.RATE, **start, "input": inputs}
    )


def multisines(vehicle: Vehicle, point: Trim) -> Maneuver:
    """Return harmonics from 0.1 to 2 Hz on all controls at once, each control its own."""
    common = {
        "shape": "multisine", "start": 1.0, "duration": 20.0, "amplitude": jsbsim_flight.AMPLITUDE, "band": 2.0,
        "stride": len(vehicle.controls),
    }  # fmt: skip
    return _maneuver(
        point, [{**common, "control": c, "first": 2 + i} for i, c in enumerate(vehicle.controls)]
    )


def pulses(vehicle: Vehicle, point: Trim) -> Maneuver:
    """Return a second and a half on each control, after which the aircraft is left to itself."""
    common = {"shape": "pulse", "duration": 1.5, "amplitude": jsbsim_flight.AMPLITUDE}
    inputs = [{**common, "control": c, "start": 1.0 + 3.0 * i} for i, c in enumerate(vehicle.controls)]
    return _maneuver(point, inputs)


INPUTS: Final[dict[str, Callable[[Vehicle, Trim], Maneuver]]] = {
    "3-2-1-1, doublets": jsbsim_flight.every_control,
    "multisines": multisines,
    "pulses": pulses,
}


def compare(vehicle_name: str, inputs: str) -> list[dict[str, Any]]:
    """Export a vehicle, fly it by both simulators, and return the records of its channels."""
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
        flat = jsbsim_flight.jsbsim_readings(root, name, record, planet)
        faster = jsbsim_flight.jsbsim_readings(root, name, record, planet, FASTER * jsbsim_flight.FRAME_RATE)
        earth = jsbsim_flight.jsbsim_readings(root, name, record, None)
    pairs = ((own, flat), (own, faster), (fine, flat), (own, earth))
    differences = {
        n: jsbsim_flight.relative_differences(record.vehicle, *pair)
        for n, pair in zip(DIFFERENCES, pairs, strict=True)
    }
    largest = dict(zip(differences[FLAT], np.abs(own).max(axis=0).tolist(), strict=True))
    return [
        {
            "vehicle": vehicle_name,
            "inputs": inputs,
            "channel": channel,
            "largest": most,
            **{n: d[channel] for n, d in differences.items()},
        }
        for channel, most in largest.items()
    ]


def show(setting: Setting, samples: Samples) -> Findings:
    """Fly every vehicle through every set of inputs; nothing is drawn by chance."""
    flights = [compare(vehicle, inputs) for vehicle in VEHICLES for inputs in INPUTS]
    worst = [
        {
            **max(flight, key=lambda record: float(record[FRAMES])),
            **{n: max(record[n] for record in flight) for n in DIFFERENCES},
        }
        for flight in flights
    ]
    whole = [w for w in worst if w["vehicle"] != "crooked"]
    flat, frames = max(w[FLAT] for w in whole), max(w[FRAMES] for w in worst)
    claims = (
        holds(
            "JSBSim within 1e-3 of every channel's maximum over 30 s, where delays are whole samples",
            flat <= DIFFERENCE_LIMIT,
            f"{number(flat, 2)} at most, over {len(whole)} flights",
        ),
        holds(
            "Within 1e-3 on the same points, whatever the delays",
            frames <= DIFFERENCE_LIMIT,
            f"{number(frames, 2)} at most, over {len(flights)} flights",
        ),
    )
    caption = "Largest difference of any channel, as a fraction of the channel's maximum"
    rounded = [
        {**r, "largest": float(f"{r['largest']:.6g}"), **{n: float(f"{r[n]:.2g}") for n in DIFFERENCES}}
        for flight in flights
        for r in flight
    ]
    return Findings.tabulated(
        "Exported aircraft flown by JSBSim",
        LEAD,
        claims,
        (Section("Vehicles and inputs", (page_table(caption, SHOWN, worst), Prose(WORDS))),),
        rounded,
    )


EXPERIMENT: Final = Verification("export", show)
