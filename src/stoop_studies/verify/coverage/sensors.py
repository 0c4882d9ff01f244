"""Scenes in calm air: white noise of the sensors, and noise that remembers."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.signal import lfilter

from stoop.base.arrays import FloatArray
from stoop.flight import Flight
from stoop.simulate import Maneuver, simulate_flight
from stoop.vehicle import Vehicle
from stoop_studies.verify.coverage.scene import (
    Scene,
    aircraft,
    biased,
    coefficients,
    maneuvers,
    misled,
    sensor_noise,
    windows,
)

MEMORY: Final = 0.95  #: correlation of neighboring samples, 50 Hz; 0.4 s
Noise = Callable[[np.random.Generator, int, int], FloatArray]


def white(rng: np.random.Generator, samples: int, channels: int) -> FloatArray:
    """Return white noise (samples, channels) of unit variance."""
    return rng.standard_normal((samples, channels))


def remembering(rng: np.random.Generator, samples: int, channels: int) -> FloatArray:
    """Return stationary AR(1) noise (samples, channels) of unit variance."""
    driven = rng.standard_normal((samples, channels))
    driven[1:] *= np.sqrt(1.0 - MEMORY**2)
    return np.asarray(lfilter([1.0], [1.0, -MEMORY], driven, axis=0))


def _scene(noise: Noise, seed: int) -> Scene:
    rng = np.random.default_rng(seed)
    truth = aircraft()
    flights = {n: _measured(biased(truth, rng), m, noise, rng, n) for n, m in maneuvers().items()}
    return Scene(misled(truth, rng), flights, windows(), coefficients(truth))


def _measured(
    vehicle: Vehicle, maneuver: Maneuver, noise: Noise, rng: np.random.Generator, name: str
) -> Flight:
    """Fly, then add noise to what the (biased) sensors would read."""
    flight = simulate_flight(vehicle, maneuver, noise=False, name=name)
    errors = sensor_noise(vehicle) * noise(rng, len(maneuver.time), len(vehicle.outputs))
    readings = {
        channel: (flight.data[channel].dims, flight.data[channel].to_numpy() + error)
        for channel, error in zip(vehicle.outputs, errors.T, strict=True)
    }
    return replace(flight, data=flight.data.assign(readings))


in_white_noise = functools.partial(_scene, white)
in_remembering_noise = functools.partial(_scene, remembering)
