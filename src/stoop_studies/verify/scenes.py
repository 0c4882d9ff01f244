"""Simulated flights of the twin-boom aircraft: its truth, wrong starts, maneuvers, and noise that a seed draws."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from scipy.signal import lfilter

from stoop.base.arrays import FloatArray
from stoop.base.units import FOOT, KNOT
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.simulation import trim
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop.vehicle.schema import Turbulence

AIRCRAFT: Final = "twin-boom"  #: built in
DURATION: Final = 15.0  #: s, of each maneuver
RATE: Final = 50.0  #: Hz
LOG_GRID: Final = (
    100.0  #: Hz, of the grids of logs with which the published records were made, whatever their own rates
)
START_ERROR: Final = 0.3  #: starting values are off by up to this share
TRUTHS: Final = {"CLV": 0.05, "CDV": 0.02, "CDalpha2": 1.2, "CmV": 0.03}  #: zero in the built-in vehicle
BIASES: Final = {
    "p": 0.01, "q": 0.01, "r": 0.01, "ax": 0.1, "ay": 0.1, "az": 0.1, "alpha": 0.01, "beta": 0.01,
}  #: SI; standard deviation of each maneuver's biases, and their prior  # fmt: skip
Step = tuple[str, str, float, float, float]  #: control, shape, start (s), step (s), amplitude (rad)
STEPS: Final[Mapping[str, tuple[Step, ...]]] = {
    "pitch": (("elevator", "3-2-1-1", 1.0, 0.3, 0.12), ("elevator", "doublet", 6.0, 1.5, 0.05)),
    "heave": (("elevator", "doublet", 1.0, 2.5, 0.06), ("elevator", "doublet", 8.0, 0.4, 0.10)),
    "roll": (("aileron", "doublet", 1.0, 0.5, 0.10), ("rudder", "2-1-1", 4.0, 0.6, 0.12)),
    "yaw": (("rudder", "doublet", 1.0, 0.7, 0.15), ("aileron", "2-1-1", 6.0, 0.5, -0.10)),
}  #: maneuver to its inputs
OUTLIERS: Final = (0.02, 10.0)  #: share of the readings, and how many times as widely they scatter
SPIKES: Final = (0.003, 80.0)  #: share of the readings, and by how many standard deviations they are off
STUDENT: Final = 3  #: degrees of freedom
NOISY: Final = ("yaw", 4.0)  #: a maneuver, and how many times as noisy it is
AR_COEFFICIENT: Final = 0.95  #: correlation of neighboring samples, 50 Hz; 0.4 s
LATE: Final = 0.06  #: s
ALTITUDE: Final = 200.0  #: m
WIND_20_FT: Final = 30.0 * KNOT  #: m/s at 20 ft: moderate turbulence
INTENSITY_BOUNDS: Final = (0.05, 10.0)  #: m/s
Noise = Callable[[np.random.Generator, int, int], FloatArray]


@dataclass(frozen=True, eq=False)
class Scene:
    """What is identified: a vehicle with wrong values, flights, and the truth of the compared parameters, SI."""

    start: Vehicle
    flights: Mapping[str, Flight]
    windows: tuple[Window, ...]
    truth: Mapping[str, float]


def step_maneuvers(
    steps: Mapping[str, tuple[Step, ...]], duration: float, rate: float, **more: Any
) -> dict[str, Maneuver]:
    """Return maneuvers of so many seconds at so many Hz; ``more`` holds for each of their inputs."""
    names = ("control", "shape", "start", "step", "amplitude")
    return {
        name: Maneuver.model_validate(
            {
                "duration": duration,
                "rate": rate,
                "input": [dict(zip(names, s, strict=True)) | more for s in own],
            }
        )
        for name, own in steps.items()
    }


def multisine_maneuver(
    amplitudes: Mapping[str, tuple[float, int]], duration: float, rate: float, band: float,
    span: tuple[float, float] | None = None,
) -> Maneuver:  # fmt: skip
    """Return multisines on all controls at once that share no frequency; duration in s, rate and band in Hz.

    ``amplitudes`` maps a control to its amplitude (rad) and the number of its first harmonic; ``span`` is when the sines
    begin and how long they last, s (all of the maneuver).
    """
    start, length = span or (0.0, duration)
    common = {
        "shape": "multisine",
        "start": start,
        "duration": length,
        "band": band,
        "stride": len(amplitudes),
    }
    inputs = [{**common, "control": c, "amplitude": a, "first": k} for c, (a, k) in amplitudes.items()]
    return Maneuver.model_validate(
        {"duration": duration, "rate": rate, "altitude": ALTITUDE, "input": inputs}
    )


@functools.cache
def maneuvers(still: str = "") -> Mapping[str, Maneuver]:
    """Return the maneuvers of `STEPS` by name; the control `still` does not move."""
    steps = {name: tuple(s for s in own if s[0] != still) for name, own in STEPS.items()}
    return step_maneuvers(steps, DURATION, RATE)


def whole_maneuvers() -> tuple[Window, ...]:
    """Return a window on all of each maneuver."""
    return tuple(Window(name, 0.0, DURATION) for name in STEPS)


@functools.cache
def aircraft() -> Vehicle:
    """Return the truth: the twin-boom aircraft on all six degrees of freedom, none of its 32 coefficients zero."""
    return with_trim_thrust(load_vehicle(AIRCRAFT).with_numbers({n: {"value": v} for n, v in TRUTHS.items()}))


def with_trim_thrust(vehicle: Vehicle) -> Vehicle:
    """Return a vehicle with the thrust of its level flight: what is not free must be right."""
    thrust = float(trim(vehicle, None, ALTITUDE).thrust["propulsion.thrust"])
    return vehicle.with_numbers({"propulsion.thrust": {"value": thrust}})


def coefficients(vehicle: Vehicle) -> dict[str, float]:
    """Return the free numbers without sensor biases, by name."""
    return {p.name: p.value for p in vehicle.parameters if p.free and not p.name.startswith("sensors.")}


def with_biases(vehicle: Vehicle, rng: np.random.Generator) -> Vehicle:
    """Return a vehicle whose sensors have biases that are drawn from their prior."""
    return vehicle.with_numbers(
        {f"sensors.{c}.bias": {"value": s * rng.standard_normal()} for c, s in BIASES.items()}
    )


def wrong_start(vehicle: Vehicle, rng: np.random.Generator) -> Vehicle:
    """Return a vehicle to start from: coefficients wrong, in boxes that no estimate meets, and biases unknown."""
    known, wrong = coefficients(vehicle), {}
    for p in vehicle.parameters:
        if p.name in known:
            value = p.value * rng.uniform(1.0 - START_ERROR, 1.0 + START_ERROR)
            more = 0.5 * (
                p.upper - p.lower
            )  # twice as wide as the vehicle file's: a bound that is met has no error bar
            wrong[p.name] = {"value": value, "bounds": (p.lower - more, p.upper + more)}
    unknown = {f"sensors.{c}.bias": {"value": 0.0, "free": True, "prior": s} for c, s in BIASES.items()}
    return vehicle.with_numbers({**wrong, **unknown})


def sensor_noise(vehicle: Vehicle) -> FloatArray:
    """Return the standard deviation (n_y,) of each channel's noise, as the vehicle file says."""
    return np.array([getattr(vehicle.file.sensors, c).sigma for c in vehicle.outputs])


