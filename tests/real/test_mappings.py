"""Mappings on real logs: ready ones against physics, drafts against the ready ones, clocks against a known shift."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stoop.flight import load
from stoop.flight.mapping_draft import draft_of
from stoop.logs import read


def test_crazyflie(shared_data: Path) -> None:
    """Velocity is the derivative of position, acceleration that of velocity; hover needs 44.4 to 44.8 thousand of 65535."""
    flight = load(shared_data / "crazypad-propeller-damage" / "normal_flight__E8_log00.usd")
    for rate, place in (("ve", "pe"), ("vd", "pd")):  # it hardly moves north
        moved = flight.column(place)[20:] - flight.column(place)[:-20]
        said = np.convolve(flight.column(rate), np.full(21, 0.01))[20:-20]
        assert np.corrcoef(moved, said)[0, 1] > 0.9, rate
    change = np.gradient(flight.column("vd"), flight.time)
    assert np.corrcoef(change, flight.column("ad"))[0, 1] > 0.7
    airborne = flight.column("pd") < -0.3
    assert np.median(flight.column("motor_3")[airborne]) * 65.535 == pytest.approx(44.6, abs=0.5)
    assert 3.0 < flight.column("voltage").min() < flight.column("voltage").max() < 4.3
    assert list(flight.unmapped) == ["fixedFrequency"]


def test_ardupilot(shared_data: Path) -> None:
    """The vehicle stands, leaning on its wing: gravity must point as the attitude says."""
    flight = load(shared_data / "ardupilot-dataflash-sample" / "test.BIN")
    force = np.array([np.nanmedian(flight.column(name)) for name in ("ax", "ay", "az")])
    assert np.linalg.norm(force) == pytest.approx(9.81, rel=0.02)
    phi, theta = (float(np.nanmedian(flight.column(name))) for name in ("phi", "theta"))
    assert np.arctan2(-force[1], -force[2]) == pytest.approx(phi, abs=0.06)
    assert np.arcsin(force[0] / np.linalg.norm(force)) == pytest.approx(theta, abs=0.03)
    assert flight.faults == ()
    assert np.nanmedian(flight.column("pwm_3")) == 1100.0
    assert flight.unmapped["MAG"] == ()


def test_drafts_find_what_the_ready_mapping_takes(shared_data: Path) -> None:
    """The same log without its name: every line without a doubt must be right."""
    log = read(shared_data / "altlnt-vtail-8kg-px4" / "flight2")
    names = ("vehicle_attitude", "sensor_combined", "airspeed", "battery_status", "vehicle_air_data")
    made = draft_of(replace(log, format="mat", streams={name: log.streams[name] for name in names}))
    lines = tomllib.loads(made.text)["variables"]
    right = {
        "q": ("gyro_rad[1]", "rad/s"), "az": ("accelerometer_m_s2[2]", "m/s2"), "q0": ("q[0]", "1"),
        "V": ("true_airspeed_m_s", "m/s"), "density": ("rho", "kg/m3"), "voltage": ("voltage_v", "V"),
    }  # fmt: skip
    assert {name: (lines[name]["column"], lines[name]["unit"]) for name in right} == right
    assert not any("scale" in lines[name] for name in right)
