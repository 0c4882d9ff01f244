"""Exported aircraft in JSBSim: how far it flies from our own simulation in thirty seconds, and why."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.export import excitation, jsbsim_folder
from stoop.export.flown import Record, jsbsim_readings, own_readings, relative_differences
from stoop.export.jsbsim_flight import FRAME_RATE, frames_per_sample
from stoop.export.names import file_name
from stoop.report.sheet import Prose, Section, Table
from stoop.simulate import trim
from stoop_studies.findings import Claim, Findings, Results, Setting, holds, number
from stoop_studies.verify.export.aircraft import INPUTS, VEHICLES, load

GOAL: Final = 1e-3  #: of each channel's maximum
FASTER: Final = 4.0  #: times the frames of JSBSim
ALTITUDE: Final = 200.0  #: m
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


@dataclass(frozen=True, eq=False)
class Flight:
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
    channels: tuple[str, ...]
    largest: FloatArray
    flat: Mapping[str, float]
    faster: Mapping[str, float]
    frames: Mapping[str, float]
    earth: Mapping[str, float]

    @property
    def worst(self) -> str:
        """The channel that differs most."""
        return max(self.frames, key=lambda c: self.frames[c])

    @property
    def rows(self) -> Iterator[tuple[Cell, ...]]:
        """What stands under `HEAD`."""
        for channel, most in zip(self.channels, self.largest.tolist(), strict=True):
            apart = (getattr(self, k)[channel] for k in ("flat", "faster", "frames", "earth"))
            yield (
                self.vehicle,
                self.inputs,
                channel,
                float(f"{most:.6g}"),
                *(float(f"{x:.2g}") for x in apart),
            )


def fly(vehicle_name: str, inputs: str) -> Flight:
    """Export, fly by both, and compare."""
    vehicle = load(vehicle_name)
    point = trim(vehicle, None, ALTITUDE)
    record = excitation.record(vehicle, point, INPUTS[inputs](vehicle, point))
    own, fine = own_readings(record), own_readings(record, frames_per_sample(record.dt))
    with tempfile.TemporaryDirectory(prefix="stoop-export-") as folder:
        root = Path(folder)
        _write(root, record)
        planet = root / jsbsim_folder.PLANET
        name = file_name(vehicle.name)
        flat = jsbsim_readings(root, name, record, planet)
        faster = jsbsim_readings(root, name, record, planet, FASTER * FRAME_RATE)
        earth = jsbsim_readings(root, name, record, None)
    pairs = ((own, flat), (own, faster), (fine, flat), (own, earth))
    differences = [relative_differences(record.vehicle, a, b) for a, b in pairs]
    return Flight(vehicle_name, inputs, vehicle.outputs, np.abs(own).max(axis=0), *differences)


def _write(root: Path, record: Record) -> None:
    for place, text in jsbsim_folder.folder(record.vehicle, None).items():
        path = root / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def _table(flights: list[Flight]) -> Table:
    head = (
        "vehicle",
        "inputs",
        "largest in",
        "JSBSim",
        "4000 steps a second",
        "on JSBSim's frames",
        "on the Earth",
    )
    rows = tuple(
        (
            f.vehicle,
            f.inputs,
            f.worst,
            *(f"{max(m.values()):.1e}" for m in (f.flat, f.faster, f.frames, f.earth)),
        )
        for f in flights
    )
    return Table("Largest difference of any channel, as a fraction of the channel's maximum", head, rows)


def _claims(flights: list[Flight]) -> tuple[Claim, ...]:
    whole = [f for f in flights if f.vehicle != "crooked"]
    flat = max(max(f.flat.values()) for f in whole)
    frames = max(max(f.frames.values()) for f in flights)
    return (
        holds(
            "JSBSim within 1e-3 of every channel's maximum over 30 s, where delays are whole samples",
            flat <= GOAL,
            f"{number(flat, 2)} at most, over {len(whole)} flights",
        ),
        holds(
            "Within 1e-3 on the same points, whatever the delays",
            frames <= GOAL,
            f"{number(frames, 2)} at most, over {len(flights)} flights",
        ),
    )


@dataclass(frozen=True)
class Export:
    """Every vehicle through every set of inputs."""

    name: str = "export"
    runs: int = 1
    parts: tuple[str, ...] = ()

    def plan(self, setting: Setting) -> None:
        """Nothing takes long."""

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Fly them all; nothing is drawn by chance."""
        flights = [fly(vehicle, inputs) for vehicle in VEHICLES for inputs in INPUTS]
        rows = tuple(row for flight in flights for row in flight.rows)
        sections = (Section("Vehicles and inputs", (_table(flights), Prose(WORDS))),)
        title = "Exported aircraft flown by JSBSim"
        return Findings(title, LEAD, _claims(flights), sections, HEAD, rows)
