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
from stoop.base.toml import quoted, quoted_key
from stoop.base.units import FACTORS
from stoop.base.variables import EULER, POSITION, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.simulation.trajectories import traveled
from stoop_studies.verify import lines
from stoop_studies.verify.instruments import BIASES, DRIFT, NOISE, drifting
from stoop_studies.verify.outside_aircraft import OutsideFlight
from stoop_studies.verify.pilots import Columns
from stoop_studies.verify.study import data_text

HABITS: Final[Mapping[str, Mapping[str, Any]]] = tomllib.loads(data_text("habits.toml"))
DIALECTS: Final = tuple(HABITS)
SENSORS: Final = {
    "imu": (*RATES, *SPECIFIC_FORCE), "attitude": EULER, "gps": (*VELOCITY, *POSITION), "air": ("V", "alpha", "beta", "altitude"),
}  #: what one sensor reads at once; all others are commands  # fmt: skip
PULSE: Final = (
    1500.0,
    400.0,
)  #: us, of a command in the middle, and per unit; of a throttle or motor 1000 and 1000
MAX_PULSES: Final = (1000.0, 1000.0)
STEPS: Final = {
    "deg/s": 0.06,
    "g": 0.002,
    "deg": 0.01,
    "kt": 0.1,
    "ft/min": 1.0,
    "ft": 1.0,
    "percent": 0.1,
    "rpm": 1.0,
    "us": 1.0,
}
"""What a recorder that rounds rounds to, by unit."""


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
    dialect = str(rng.choice(dialects))
    imu = float(rng.choice((50.0, 100.0, 200.0)))
    rates = {
        "imu": imu, "attitude": float(rng.choice((imu, 50.0))), "gps": float(rng.choice((1.0, 5.0, 10.0))),
        "air": float(rng.choice((10.0, 25.0, 50.0))),
        "commands": float(rng.choice((10.0, 25.0, 50.0) if winged else (50.0, imu))),
    }  # fmt: skip
    late = {
        "gps": float(rng.uniform(0.1, 0.3)),
        "commands": float(rng.choice((0.0, 0.0, rng.uniform(0.05, 0.4)))),
    }
    if dialect == "motion_capture":
        rates = dict.fromkeys(rates, 100.0)
        late["gps"] = 0.0
    lost = ((), (), ("alpha", "beta"), ("beta",), ("pn", "pe")) if winged else ((), ("pn", "pe"))
    return Recorder(
        dialect, rates, late, bool(rng.random() < 0.6), float(rng.choice((0.5, 1.0, 2.0))), bool(rng.random() < 0.5),
        int(rng.choice((0, 0, 3))), lost[int(rng.integers(len(lost)))],
    )  # fmt: skip


def rows_of(recorder: Recorder, columns: Columns) -> dict[str, Sequence[Any]]:
    """Return column, unit, factor and offset of each variable that a recorder writes of a flight."""
    habit = HABITS[recorder.dialect]
    out: dict[str, Sequence[Any]] = {}
    for name, row in habit.items():
        if name in ("motor", "rotor"):
            out |= {f"{name}_{n}": [row[0].format(n=n, k=n - 1), *row[1:]] for n in range(1, 9)}
        elif name not in ("clock", "file"):
            out[name] = row
    return {n: _pulsed(n, row) for n, row in out.items() if n in columns and n not in recorder.missing}


def _pulsed(name: str, row: Sequence[Any]) -> Sequence[Any]:
    if row[1] != "us":
        return row
    middle, span = MAX_PULSES if name.startswith(("control_throttle", "motor")) else PULSE
    return [row[0], "1", 1.0 / span, -middle / span]


def measured(
    true: Columns, rate: float, recorder: Recorder, arm: FloatArray, rng: np.random.Generator
) -> Columns:
    """Return what sound sensors read at each instant of the truth: an ``arm`` (3,), m, biases, drift and noise."""
    count, out = len(true["p"]), dict(true)
    place = traveled(np.stack([true[n] for n in VELOCITY], axis=-1), 1.0 / rate)
    out |= dict(zip(POSITION, place.T, strict=True))
    omega = np.stack([true[a] for a in RATES], axis=-1)
    moved = np.cross(np.gradient(omega, 1.0 / rate, axis=0), arm) + np.cross(omega, np.cross(omega, arm))
    out |= {n: true[n] + moved[:, i] for i, n in enumerate(SPECIFIC_FORCE)}
    out |= {n: np.unwrap(true[n]) for n in ("phi", "psi")}
    for name in out.keys() & (NOISE.keys() | DRIFT.keys()):
        slow = drifting(rng, count, rate, *DRIFT[name]) if name in DRIFT else 0.0
        noise = recorder.noise * NOISE.get(name, 0.0) * rng.standard_normal(count)
        out[name] = out[name] + noise + slow + BIASES.get(name, 0.0) * rng.standard_normal()
    return out


