"""Which pulses are motors: those of a copter, never those of a plane."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.flight import Flight, find_maneuvers, from_columns
from stoop.flight.airborne import carried_by_rotors, flying, lift_command, rotor_pulses
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import resolve_vehicle

INPUT = '[[input]]\ncontrol = "{}"\nshape = "doublet"\nstart = {}\nstep = 0.2\namplitude = {}\n'
FLOWN = parse_maneuver(
    "duration = 20.0\nwind = [2.0, 1.0, 0.0]\n"
    + "".join(INPUT.format(*one) for one in (("roll", 3, 8.0), ("pitch", 9, 8.0), ("yaw", 15, 1.0))),
    "flown.toml",
)


def pulsed(flight: Flight, kind: str = "motor_", **more: FloatArray) -> Flight:
    """Return a flight in which nothing is left of motors but pulses in whole microseconds."""
    columns = {str(name): flight.column(str(name)) for name in flight.data.data_vars}
    pulses = {
        name.replace(kind, "pwm_"): np.round(1000.0 + 1000.0 * x)
        for name, x in columns.items()
        if kind in name
    }
    rest = {name: x for name, x in columns.items() if kind not in name}
    return from_columns("pulsed", flight.time, {**rest, **pulses, **more})


@pytest.fixture(scope="module", params=["quad-x", "hexa-x"])
def copter(request: pytest.FixtureRequest) -> Flight:
    return pulsed(simulate_flight(resolve_vehicle(request.param), FLOWN, seed=3, name="f"))


@pytest.mark.parametrize("samples", [2, 3, 9, 10])
def test_a_flight_shorter_than_a_block_shows_no_motors(samples: int) -> None:
    ripple = np.sin(np.arange(samples) + np.arange(6)[:, None])
    pulses = {f"pwm_{n}": 1500.0 + 20.0 * ripple[n - 1] for n in range(1, 5)}
    brief = from_columns("brief", 0.01 * np.arange(samples), {**pulses, "p": ripple[4], "q": ripple[5]})
    assert rotor_pulses(brief) == []
    assert not carried_by_rotors(brief)


def test_pulses_that_turn_a_copter_are_motors(copter: Flight) -> None:
    motors = [str(name) for name in copter.data.data_vars if str(name).startswith("pwm_")]
    assert rotor_pulses(copter) == motors
    assert carried_by_rotors(copter)
    assert flying(copter).all()
    assert [m.axis for m in find_maneuvers(copter)] == ["roll", "pitch", "yaw"]


def test_a_gimbal_and_a_dead_output_are_no_motors(copter: Flight) -> None:
    n = copter.time.size
    gimbal = 1500.0 + 300.0 * np.sin(copter.time)
    columns = {str(name): copter.column(str(name)) for name in copter.data.data_vars}
    more = from_columns(
        "f", copter.time, {**columns, "pwm_9": 1100.0 + 0.1 * gimbal, "pwm_10": np.full(n, 1000.0)}
    )
    assert rotor_pulses(more) == rotor_pulses(copter)
    told = lift_command(more)
    assert told is not None
    assert np.median(told) == pytest.approx(
        np.median([copter.column(x) for x in rotor_pulses(copter)]) / 1e3 - 1.0, rel=0.01
    )


@pytest.mark.parametrize("seed", range(4))
def test_four_surfaces_that_answer_a_plane_in_the_hand_are_none(seed: int) -> None:
    """Two ailerons and two elevators at mid-travel, held against the attitude of a plane that is carried about."""
    rng = np.random.default_rng(seed)
    t = np.arange(6000) / 100.0
    phi, theta = (
        sum(a * np.sin(w * t + 6.0 * b) for a, w, b in rng.random((5, 3)) * [0.2, 4.0, 1.0]) for _ in "ab"
    )
    p, q = np.gradient(phi, t), np.gradient(theta, t)
    pulses = [
        1500.0 - s * 400.0 * (x + 0.2 * rate)
        for s, x, rate in ((1, phi, p), (-1, phi, p), (1, theta, q), (-1, theta, q))
    ]
    noise = 0.01 * rng.normal(size=(2, t.size))
    columns = {f"pwm_{i + 1}": np.round(x) for i, x in enumerate(pulses)}
    plane = from_columns(
        "p", t, {**columns, "p": p + noise[0], "q": q + noise[1], "r": 0.0 * t, "az": 0.0 * t - 9.8}
    )
    assert rotor_pulses(plane) == []
    assert not carried_by_rotors(plane)


@pytest.mark.parametrize("seed", range(10))
def test_surfaces_of_any_effect_are_no_motors(seed: int) -> None:
    """Four to seven outputs at mid-travel, each of which may turn the vehicle by any amount."""
    rng = np.random.default_rng(seed)
    t = np.arange(4000) / 100.0
    moved = np.array(
        [np.convolve(rng.normal(size=t.size), np.full(15, 1 / 15), "same") for _ in range(rng.integers(4, 8))]
    )
    effect = rng.normal(size=(2, len(moved))) * (rng.random((2, len(moved))) < 0.5)
    p, q = 5e-4 * np.cumsum(effect @ moved, axis=1) + 2e-3 * rng.normal(size=(2, t.size))
    pulses = {f"pwm_{i + 1}": np.round(1500.0 + 300.0 * x) for i, x in enumerate(moved)}
    assert rotor_pulses(from_columns("p", t, {**pulses, "p": p, "q": q})) == []


def test_motors_are_found_in_gusts(copter: Flight) -> None:
    """In a real flight motors explain a few hundredths of the angular accelerations, filtered to 0.1 s."""
    rng = np.random.default_rng(1)
    columns = {str(name): copter.column(str(name)) for name in copter.data.data_vars}
    gusts = {
        rate: columns[rate]
        + 0.04 * np.repeat(rng.normal(size=copter.time.size // 10 + 1), 10)[: copter.time.size]
        for rate in "pq"
    }
    assert rotor_pulses(from_columns("g", copter.time, {**columns, **gusts})) == rotor_pulses(copter)
