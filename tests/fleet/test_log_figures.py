"""Figures of a flight: errors that hold, priors taken off, and reasons where a flight cannot tell."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from stoop.base.arrays import FloatArray
from stoop.errors import FlightError
from stoop.flight import Flight, from_columns
from stoop.flight.flight import AirData
from stoop.flight.gridding import Channels
from stoop.reconstruction.compatibility import Compatibility, Consistency, InstrumentError, Trace
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import load_maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.extensions import with_free_number
from stoop_analysis.performance.effectiveness import Balance
from stoop_fleet import log_figures
from stoop_fleet.log_figures import FlightFigure, command_delay, conditions, figures_of, groups
from stoop_fleet.vibration import NO_VIBRATION, vibration

RATE, SECONDS, RESISTANCE = 20.0, 240.0, 0.05
GROUPS, PLANE = groups(NO_VIBRATION), builtin_vehicle("twin-boom")
MANEUVER = Path(__file__).parents[2] / "examples" / "maneuver_3211.toml"


def told(group: str, flight: Flight, vehicle: Vehicle | None = None) -> dict[str, FlightFigure]:
    """Return the figures of a group by name; the reason for others is left alone."""
    found: dict[str, FlightFigure] = {}
    with suppress(FlightError):
        found.update((one.name, one) for one in GROUPS[group].evaluate(flight, vehicle))
    return found


def drawn(rng: np.random.Generator) -> Flight:
    time = np.arange(0.0, SECONDS, 1.0 / RATE)

    def colored(pole: float) -> FloatArray:
        return np.asarray(lfilter([1.0], [1.0, -pole], rng.standard_normal(time.size)) * np.sqrt(1 - pole**2))

    current = 15.0 + 3.0 * colored(np.exp(-1.0 / (RATE * 2.0)))
    charge = 16.8 - 0.006 * time - 2e-6 * time**2
    voltage = charge - RESISTANCE * current + 0.05 * colored(np.exp(-1.0 / (RATE * 3.0)))
    return from_columns("f", time, {"voltage": voltage, "current": current})


def test_the_resistance_of_a_battery_with_an_error_that_holds() -> None:
    rng = np.random.default_rng(0)
    found = [told("battery", drawn(rng))["battery.resistance"] for _ in range(100)]
    ratios = np.array([(one.value - RESISTANCE) / one.std_error for one in found])
    assert np.sqrt(np.mean(ratios**2)) == pytest.approx(1.0, abs=0.35)
    assert np.mean(np.abs(ratios) < 1.96) > 0.85


def test_what_a_flight_cannot_tell_is_absent_with_the_reason() -> None:
    flight = drawn(np.random.default_rng(1))
    found, absent = figures_of(flight, builtin_vehicle("quad-x"))
    assert [(one.name, one.parts) for one in found] == [("battery.resistance", "battery")]
    assert set(absent) == set(GROUPS) - {"battery"}
    t, columns = flight.time, {name: flight.column(name) for name in ("voltage", "current")}
    still = from_columns("f", t, columns | {"current": np.ones(t.size)})
    short = from_columns("f", t[:100], {name: x[:100] for name, x in columns.items()})
    assert figures_of(still)[1]["battery"] == "the current hardly changed"
    assert "of more than 30 s are needed" in figures_of(short)[1]["battery"]
    assert figures_of(flight)[1]["rotors"] == "no vehicle with rotors was given"
    held = glide(np.random.default_rng(0), rudder=np.full(round(300.0 * RATE), 0.02))
    found, absent = figures_of(held, PLANE)
    assert {one.name for one in found} >= {"trim.elevator", "trim_slope.elevator", "trim.alpha"}
    assert absent["rest of trims"] == "not determined: trim.rudder", "it never moved"
    assert absent["hover"].startswith("no commands of motors")


ERROR = InstrumentError(0.0, 1.0, 0.0, 1.0, 0.0, 1.0, True, "", "1", "")


def test_the_prior_of_an_instrument_error_is_taken_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the reading, 0.02 with an error of 0.03, had stood alone; what no reading told has no figure."""
    precisions = 0.03**-2.0, 0.04**-2.0
    mean, error = (1.02 * precisions[0] + precisions[1]) / sum(precisions), sum(precisions) ** -0.5
    scale = replace(ERROR, estimate=mean, std_error=error, prior_mean=1.0, prior_std=0.04)
    bias = replace(ERROR, estimate=0.0, std_error=0.03, prior_mean=0.0, prior_std=0.03, unit="rad/s")
    checked = SimpleNamespace(findings={"V.scale": scale, "p.bias": bias}, channels={})
    monkeypatch.setattr(log_figures.Compatibility, "of", lambda flight: (checked, None))
    flight = drawn(np.random.default_rng(0))
    (one,) = told("instruments", flight).values()
    assert (one.name, one.parts) == ("V.scale", "pitot")
    assert figures_of(flight)[1]["rest of instruments"] == "not determined: p.bias"
    assert (one.value, one.std_error) == pytest.approx((1.02, 0.03))


