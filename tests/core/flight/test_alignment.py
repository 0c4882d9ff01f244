"""Clocks that disagree: a known shift must come back, to a fraction of a sample, with an honest error."""

from pathlib import Path

import numpy as np
import pytest
from helpers.made_logs import CLOCK, body_rates, csv_log

from stoop.base.arrays import FloatArray
from stoop.errors import FlightError, LogError
from stoop.flight import load_flight
from stoop.flight.alignment import Lag, attitude_delay, find_lag, quantities, with_drift
from stoop.flight.gridding import Channels
from stoop.flight.mapping import FlightMapping
from stoop_plan.log_bytes import Topic, ulog

RNG = np.random.default_rng(7)
TONES = [*zip(RNG.normal(size=12), RNG.uniform(0.1, 2.0, 12), RNG.uniform(0, 6.28, 12), strict=True)]
MAPPING = CLOCK + 'r = {stream = "autopilot.csv", column = "gz", unit = "rad/s"}\n'
MAPPING += 'psi = {stream = "mocap.csv", column = "yaw", unit = "deg"}\n'
ALIGN = '[align."mocap.csv"]\nwith = "autopilot.csv"\n'


def heading(t: FloatArray) -> FloatArray:
    return np.sum([0.1 * a * np.sin(6.2832 * f * t + p) for a, f, p in TONES], axis=0)


def yaw_rate(t: FloatArray) -> FloatArray:
    return np.sum([0.1 * a * 6.2832 * f * np.cos(6.2832 * f * t + p) for a, f, p in TONES], axis=0)


def lag_of(shift: float, noise: float = 0.0, rate: float = 50.0, seed: int = 0, drift: float = 0.0) -> Lag:
    rng = np.random.default_rng(seed)
    t, s = np.arange(0.0, 60.0, 0.01), np.arange(5.0, 55.0, 1.0 / rate)
    fixed = yaw_rate(t) + noise * rng.normal(size=t.size)
    psi = heading(s) + 0.1 * noise * rng.normal(size=s.size)
    clock = s - shift - drift * (s - 30.0)
    moving = quantities([Channels("m", clock, {"psi": psi})])
    reference = quantities([Channels("r", t, {"r": fixed})])
    found = find_lag(moving, reference)
    return with_drift(found, moving, reference) if drift else found


@pytest.mark.parametrize("shift", [0.0, 3.21, -2.4567, 1.0e6 + 0.123])
def test_a_shift_comes_back_to_a_fraction_of_a_sample(shift: float) -> None:
    found = lag_of(shift)
    assert found.shift == pytest.approx(shift, abs=5e-4)
    assert found.correlation > 0.99
    assert found.trusted
    assert found.using == ("psi_dot",)
    assert lag_of(shift, rate=12.0).shift == pytest.approx(shift, abs=0.004)


def test_the_error_is_as_large_as_it_says() -> None:
    found = [lag_of(0.1234, noise=0.3, seed=seed) for seed in range(20)]
    misses = np.array([(lag.shift - 0.1234) / lag.sigma for lag in found])
    assert 0.3 < np.sqrt(np.mean(misses**2)) < 2.0
    assert max(abs(lag.shift - 0.1234) for lag in found) < 0.03


def test_noise_and_a_pure_tone_are_not_trusted() -> None:
    """A sine fits as well one period later."""
    rng, t = np.random.default_rng(3), np.arange(0.0, 60.0, 0.01)
    found = find_lag({"r": (t, rng.normal(size=t.size))}, {"r": (t, rng.normal(size=t.size))})
    assert found is None or not found.trusted
    found = find_lag({"r": (t, np.sin(3.0 * t))}, {"r": (t, np.sin(3.0 * t + 0.5))})
    assert found.rival > 0.95
    assert not found.trusted


def test_a_clock_that_runs_away() -> None:
    found = lag_of(2.0, noise=0.05, drift=1e-3)
    assert found.drift == pytest.approx(1e-3, abs=2e-4)
    clock = np.array([10.0, 50.0])
    truth = (clock + 2.0 - 30e-3) / (1 - 1e-3)
    np.testing.assert_allclose(found.moved(clock), truth, atol=0.01)


def test_holes_do_not_count_and_the_largest_shift_is_kept_to() -> None:
    t = np.arange(0.0, 60.0, 0.01)
    kept = (t < 20.0) | (t > 31.7)
    found = find_lag({"r": (t[kept] - 0.5, yaw_rate(t[kept]))}, {"r": (t, yaw_rate(t))})
    assert found.shift == pytest.approx(0.5, abs=1e-3)
    assert found.correlation > 0.98
    moving, fixed = {"r": (t - 8.0, yaw_rate(t))}, {"r": (t, yaw_rate(t))}
    near, far = find_lag(moving, fixed, 2.0), find_lag(moving, fixed, 10.0)
    assert abs(near.shift) <= 2.0
    assert far.shift == pytest.approx(8.0, abs=1e-3)
    for samples in (3, 300):
        brief = {"r": (t[:samples], yaw_rate(t[:samples]))}
        assert find_lag(brief, brief) is None