def sampled(columns: Columns, rate: float, recorder: Recorder) -> tuple[FloatArray, Columns]:
    """Return the times (m,) of the rows from zero and what each row holds of columns (n,) at a rate.

    A latency is by how much what is read is older than its row; commands are written before they act.
    """
    count = len(columns["p"])
    time = np.arange(int((count - 1) / rate * recorder.rate)) / recorder.rate
    clock = np.arange(count) / rate
    out: Columns = {}
    sensors = {n: s for s, names in SENSORS.items() for n in names}
    for name, x in columns.items():
        sensor = sensors.get(name, "commands")
        own, late = (
            recorder.rates[sensor],
            recorder.latency.get(sensor, 0.0) * (-1.0 if sensor == "commands" else 1.0),
        )
        step = np.floor(time * own + 1e-9)
        before, after = (clip_to(clock, x, k / own - late) for k in (step, step + 1.0))
        share = 0.0 if recorder.held else time * own - step
        out[name] = before + share * (after - before)
    return time, out


def clip_to(clock: FloatArray, x: FloatArray, when: FloatArray) -> FloatArray:
    """Return the samples of x (n,) that were the last at given times; the ends are held."""
    at = np.floor((when - clock[0]) / (clock[1] - clock[0]) + 1e-6).astype(int)
    return np.asarray(x[np.clip(at, 0, len(x) - 1)])


def write(
    flight: OutsideFlight, recorder: Recorder, arm: FloatArray, folder: Path, rng: np.random.Generator,
    mangle: Callable[[lines.Columns], lines.Columns] = dict,
) -> Log:  # fmt: skip
    """Write a log into a folder; ``mangle`` is what is wrong with its columns."""
    true = {n: -x if n in flight.reversed else x for n, x in flight.columns.items()}
    time, shown = sampled(measured(true, flight.rate, recorder, arm, rng), flight.rate, recorder)
    rows = rows_of(recorder, shown)
    shown = {n: shown[n] for n in rows}
    start, (clock, unit) = float(np.round(rng.uniform(5.0, 300.0), 2)), HABITS[recorder.dialect]["clock"]
    table = {clock: (start + time) / FACTORS[unit]}
    for name, x in mangle(shown).items():
        if name not in rows:
            continue
        column, of, factor, offset = (
            (*rows[name], 1.0, 0.0)[:4] if len(rows[name]) == 2 else (*rows[name], 0.0)[:4]
        )
        value = (x - offset) / (factor * FACTORS[of])
        if name == "psi":
            value = np.mod(value, 2.0 * np.pi / FACTORS[of])
        step = STEPS.get(of, 0.0)
        table[column] = np.round(value / step) * step if recorder.rounded and step else value
    kept = np.ones(len(time), dtype=bool)
    for begin in rng.uniform(5.0, time[-1] - 5.0, recorder.gaps):
        kept &= (time < begin) | (time > begin + rng.uniform(0.3, 1.0))
    path = save({n: x[kept] for n, x in table.items()}, folder, HABITS[recorder.dialect].get("file", "csv"))
    return Log(path, mapping_text(recorder, rows), tuple(rows), {n: x[kept] for n, x in shown.items()}, start)


def save(table: Columns, folder: Path, kind: str) -> Path:
    """Write a table as a CSV or MATLAB file."""
    path = folder / f"log.{kind}"
    if kind == "mat":
        from scipy.io import savemat

        savemat(path, {n: x[:, None] for n, x in table.items()})
        return path
    np.savetxt(path, np.column_stack([*table.values()]), "%.9g", ",", header=",".join(table), comments="")
    return path


def mapping_text(recorder: Recorder, rows: Mapping[str, Sequence[Any]]) -> str:
    """Return the mapping that reads a log right."""
    clock, unit = HABITS[recorder.dialect]["clock"]
    head = ["[time]", f"column = {quoted(clock)}", f'unit = "{unit}"', "", "[variables]"]
    extra = [dict(zip(("scale", "offset"), row[2:], strict=False)) for row in rows.values()]
    return "\n".join([
        *head,
        *(
            f"{quoted_key(n)} = {{column = {quoted(row[0])}, unit = {quoted(row[1])}"
            + "".join(f", {k} = {v!r}" for k, v in more.items()) + "}"
            for (n, row), more in zip(rows.items(), extra, strict=True)
        ),
        "",
    ])  # fmt: skip
