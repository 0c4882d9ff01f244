"""Air-relative velocity without a vane: flight-path reconstruction from inertial data and a steady wind.

The ground velocity is smoothed at the rate of the accelerometers (`stoop.flight.velocity_smoother`), a steady
horizontal wind and the calibration of the pitot are estimated over the airborne part (`stoop.flight.wind`),
and the difference is turned into body axes::

    (u, v, w) = R' (v_ground - w),  V = |v_ground - w|,  alpha = atan2(w, u),  beta = asin(v / V)

What it cannot see: gusts and vertical wind. They are the error of alpha and beta, about gust / V.

References
----------
.. [1] Klein, Morelli, "Aircraft System Identification", 2nd ed., ch. 10 (data compatibility).
.. [2] Mulder, Chu, Sridhar, Breeman, Laban, "Non-linear aircraft flight path reconstruction review and new
   advances", Prog. Aerospace Sci. 35 (1999) 673.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.base.notices import notice
from stoop.base.rotations import matrices_of, normalized, quaternions_of
from stoop.base.variables import EULER, QUATERNION, RATES, SPECIFIC_FORCE, VARIABLES, VELOCITY
from stoop.flight.air_data import NAN, POOR_WIND_STD, AirData, LogWind, air_data_notices
from stoop.flight.airborne import carried_by_rotors, hovered
from stoop.flight.airspeed import SEA_LEVEL_DENSITY
from stoop.flight.flight import Flight, dataset
from stoop.flight.gridding import complete
from stoop.flight.velocity_smoother import Record, Smoothed, smooth_velocity
from stoop.flight.wind import (
    KAPPA,
    OFFSET,
    SLOPE,
    TRIM,
    WIND_E,
    WIND_N,
    Airborne,
    Evidence,
    Fit,
    Prior,
    air_relative,
    default_prior,
    fit,
    pitot_equation,
    sideslip_equation,
)

RECONSTRUCTED: Final = "reconstructed"  #: source of what no sensor measured
SMOOTHED: Final = ("vn_smooth", "ve_smooth", "vd_smooth")
SAMPLE_TIME: Final = 0.1  #: s between the samples that the wind is fitted to
MIN_SPEED: Final = 3.0  #: m/s over ground; slower is not flying
FLYING_SHARE: Final = 0.4  #: of the highest speed; slower is not flying
EDGE_TIME: Final = 2.0  #: s cut off around take-off and landing
MIN_TIME: Final = 5.0  #: s of airborne data (and of pitot) below which nothing is estimated
REST_SPEED: Final = 0.5  #: m/s
REST_RATE: Final = 0.1  #: rad/s
LOG_WIND_STD: Final = 0.5  #: m/s; no logged wind is believed more than this
MAX_SIDESLIP: Final = 0.15  #: rad, rms; a larger scatter says that the vehicle does not weathercock


def with_air(flight: Flight) -> Flight:
    """Reconstruct what air data were not measured, where there is no vane but ground velocity and attitude.

    A rotorcraft without a pitot has no air data; none are needed.
    """
    there, needed = flight.names, (*VELOCITY, *QUATERNION)
    if there & {"alpha", "beta"} or not there >= set(needed) or not _has_samples(flight, needed):
        return flight
    columns, air = _columns_with_air(flight)
    if (air.method == "none" and carried_by_rotors(flight)) or (air.method == "sideslip" and hovered(flight)):
        return flight
    new = columns.keys() - (there if _measured_speed(flight) is not None else there - {"V"})
    sources = {name: replace(flight.sources["vn"], source=RECONSTRUCTED) for name in new}
    # The reconstruction says more of the pitot than its faults do.
    replaced = [fault.notice for fault in flight.faults if fault.variable == "airspeed_pitot"]
    return replace(
        flight,
        data=dataset(flight.time, columns),
        air=air,
        sources={**flight.sources, **sources},
        notices=(*(one for one in flight.notices if one not in replaced), *air.notices),
    )


def without(flight: Flight, windows: Sequence[tuple[float, float]]) -> Flight:
    """Reconstruct the air data anew, learning nothing about wind and pitot inside some windows [s].

    A flight whose air data were measured, or could not be reconstructed, is returned as it is.
    """
    if not windows or flight.air is None or flight.air.method == "none":
        return flight
    columns, air = _columns_with_air(flight, windows)
    if air.method == "none":
        return replace(flight, notices=(*flight.notices, notice("wind-of-predicted-windows", flight.name)))
    kept = tuple(one for one in flight.notices if one not in flight.air.notices)
    return replace(flight, data=dataset(flight.time, columns), air=air, notices=(*kept, *air.notices))


def _columns_with_air(
    flight: Flight, exclude: Sequence[tuple[float, float]] = ()
) -> tuple[dict[str, FloatArray], AirData]:
    """Return all columns with reconstructed air data; a measured V stays, and is a pitot where there is none."""
    columns = {name: flight.column(name) for name in VARIABLES if name in flight.data}
    measured = _measured_speed(flight)
    as_pitot = measured is not None and "airspeed_pitot" not in columns
    given = {**columns, "airspeed_pitot": measured} if measured is not None and as_pitot else columns
    added, air = reconstruct(flight.time, given, flight.sources["vn"].rate, exclude)
    columns = {name: x for name in VARIABLES if (x := added.get(name, columns.get(name))) is not None}
    if measured is None or air.method == "none":
        return columns, air
    found = notice("airspeed-measured-as-pitot" if as_pitot else "airspeed-measured", "V")
    return {**columns, "V": measured}, replace(air, notices=(*air.notices, found))


def _measured_speed(flight: Flight) -> FloatArray | None:
    source = flight.sources.get("V")
    if source is None or source.source == RECONSTRUCTED or not _has_samples(flight, ["V"]):
        return None
    return flight.column("V")


def _has_samples(flight: Flight, names: Sequence[str]) -> bool:
    """Tell whether all of some variables have a value at one sample at least."""
    return bool(np.logical_and.reduce([np.isfinite(flight.column(name)) for name in names]).any())


@dataclass(frozen=True)
class _Record:
    """Columns of a flight on its grid; those that are missing read NaN."""

    time: FloatArray
    columns: Mapping[str, FloatArray]

    def column(self, name: str) -> FloatArray:
        found = self.columns.get(name)
        return np.full(self.time.size, np.nan) if found is None else np.asarray(found, dtype=np.float64)

    def stack(self, names: Sequence[str]) -> FloatArray:
        return np.column_stack([self.column(name) for name in names])

    @property
    def step(self) -> float:
        return float(np.median(np.diff(self.time)))

    def quaternion(self) -> FloatArray:
        if set(QUATERNION) <= self.columns.keys():
            return normalized(self.stack(QUATERNION))
        return quaternions_of(self.stack(EULER))


def reconstruct(
    time: FloatArray,
    columns: Mapping[str, FloatArray],
    velocity_rate: float = 10.0,
    exclude: Sequence[tuple[float, float]] = (),
) -> tuple[dict[str, FloatArray], AirData]:
    """Reconstruct airspeed, angle of attack and sideslip of a flight without vanes.

    Parameters
    ----------
    time : (n,) s, uniform
    columns : name -> (n,), NaN in gaps: vn ve vd [m/s], q0..q3 (or phi theta psi [rad]) and, where
        there are any, ax ay az [m/s2], p q r [rad/s], airspeed_pitot, wind_n, wind_e [m/s], density [kg/m3]
    velocity_rate : Hz, at which the velocity was recorded before it was interpolated onto the grid
    exclude : windows [s] from which nothing is learnt about wind and pitot

    Returns
    -------
    columns : V [m/s], alpha, beta [rad] (at the accelerometer) and vn_smooth, ve_smooth, vd_smooth [m/s];
        none when nothing could be reconstructed
    air : what was found
    """
    record = _Record(time, columns)
    for code, lacking in (
        ("no-air-data-short-record", time.size < 10),
        ("no-air-data-without-velocity", not complete(record.stack(VELOCITY)).any()),
        ("no-air-data-without-attitude", not complete(record.quaternion()).any()),
    ):
        if lacking:
            return {}, AirData("none", notices=(notice(code),))
    rotation = matrices_of(record.quaternion())
    velocity = record.stack(VELOCITY)
    motion = smooth_velocity(Record(time, rotation, record.stack(SPECIFIC_FORCE), velocity), velocity_rate)
    if motion is None:  # without accelerometers the velocity is taken as logged
        none = np.full(3, np.nan)
        motion = Smoothed(velocity, np.full(time.size, np.nan), none, none, *[NAN] * 6)
    flying = _flying(motion.velocity, record.column("airspeed_pitot"))
    used = _away_from_ground(motion.velocity, flying, record.step)
    for start, stop in exclude:
        used &= (time < start) | (time > stop)
    samples = _samples(record, rotation, motion, used)
    if samples.time.size * samples.step < MIN_TIME:
        return {}, AirData("none", notices=(notice("no-air-data-short-flight", duration=MIN_TIME),))
    air = _air_data(record, samples, motion)
    through = motion.velocity - np.array([air.wind_n, air.wind_e, 0.0])
    speed, alpha, beta = flow(np.einsum("nij,ni->jn", rotation, through).T, MIN_SPEED)
    fast = (flying == 1.0) & (speed > MIN_SPEED)
    found = {"V": speed, "alpha": np.where(fast, alpha, np.nan), "beta": np.where(fast, beta, np.nan)}
    return found | dict(zip(SMOOTHED, motion.velocity.T, strict=True)), air


def flow(velocity: FloatArray, least: float = 0.0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return airspeed, angle of attack and sideslip (n,) of velocities through the air along body axes (n, 3).

    Parameters
    ----------
    velocity : (n, 3) m/s
    least : m/s; beta is taken as if no speed were lower
    """
    u, v, w = velocity.T
    speed = np.sqrt(u**2 + v**2 + w**2)
    return speed, np.arctan2(w, u), np.arcsin(np.clip(v / np.maximum(speed, least), -1.0, 1.0))