def white(rng: np.random.Generator, samples: int, channels: int) -> FloatArray:
    """Return white noise (samples, channels) of unit variance."""
    return rng.standard_normal((samples, channels))


def autoregressive(rng: np.random.Generator, samples: int, channels: int) -> FloatArray:
    """Return stationary AR(1) noise (samples, channels) of unit variance."""
    driven = rng.standard_normal((samples, channels))
    driven[1:] *= np.sqrt(1.0 - AR_COEFFICIENT**2)
    return np.asarray(lfilter([1.0], [1.0, -AR_COEFFICIENT], driven, axis=0))


def with_outliers(rng: np.random.Generator, samples: int, channels: int) -> FloatArray:
    """Return the noise of `white`, of which a share (`OUTLIERS`) scatters more widely."""
    noise, (share, width) = white(rng, samples, channels), OUTLIERS
    return np.where(rng.spawn(1)[0].random(noise.shape) < share, width * noise, noise)


def with_spikes(rng: np.random.Generator, samples: int, channels: int) -> FloatArray:
    """Return the noise of `white` with spikes up or down (`SPIKES`)."""
    noise, own, (share, size) = white(rng, samples, channels), rng.spawn(1)[0], SPIKES
    return noise + np.where(own.random(noise.shape) < share, own.choice([-size, size], noise.shape), 0.0)


def student(rng: np.random.Generator, samples: int, channels: int) -> FloatArray:
    """Return Student's t: the noise of `white` over the root of a mean square of its own (samples, channels)."""
    noise = white(rng, samples, channels)
    return noise / np.sqrt(rng.spawn(1)[0].chisquare(STUDENT, noise.shape) / STUDENT)