def test_attitudes_tell_the_rates_and_velocities_the_load() -> None:
    t = np.arange(0.0, 10.0, 0.002)
    phi, theta, psi = 0.5 * np.sin(t), 0.3 * np.cos(1.3 * t), 0.7 * t
    dphi, dtheta, dpsi = 0.5 * np.cos(t), -0.39 * np.sin(1.3 * t), 0.7 + 0 * t
    p, q, r = body_rates(phi, theta, dphi, dtheta, dpsi)
    truth = {"p": p, "q": q, "r": r, "psi_dot": dpsi, "turning": np.sqrt(p**2 + q**2 + r**2)}
    found = quantities([Channels("a", t, {"phi": phi, "theta": theta, "psi": psi})])
    for name, rate in truth.items():
        np.testing.assert_allclose(found[name][1][2:-2], rate[2:-2], atol=2e-5)
    t = np.arange(0.0, 10.0, 0.01)
    told = quantities([Channels("v", t, {"pn": np.sin(t), "vn": np.cos(t), "ve": 0 * t, "vd": 2.0 * t})])
    np.testing.assert_allclose(told["load"][1][2:-2], np.hypot(np.sin(t), 7.80665)[2:-2], atol=1e-3)
    assert quantities([Channels("h", t, {"altitude": 3.0 * t})])["vd"][1] == pytest.approx(-3.0)


def test_mistakes() -> None:
    for entry, words in (
        ({"with": "a", "gain": 1}, r"align\.m\.gain: unknown key"),
        ({}, r"align\.m\.with: missing"),
        ({"with": "m"}, "cannot be aligned with itself"),
        ({"with": "a", "using": ["yaw"]}, r"align\.m\.using\.0: it must be 'p', 'q', 'r'"),
        ({"with": "a", "longest": -1}, r"align\.m\.longest: it must be greater than 0"),
        ("a", r"align\.m: this must be a table"),
    ):
        with pytest.raises(LogError, match=words):
            FlightMapping.parse("m.toml", {"extends": "px4", "align": {"m": entry}})


def test_from_two_files_to_one_clock(tmp_path: Path) -> None:
    t, s = np.arange(0.0, 60.0, 0.01), np.arange(0.0, 40.0, 0.02)
    csv_log(tmp_path / "autopilot.csv", {"t": t, "gz": yaw_rate(t)})
    csv_log(tmp_path / "mocap.csv", {"t": s, "yaw": np.degrees(heading(s + 7.4321))})
    mapping = tmp_path / "mapping.toml"
    mapping.write_text(MAPPING)
    (advice,) = (found for found in load_flight(tmp_path).notices if found.code == "clocks-disagree")
    sign = 1.0 if advice.values["reference"] == "mocap.csv" else -1.0
    assert advice.values["shift"] == pytest.approx(sign * 7.432, abs=5e-4)
    mapping.write_text(MAPPING + ALIGN)
    flight = load_flight(tmp_path)
    (found,) = (found for found in flight.notices if found.code == "clock-aligned")
    assert (found.subject, found.values["using"]) == ("mocap.csv", ("psi_dot",))
    assert found.values["shift"] == pytest.approx(7.4321, abs=1e-3)
    assert found.values["correlation"] == pytest.approx(1.0, abs=5e-3)
    inside = np.isfinite(flight.column("psi"))
    np.testing.assert_allclose(flight.column("psi")[inside], heading(flight.time[inside]), atol=2e-3)
    csv_log(tmp_path / "mocap.csv", {"t": s, "yaw": np.cumsum(np.random.default_rng(5).normal(size=s.size))})
    for text, words in (
        (MAPPING + ALIGN, "do not show the same motion"),
        (MAPPING.replace("psi =", "theta =") + ALIGN, r"nothing in common .* autopilot.csv holds r, psi_dot"),
        (MAPPING + ALIGN.replace('"mocap', '"film'), r"'film\.csv' is not in the log; it holds autopilot\.csv, mocap\.csv"),
    ):  # fmt: skip
        mapping.write_text(text)
        with pytest.raises(FlightError, match=words):
            load_flight(tmp_path)


def test_a_late_attitude_is_told() -> None:
    t, s = np.arange(0.0, 60.0, 0.005), np.arange(0.0, 60.0, 0.02)
    rates = Channels("gyro", t, {"p": 0 * t, "q": 0 * t, "r": yaw_rate(t)})
    parts = {"phi": 0 * s, "theta": 0 * s, "psi": heading(s)}
    (found,) = attitude_delay([rates, Channels("filter", s + 0.15, parts)])
    assert (found.code, found.subject, found.values["reference"]) == ("attitude-late", "filter", "gyro")
    assert found.values["delay"] == pytest.approx(0.15, abs=5e-4)
    assert attitude_delay([rates, Channels("filter", s, parts)]) == []
    assert attitude_delay([rates]) == []


def test_a_file_of_another_kind_beside_the_log(tmp_path: Path) -> None:
    t, s = np.arange(0.0, 60.0, 0.01), np.arange(0.0, 40.0, 0.02)
    (tmp_path / "f.ulg").write_bytes(ulog([Topic("data", t, {"gz": yaw_rate(t)})]))
    csv_log(tmp_path / "mocap.csv", {"ms": 1e3 * s, "yaw": np.degrees(heading(s + 3.7))})
    text = (
        '[files]\nmocap = "mocap.csv"\n[clock.mocap]\ncolumn = "ms"\nunit = "ms"\n[align.mocap]\nwith = "data"\n'
        '[variables]\nr = {stream = "data", column = "gz", unit = "rad/s"}\n'
        'psi = {stream = "mocap", column = "yaw", unit = "deg"}\n'
    )
    (tmp_path / "f.ulg.toml").write_text(text)
    flight = load_flight(tmp_path / "f.ulg")
    (found,) = (found for found in flight.notices if found.code == "clock-aligned")
    assert found.values["shift"] == pytest.approx(3.7, abs=5e-3)
    for wrong in ("film.csv", "../mocap.csv"):
        (tmp_path / "f.ulg.toml").write_text(text.replace("mocap.csv", wrong))
        with pytest.raises(LogError, match=r"files\.mocap = .* put it beside the log"):
            load_flight(tmp_path / "f.ulg")
