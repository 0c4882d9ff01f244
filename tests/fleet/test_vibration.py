"""Vibration of a flight: of each rotor by its speed, and what no rotor tells, from logs that are faster than a grid."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from stoop.base.arrays import FloatArray
from stoop.flight.gridding import Channels
from stoop_fleet.logs import plan, read
from stoop_fleet.vibration import SPEEDS, Windows, vibration

SECONDS, RATE, TURNS = 90.0, 500.0, 100.0  #: s, Hz, rotors a second
SHAKES = np.array([0.5, 0.4, 1.5, 0.6])  #: m/s2, of each rotor
NOISE = 0.5  #: m/s2


def shaken(rng: np.random.Generator, apart: float = 0.06, rate: float = RATE) -> list[Channels]:
    """Return accelerations of four rotors that shake sideways, and their speeds, which an ESC measures to 1 % at 50 Hz."""
    time = np.arange(0.0, SECONDS, 1.0 / rate)
    pole = np.exp(-2.0 / rate)  # speeds change within half a second
    colored = lfilter([1.0], [1.0, -pole], rng.standard_normal((4, time.size))) * np.sqrt(1.0 - pole**2)
    speed = 2.0 * np.pi * TURNS * (1.0 + apart * (np.arange(4)[:, None] - 1.5) + 0.02 * colored)
    phase = np.cumsum(speed, axis=1) / rate + rng.uniform(0.0, 6.0, (4, 1))
    force = NOISE * rng.standard_normal((3, time.size)) + np.array([0.0, 0.0, -9.81])[:, None]
    force[0] += SHAKES @ np.cos(phase) + np.sin(time)
    force[1] += SHAKES @ np.sin(phase)
    read = np.arange(0.0, SECONDS, 0.02)
    measured = [np.interp(read, time, x) * (1.0 + 0.01 * rng.standard_normal(read.size)) for x in speed]
    channels = ("imu", time, ("ax", "ay", "az"), force), ("esc", read, SPEEDS[:4], measured)
    return [Channels(name, at, dict(zip(names, rows, strict=True))) for name, at, names, rows in channels]


def level(windows: Windows | None) -> FloatArray:
    """Return the root of the usual mean square of each rotor: of one that shakes in two directions, its amplitude."""
    return np.sqrt([np.median(x) for x in windows.squares.values()])


def test_each_rotor_has_the_vibration_that_turns_with_it() -> None:
    """What no rotor tells is half of the second difference, of white noise 1.5 times its mean square."""
    channels = shaken(np.random.default_rng(0))
    found, alone = vibration(channels), vibration(channels[:1])
    assert list(found.turning.squares) == list(SPEEDS[:4])
    assert level(found.turning) == pytest.approx(SHAKES, rel=0.1)
    assert (alone.turning, alone.absent) == (None, "no speeds of rotors")
    assert np.sqrt(alone.rough.squares["az"].mean() / 1.5) == pytest.approx(NOISE, rel=0.02)


def test_windows_with_a_gap_or_a_lost_reading_are_left_out() -> None:
    imu, esc = shaken(np.random.default_rng(3))
    kept = (imu.time < 30.0) | (imu.time > 35.0)
    force = {name: np.where(imu.time > 80.0, np.nan, x)[kept] for name, x in imu.values.items()}
    found = vibration([Channels("imu", imu.time[kept], force), esc])
    for windows in (found.rough, found.turning):
        assert not np.any((windows.time > 30.0) & (windows.time < 35.0) | (windows.time >= 80.0))
        assert len(windows.time) * windows.length == pytest.approx(75.0, abs=3.0)
    assert level(found.turning) == pytest.approx(SHAKES, rel=0.1)


def test_accelerations_that_are_too_slow_and_rotors_that_stand_tell_nothing() -> None:
    slow = vibration(shaken(np.random.default_rng(4), rate=200.0))
    assert slow.turning is None
    assert re.fullmatch(r"accelerations at 200 Hz do not show what turns 11\d times a second", slow.absent)
    imu, esc = shaken(np.random.default_rng(4))
    still = esc.values["rotor_1"] * 0.0
    standing = Channels("esc", esc.time, {"rotor_1": still, "rotor_2": still * np.nan})
    assert vibration([imu, standing]).absent == "no speeds of rotors"
    assert vibration([esc]).absent == "no accelerations at 40 Hz"


MAPPING = """
group.force = { variables = ["ax", "ay", "az"], unit = "m/s2", sources = [{columns = ["ax", "ay", "az"]}] }
group.rotors = { variables = ["rotor_{1..4}"], unit = "rad/s", sources = [{columns = "rotor_{1..4}"}] }
[variables]
""" + "".join(f'motor_{i} = {{column = "motor", unit = "1"}}\n' for i in range(1, 5))


def test_a_log_has_the_vibration_of_its_rotors_by_their_names(tmp_path: Path) -> None:
    imu, esc = shaken(np.random.default_rng(5))
    speeds = {name: np.interp(imu.time, esc.time, x) for name, x in esc.values.items()}
    log, mapping = tmp_path / "log.csv", tmp_path / "m.toml"
    pd.DataFrame({"time": imu.time, **imu.values, **speeds, "motor": 0.5}).to_csv(log, index=False)
    mapping.write_text(MAPPING)
    (run,) = plan([log], "quad-x", mapping, None, tmp_path / "store").campaign.runs
    (found,) = read({**run.arguments, **run.places}, [])
    assert isinstance(found, dict)
    rows = {name: (value, error, parts) for name, value, error, parts, _ in found["figures"]}
    names = [f"vibration.m{n}" for n in range(1, 5)]
    assert set(rows) == {*names, "vibration.ax", "vibration.ay", "vibration.az"}
    values, _, parts = zip(*(rows[name] for name in names), strict=True)
    assert parts == ("m1", "m2", "m3", "m4")
    assert np.exp(values) == pytest.approx(SHAKES, rel=0.15)
    assert rows["vibration.az"][0] == pytest.approx(np.log(NOISE * 1.5**0.5), abs=0.02)
