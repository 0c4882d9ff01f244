"""Air data and compatibility of flights without vanes, on a simulated log whose truth is known and on real flights."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from real import simulated

from stoop.base.arrays import FloatArray
from stoop.flight import Flight, find_maneuvers, load
from stoop.flight.flight import AirData
from stoop.input_design.windows import find_windows
from stoop.reconstruction.compatibility import Compatibility
from stoop.workflow.reconstruction import check_compatibility, write_compatibility


def codes(flight: AirData | Compatibility) -> set[str]:
    return {found.code for found in flight.notices}


def air_of(flight: Flight) -> AirData:
    return flight.air  # type: ignore[return-value]


def check_pitot_and_wind(flight: Flight, low: tuple[float, float], wind: tuple[float, float]) -> None:
    """Check that the pitot is found to read low at 24 m/s by so much, and the wind, confirmed by the sideslip."""
    air = air_of(flight)
    assert air.rest_offset == pytest.approx(-3.0, abs=0.1)
    assert low[0] < 24.0 - (24.0 / air.pitot_scale + air.pitot_offset) < low[1]
    assert {"pitot-pressure-offset", "pitot-offset-inconsistent", "sideslip-wind-agrees"} <= codes(air)
    assert air.method == "pitot"
    assert np.hypot(air.wind_n - wind[0], air.wind_e - wind[1]) < 0.6
    assert max(air.wind_n_std, air.wind_e_std) < 0.3
    assert np.max(np.abs(air.accelerometer_bias)) < 0.2
    assert abs(np.degrees(air.heading_error)) < 2.0
    (fault,) = flight.faults
    assert (fault.kind, fault.variable) == ("offset at rest", "airspeed_pitot")
    assert fault.value == pytest.approx(-3.0, abs=0.1)


def check_windows(flight: Flight, flown: tuple[tuple[float, float], ...]) -> None:
    kept = [w for w in find_windows({flight.name: flight}).windows if w.accept]
    assert [w.axis for w in kept] == ["roll", "pitch", "yaw", "roll"]
    for window, (start, stop) in zip(kept, flown, strict=True):
        assert window.start == pytest.approx(start, abs=0.7)
        assert window.stop == pytest.approx(stop, abs=0.7)
    assert [w.axis for w in kept if w.use == "validate"] == ["roll"], "the axis that was flown twice"


def check_kinematics(flight: Flight, spans: list[tuple[float, float]], folder: Path) -> Compatibility:
    """Check the pitot, the wind and the navigation by kinematics alone, and a turned sign; the corrected flight is read again."""
    result, corrected = check_compatibility(flight, spans)
    air = air_of(flight)
    for axis, whole in (("n", air.wind_n), ("e", air.wind_e)):
        one = result.findings[f"wind.{axis}"]
        assert one.estimate == pytest.approx(whole, abs=4.0 * one.std_error)
    assert "winds-agree" in codes(result)
    assert not any("inconsistent" in code for code in codes(result))
    for name, limit in (("phi", 0.02), ("theta", 0.02), ("vn", 0.3), ("ve", 0.3), ("vd", 0.3)):
        assert result.channels[name].rms < min(limit, 0.2 * result.channels[name].movement)
    write_compatibility(result, flight, corrected, folder, "stoop compatibility")
    again = load(folder / "flight.nc")
    assert 24.0 / air_of(again).pitot_scale + air_of(again).pitot_offset == pytest.approx(24.0, abs=1.0)
    for name in ("p", "phi", "ax", "V"):
        assert np.array_equal(again.column(name), corrected.column(name), equal_nan=True)
    assert "<h1>Data compatibility" in (folder / "compatibility.html").read_text()
    wrong = flight.data.assign(q=("time", -flight.column("q")))
    turned, _ = check_compatibility(dataclasses.replace(flight, data=wrong), spans[:1])
    assert "attitude-inconsistent" in codes(turned)
    return result


def low_at_24(result: Compatibility) -> float:
    found = result.findings
    return 24.0 - found["airspeed_pitot.scale"].estimate * 24.0 - found["airspeed_pitot.bias"].estimate


def check_simulated_log(flight: Flight) -> None:
    low = 24.0 * (1.0 - simulated.SCALE) - simulated.OFFSET
    check_pitot_and_wind(flight, (low - 0.5, low + 0.5), simulated.WIND)
    check_windows(flight, ((146.6, 149.0), (152.4, 156.0), (159.4, 162.5), (167.5, 170.0)))
    hole = (flight.time > simulated.LOST[0][0]) & (flight.time < simulated.LOST[0][1])
    assert np.isnan(flight.column("beta")[hole]).all()
    assert any(found.values.get("kind") == "dropout" for found in flight.notices)


def test_compatibility_of_a_simulated_log(simulated_flight: Flight, tmp_path: Path) -> None:
    result = check_kinematics(simulated_flight, [(146.5, 158.0), (159.5, 166.0)], tmp_path)
    low = 24.0 * (1.0 - simulated.SCALE) - simulated.OFFSET
    assert low_at_24(result) == pytest.approx(low, abs=0.7)
    for name, truth in zip(("wind.n", "wind.e", "attitude.delay"), (*simulated.WIND, 0.0), strict=True):
        found = result.findings[name]
        assert abs(found.estimate - truth) < 4.0 * found.std_error, name


def test_pitot_and_wind_of_the_v_tail(vtail_flight: Flight) -> None:
    """Its pitot reads -3 m/s at rest and 5 to 6 m/s low in flight (SOURCE.md)."""
    check_pitot_and_wind(vtail_flight, (5.0, 6.0), (-1.2, -3.2))
    assert abs(air_of(vtail_flight).velocity_delay) < 0.005
    found = [(m.axis, round(m.start), round(m.stop)) for m in find_maneuvers(vtail_flight)]
    small = ("pitch", 160, 162)  # a quarter of the size of the other one
    assert found == [("roll", 140, 146), ("pitch", 146, 152), small, ("yaw", 162, 169), ("roll", 188, 195)]
    flown = ((140.5, 145.0), (146.0, 151.5), (161.6, 168.3), (188.1, 195.1))  # docs/vtail.md
    check_windows(vtail_flight, flown)


def test_forces_of_the_v_tail_are_straight_lines(vtail_flight: Flight) -> None:
    """In sideslip in the roll doublet, in angle of attack in the pitch doublet; beta holds only the integral of a_y."""

    def coefficient(start: float, stop: float, force: str, angle: str) -> tuple[FloatArray, FloatArray]:
        columns = np.column_stack([vtail_flight.column(name) for name in (force, angle, "V")])
        keep = (vtail_flight.time >= start) & (vtail_flight.time <= stop) & np.isfinite(columns).all(axis=1)
        a, x, speed = columns[keep].T
        return x, 2.0 * 8.5 * a / (1.17 * speed**2 * 0.66)

    beta, side = coefficient(140.0, 145.0, "ay", "beta")
    assert np.corrcoef(side, beta)[0, 1] < -0.98
    assert -0.7 < np.polyfit(beta, side, 1)[0] < -0.45
    alpha, normal = coefficient(146.0, 152.0, "az", "alpha")
    assert np.corrcoef(-normal, alpha)[0, 1] > 0.97


def test_compatibility_of_the_v_tail(vtail_flight: Flight, tmp_path: Path) -> None:
    spans = [(140.0, 152.0), (156.0, 172.0), (186.0, 200.0)]
    assert 4.5 < low_at_24(check_kinematics(vtail_flight, spans, tmp_path)) < 6.5


def test_a_healthy_pitot_is_left_healthy(shared_data: Path) -> None:
    """Solar Surfer: another airplane, another autopilot version, published as usable."""
    air = air_of(load(shared_data / "mit-solar-surfer-px4csv"))
    assert air.method == "pitot"
    assert abs(air.pitot_scale - 1.0) < 2.5 * air.pitot_scale_std
    assert abs(air.pitot_offset) < 2.5 * air.pitot_offset_std
    assert "sideslip-wind-agrees" in codes(air)
