"""Estimates in real time: the transform against its sum, memory that does not grow, the end against the batch."""

from dataclasses import replace

import numpy as np
import pytest
from unit.estimate.fits import posed
from unit.estimate.regression.conftest import DURATION

from stoop import Flight, Vehicle
from stoop.estimate.regression.aircraft import AircraftEquations
from stoop.estimate.regression.least_squares import Estimates, FrequencyDomain, estimate, fourier_transform
from stoop.estimate.regression.recursive import STENCIL, Estimate, RealTime, RecursiveTransform
from stoop.simulation.delays import play, rate_limited
from stoop.vehicle.load import parse_vehicle

BAND = FrequencyDomain(0.04, 1.5)


def test_the_difference_is_exact_for_polynomials_of_fourth_degree() -> None:
    slopes = [STENCIL @ np.arange(-2.0, 3.0) ** degree for degree in range(5)]
    np.testing.assert_allclose(slopes, [0.0, 1.0, 0.0, 0.0, 0.0], atol=1e-14)


def flown(vehicle: Vehicle, flight: Flight, stop: int | None = None) -> dict[str, Estimate]:
    """Return what is known in real time after the first samples."""
    dt = 1.0 / flight.rate
    online = RealTime(vehicle, dt, BAND.frequencies(len(flight.time), dt), np.inf)
    names = [c for c in (*vehicle.outputs, *vehicle.inputs, "altitude") if c in flight.data]
    for row in np.column_stack([flight.column(c) for c in names])[:stop]:
        online.update(dict(zip(names, row, strict=True)))
    return online.estimate()


def batch_of(vehicle: Vehicle, flight: Flight, stop: float = DURATION) -> tuple[AircraftEquations, Estimates]:
    problem = posed(vehicle, flight, stop)
    equations = AircraftEquations.of(problem.layout, problem.pieces)
    found = estimate(equations, BAND)
    assert found is not None
    return equations, found


@pytest.mark.parametrize("memory", [np.inf, 1.0])
def test_the_growing_transform_is_the_transform(memory: float) -> None:
    """Of signals that fade into the past, where there is a memory."""
    signals, frequencies = np.random.default_rng(0).standard_normal((300, 3)), 0.2 + 0.1 * np.arange(15)
    growing = RecursiveTransform(frequencies, 3, 0.02, memory)
    for row in signals:
        growing.update(row)
    faded = signals * np.exp(-0.02 / memory * (299 - np.arange(300)))[:, None]
    np.testing.assert_allclose(growing.values, fourier_transform(faded, frequencies, 0.02), atol=1e-10)


def test_the_end_is_that_of_the_batch(full: Vehicle, noisy: Flight) -> None:
    equations, batch = batch_of(full, noisy)
    found = flown(full, noisy)
    each = zip(equations.names, batch.values, np.sqrt(np.diag(batch.covariance)), strict=True)
    well = [(found[n], value, std) for n, value, std in each if n in found and std < 0.01 * abs(value)]
    assert len(well) >= 6
    for one, value, std in well:
        assert (one.value, one.std_error) == (pytest.approx(value, rel=0.02), pytest.approx(std, rel=0.3))


def with_servo(full: Vehicle, servo: str) -> Vehicle:
    text = f"{full.text}\n[controls.elevator]\n{servo}\n[controls.aileron]\n[controls.rudder]\n"
    thrust = full.value("propulsion.thrust")
    return parse_vehicle(text, "late").with_numbers({"propulsion.thrust": {"value": thrust}})


def test_lags_and_delays_of_controls_are_those_of_the_batch(full: Vehicle, noisy: Flight) -> None:
    late = with_servo(full, "lag = 0.06\ndelay = 0.05\n")
    equations, batch = batch_of(late, noisy, 12.5)
    found = flown(late, noisy, 626)
    for name in ("Cmelevator", "Cmalpha"):
        assert found[name].value == pytest.approx(batch.values[equations.names.index(name)], rel=0.02)


def test_a_servo_is_followed_sample_by_sample(full: Vehicle, noisy: Flight) -> None:
    found = flown(with_servo(full, "rate_limit = 0.1\ndead_zone = 0.02\ndelay = 0.02\n"), noisy, 400)
    moved = rate_limited(play(noisy.column("elevator"), 0.02), 0.1 / noisy.rate)
    assert np.abs(moved - noisy.column("elevator")).max() > 0.02, "it shows"
    followed = replace(noisy, data=noisy.data.assign(elevator=("time", moved)))
    expected = flown(with_servo(full, "delay = 0.02\n"), followed, 400)
    assert found.keys() == expected.keys()
    assert all(found[n].value == pytest.approx(one.value, rel=1e-6, abs=1e-9) for n, one in expected.items())
