"""Estimates in real time: the transform against its sum, memory that does not grow, the end against the batch."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from stoop.errors import IdentificationError
from stoop.estimate.fit import Options, estimation_problem
from stoop.estimate.regression.aircraft import AircraftEquations
from stoop.estimate.regression.least_squares import Estimates, FrequencyDomain, estimate, fourier_transform
from stoop.estimate.regression.recursive import Estimate, RealTime, RecursiveTransform
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.simulation.delays import play, rate_limited
from stoop.vehicle import Vehicle
from stoop.vehicle.load import parse_vehicle

BAND = FrequencyDomain(0.04, 1.5)


def flown(
    vehicle: Vehicle, flight: Flight, online: RealTime, start: int = 0, stop: int | None = None
) -> dict[str, Estimate]:
    names = [c for c in (*vehicle.outputs, *vehicle.inputs, "altitude") if c in flight.data]
    table = np.column_stack([flight.column(c) for c in names])
    for row in table[start:stop]:
        online.update(dict(zip(names, row, strict=True)))
    return online.estimate()


def batch_of(vehicle: Vehicle, flight: Flight) -> tuple[AircraftEquations, Estimates]:
    problem, _ = estimation_problem(vehicle, {"noisy": flight}, [Window("noisy", 0.0, 25.0)], Options())
    equations = AircraftEquations.of(problem.layout, problem.pieces)
    found = estimate(equations, BAND)
    assert found is not None
    return equations, found


def online(vehicle: Vehicle, flight: Flight, memory: float = np.inf) -> RealTime:
    dt = 1.0 / flight.rate
    return RealTime(vehicle, dt, BAND.frequencies(len(flight.time), dt), memory)


def test_the_growing_transform_is_the_transform() -> None:
    signals = np.random.default_rng(0).standard_normal((300, 3))
    frequencies = 0.2 + 0.1 * np.arange(15)
    growing = RecursiveTransform(frequencies, 3, 0.02)
    for row in signals:
        growing.update(row)
    np.testing.assert_allclose(growing.values, fourier_transform(signals, frequencies, 0.02), atol=1e-10)


def test_forgetting_fades_the_past() -> None:
    signals = np.random.default_rng(0).standard_normal((300, 1))
    growing = RecursiveTransform(np.array([0.5]), 1, 0.02, memory=1.0)
    for row in signals:
        growing.update(row)
    faded = signals * np.exp(-0.02 * (299 - np.arange(300)))[:, None]
    np.testing.assert_allclose(growing.values, fourier_transform(faded, np.array([0.5]), 0.02), atol=1e-10)


def test_the_end_is_that_of_the_batch(full: Vehicle, noisy: Flight) -> None:
    equations, batch = batch_of(full, noisy)
    found = flown(full, noisy, online(full, noisy))
    std = np.sqrt(np.diag(batch.covariance))
    well = 0
    for k, name in enumerate(equations.names):
        if name in found and std[k] < 0.01 * abs(batch.values[k]):
            assert found[name].value == pytest.approx(batch.values[k], rel=0.02), name
            assert found[name].std_error == pytest.approx(std[k], rel=0.3), name
            well += 1
    assert well >= 6


def test_memory_does_not_grow_with_the_record(full: Vehicle, noisy: Flight) -> None:
    estimator = online(full, noisy)
    flown(full, noisy, estimator, 0, 60)

    def size() -> int:
        state = (estimator._recent, estimator._lags, estimator._transform)
        return len(pickle.dumps([vars(s) if hasattr(s, "__dict__") else s for s in state]))

    before = size()
    flown(full, noisy, estimator, 60, 300)
    assert abs(size() - before) <= 16  # a counter has more digits


def test_too_little_says_nothing(full: Vehicle, noisy: Flight) -> None:
    assert flown(full, noisy, online(full, noisy), 0, 10) == {}


def test_a_sample_without_a_reading_says_nothing_but_time_passes(full: Vehicle, noisy: Flight) -> None:
    estimator = online(full, noisy)
    flown(full, noisy, estimator, 0, 100)
    before = estimator._transform.values.copy()
    estimator.update({"V": 35.0})
    np.testing.assert_array_equal(estimator._transform.values[:, :-2], before[:, :-2])
    assert estimator._transform.count == 97


def with_servo(full: Vehicle, servo: str) -> Vehicle:
    text = f"{full.text}\n[controls.elevator]\n{servo}\n[controls.aileron]\n[controls.rudder]\n"
    thrust = full.value("propulsion.thrust")
    return parse_vehicle(text, "late").with_numbers({"propulsion.thrust": {"value": thrust}})


def test_lags_and_delays_of_controls_are_those_of_the_batch(full: Vehicle, noisy: Flight) -> None:
    late = with_servo(full, "lag = 0.06\ndelay = 0.05\n")
    equations, batch = batch_of(late, noisy)
    found = flown(late, noisy, online(late, noisy))
    for name in ("Cmelevator", "Cmalpha"):
        assert found[name].value == pytest.approx(batch.values[equations.names.index(name)], rel=0.02)


def test_a_servo_is_followed_sample_by_sample(full: Vehicle, noisy: Flight) -> None:
    slow = with_servo(full, "rate_limit = 0.1\ndead_zone = 0.02\ndelay = 0.02\n")
    found = flown(slow, noisy, online(slow, noisy))
    moved = rate_limited(play(noisy.column("elevator"), 0.02), 0.1 / noisy.rate)
    assert np.abs(moved - noisy.column("elevator")).max() > 0.02, "it shows"
    followed = replace(noisy, data=noisy.data.assign(elevator=("time", moved)))
    late = with_servo(full, "delay = 0.02\n")
    expected = flown(late, followed, online(late, followed))
    assert found.keys() == expected.keys()
    assert all(found[n].value == pytest.approx(one.value, rel=1e-6, abs=1e-9) for n, one in expected.items())


def test_nothing_free_is_refused(full: Vehicle) -> None:
    held = full.with_numbers({p.name: {"free": False} for p in full.parameters})
    with pytest.raises(IdentificationError, match="no aerodynamic term is free"):
        RealTime(held, 0.02, np.array([0.1, 0.2]))


def test_error_bars_of_a_short_record_are_honest(full: Vehicle, noisy: Flight) -> None:
    """Frequencies closer than one over the record repeat each other; with few that differ nothing is said."""
    estimator = online(full, noisy)
    assert flown(full, noisy, estimator, 0, 60) == {}
    off = []
    for k in range(60, 300, 60):
        found = flown(full, noisy, estimator, k, k + 60)
        off += [(e.value - full.value(n)) / e.std_error for n, e in found.items()]
    assert len(off) > 50
    assert np.sqrt(np.mean(np.square(off))) < 1.5