@pytest.mark.parametrize(("gusts", "grows"), [(0.1, 1.1), (1.0, np.inf)])
def test_the_error_of_a_scale_reaches_to_the_reverse_regression(gusts: float, grows: float) -> None:
    """Of a vane that reads gusts, which the reconstruction does not know; the regression on it is too flat."""
    rng, time = np.random.default_rng(2), np.arange(0.0, 100.0, 0.01)
    alpha = 0.1 + 0.05 * rng.standard_normal(time.size)
    known = alpha + 0.05 * gusts * rng.standard_normal(time.size)
    vane = alpha + 0.005 * rng.standard_normal(time.size)
    slope, level = np.polyfit(known, vane, 1)
    read = level + slope * known
    channels = {"alpha": Consistency(float(np.std(vane - read)), float(np.std(vane)), "rad")}
    traces = (Trace(time, {"alpha": vane}, {"alpha": read}),)
    bare = {"alpha.scale": slope, "alpha.bias": level}
    findings = {name: replace(ERROR, estimate=x, std_error=0.05) for name, x in bare.items()}
    checked = Compatibility("f", findings, channels, traces, ())
    scale, bias = (log_figures.with_attenuation(checked, name) for name in findings)
    reverse = 1.0 / np.polyfit(vane, known, 1)[0]
    assert np.hypot(0.05, reverse - slope) == pytest.approx(scale.std_error, rel=1e-3)
    assert scale.std_error <= 0.05 * grows
    assert abs(scale.estimate - 1.0) < scale.std_error
    assert abs(bias.estimate) < bias.std_error


def hovering(rng: np.random.Generator, slope: float) -> Flight:
    balance, time = Balance(builtin_vehicle("quad-x")), np.arange(0.0, 300.0, 1.0 / RATE)
    commands = np.linspace(0.2, 1.0, 500)
    lifts = balance.of_thrust[0] @ balance.drive({f"motor_{i}": commands for i in range(1, 5)})[0]
    charge = 16.0 - 2.0 * time / time[-1]
    effort = lfilter([0.3], [1.0, -0.95], rng.standard_normal(time.size))
    lift = 12.0 + slope * (charge - 15.0) + 0.1 * effort
    command = np.interp(lift, lifts, commands)
    columns = {"voltage": charge - 0.02 * effort} | {f"motor_{i}": command for i in range(1, 5)}
    return from_columns("f", time, columns)


def test_lift_over_the_voltage_of_the_charge_with_an_error_that_holds() -> None:
    """A regression on the measured voltage, which sags under thrust, would be off."""
    rng, ratios = np.random.default_rng(0), []
    for _ in range(40):
        found = told("rotors", hovering(rng, -0.3), builtin_vehicle("quad-x"))
        slope = found["hover.voltage_slope"]
        assert slope.parts == "m1 m2 m3 m4 battery"
        assert found["hover.lift"].value == pytest.approx(12.0, abs=0.05)
        ratios.append((slope.value + 0.3) / slope.std_error)
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.35)
    flight = hovering(rng, 0.0)
    (one,) = told("hover", flight).values()  # needs no vehicle
    assert one.value == pytest.approx(flight.column("motor_1").mean(), rel=0.01)


MASS, AREA, SPEED, DENSITY = 189.40, 2.8667, 35.0, 1.20165  #: of the built-in airplane
LEVEL = MASS * 9.80665 / (0.5 * DENSITY * SPEED**2 * AREA)  #: lift coefficient at the reference


def glide(rng: Any, noise: float = 0.02, swing: float = 4.0, mass: float = MASS, **others: Any) -> Flight:
    time = np.arange(0.0, 300.0, 1.0 / RATE)
    V = SPEED + swing * np.sin(0.05 * time)
    pressure_area = 0.5 * DENSITY * V**2 * AREA
    CL = mass * 9.80665 / pressure_area
    falling = (0.05 + 0.06 * CL**2) * pressure_area / (mass * 9.80665) * V
    energy = 3000.0 - np.concatenate([[0.0], np.cumsum(0.5 * (falling[1:] + falling[:-1])) / RATE])
    alpha = -0.08 + CL / 4.8
    columns = {"V": V, "alpha": alpha, "ax": 9.80665 * np.sin(alpha), "az": -9.80665 * np.cos(alpha),
               "altitude": energy - V**2 / (2.0 * 9.80665), "throttle": np.where(time < 10.0, 0.5, 0.0),
               "density": np.full(time.size, DENSITY), "elevator": 0.01 - 0.3 * (CL - LEVEL)}  # fmt: skip
    for name in ("alpha", "elevator"):
        columns[name] = columns[name] + noise * lfilter([0.3], [1.0, -0.9], rng.standard_normal(time.size))
    return from_columns("f", time, columns | others)


