"""Figures of a flight: errors that hold, priors taken off, and reasons where a flight cannot tell."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from stoop.base.arrays import FloatArray
from stoop.fleet import log_figures
from stoop.fleet.log_figures import FlightFigure, conditions, figures_of, groups
from stoop.fleet.vibration import NO_VIBRATION, vibration
from stoop.flight import Flight, from_columns
from stoop.flight.gridding import Channels
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import load_maneuver
from stoop.vehicle.builtin import builtin_vehicle

RATE, SECONDS, RESISTANCE = 20.0, 240.0, 0.05
GROUPS = groups(NO_VIBRATION)


def drawn(rng: np.random.Generator) -> Flight:
    """Return a flight of a battery that is emptied, its readings correlated over seconds."""
    time = np.arange(0.0, SECONDS, 1.0 / RATE)

    def colored(pole: float) -> FloatArray:
        return np.asarray(lfilter([1.0], [1.0, -pole], rng.standard_normal(time.size)) * np.sqrt(1 - pole**2))

    current = 15.0 + 3.0 * colored(np.exp(-1.0 / (RATE * 2.0)))
    voltage = (
        16.8
        - 0.006 * time
        - 2e-6 * time**2
        - RESISTANCE * current
        + 0.05 * colored(np.exp(-1.0 / (RATE * 3.0)))
    )
    return from_columns("f", time, {"voltage": voltage, "current": current})


def resistance(flight: Flight) -> FlightFigure:
    (one,) = GROUPS["battery"].evaluate(flight, None)
    return one


def test_the_resistance_of_a_battery_with_an_error_that_holds() -> None:
    rng = np.random.default_rng(0)
    found = [resistance(drawn(rng)) for _ in range(100)]
    ratios = np.array([(one.value - RESISTANCE) / one.std_error for one in found])
    assert found[0].parts == "battery"
    assert np.sqrt(np.mean(ratios**2)) == pytest.approx(1.0, abs=0.35)
    assert np.mean(np.abs(ratios) < 1.96) > 0.85


def test_what_a_flight_cannot_tell_is_absent_with_the_reason() -> None:
    flight = drawn(np.random.default_rng(1))
    found, absent = figures_of(flight, builtin_vehicle("quad-x"))
    assert [one.name for one in found] == ["battery.resistance"]
    assert set(absent) == set(GROUPS) - {"battery"}
    still = from_columns(
        "f", flight.time, {"voltage": flight.column("voltage"), "current": np.ones(flight.time.size)}
    )
    assert figures_of(still)[1]["battery"] == "the current hardly changed"
    short = from_columns(
        "f", flight.time[:100], {name: flight.column(name)[:100] for name in ("voltage", "current")}
    )
    assert "of more than 30 s are needed" in figures_of(short)[1]["battery"]
    assert figures_of(flight)[1]["rotors"] == "no vehicle with rotors was given"


def test_the_prior_of_an_instrument_error_is_taken_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the reading, 0.02 with an error of 0.03, had stood alone; what no reading told has no figure."""
    precisions = 0.03**-2.0, 0.04**-2.0
    mean = 1.0 * precisions[1] + 1.02 * precisions[0]
    found = {
        "V.scale": SimpleNamespace(
            estimate=mean / sum(precisions), std_error=sum(precisions) ** -0.5, prior_mean=1.0, prior_std=0.04,
            identifiable=True, unit="1",
        ),
        "p.bias": SimpleNamespace(
            estimate=0.0, std_error=0.03, prior_mean=0.0, prior_std=0.03, identifiable=True, unit="rad/s"
        ),
    }  # fmt: skip
    monkeypatch.setattr(log_figures, "check", lambda flight: (SimpleNamespace(findings=found), None))
    (one,) = GROUPS["instruments"].evaluate(drawn(np.random.default_rng(0)), None)
    assert (one.name, one.parts) == ("V.scale", "pitot")
    assert one.value == pytest.approx(1.02)
    assert one.std_error == pytest.approx(0.03)


MASS, AREA, SPEED, DENSITY = 189.40, 2.8667, 35.0, 1.20165  #: of the built-in airplane