def _flying(velocity: FloatArray, pitot: FloatArray) -> FloatArray:
    """Return 1 in flight, 0 on the ground, NaN where it is not known."""
    ground = np.hypot(velocity[:, 0], velocity[:, 1])
    known = np.isfinite(ground)
    speed = np.fmax(ground, pitot)
    if not known.any():
        return np.full(ground.size, np.nan)
    fast = (ground > MIN_SPEED) & (speed > FLYING_SHARE * np.nanpercentile(speed[known], 90.0))
    return np.where(known, fast, np.nan)


def _away_from_ground(velocity: FloatArray, flying: FloatArray, step: float) -> BoolArray:
    """Keep what is at least `EDGE_TIME` away from the ground."""
    window = np.ones(2 * round(EDGE_TIME / step) + 1)
    touched = np.convolve(flying == 0.0, window)[window.size // 2 :][: flying.size] > 0.5
    return np.asarray((flying == 1.0) & ~touched & complete(velocity), dtype=np.bool_)


def _samples(record: _Record, rotation: FloatArray, motion: Smoothed, airborne: BoolArray) -> Airborne:
    """Thin the airborne part to `SAMPLE_TIME`."""
    stride = max(1, round(SAMPLE_TIME / record.step))
    good = airborne & np.isfinite(rotation).all(axis=(1, 2))
    taken = np.flatnonzero(good & (np.arange(good.size) % stride == 0))
    lateral = record.column("ay")[taken] - np.nan_to_num(motion.bias[1])
    return Airborne(
        np.asarray(record.time[taken], dtype=np.float64),
        stride * record.step,
        motion.velocity[taken],
        rotation[taken, :, 1],
        np.nan_to_num(lateral),
        record.column("airspeed_pitot")[taken],
    )


def _rest_offset(record: _Record, velocity: FloatArray) -> float:
    """Return the median reading of the pitot while the vehicle stands still; NaN where that is too short."""
    pitot = record.column("airspeed_pitot")
    still = np.linalg.norm(velocity, axis=1) < REST_SPEED
    still &= ~(np.abs(record.stack(RATES)) > REST_RATE).any(axis=1) & np.isfinite(pitot)
    return float(np.median(pitot[still])) if np.count_nonzero(still) * record.step > 1.0 else NAN


def _log_wind(record: _Record, samples: Airborne) -> LogWind:
    """Return mean and standard deviation of the logged wind while airborne."""
    wind = record.stack(("wind_n", "wind_e"))
    wind = wind[(record.time >= samples.time[0]) & (record.time <= samples.time[-1])]
    wind = wind[complete(wind)]
    if not wind.size:
        return LogWind(np.full(2, np.nan), np.full(2, np.nan))
    return LogWind(wind.mean(axis=0), wind.std(axis=0))


def _best_wind(samples: Airborne, log_wind: LogWind, prior: Prior, sideslip: Fit | None) -> tuple[str, Fit]:
    """Trust the pitot when it determines the wind, else the most certain of the other estimates."""
    with_pitot = samples.with_pitot()
    pitot: list[Evidence] = []
    if with_pitot.time.size * samples.step > MIN_TIME:
        pitot = [(pitot_equation, with_pitot)]
    options: list[tuple[str, Fit]] = []
    if pitot:
        options.append(("pitot", fit(pitot, prior)))
        if options[0][1].wind_std < POOR_WIND_STD:
            return options[0]
        if sideslip is not None:
            both = fit([*pitot, (sideslip_equation, samples)], prior)
            options.append(("pitot and sideslip", both))
    elif sideslip is not None:
        options.append(("sideslip", sideslip))
    if log_wind.known:
        logged = prior.with_wind(log_wind.mean, np.maximum(log_wind.std, LOG_WIND_STD))
        options.append(("pitot and log" if pitot else "log", fit(pitot, logged)))
    options = options or [("still air", fit([], prior))]
    return min(options, key=lambda option: option[1].wind_std)


def _sideslip_wind(samples: Airborne, prior: Prior) -> Fit | None:
    """Fit the wind to the sideslip; None when the vehicle does not fly like a weather vane.

    It does when sideslip, less what the lateral force explains, is small, and when that force opposes
    the sideslip.
    """
    found = fit([(sideslip_equation, samples)], prior)
    speed = float(np.median(air_relative(samples.velocity, found.theta)[1]))
    steady = found.rms[0] < MAX_SIDESLIP * speed
    opposing = found.theta[KAPPA] < 2.0 * found.std[KAPPA]
    return found if steady and opposing else None


def _air_data(record: _Record, samples: Airborne, motion: Smoothed) -> AirData:
    """Fit the wind and describe it; the residuals of the fit are taken as gusts, alike in all directions."""
    rest, log_wind = _rest_offset(record, motion.velocity), _log_wind(record, samples)
    prior = default_prior(rest)
    sideslip = _sideslip_wind(samples, prior)
    method, found = _best_wind(samples, log_wind, prior, sideslip)
    theta, std = found.theta, found.std
    speed = float(np.median(air_relative(samples.velocity, theta)[1]))
    smoothing = float(np.nanmedian(motion.std)) if np.isfinite(motion.std).any() else 0.0
    rms = found.rms[0] if found.rms else NAN
    pitot = "pitot" in method
    calibration: dict[str, Any] = {}
    if pitot:
        calibration = {
            "pitot_scale": float(1.0 / theta[SLOPE]),
            "pitot_scale_std": float(std[SLOPE] / theta[SLOPE] ** 2),
            "pitot_offset": float(theta[OFFSET]),
            "pitot_offset_std": float(std[OFFSET]),
        }
    gust = rms / (float(theta[SLOPE]) if pitot else 1.0)
    air = AirData(
        method,
        wind_n=float(theta[WIND_N]),
        wind_e=float(theta[WIND_E]),
        wind_n_std=float(std[WIND_N]),
        wind_e_std=float(std[WIND_E]),
        **calibration,
        rest_offset=rest,
        residual_rms=rms,
        sideslip_wind=(NAN,) * 4 if sideslip is None else (*_pair(sideslip.theta), *_pair(sideslip.std)),
        gust=gust,
        incidence_std=float(np.sqrt(gust**2 + found.wind_std**2 + smoothing**2)) / speed,
        velocity_delay=motion.delay,
        velocity_delay_std=motion.delay_std,
        heading_error=motion.heading_error,
        heading_error_std=motion.heading_error_std,
        accelerometer_bias=_triple(motion.bias),
        accelerometer_bias_std=_triple(motion.bias_std),
        traces=_traces(record, samples, theta, sideslip),
    )
    density = record.column("density")
    rho = float(np.nanmedian(density)) if np.isfinite(density).any() else SEA_LEVEL_DENSITY
    return replace(air, notices=air_data_notices(air, float(prior.std[SLOPE]), speed, rho, log_wind))


def _pair(values: FloatArray) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _triple(values: FloatArray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def _traces(
    record: _Record, samples: Airborne, theta: FloatArray, sideslip: Fit | None
) -> dict[str, FloatArray]:
    air, speed = air_relative(samples.velocity, theta)
    at = np.searchsorted(record.time, samples.time)
    traces = {
        "time": samples.time,
        "speed_inertial": speed,
        "pitot": samples.pitot,
        "pitot_corrected": (samples.pitot - theta[OFFSET]) / theta[SLOPE],
        "wind_n_log": record.column("wind_n")[at],
        "wind_e_log": record.column("wind_e")[at],
        "beta": np.arcsin(np.clip(np.sum(samples.right * air, axis=1) / speed, -1.0, 1.0)),
    }
    if sideslip is not None:
        trim, kappa = sideslip.theta[TRIM], sideslip.theta[KAPPA]
        traces["beta_from_force"] = trim + kappa * samples.lateral / speed**2
    return traces