def test_trims_are_those_at_the_airspeed_of_reference_with_errors_that_hold() -> None:
    rng, ratios = np.random.default_rng(0), []
    truth = {"trim.elevator": 0.01, "trim.alpha": -0.08 + LEVEL / 4.8}
    slopes = {"trim_slope.elevator": -0.3 * LEVEL, "trim_slope.alpha": LEVEL / 4.8}
    for _ in range(60):
        found = told("trims", glide(rng), PLANE)
        assert [found[name].parts for name in truth] == ["elevator pitot", "vanes pitot"]
        ratios += [(found[name].value - true) / found[name].std_error for name, true in truth.items()]
        assert all(abs(found[n].value - true) < 3.0 * found[n].std_error for n, true in slopes.items())
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.3)


def test_the_drag_coefficient_is_that_of_level_flight_at_the_airspeed_of_reference() -> None:
    (one,) = told("drag", glide(rng := np.random.default_rng(0)), PLANE).values()
    assert one.value == pytest.approx(0.05 + 0.06 * LEVEL**2, rel=0.01)
    assert (one.std_error < 0.05 * one.value, one.parts) == (True, "pitot vanes")
    assert figures_of(glide(rng), PLANE)[1]["rest of drag"].startswith("flown at lift coefficients from 0.")
    points = told("drag", glide(rng, noise=0.005, swing=13.0), PLANE)
    for name, over in (("drag.CD_slow", 0.8), ("drag.CD", 1.0), ("drag.CD_fast", 1.3)):
        assert points[name].value == pytest.approx(0.05 + 0.06 * (LEVEL / over**2) ** 2, rel=0.02)


def test_a_flight_of_another_mass_has_the_same_drag_and_trims_at_the_same_lift_coefficient() -> None:
    flight = glide(np.random.default_rng(0), 0.002, mass=1.1 * MASS)
    vehicle = PLANE.with_numbers({"mass.mass": {"value": 1.1 * MASS}})
    figures = told("drag", flight, vehicle) | told("trims", flight, vehicle)
    assert figures["drag.CD"].value == pytest.approx(0.05 + 0.06 * LEVEL**2, rel=0.01)
    trims = [figures[name].value for name in ("trim.alpha", "trim.elevator")]
    assert trims == pytest.approx([-0.08 + LEVEL / 4.8, 0.01], abs=0.002)


def test_a_rougher_ride_is_a_larger_vibration() -> None:
    rng, time = np.random.default_rng(0), np.arange(0.0, 120.0, 0.01)
    shakes, values = 0.5 * rng.standard_normal(time.size), []
    for factor in (1.0, 1.1):
        flight = from_columns("f", time, {"az": np.sin(time) + factor * shakes})
        shaken = vibration([Channels("imu", time, {"az": flight.column("az")})])
        (one,) = groups(shaken)["vibration"].evaluate(flight, None)
        values.append(one.value)
    assert one.name == "vibration.az"
    assert values[1] - values[0] == pytest.approx(np.log(1.1), abs=0.01)
    assert one.std_error == pytest.approx(0.01, rel=0.5), "of 120 blocks of 100 readings"


def test_conditions_that_were_not_logged_follow_from_others() -> None:
    def of(**columns: float) -> Flight:
        return from_columns("f", np.arange(0.0, 10.0, 0.1), {n: np.full(100, x) for n, x in columns.items()})

    flight = of(pressure=95e3, temperature=300.0)
    assert conditions(of(wind_n=3.0, wind_e=4.0)) == {"wind": 5.0}
    air = AirData("pitot", wind_n=3.0, wind_e=4.0, wind_n_std=0.5, wind_e_std=0.5)
    weather = {"density": 95e3 / (287.05287 * 300.0), "temperature": 300.0}
    assert conditions(flight) == pytest.approx(weather)
    assert conditions(replace(flight, air=air)) == pytest.approx({**weather, "wind": 5.0})
    assert "wind" not in conditions(replace(flight, air=replace(air, wind_e_std=5.0))), "hardly known"


def test_the_numbers_of_the_vehicle_are_those_that_flew() -> None:
    found = told("parameters", simulate_flight(PLANE, load_maneuver(MANEUVER), seed=1), PLANE)
    found.pop("delay.commands", None)
    ratios = [(one.value - PLANE.value(name)) / one.std_error for name, one in found.items()]
    assert {"CLalpha", "Cmalpha", "Cmq"} <= found.keys()
    assert np.mean(np.abs(ratios) < 3.0) > 0.8


def test_the_delay_of_commands_is_that_which_flew() -> None:
    flown = PLANE
    for name in (f"controls.{control}.delay" for control in PLANE.controls):
        flown = with_free_number(flown, name)[0].with_numbers({name: {"value": 0.05}})
    flight = simulate_flight(flown, load_maneuver(MANEUVER), seed=1)
    one = command_delay(PLANE, {flight.name: flight}, [f"{flight.name}@0.5:25"])
    assert one.value == pytest.approx(0.05, abs=4.0 * one.std_error)
    assert (one.std_error < 0.003, one.parts) == (True, "elevator aileron rudder software")
