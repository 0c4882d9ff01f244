"""Recorders of other people: rates, holds, latencies, units, frames, names, noise, steps and gaps of what was flown.

A seed draws the habits of one recorder; the file has one row per sample of its fastest sensor, as tables have. Slower columns
repeat their last reading, or are interpolated by who wrote the table. The truth of what was recorded stays beside.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.units import FACTORS
from stoop.base.variables import EULER, POSITION, RATES, SPECIFIC_FORCE, VELOCITY
from stoop_studies.verify import lines
from stoop_studies.verify.instruments import BIASES, DRIFT, NOISE, drifting, without_noise
from stoop_studies.verify.outside_aircraft import TABLES, OutsideFlight
from stoop_studies.verify.pilots import Columns
from stoop_studies.verify.study import data_text

HABITS: Final[Mapping[str, Mapping[str, Any]]] = tomllib.loads(data_text("habits.toml"))
DIALECTS: Final = tuple(HABITS)
SENSORS: Final = {
    "imu": (*RATES, *SPECIFIC_FORCE), "attitude": EULER, "gps": (*VELOCITY, *POSITION), "air": ("V", "alpha", "beta", "altitude"),
}  #: what one sensor reads at once; all others are commands  # fmt: skip


@dataclass(frozen=True)
class Recorder:
    """The habits of a recorder: rates in Hz and latencies in s by sensor, which are held, and what is lost."""

    dialect: str
    rates: Mapping[str, float]
    latency: Mapping[str, float]
    held: bool  #: slow columns repeat their last reading; else they are interpolated
    noise: float  #: over that of `instruments.NOISE`
    rounded: bool
    gaps: int  #: dropouts of all columns, 0.3 to 1 s each
    missing: tuple[str, ...]  #: sensors, or variables

    @property
    def rate(self) -> float:
        """Hz, of the rows."""
        return max(self.rates.values())


@dataclass(frozen=True, eq=False)
class Log:
    """A log that was written, and what is true of it."""

    path: Path
    mapping: str  #: TOML that reads it right
    lines: tuple[str, ...]  #: variables that it holds
    shown: Columns  #: variable -> (n,) what the rows would read by a right mapping
    start: float  #: s, where its clock begins


def draw(rng: np.random.Generator, winged: bool, dialects: Sequence[str] = DIALECTS) -> Recorder:
    """Draw a recorder of some kinds of logs."""

    def among(*values: float) -> float:
        return float(rng.choice(values))

    dialect, imu = str(rng.choice(dialects)), among(50.0, 100.0, 200.0)
    rates = {"imu": imu, "attitude": among(imu, 50.0), "gps": among(1.0, 5.0, 10.0)}
    rates["air"] = among(10.0, 25.0, 50.0)
    rates["commands"] = among(*((10.0, 25.0, 50.0) if winged else (50.0, imu)))
    late = {"gps": float(rng.uniform(0.1, 0.3)), "commands": among(0.0, 0.0, rng.uniform(0.05, 0.4))}
    if dialect == "motion_capture":
        rates, late["gps"] = dict.fromkeys(rates, 100.0), 0.0
    lost = ((), (), ("alpha", "beta"), ("beta",), ("pn", "pe")) if winged else ((), ("pn", "pe"))
    held, noise, rounded = bool(rng.random() < 0.6), among(0.5, 1.0, 2.0), bool(rng.random() < 0.5)
    gaps = int(among(0, 0, 3))
    return Recorder(dialect, rates, late, held, noise, rounded, gaps, lost[int(rng.integers(len(lost)))])


def rows_of(recorder: Recorder, columns: Columns) -> dict[str, tuple[str, str, float, float]]:
    """Return column, unit, factor and offset of each variable that a recorder writes of a flight."""
    habit, rotors = HABITS[recorder.dialect], ("motor", "rotor")
    named = {n: row for n, row in habit.items() if n not in ("clock", "file", *rotors)}
    for of in (one for one in rotors if one in habit):
        column, *more = habit[of]
        named |= {f"{of}_{n}": [column.format(n=n, k=n - 1), *more] for n in range(1, 9)}
    written = {n: row for n, row in named.items() if n in columns and n not in recorder.missing}
    return {n: (*row, *(1.0, 0.0)[len(row) - 2 :]) for n, row in written.items()}


def measured(
    true: Columns, rate: float, recorder: Recorder, arm: FloatArray, rng: np.random.Generator
) -> Columns:
    """Return what sound sensors read at each instant of the truth: an ``arm`` (3,), m, biases, drift and noise."""
    count, out = len(true["p"]), without_noise(true, rate, arm)
    for name in [n for n in out if n in NOISE or n in DRIFT]:
        slow = drifting(rng, count, rate, *DRIFT[name]) if name in DRIFT else 0.0
        noise = recorder.noise * NOISE.get(name, 0.0) * rng.standard_normal(count)
        out[name] = out[name] + noise + slow + BIASES.get(name, 0.0) * rng.standard_normal()
    return out


def sampled(columns: Columns, rate: float, recorder: Recorder) -> tuple[FloatArray, Columns]:
    """Return the times (m,) of the rows from zero and what each row holds of columns (n,) at a rate.

    A latency is by how much what is read is older than its row; commands are written before they act.
    """
    count, out = len(columns["p"]), {}
    time = np.arange(int((count - 1) / rate * recorder.rate)) / recorder.rate
    sensors = {n: s for s, names in SENSORS.items() for n in names}
    for name, x in columns.items():
        sensor = sensors.get(name, "commands")
        own, sign = recorder.rates[sensor], -1.0 if sensor == "commands" else 1.0
        step = np.floor(time * own + 1e-9)
        # the samples that were the last at the readings before and after a row; the ends are held
        when = [k / own - sign * recorder.latency.get(sensor, 0.0) for k in (step, step + 1.0)]
        before, after = (
            x[np.clip(np.floor(t / (1.0 / rate) + 1e-6).astype(int), 0, count - 1)] for t in when
        )
        out[name] = before + (0.0 if recorder.held else time * own - step) * (after - before)
    return time, out


def write(
    flight: OutsideFlight, recorder: Recorder, arm: FloatArray, folder: Path, rng: np.random.Generator,
    mangle: Callable[[lines.Columns], lines.Columns] = dict,
) -> Log:  # fmt: skip
    """Write a log into a folder; ``mangle`` is what is wrong with its columns."""
    true = {n: -x if n in flight.reversed else x for n, x in flight.columns.items()}
    time, shown = sampled(measured(true, flight.rate, recorder, arm, rng), flight.rate, recorder)
    rows, habit = rows_of(recorder, shown), HABITS[recorder.dialect]
    shown = {n: shown[n] for n in rows}
    start, (clock, unit) = float(np.round(rng.uniform(5.0, 300.0), 2)), habit["clock"]
    table, mangled = {clock: (start + time) / FACTORS[unit]}, mangle(shown)
    for name, (column, of, factor, offset) in rows.items():
        value = (mangled[name] - offset) / (factor * FACTORS[of])
        if name == "psi":  # up to a full turn, in whatever it is written
            turn = np.max(np.abs(mangle({**shown, name: shown[name] + 2.0 * np.pi})[name] - mangled[name]))
            value = np.mod(value, (turn if turn > 1e-6 else 2.0 * np.pi) / FACTORS[of])
        step = TABLES["steps"].get(of, 0.0)
        table[column] = np.round(value / step) * step if recorder.rounded and step else value
    kept = np.ones(len(time), dtype=bool)
    for begin in rng.uniform(5.0, time[-1] - 5.0, recorder.gaps):
        kept &= (time < begin) | (time > begin + rng.uniform(0.3, 1.0))
    path = lines.save({n: x[kept] for n, x in table.items()}, folder, habit.get("file", "csv"))
    mapping = lines.mapping_of(habit["clock"], rows)
    return Log(path, mapping, tuple(rows), {n: x[kept] for n, x in shown.items()}, start)
