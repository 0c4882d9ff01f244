"""Micro airplanes and quadrotors in a room with motion capture: from a log of pose and commands to a model, by the defaults.

The made-up vehicles of `fleet`, smaller, fly in still air. Their log holds position, attitude and the commands that a radio on
the ground sent: late by up to 0.4 s, of an airplane held from one message to the next. Nothing else is known of the motion.
"""

from __future__ import annotations

import csv
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.interpolate import CubicSpline

from stoop.assessment.covariance import NORMAL_95
from stoop.base.arrays import FloatArray
from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.base.rotations import continuous, quaternions_of
from stoop.base.units import DEGREE
from stoop.base.variables import EULER, VELOCITY
from stoop.errors import StoopError
from stoop.flight import Flight, load_flight
from stoop.vehicle import Vehicle
from stoop.vehicle.load import parse_vehicle
from stoop_draft.mapping_draft import draft as draft_mapping
from stoop_draft.vehicle_draft.draft import draft
from stoop_draft.vehicle_draft.request import Request
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify import defaults, instruments, pilots, study
from stoop_studies.verify.defects import edited
from stoop_studies.verify.made_up import made_up
from stoop_studies.verify.scenes import LOG_GRID

CASES: Final = {"wings": "micro airplanes", "rotors": "quadrotors"}
KINDS: Final = {
    "wings": (("conventional", "navion", (0.05, 0.3)), ("conventional", "aerosonde", (0.1, 0.4))),
    "rotors": (("quad", "quad-x", (0.03, 0.3)),),
}
RATES: Final = (100.0, 120.0, 200.0, 240.0)  #: Hz, of motion capture
#: steps of a pilot's 50 Hz from one message of the radio to the next: 50 to 8.3 Hz
HELD: Final = (1, 2, 3, 5, 6)
LATEST: Final = 0.4  #: s
IN_THE_ROOM: Final = {"environment.density": SEA_LEVEL_DENSITY}
NOISE: Final = {"position": 0.001, "attitude": 0.3 * DEGREE}  #: m, rad
DELAY_ERROR: Final = 0.01  #: s
FOUND: Final = 0.95  #: share of the vehicles whose delay is to be within that
#: names of columns: position north, east, down; attitude as Euler angles or as a quaternion
COLUMNS: Final = (
    (("x_n", "y_n", "z_n"), ("roll", "pitch", "yaw")),
    (("pos_n", "pos_e", "pos_d"), ("qw", "qx", "qy", "qz")),
)


def fly(case: str, seed: int, folder: Path) -> tuple[defaults.Flown, float]:
    """Fly a vehicle and write its log into a folder; return the flight and the delay of its commands, s."""
    made, rng = made_up(seed, KINDS[case]), np.random.default_rng([61, seed, len(case)])
    made = replace(made, vehicle=parse_vehicle(edited(made.vehicle.text, IN_THE_ROOM), made.vehicle.where))
    truth, every, late = made.vehicle, int(rng.choice(HELD)), float(np.round(rng.uniform(0.0, LATEST), 2))
    if made.winged:
        planned = pilots.plan(truth, made.throw, rng)
        flown, rate = pilots.by_stoop(truth, planned, made.throw, rng, every), pilots.RATE
    else:
        flown, rate = pilots.on_rotors(truth, np.zeros(2), rng), pilots.ROTOR_RATE
    clock = np.arange(len(flown["p"])) / rate
    columns = _pose(flown, clock)
    stop = clock[-1] - late
    seen = np.arange(0.0, stop, 1.0 / float(rng.choice(RATES)))
    pose = [x(seen) + s * rng.standard_normal(len(seen)) for x, s in columns]
    place, attitude = COLUMNS[seed % len(COLUMNS)]
    if len(attitude) == 4:
        pose[3:] = [*continuous(quaternions_of(np.column_stack(pose[3:]))).T]
    rows = np.column_stack([seen, *pose, *(np.interp(seen + late, clock, flown[n]) for n in truth.recorded)])
    path = folder / f"capture{seed}.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        names = (n.removeprefix("control_") for n in truth.recorded)
        writer.writerow(["t", *place, *attitude, *names])
        writer.writerows(np.round(rows, 6).tolist())
    airspeed = float(np.mean(flown["V"])) if made.winged else 0.0
    defect = instruments.Defect("none", delay={"commands": late})
    # a grid of 10 ms or finer has all corners of the commands, so that these are not smoothed
    fine = np.linspace(0.0, clock[-1], 4 * len(clock) - 3)
    true = {n: np.interp(fine + late * (n in truth.recorded), clock, x) for n, x in flown.items()}
    return defaults.Flown(made, path, "stoop", "calm", defect, fine, true, airspeed), late


