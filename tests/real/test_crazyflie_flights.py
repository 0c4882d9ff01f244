"""The 32 flights of Crazyflies with whole, cut and loaded propellers: read whole, checksums fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop.logs import read

FOLDER = "crazypad-propeller-damage"
HOVER = {
    "normal_flight__E8": (44.2e3, 44.8e3),
    "normal_flight__E9": (44.5e3, 46.8e3),
    "add_weight_W3": (60e3, 63e3),
}


def test_all_flights_are_read_whole(shared_data: Path) -> None:
    files = sorted((shared_data / FOLDER).glob("*.usd"))
    assert len(files) == 32
    for path in files:
        recording = read(path)
        assert recording.format == "crazyflie"
        assert recording.defects == ()
        assert recording.info["checksum"] == "fits"
        stream = recording.streams["fixedFrequency"]
        assert stream.period == pytest.approx(1.0 / 101.0, rel=0.02)
        assert 25.5 < stream.time[-1] - stream.time[0] < 26.0
        assert len(stream.columns) == 20
        assert 3000.0 < np.median(stream.columns["pm.vbatMV"]) < 4200.0


@pytest.mark.parametrize("condition", HOVER)
def test_hover_commands_as_stated_by_the_source(shared_data: Path, condition: str) -> None:
    for path in (shared_data / FOLDER).glob(f"{condition}*.usd"):
        columns = read(path).streams["fixedFrequency"].columns
        hover = float(np.mean(columns["motor.m3"][columns["stateEstimate.z"] > 0.5]))
        assert HOVER[condition][0] < hover < HOVER[condition][1]
