"""Compatibility of a real flight without vanes, whose pitot is at fault (SOURCE.md)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop.flight import Flight, load
from stoop.reconstruction.compatibility import Compatibility
from stoop.workflow.reconstruction import check_compatibility, write_compatibility

Checked = tuple[Compatibility, Flight, Flight]


@pytest.fixture(scope="module")
def checked(vtail_flight: Flight) -> Checked:
    windows = [(140.0, 152.0), (156.0, 172.0), (186.0, 200.0)]
    return (*check_compatibility(vtail_flight, windows), vtail_flight)


def test_the_pitot_fault_is_found_by_the_kinematics_alone(checked: Checked) -> None:
    """About 5 to 6 m/s below the true airspeed in flight (SOURCE.md)."""
    found = checked[0].findings
    reading = found["airspeed_pitot.scale"].estimate * 24.0 + found["airspeed_pitot.bias"].estimate
    assert 4.5 < 24.0 - reading < 6.5


def test_the_wind_agrees_with_the_reconstruction_of_the_whole_flight(checked: Checked) -> None:
    result, _, flight = checked
    assert flight.air is not None
    for axis, whole in (("n", flight.air.wind_n), ("e", flight.air.wind_e)):
        one = result.findings[f"wind.{axis}"]
        assert one.estimate == pytest.approx(whole, abs=4.0 * one.std_error)
    assert "winds-agree" in {found.code for found in result.notices}


def test_an_autopilot_s_navigation_is_consistent(checked: Checked) -> None:
    result = checked[0]
    assert not any("inconsistent" in found.code for found in result.notices)
    for name, limit in (("phi", 0.02), ("theta", 0.02), ("vn", 0.3), ("ve", 0.3), ("vd", 0.3)):
        assert result.channels[name].rms < limit
        assert result.channels[name].rms < 0.2 * result.channels[name].movement


def test_the_corrected_flight_can_be_written_and_read(checked: Checked, tmp_path: Path) -> None:
    result, corrected, flight = checked
    write_compatibility(result, flight, corrected, tmp_path, "stoop compatibility")
    again = load(tmp_path / "flight.nc")
    assert again.air is not None
    reading = 24.0 / again.air.pitot_scale + again.air.pitot_offset
    assert reading == pytest.approx(24.0, abs=1.0)
    for name in ("p", "phi", "ax", "V"):
        assert np.array_equal(again.column(name), corrected.column(name), equal_nan=True)
    assert "<h1>Data compatibility" in (tmp_path / "compatibility.html").read_text()


def test_a_turned_sign_is_inconsistent(checked: Checked) -> None:
    flight = checked[2]
    wrong = flight.data.assign(q=("time", -flight.column("q")))
    import dataclasses

    result, _ = check_compatibility(dataclasses.replace(flight, data=wrong), [(140.0, 152.0)])
    assert "attitude-inconsistent" in {found.code for found in result.notices}