def _pose(flown: Mapping[str, FloatArray], clock: FloatArray) -> list[tuple[CubicSpline, float]]:
    """Return position and attitude as functions of time, each with its noise."""
    speeds = [CubicSpline(clock, flown[n]).antiderivative() for n in VELOCITY]
    angles = [CubicSpline(clock, np.unwrap(flown[n])) for n in EULER]
    return [(x, NOISE["position"]) for x in speeds] + [(x, NOISE["attitude"]) for x in angles]


def drafted(flown: defaults.Flown) -> tuple[Flight, Vehicle]:
    """Return the flight of a log, by a drafted mapping that is written beside it, and the vehicle drafted of both."""
    mapping, made = flown.path.with_name("mapping.toml"), flown.vehicle
    mapping.write_text(draft_mapping(flown.path).text, encoding="utf-8")
    flight = load_flight(flown.path, mapping, rate=LOG_GRID)
    request = Request(made.template, made.tape["mass"], made.tape["span"], made.tape.get("chord"))
    return flight, draft(request, (flight,), f"new {made.number}").vehicle


@study.work
def examine(case: str, seed: int) -> dict[str, Any]:
    """Fly, record and identify by the defaults; what stops the chain is recorded."""
    with tempfile.TemporaryDirectory(prefix="stoop-capture-") as name:
        flown, late = fly(case, seed, Path(name))
        about = {"template": flown.vehicle.template, "mass": flown.vehicle.tape["mass"], "delay": late}
        began = time.perf_counter()
        try:
            flight, vehicle = drafted(flown)
            job = defaults.identified(flight, vehicle, Path(name) / "result")
        except StoopError as error:
            return {**about, "stopped": str(error), "seconds": time.perf_counter() - began}
        seconds, found = time.perf_counter() - began, defaults.compared(flown, job)
        delays = [row for n, row in found["numbers"].items() if n.endswith(".delay")]
        for row in delays:
            row[2] = late
        return {**about, "stopped": "", "seconds": seconds, "late": delays, **found}


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return how far the defaults carry, by kind of vehicle."""
    table = [defaults.summary(case, samples[case]) for case in CASES]
    for row in table:
        row |= {"late": _late(samples[row["case"]])}
    rows = [_row(case, r) for case in CASES for r in samples[case]]
    head = ("estimate", "std_error", "truth", "at_bound", "identifiable")
    numbers = [
        {"case": case, "vehicle": i, "number": n, **dict(zip(head, row, strict=True))}
        for case in CASES
        for i, r in enumerate(samples[case])
        for n, row in r.get("numbers", {}).items()
    ]
    claims = [claim for row in table for claim in _claims(row)]
    parts = {"vehicles": rows, "numbers": numbers}
    return Findings.of("From motion capture to model by the defaults", claims, table, parts)


def _late(records: Sequence[Mapping[str, Any]]) -> float | None:
    """Return the share of vehicles whose delay of commands is found within `DELAY_ERROR`."""
    found = [abs(r["late"][0][0] - r["late"][0][2]) <= DELAY_ERROR for r in records if r.get("late")]
    return float(np.mean(found)) if found else None


def _row(case: str, record: Mapping[str, Any]) -> dict[str, Any]:
    about = {k: record[k] for k in ("template", "mass", "delay", "stopped", "seconds")}
    if record["stopped"]:
        return {"case": case, **about, **dict.fromkeys(("found", "coverage", "grade", "right", "method"))}
    z, bound = defaults.scores([record], "numbers")
    inside = float(np.sum(np.abs(z) <= NORMAL_95) / max(len(z) + bound, 1))
    found = record["late"][0][0] if record["late"] else None
    return {
        "case": case, **about, "found": found, "coverage": inside, "grade": record["grade"],
        "right": defaults.right(record), "method": record["method"],
    }  # fmt: skip


def _claims(row: Mapping[str, Any]) -> list[Claim]:
    title = CASES[row["case"]].capitalize()
    first, last = defaults.claims_of_chain(title, row)
    within = holds(
        f"{title}: the delay of the commands is found within {1000 * DELAY_ERROR:g} ms",
        (row["late"] or 0.0) >= FOUND,
        f"{100 * (row['late'] or 0.0):.0f} %",
    )
    return [*first, within, *last]


EXPERIMENT: Final = study.Verification(
    "capture", show, runs=20, work="examine", cases=tuple(CASES), parts=("vehicles", "numbers")
)