def recorded_late(readings: FloatArray) -> FloatArray:
    """Return readings (n,) as they are recorded `LATE` seconds late; the first stands before them."""
    shift = round(LATE * RATE)
    return np.concatenate([np.repeat(readings[:1], shift), readings[:-shift]])


def _in_sensor_noise(
    noise: Noise,
    seed: int,
    factors: Mapping[str, float] = MappingProxyType({}),
    left_out: str = "",
    late: Sequence[str] = (),
    still: str = "",
) -> Scene:
    """Return flights whose (biased) sensors read noise of a kind that the seed draws.

    The noise of a maneuver is larger by its factor; one maneuver may be flown and left out; the readings of some channels may
    be recorded `LATE` seconds late; one control may be held `still` throughout.
    """
    rng, truth, flights = np.random.default_rng(seed), aircraft(), {}
    for name, maneuver in maneuvers(still).items():
        flight = simulate_flight(with_biases(truth, rng), maneuver, noise=False, name=name)
        errors = sensor_noise(truth) * noise(rng, len(maneuver.time), len(truth.outputs))
        errors *= factors.get(name, 1.0)
        readings = {}
        for channel, error in zip(truth.outputs, errors.T, strict=True):
            exact = flight.data[channel].to_numpy()
            read = recorded_late(exact) if channel in late else exact
            readings[channel] = (flight.data[channel].dims, read + error)
        flights[name] = replace(flight, data=flight.data.assign(readings))
    windows = tuple(w for w in whole_maneuvers() if w.flight != left_out)
    return Scene(wrong_start(truth, rng), flights, windows, coefficients(truth))


in_white_noise = functools.partial(_in_sensor_noise, white)
in_outliers = functools.partial(_in_sensor_noise, with_outliers)
in_spikes = functools.partial(_in_sensor_noise, with_spikes)
in_student_noise = functools.partial(_in_sensor_noise, student)
in_unequal_noise = functools.partial(_in_sensor_noise, white, factors=dict([NOISY]))
with_late_vanes = functools.partial(_in_sensor_noise, white, late=("alpha", "beta"))
without_noisy_maneuver = functools.partial(_in_sensor_noise, white, left_out=NOISY[0])
in_autoregressive_noise = functools.partial(_in_sensor_noise, autoregressive)


@functools.cache
def turbulent_aircraft() -> Vehicle:
    """Return the aircraft in moderate Dryden turbulence, the intensities among what is to be found."""
    return in_turbulence(aircraft(), WIND_20_FT)


def in_turbulence(vehicle: Vehicle, wind: float, airspeed: float | None = None) -> Vehicle:
    """Return a vehicle in the Dryden turbulence of a wind at 20 ft, m/s, that passes at its airspeed or a given one, m/s.

    MIL-F-8785C, section 3.7.3.2 (below 1000 ft): L_w = h, L_u = L_v = h / (0.177 + 0.000823 h)^1.2, h and L in ft;
    sigma_w = 0.1 W_20, sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4.
    """
    h = ALTITUDE / FOOT
    share = 0.177 + 0.000823 * h
    along = _gust(0.1 * wind / share**0.4, FOOT * h / share**1.2)
    table = {"u": along, "v": along, "w": _gust(0.1 * wind, ALTITUDE)}
    passing = {} if airspeed is None else {"airspeed": airspeed}
    turbulence = Turbulence.model_validate({**table, **passing})
    return replace(vehicle, file=vehicle.file.model_copy(update={"turbulence": turbulence}))


def _gust(intensity: float, length: float) -> dict[str, Any]:
    return {"intensity": {"value": intensity, "free": True, "bounds": INTENSITY_BOUNDS}, "length": length}


def in_dryden_turbulence(seed: int) -> Scene:
    """Return maneuvers through gusts that the seed draws, with white noise of the sensors."""
    rng = np.random.default_rng(seed)
    truth = turbulent_aircraft()
    flights = {
        name: simulate_flight(with_biases(truth, rng), m, seed=int(rng.integers(2**31)), name=name)
        for name, m in maneuvers().items()
    }
    start = wrong_start(truth, rng)
    bounds = {p.name: {"bounds": INTENSITY_BOUNDS} for p in start.parameters if p.name.endswith(".intensity")}
    return Scene(start.with_numbers(bounds), flights, whole_maneuvers(), coefficients(truth))
