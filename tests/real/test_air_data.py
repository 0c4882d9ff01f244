"""Air data reconstructed from real flights without vanes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop.flight.flight import AirData, Flight
from stoop.flight.load import load


@pytest.fixture(scope="session")
def vtail(vtail_flight: Flight) -> Flight:
    """Flight whose pitot reads -3 m/s at rest and 5 to 6 m/s low in flight (SOURCE.md)."""
    return vtail_flight


@pytest.fixture(scope="module")
def air(vtail: Flight) -> AirData:
    assert vtail.air is not None
    return vtail.air


def window(
    flight: Flight, start: float, stop: float, *names: str
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    columns = np.column_stack([flight.column(name) for name in names])
    keep = (flight.time >= start) & (flight.time <= stop) & np.isfinite(columns).all(axis=1)
    return columns[keep]


def test_pitot_fault_is_found_at_rest_and_in_flight(air: AirData) -> None:
    assert air.rest_offset == pytest.approx(-3.0, abs=0.1)
    low = 24.0 - (24.0 / air.pitot_scale + air.pitot_offset)
    assert 5.0 < low < 6.0
    assert {found.code for found in air.notices} >= {"pitot-pressure-offset", "pitot-offset-inconsistent"}


def test_wind_is_found_by_the_pitot_and_confirmed_by_the_sideslip(air: AirData) -> None:
    assert air.method == "pitot"
    assert np.hypot(air.wind_n, air.wind_e) == pytest.approx(3.5, abs=0.5)
    assert max(air.wind_n_std, air.wind_e_std) < 0.3
    assert "sideslip-wind-agrees" in {found.code for found in air.notices}


def test_velocity_heading_and_accelerometers_are_consistent(air: AirData) -> None:
    assert abs(air.velocity_delay) < 0.005
    assert abs(np.degrees(air.heading_error)) < 1.0
    assert np.max(np.abs(air.accelerometer_bias)) < 0.2


def test_lateral_force_is_a_straight_line_in_sideslip(vtail: Flight) -> None:
    """Roll doublet of 140 to 145 s: nothing of a_y went into beta at these frequencies but its integral."""
    ay, beta, speed = window(vtail, 140.0, 145.0, "ay", "beta", "V").T
    coefficient = 2.0 * 8.5 * ay / (1.17 * speed**2 * 0.66)
    assert np.corrcoef(coefficient, beta)[0, 1] < -0.98
    assert -0.7 < np.polyfit(beta, coefficient, 1)[0] < -0.45


def test_normal_force_is_a_straight_line_in_alpha(vtail: Flight) -> None:
    """Pitch doublet of 146 to 152 s."""
    az, alpha, speed = window(vtail, 146.0, 152.0, "az", "alpha", "V").T
    coefficient = -2.0 * 8.5 * az / (1.17 * speed**2 * 0.66)
    assert np.corrcoef(coefficient, alpha)[0, 1] > 0.97


def test_holes_of_the_log_stay_holes(vtail: Flight) -> None:
    hole = (vtail.time > 145.1) & (vtail.time < 145.9)
    assert np.isnan(vtail.column("beta")[hole]).all()


def test_a_healthy_pitot_is_left_healthy(shared_data: Path) -> None:
    """Solar Surfer: another airplane, another autopilot version, published as usable."""
    air = load(shared_data / "mit-solar-surfer-px4csv").air
    assert air is not None
    assert air.method == "pitot"
    assert abs(air.pitot_scale - 1.0) < 2.5 * air.pitot_scale_std
    assert abs(air.pitot_offset) < 2.5 * air.pitot_offset_std
    assert "sideslip-wind-agrees" in {found.code for found in air.notices}


def test_a_hexacopter_has_no_wing_that_tells_the_wind(shared_data: Path) -> None:
    mapping = Path(__file__).parents[2] / "examples" / "hexacopter_mapping.toml"
    flight = load(shared_data / "altlnt-hexacopter-px4", mapping)
    assert not {"V", "alpha", "beta"} & set(flight.data.data_vars)
    assert not any("wind" in str(found) or "air data" in str(found) for found in flight.notices)
