"""Tables of hostile numbers: each ends in a flight with its summary, or in one line."""

import contextlib
from pathlib import Path

import numpy as np
import pytest
from helpers.made_logs import CLOCK, lines_of

from stoop.base.arrays import FloatArray
from stoop.errors import StoopError
from stoop.flight import describe, load_flight
from stoop_plan.input_design.windows import find_windows

HOSTILE = (0.0, 1.0, -1.0, 5e-324, 1e-9, 1e9, 1e154, -1e308, np.inf, -np.inf, np.nan)
LOW = "alpha beta p q r phi theta psi ax ay elevator aileron rudder thrust motor_1 motor_2 q0 q1 q2 q3 ve vd"
LARGE = {"V": 30.0, "airspeed_pitot": 30.0, "az": 10.0, "vn": 30.0, "density": 1.2, "pwm_1": 1500.0}
SIZES = LARGE | dict.fromkeys(LOW.split(), 0.1)  #: usual size of a variable, SI


def column(random: np.random.Generator, t: FloatArray, size: float) -> FloatArray:
    n, hostile = len(t), float(random.choice(HOSTILE))
    usual = size * (1.0 + 0.1 * np.sin(t * random.uniform(0.1, 30.0)) + 0.01 * random.normal(size=n))
    with np.errstate(all="ignore"):
        return (
            usual,
            usual,
            np.full(n, hostile),
            np.where(np.arange(n) == random.integers(n), hostile, np.nan),
            np.where(np.arange(n) > random.integers(n), hostile, usual),
            np.where(random.random(n) < 0.5, hostile, usual),
            random.choice(HOSTILE, size=n),
            np.sign(usual - size) * hostile,
            np.cumsum(random.normal(size=n)) * 10.0 ** random.uniform(-5.0, 5.0),
        )[random.integers(9)]


def write(random: np.random.Generator, folder: Path) -> Path:
    n = int(random.choice([1, 2, 3, 7, 20, 100, 600, 3000]))
    dt = float(random.choice([1e-6, 1e-4, 0.01, 0.1, 100.0]))
    t = np.arange(n) * dt + float(random.choice([0.0, 1.7e9]))
    if random.random() < 0.2:
        t[n // 2 :] += float(random.choice([1.0, 3600.0, 1e6]))
    names = random.choice(list(SIZES), size=random.integers(1, len(SIZES)), replace=False).tolist()
    table = np.column_stack([t, *(column(random, t, SIZES[name]) for name in names)])
    lines = [",".join(map(repr, row)).replace("nan", "") for row in table.tolist()]
    path = folder / "flight.csv"
    path.write_text("\n".join([",".join(["t", *names]), *lines]))
    path.with_name("flight.csv.toml").write_text(CLOCK + lines_of(*names))
    return path


@pytest.mark.parametrize("seeds", [range(8), range(8, 150)], ids=["few", "many"])
def test_hostile_numbers_end_well(seeds: range, tmp_path: Path) -> None:
    for seed in seeds:
        path = write(np.random.default_rng([seed // 5, seed % 5]), tmp_path)
        with contextlib.suppress(StoopError):
            flight = load_flight(path)
            describe(flight)
            find_windows({"flight": flight.without_faults()})
