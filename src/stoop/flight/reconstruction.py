"""Air-relative velocity without a vane: flight-path reconstruction from inertial data and a steady wind.

The ground velocity is smoothed at the rate of the accelerometers (`stoop.flight.smoother`), a steady
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

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import matrices_of, normalized, quaternions_of
from stoop.flight.air_data import NAN, POOR, AirData, LogWind, notes
from stoop.flight.equivalent import SEA_LEVEL_DENSITY
from stoop.flight.grid import complete
from stoop.flight.smoother import BoolArray, Record, Smoothed, smooth_velocity
from stoop.flight.wind import (
    KAPPA,
    OFFSET,
    SLOPE,
    TRIM,
    WIND_E,
    WIND_N,
    Airborne,
    Fit,
    Pitot,
    Prior,
    Sideslip,
    air_relative,
    default_prior,
    fit,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray as xr

VELOCITY: Final = ("vn", "ve", "vd")
FORCE: Final = ("ax", "ay", "az")
RATES: Final = ("p", "q", "r")
QUATERNION: Final = ("q0", "q1", "q2", "q3")
EULER: Final = ("phi", "theta", "psi")

THIN: Final = 0.1  #: s between the samples that the wind is fitted to
SLOWEST: Final = 3.0  #: m/s over ground; slower is not flying
MARGIN: Final = 2.0  #: s cut off around take-off and landing
LEAST: Final = 5.0  #: s of airborne data (and of pitot) below which nothing is estimated
REST_SPEED: Final = 0.5  #: m/s
REST_RATE: Final = 0.1  #: rad/s
LOG_WIND_STD: Final = 0.5  #: m/s; no logged wind is believed more than this
FLYING: Final = 0.4  #: of the highest speed; slower is not flying
STEADY: Final = 0.15  #: rad; a larger scatter of the sideslip says that the vehicle does not weathercock

_HOW: Final = "reconstructed from inertial data and a steady wind"
ATTRIBUTES: Final = {
    "V": {"units": "m/s", "long_name": f"true airspeed, {_HOW}"},
    "alpha": {"units": "rad", "long_name": f"angle of attack at the accelerometer, {_HOW}"},
    "beta": {"units": "rad", "long_name": f"sideslip angle at the accelerometer, {_HOW}"},
    "vn_smooth": {
        "units": "m/s",
        "long_name": "velocity over ground, north, smoothed with the accelerometers",
    },
    "ve_smooth": {
        "units": "m/s",
        "long_name": "velocity over ground, east, smoothed with the accelerometers",
    },
    "vd_smooth": {
        "units": "m/s",
        "long_name": "velocity over ground, down, smoothed with the accelerometers",
    },
}

__all__ = ["AirData", "reconstruct"]


def reconstruct(
    data: xr.Dataset, velocity_rate: float = 10.0, exclude: Sequence[tuple[float, float]] = ()
) -> tuple[xr.Dataset, AirData]:
    """Reconstruct airspeed, angle of attack and sideslip of a flight without vanes.

    Parameters
    ----------
    data : over "time" [s], uniform, NaN in gaps: vn ve vd [m/s], q0..q3 (or phi theta psi [rad]) and, where
        there are any, ax ay az [m/s2], p q r [rad/s], airspeed_pitot, wind_n, wind_e [m/s], density [kg/m3]
    velocity_rate : Hz, at which the velocity was recorded before it was interpolated onto the grid
    exclude : windows [s] from which nothing is learnt about wind and pitot

    Returns
    -------
    data : with V [m/s], alpha, beta [rad] (at the accelerometer) and vn_smooth, ve_smooth, vd_smooth [m/s];
        unchanged when nothing could be reconstructed
    air : what was found; `air.notes` tells the user
    """
    missing = _missing(data)
    if missing:
        return data, AirData("none", notes=(f"no airspeed, alpha and beta: {missing}",))
    rotation = matrices_of(_quaternion(data))
    motion = _smoothed(data, rotation, velocity_rate)
    flying = _flying(motion.velocity, _column(data, "airspeed_pitot"))
    learnt = _airborne(motion.velocity, flying, _step(data)) & ~_inside(data, exclude)
    samples = _thin(data, rotation, motion, learnt)
    if samples.time.size * samples.step < LEAST:
        why = f"no airspeed, alpha and beta: less than {LEAST:g} s of flight with attitude and velocity"
        return data, AirData("none", notes=(why,))
    air = _air_data(data, samples, motion)
    return _with_air(data, rotation, motion.velocity, flying, air), air


def _inside(data: xr.Dataset, windows: Sequence[tuple[float, float]]) -> BoolArray:
    time = data["time"].to_numpy()
    inside = np.zeros(time.size, dtype=np.bool_)
    for start, stop in windows:
        inside |= (time >= start) & (time <= stop)
    return inside


def _missing(data: xr.Dataset) -> str:
    """Tell what the reconstruction lacks, or nothing."""
    if data.sizes.get("time", 0) < 10:
        return "the record is too short"
    if not complete(_columns(data, VELOCITY)).any():
        return "the log has no velocity over ground"
    if not complete(_quaternion(data)).any():
        return "the log has no attitude"
    return ""


def _column(data: xr.Dataset, name: str) -> FloatArray:
    if name not in data:
        return np.full(data.sizes["time"], np.nan)
    return np.asarray(data[name].to_numpy(), dtype=np.float64)


def _columns(data: xr.Dataset, names: tuple[str, ...]) -> FloatArray:
    return np.column_stack([_column(data, name) for name in names])


def _quaternion(data: xr.Dataset) -> FloatArray:
    if set(QUATERNION) <= set(data.data_vars):
        return normalized(_columns(data, QUATERNION))
    return quaternions_of(_columns(data, EULER))


def _step(data: xr.Dataset) -> float:
    return float(np.median(np.diff(data["time"].to_numpy())))


def _smoothed(data: xr.Dataset, rotation: FloatArray, rate: float) -> Smoothed:
    """Smooth the velocity; without accelerometers take it as logged."""
    velocity = _columns(data, VELOCITY)
    time = np.asarray(data["time"].to_numpy(), dtype=np.float64)
    found = smooth_velocity(Record(time, rotation, _columns(data, FORCE), velocity), rate)
    if found is not None:
        return found
    none = np.full(3, np.nan)
    return Smoothed(velocity, np.full(time.size, np.nan), none, none, *[NAN] * 6)


def _flying(velocity: FloatArray, pitot: FloatArray) -> FloatArray:
    """Return 1 in flight, 0 on the ground, NaN where it is not known."""
    ground = np.hypot(velocity[:, 0], velocity[:, 1])
    known = np.isfinite(ground)
    speed = np.fmax(ground, pitot)
    if not known.any():
        return np.full(ground.size, np.nan)
    fast = (ground > SLOWEST) & (speed > FLYING * np.nanpercentile(speed[known], 90.0))
    return np.where(known, fast, np.nan)


def _airborne(velocity: FloatArray, flying: FloatArray, step: float) -> BoolArray:
    """Keep what is at least `MARGIN` away from the ground."""
    window = np.ones(2 * round(MARGIN / step) + 1)
    touched = np.convolve(flying == 0.0, window)[window.size // 2 :][: flying.size] > 0.5
    return np.asarray((flying == 1.0) & ~touched & complete(velocity), dtype=np.bool_)


def _thin(data: xr.Dataset, rotation: FloatArray, motion: Smoothed, airborne: BoolArray) -> Airborne:
    stride = max(1, round(THIN / _step(data)))
    good = airborne & np.isfinite(rotation).all(axis=(1, 2))
    taken = np.flatnonzero(good & (np.arange(good.size) % stride == 0))
    lateral = _column(data, "ay")[taken] - np.nan_to_num(motion.bias[1])
    return Airborne(
        np.asarray(data["time"].to_numpy()[taken], dtype=np.float64),
        stride * _step(data),
        motion.velocity[taken],
        rotation[taken, :, 1],
        np.nan_to_num(lateral),
        _column(data, "airspeed_pitot")[taken],
    )


def _rest_offset(data: xr.Dataset, velocity: FloatArray) -> float:
    """Median reading of the pitot while the vehicle stands still."""
    pitot, rates = _column(data, "airspeed_pitot"), _columns(data, RATES)
    still = np.linalg.norm(velocity, axis=1) < REST_SPEED
    still &= ~(np.abs(rates) > REST_RATE).any(axis=1) & np.isfinite(pitot)
    return float(np.median(pitot[still])) if np.count_nonzero(still) * _step(data) > 1.0 else NAN


def _log_wind(data: xr.Dataset, samples: Airborne) -> LogWind:
    """Mean and wander of the logged wind while airborne."""
    wind = _columns(data, ("wind_n", "wind_e"))
    time = data["time"].to_numpy()
    wind = wind[(time >= samples.time[0]) & (time <= samples.time[-1])]
    wind = wind[complete(wind)]
    if not wind.size:
        return LogWind(np.full(2, np.nan), np.full(2, np.nan))
    return LogWind(wind.mean(axis=0), wind.std(axis=0))


@dataclass(frozen=True)
class _Choice:
    """The wind that is used, and what sideslip alone says of it."""

    method: str
    fit: Fit
    sideslip: Fit | None


def _choose(samples: Airborne, log_wind: LogWind, prior: Prior) -> _Choice:
    """Trust the pitot when it can tell the wind, else the most certain of the other witnesses."""
    with_pitot = samples.where(samples.pitot)
    pitot = [Pitot(with_pitot)] if with_pitot.time.size * samples.step > LEAST else []
    sideslip = _sound_sideslip(samples, prior)
    options: list[tuple[str, Fit]] = []
    if pitot:
        options.append(("pitot", fit(pitot, prior)))
        if options[0][1].wind_std < POOR:
            return _Choice(*options[0], sideslip)
        if sideslip is not None:
            options.append(("pitot and sideslip", fit([*pitot, Sideslip(samples)], prior)))
    elif sideslip is not None:
        options.append(("sideslip", sideslip))
    if log_wind.known:
        believed = prior.with_wind(log_wind.mean, np.maximum(log_wind.wander, LOG_WIND_STD))
        options.append(("pitot and log" if pitot else "log", fit(pitot, believed)))
    options = options or [("still air", fit([], prior))]
    return _Choice(*min(options, key=lambda option: option[1].wind_std), sideslip)


def _sound_sideslip(samples: Airborne, prior: Prior) -> Fit | None:
    """Fit the wind to the sideslip; None when the vehicle does not fly like a weather vane.

    It does when sideslip, less what the lateral force explains, is small, and when that force opposes
    the sideslip.
    """
    found = fit([Sideslip(samples)], prior)
    speed = float(np.median(air_relative(samples.velocity, found.theta)[1]))
    steady = found.rms[0] < STEADY * speed
    opposing = found.theta[KAPPA] < 2.0 * found.std[KAPPA]
    return found if steady and opposing else None


def _air_data(data: xr.Dataset, samples: Airborne, motion: Smoothed) -> AirData:
    rest, log_wind = _rest_offset(data, motion.velocity), _log_wind(data, samples)
    prior = default_prior(rest)
    choice = _choose(samples, log_wind, prior)
    speed = float(np.median(air_relative(samples.velocity, choice.fit.theta)[1]))
    air = replace(
        _found(choice, speed, float(np.nanmedian(motion.std)) if np.isfinite(motion.std).any() else 0.0),
        rest_offset=rest,
        velocity_delay=motion.delay,
        velocity_delay_std=motion.delay_std,
        heading_error=motion.heading_error,
        heading_error_std=motion.heading_error_std,
        accelerometer_bias=_triple(motion.bias),
        accelerometer_bias_std=_triple(motion.bias_std),
        traces=_traces(data, samples, choice),
    )
    density = _column(data, "density")
    rho = float(np.nanmedian(density)) if np.isfinite(density).any() else SEA_LEVEL_DENSITY
    return replace(air, notes=notes(air, float(prior.std[SLOPE]), speed, rho, log_wind))


def _triple(values: FloatArray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def _found(choice: _Choice, speed: float, smoothing: float) -> AirData:
    theta, std = choice.fit.theta, choice.fit.std
    air = AirData(
        choice.method,
        wind_n=float(theta[WIND_N]),
        wind_e=float(theta[WIND_E]),
        wind_n_std=float(std[WIND_N]),
        wind_e_std=float(std[WIND_E]),
        residual_rms=choice.fit.rms[0] if choice.fit.rms else NAN,
        sideslip_wind=_wind_and_std(choice.sideslip),
    )
    air = _with_incidence(air, choice, speed, smoothing)
    if "pitot" not in choice.method:
        return air
    return replace(
        air,
        pitot_scale=float(1.0 / theta[SLOPE]),
        pitot_scale_std=float(std[SLOPE] / theta[SLOPE] ** 2),
        pitot_offset=float(theta[OFFSET]),
        pitot_offset_std=float(std[OFFSET]),
    )


def _with_incidence(air: AirData, choice: _Choice, speed: float, smoothing: float) -> AirData:
    """Take what the fit leaves over as the gusts, alike in all directions."""
    slope = float(choice.fit.theta[SLOPE]) if "pitot" in choice.method else 1.0
    gust = air.residual_rms / slope
    error = float(np.sqrt(gust**2 + choice.fit.wind_std**2 + smoothing**2))
    return replace(air, gust=gust, incidence_std=error / speed)


def _wind_and_std(found: Fit | None) -> tuple[float, float, float, float]:
    if found is None:
        return NAN, NAN, NAN, NAN
    (north, east), (north_std, east_std) = found.theta[:2], found.std[:2]
    return float(north), float(east), float(north_std), float(east_std)


def _traces(data: xr.Dataset, samples: Airborne, choice: _Choice) -> dict[str, FloatArray]:
    theta = choice.fit.theta
    air, speed = air_relative(samples.velocity, theta)
    at = np.searchsorted(data["time"].to_numpy(), samples.time)
    traces = {
        "time": samples.time,
        "speed_inertial": speed,
        "pitot": samples.pitot,
        "pitot_corrected": (samples.pitot - theta[OFFSET]) / theta[SLOPE],
        "wind_n_log": _column(data, "wind_n")[at],
        "wind_e_log": _column(data, "wind_e")[at],
        "beta": np.arcsin(np.clip(np.sum(samples.right * air, axis=1) / speed, -1.0, 1.0)),
    }
    if choice.sideslip is not None:
        trim, kappa = choice.sideslip.theta[TRIM], choice.sideslip.theta[KAPPA]
        traces["beta_from_force"] = trim + kappa * samples.lateral / speed**2
    return traces


def _with_air(
    data: xr.Dataset, rotation: FloatArray, velocity: FloatArray, flying: FloatArray, air: AirData
) -> xr.Dataset:
    """Add V, alpha, beta; the angles only in flight, where the airspeed is well above zero."""
    through = velocity - np.array([air.wind_n, air.wind_e, 0.0])
    u, v, w = np.einsum("nij,ni->jn", rotation, through)
    speed = np.sqrt(u**2 + v**2 + w**2)
    fast = (flying == 1.0) & (speed > SLOWEST)
    alpha = np.where(fast, np.arctan2(w, u), np.nan)
    beta = np.where(fast, np.arcsin(np.clip(v / np.maximum(speed, SLOWEST), -1.0, 1.0)), np.nan)
    columns = {"V": speed, "alpha": alpha, "beta": beta}
    columns |= dict(zip(("vn_smooth", "ve_smooth", "vd_smooth"), velocity.T, strict=True))
    return data.assign({name: ("time", x, ATTRIBUTES[name]) for name, x in columns.items()})