def glide(rng: np.random.Generator, noise: float = 0.02, mass: float = MASS) -> Flight:
    """Return a glide at a load factor of one, its polar and its trims known, the motor off."""
    time = np.arange(0.0, 300.0, 1.0 / RATE)
    V = SPEED + 4.0 * np.sin(0.05 * time)
    pressure_area = 0.5 * DENSITY * V**2 * AREA
    CL = mass * 9.80665 / pressure_area
    falling = (0.05 + 0.06 * CL**2) * pressure_area / (mass * 9.80665) * V
    energy = 3000.0 - np.concatenate([[0.0], np.cumsum(0.5 * (falling[1:] + falling[:-1])) / RATE])
    alpha = -0.08 + CL / 4.8
    ratio = 9.80665 * MASS / (0.5 * DENSITY * SPEED**2 * AREA)
    columns = {
        "V": V, "alpha": alpha, "ax": 9.80665 * np.sin(alpha), "az": -9.80665 * np.cos(alpha),
        "altitude": energy - V**2 / (2.0 * 9.80665), "throttle": np.where(time < 10.0, 0.5, 0.0),
        "density": np.full(time.size, DENSITY),
        "elevator": 0.01 - 0.3 * (CL - ratio),
    }  # fmt: skip
    for name in ("alpha", "elevator"):
        columns[name] = columns[name] + noise * lfilter([0.3], [1.0, -0.9], rng.standard_normal(time.size))
    return from_columns("f", time, columns)


def test_trims_are_those_at_the_airspeed_of_reference_with_errors_that_hold() -> None:
    rng, vehicle, ratios = np.random.default_rng(0), builtin_vehicle("twin-boom"), []
    level = MASS * 9.80665 / (0.5 * DENSITY * SPEED**2 * AREA)
    truth = {"trim.elevator": 0.01, "trim.alpha": -0.08 + level / 4.8}
    for _ in range(60):
        found = {one.name: one for one in GROUPS["trims"].evaluate(glide(rng), vehicle)}
        assert {name: found[name].parts for name in truth} == {
            "trim.elevator": "elevator pitot", "trim.alpha": "vanes pitot",
        }  # fmt: skip
        ratios += [(found[name].value - true) / found[name].std_error for name, true in truth.items()]
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.3)


def test_the_drag_coefficient_is_that_of_level_flight_at_the_airspeed_of_reference() -> None:
    rng, vehicle = np.random.default_rng(0), builtin_vehicle("twin-boom")
    level = MASS * 9.80665 / (0.5 * DENSITY * SPEED**2 * AREA)
    (one,) = GROUPS["drag"].evaluate(glide(rng), vehicle)
    assert one.value == pytest.approx(0.05 + 0.06 * level**2, rel=0.01)
    assert one.std_error < 0.05 * one.value
    assert one.parts == "pitot vanes"


def test_a_flight_of_another_mass_has_the_same_drag_and_trims_at_the_same_lift_coefficient() -> None:
    flight = glide(np.random.default_rng(0), 0.002, 1.3 * MASS)
    vehicle = builtin_vehicle("twin-boom").with_numbers({"mass.mass": {"value": 1.3 * MASS}})
    level = MASS * 9.80665 / (0.5 * DENSITY * SPEED**2 * AREA)
    found = {
        one.name: one.value for group in ("drag", "trims") for one in GROUPS[group].evaluate(flight, vehicle)
    }
    assert found["drag.CD"] == pytest.approx(0.05 + 0.06 * level**2, rel=0.01)
    assert found["trim.alpha"] == pytest.approx(-0.08 + level / 4.8, abs=0.002)
    assert found["trim.elevator"] == pytest.approx(0.01, abs=0.002)


def test_a_rougher_ride_is_a_larger_vibration() -> None:
    rng, time = np.random.default_rng(0), np.arange(0.0, 120.0, 0.01)
    shakes = 0.5 * rng.standard_normal(time.size)
    slow = np.sin(time)
    values = []
    for factor in (1.0, 1.1):
        flight = from_columns("f", time, {"az": slow + factor * shakes})
        shaken = vibration([Channels("imu", time, {"az": flight.column("az")})])
        (one,) = groups(shaken)["vibration"].evaluate(flight, None)
        values.append(one.value)
    assert one.name == "vibration.az"
    assert values[1] - values[0] == pytest.approx(np.log(1.1), abs=0.01)
    assert one.std_error == pytest.approx(0.01, rel=0.5), "of 120 blocks of 100 readings"


def test_wind_and_density_are_conditions() -> None:
    flight = from_columns(
        "f", np.arange(0.0, 10.0, 0.1), {"wind_n": np.full(100, 3.0), "wind_e": np.full(100, 4.0)}
    )
    assert conditions(flight) == {"wind": 5.0}


def test_the_numbers_of_the_vehicle_are_those_that_flew() -> None:
    vehicle, examples = builtin_vehicle("twin-boom"), Path(__file__).parents[3] / "examples"
    flight = simulate_flight(vehicle, load_maneuver(examples / "maneuver_3211.toml"), seed=1)
    found = list(GROUPS["parameters"].evaluate(flight, vehicle))
    ratios = [(one.value - vehicle.value(one.name)) / one.std_error for one in found]
    assert {"CLalpha", "Cmalpha", "Cmq"} <= {one.name for one in found}
    assert np.mean(np.abs(ratios) < 3.0) > 0.8
