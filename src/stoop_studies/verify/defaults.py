"""Forty flights of twenty made-up vehicles, from log to model by the defaults: how often intervals, predictions and verdict are right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.units import FOOT
from stoop.vehicle import Vehicle, parse_vehicle
from stoop_studies.verify import instruments, pilots
from stoop_studies.verify.defects import edited
from stoop_studies.verify.fleet import KINDS, MadeUp, made_up

FLIGHTS: Final = 2 * len(KINDS)
GUSTS: Final = {"calm": 0.0, "light": 0.015, "moderate": 0.04}  #: intensity of vertical gusts over V*


@dataclass(frozen=True, eq=False)
class Flown:
    """One flight: its log is all that a user has; the rest is the truth.

    Attributes
    ----------
    vehicle : MadeUp
    path : of the log
    simulator : "stoop" or "JSBSim"
    gusts : one of `GUSTS`
    defect : of the instruments
    commands : surface -> commanded deflection (n,), rad, as it was flown, on the clock of the log
    airspeed : mean, m/s, airborne
    """

    vehicle: MadeUp
    path: Path
    simulator: str
    gusts: str
    defect: instruments.Defect
    time: np.ndarray
    commands: Mapping[str, np.ndarray]
    airspeed: float


def gusty(vehicle: Vehicle, share: float) -> Vehicle:
    """Return a vehicle in gusts whose vertical part has an intensity of so much of V*, lengths by MIL-F-8785C at 250 m."""
    if not share:
        return vehicle
    h = pilots.ALTITUDE / FOOT
    ratio = 0.177 + 0.000823 * h
    sigma = share * vehicle.value("reference.airspeed", 8.0)
    along = {"intensity": sigma / ratio**0.4, "length": FOOT * h / ratio**1.2}
    table: dict[str, Any] = {"u": along, "v": along, "w": {"intensity": sigma, "length": pilots.ALTITUDE}}
    if not vehicle.rotors:
        return parse_vehicle(edited(vehicle.text, {"turbulence": table}), vehicle.where)
    return parse_vehicle(edited(vehicle.text, {"turbulence": {**table, "airspeed": 8.0}}), vehicle.where)


def fly(number: int, folder: Path, seed: int = 0) -> Flown:
    """Fly one of the flights and write its log into a folder."""
    vehicle = made_up(number // 2)
    rng = np.random.default_rng([41, seed, number])
    name = list(GUSTS)[(number + number // 2) % len(GUSTS)]
    defect = instruments.DEFECTS[(number + number // 6) % len(instruments.DEFECTS)](rng)
    simulator = ("stoop", "JSBSim")[number % 2] if vehicle.winged else "stoop"
    truth, wind = gusty(vehicle.vehicle, GUSTS[name]), instruments.WIND * rng.standard_normal(2)
    if vehicle.winged:
        planned = pilots.plan(truth, vehicle.throw, rng)
        flown = pilots.FLYING[simulator](truth, planned, vehicle.throw, rng)
        flown |= {n: flown[n] + w for n, w in zip(("vn", "ve"), wind, strict=True)}
        flown |= {f"wind_{a}": np.full(len(flown["p"]), w) for a, w in zip("ne", wind, strict=True)}
        rate = pilots.RATE
    else:
        flown, rate = pilots.on_rotors(truth, wind, rng), pilots.ROTOR_RATE
    whole = instruments.on_the_ground(vehicle, flown, wind, rate, rng)
    read = instruments.measured(vehicle, whole, rate, defect, rng)
    start = float(np.round(rng.uniform(5.0, 300.0), 2))
    path = instruments.write_log(vehicle, read, rate, start, folder, f"flight{number:02d}")
    commands = {s: whole[s] for s in vehicle.vehicle.controls if s in whole}
    time = start + np.arange(len(whole["p"])) / rate
    airspeed = float(np.mean(flown["V"])) if vehicle.winged else 0.0
    return Flown(vehicle, path, simulator, name, defect, time, commands, airspeed)
