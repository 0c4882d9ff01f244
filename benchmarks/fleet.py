"""Logs of a fleet: time of a log, two workers beside one, memory of a worker, growth with the number of logs; a million rows.

A flight of ten minutes of the built-in airplane is copied with changed numbers. ``STOOP_FLEET_LOGS=10000`` measures as many
logs (27 MB each) in place of 24.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from benchmarks.command import timed
from benchmarks.table import Row
from stoop.flight import from_columns
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle.builtin import load_vehicle
from stoop_plan.flight_logs import save_flight_as

PART: Final = "fleet"
VEHICLE: Final = "twin-boom"
LOGS: Final = int(os.environ.get("STOOP_FLEET_LOGS", "24"))
SECONDS, RATE = 600.0, 100.0
ROWS: Final = (1000, 100, 10)  #: vehicles, flights of each, figures
_MEMORY = """
import sys
from pathlib import Path
import stoop_fleet.logs as logs
from stoop.base.memory import keep_freed_memory
keep_freed_memory()
def peak():
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(x for x in lines if x.startswith("VmHWM")).split()[1])
before = peak()
logs.read({"log": sys.argv[1], "mapping": None, "mass": None, "vehicle": sys.argv[2]}, [None])
print(before, peak())
"""


def run() -> list[Row]:
    """Measure commands in processes of their own."""
    with tempfile.TemporaryDirectory(prefix="stoop-fleet-") as scratch:
        return [*_logs(Path(scratch)), *_table(Path(scratch))]


def make(folder: Path, count: int) -> list[str]:
    """Write copies of a flight with changed numbers, and the table of their vehicles and times."""
    maneuver = Maneuver.model_validate(
        {"duration": SECONDS, "rate": RATE, "airspeed": 35.0, "altitude": 500.0}
    )
    flight = simulate_flight(load_vehicle(VEHICLE), maneuver, name="f")
    columns = {name: flight.column(name) for name in flight.names}
    rng, paths = np.random.default_rng(0), list[str]()
    for i in range(count):
        changed = {n: x + 1e-3 * x.std() * rng.standard_normal(x.size) for n, x in columns.items()}
        paths.append(str(folder / f"f{i:05}.ulg"))
        save_flight_as(from_columns(f"f{i:05}", flight.time, changed), Path(paths[-1]))
    names = [Path(path).stem for path in paths]
    dates = pd.Timestamp("2025-01-01") + pd.to_timedelta(np.arange(count) / 4.0, "h")
    table = {"flight": names, "vehicle": [f"v{i % 8}" for i in range(count)], "time": dates}
    pd.DataFrame(table).to_csv(folder / "flights.csv", index=False)
    return paths


def _logs(folder: Path) -> Iterator[Row]:
    paths, cache = make(folder, LOGS), folder / "cache"
    options = ("--vehicle", VEHICLE, "--flights", str(folder / "flights.csv"), "--alarms-a-year", "0.001")

    def read(count: int, workers: int, name: str) -> tuple[float, float]:
        words = ("fleet", *paths[:count], *options, "-o", str(folder / name), "--workers", str(workers))
        done = timed(words, cache, variables={"STOOP_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"})
        return done.ended, done.processor

    read(1, 1, "warm")
    (half_wall, half), (wall, whole), (half_again, _), (again, _) = (
        read(count, workers, f"store-{count}-{workers}") for workers in (1, 2) for count in (LOGS // 2, LOGS)
    )
    marginal = (whole - half) / (LOGS - LOGS // 2)
    size = Path(paths[0]).stat().st_size
    yield Row(
        PART,
        "a log of 10 min, one worker",
        whole / LOGS,
        "s",
        note=f"processor time; {size / 1e6:.0f} MB, {LOGS} logs",
    )
    yield Row(
        PART, "a further log, over the mean of half of them", marginal / (2.0 * half / LOGS), at_most=1.1
    )
    note = f"wall time beyond that of half of them; of whole commands {wall / again:.2f}, {wall:.0f} and {again:.0f} s"
    speed = (wall - half_wall) / (again - half_again)
    yield Row(PART, "two workers over one, speed of further logs", speed, at_least=1.9, note=note)
    words = [sys.executable, "-c", _MEMORY, paths[0], VEHICLE]
    told = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True).stdout
    idle, peak = map(int, told.split())
    note = f"of {peak / 1e6:.0f} MB; a worker that has read nothing takes {idle / 1e6:.0f}"
    yield Row(
        PART, "memory of a worker beside the log", (peak - idle - size) / 1e6, "MB", at_most=200.0, note=note
    )


def _table(folder: Path) -> Iterator[Row]:
    """Measure a store of a million rows; its figures are noise, and its state tells no alarm."""
    (vehicles, flights, figures), rng = ROWS, np.random.default_rng(0)
    store, n = folder / "store", vehicles * flights
    (store / "figures").mkdir(parents=True)
    names = np.array([f"vehicle-{i:04}" for i in range(vehicles)])
    each = {"vehicle": np.repeat(names, flights), "flight": [f"f{i:06}" for i in range(n)]}
    each |= {"time": 1.7e9 + 86400.0 * np.tile(np.arange(flights), vehicles)}
    frames = [
        pd.DataFrame({**each, "figure": f"figure-{k}", "value": rng.standard_normal(n), "std_error": 0.1})
        for k in range(figures)
    ]
    pd.concat(frames).to_parquet(store / "figures" / "figures.parquet", index=False)
    state = '{"schema": "stoop-fleet/1", "alarms_a_year": 1.0, "threshold": 20.0, "alarms": []}'
    (store / "fleet.json").write_text(state)
    shown = timed(("fleet", str(store)), folder / "cache")
    yield Row(
        PART,
        "stoop fleet STORE, a million rows",
        shown.processor,
        "s",
        at_most=2.0,
        note="processor time, whole command",
    )
