"""Exported aircraft in JSBSim: how far it flies from our own simulation in thirty seconds, and why."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.export import jsbsim_aircraft
from stoop.export.jsbsim_flight import FRAME_RATE, frames_per_sample, jsbsim_readings
from stoop.export.record import (
    AMPLITUDE,
    RATE,
    every_control,
    file_name,
    maneuver_record,
    own_readings,
    relative_differences,
)
from stoop.report.sheet import Prose, Section, Table
from stoop.simulate import Maneuver, Trim, trim
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop_studies.findings import Findings, Setting, holds, number
from stoop_studies.verify.experiment import Samples, Verification, vehicle_text
from stoop_studies.verify.scenes import ALTITUDE

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
through the samples, JSBSim along the line between them, so it is held against our simulation on the same points.

JSBSim's Earth, at 45 degrees of latitude, turns and is round."""
HEAD: Final = (
    "vehicle", "inputs", "channel", "largest", "difference", "difference_4000_hz", "difference_on_frames", "difference_earth",
)  # fmt: skip


def load(name: str) -> Vehicle:
    """Return a vehicle of the experiment."""
    if name == VEHICLES[0]:
        return builtin_vehicle(name)
    return parse_vehicle(vehicle_text(name.replace("-", "_")), name)


def _maneuver(point: Trim, inputs: list[dict[str, Any]]) -> Maneuver:
    start = {"airspeed": point.start["V"], "altitude": point.start["h"]}
    return Maneuver.model_validate({"duration": DURATION, "rate": RATE, **start, "input": inputs})


def multisines(vehicle: Vehicle, point: Trim) -> Maneuver:
    """Return harmonics from 0.1 to 2 Hz on all controls at once, each control its own."""
    common = {
        "shape": "multisine", "start": 1.0, "duration": 20.0, "amplitude": AMPLITUDE, "band": 2.0,
        "stride": len(vehicle.controls),
    }  # fmt: skip
    return _maneuver(
        point, [{**common, "control": c, "first": 2 + i} for i, c in enumerate(vehicle.controls)]
    )


def pulses(vehicle: Vehicle, point: Trim) -> Maneuver:
    """Return a second and a half on each control, after which the aircraft is left to itself."""
    common = {"shape": "pulse", "duration": 1.5, "amplitude": AMPLITUDE}
    inputs = [{**common, "control": c, "start": 1.0 + 3.0 * i} for i, c in enumerate(vehicle.controls)]
    return _maneuver(point, inputs)


INPUTS: Final[dict[str, Callable[[Vehicle, Trim], Maneuver]]] = {
    "3-2-1-1, doublets": every_control,
    "multisines": multisines,
    "pulses": pulses,
}


@dataclass(frozen=True, eq=False)
class Comparison:
    """One vehicle through one set of inputs: differences by channel.

    Attributes
    ----------
    largest : (n_y,)
        Largest magnitudes, SI and rad.
    flat, faster, frames, earth : mapping of channel to fraction of its maximum
        JSBSim at :data:`FRAME_RATE` and faster; against our simulation on JSBSim's frames; on its Earth.
    """

    vehicle: str
    inputs: str
    largest: FloatArray
    flat: Mapping[str, float]
    faster: Mapping[str, float]
    frames: Mapping[str, float]
    earth: Mapping[str, float]

    @property
    def differences(self) -> tuple[Mapping[str, float], ...]:
        """In the order of `HEAD`."""
        return self.flat, self.faster, self.frames, self.earth

    @property
    def rows(self) -> Iterator[tuple[Cell, ...]]:
        """What stands under `HEAD`."""
        for channel, most in zip(self.flat, self.largest.tolist(), strict=True):
            numbers = (float(f"{d[channel]:.2g}") for d in self.differences)
            yield (self.vehicle, self.inputs, channel, float(f"{most:.6g}"), *numbers)


def compare(vehicle_name: str, inputs: str) -> Comparison:
    """Export, fly by both, and compare."""
    vehicle = load(vehicle_name)
    point = trim(vehicle, None, ALTITUDE)
    record = maneuver_record(vehicle, point, INPUTS[inputs](vehicle, point))
    own, fine = own_readings(record), own_readings(record, frames_per_sample(record.dt))
    with tempfile.TemporaryDirectory(prefix="stoop-export-") as folder:
        root = Path(folder)
        for place, text in jsbsim_aircraft.folder(record.vehicle, None).items():
            (root / place).parent.mkdir(parents=True, exist_ok=True)
            (root / place).write_text(text, encoding="utf-8")
        planet, name = root / jsbsim_aircraft.PLANET, file_name(vehicle.name)
        flat = jsbsim_readings(root, name, record, planet)
        faster = jsbsim_readings(root, name, record, planet, FASTER * FRAME_RATE)
        earth = jsbsim_readings(root, name, record, None)
    pairs = ((own, flat), (own, faster), (fine, flat), (own, earth))
    differences = [relative_differences(record.vehicle, a, b) for a, b in pairs]
    return Comparison(vehicle_name, inputs, np.abs(own).max(axis=0), *differences)


def show(setting: Setting, samples: Samples) -> Findings:
    """Fly every vehicle through every set of inputs; nothing is drawn by chance."""
    flights = [compare(vehicle, inputs) for vehicle in VEHICLES for inputs in INPUTS]
    whole = [f for f in flights if f.vehicle != "crooked"]
    flat = max(max(f.flat.values()) for f in whole)
    frames = max(max(f.frames.values()) for f in flights)
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
    head = (
        "vehicle", "inputs", "largest in", "JSBSim", "4000 steps a second", "on JSBSim's frames", "on the Earth",
    )  # fmt: skip
    lines = tuple(
        (
            f.vehicle,
            f.inputs,
            max(f.frames, key=lambda c: f.frames[c]),
            *(f"{max(d.values()):.1e}" for d in f.differences),
        )
        for f in flights
    )
    table = Table("Largest difference of any channel, as a fraction of the channel's maximum", head, lines)
    return Findings(
        "Exported aircraft flown by JSBSim",
        LEAD,
        claims,
        (Section("Vehicles and inputs", (table, Prose(WORDS))),),
        HEAD,
        tuple(row for flight in flights for row in flight.rows),
    )


EXPERIMENT: Final = Verification("export", show)
