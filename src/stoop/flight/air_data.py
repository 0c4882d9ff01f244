"""Air-relative velocity without a vane: flight-path reconstruction from inertial data and a steady wind.

The ground velocity is smoothed at the rate of the accelerometers (`stoop.flight.velocity_smoother`), a steady
horizontal wind and the calibration of the pitot are estimated over the airborne part (`stoop.flight.airspeed`),
and the difference is turned into body axes::

    (u, v, w) = R' (v_ground - w),  alpha = atan2(w, u),  beta = asin(v / |v_ground - w|)
    V = |v_ground - w| + share (calibrated pitot - |v_ground - w|)

The share of the pitot is that of gusts in the difference (`stoop.flight.airspeed.gust_share`). Gusts and vertical wind are the
error of alpha and beta, about gust / V.

References
----------
.. [1] Klein, Morelli, "Aircraft System Identification", 2nd ed., ch. 10 (data compatibility).
.. [2] Mulder, Chu, Sridhar, Breeman, Laban, "Non-linear aircraft flight path reconstruction review and new
   advances", Prog. Aerospace Sci. 35 (1999) 673.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.base.notices import Notice, notice
from stoop.base.rotations import matrices_of, normalized, quaternions_of
from stoop.base.units import DEGREE
from stoop.base.variables import EULER, QUATERNION, RATES, SPECIFIC_FORCE, VARIABLES, VELOCITY
from stoop.flight import airspeed
from stoop.flight.airborne import hovered
from stoop.flight.flight import NAN, POOR_WIND, AirData, Flight, Gridded
from stoop.flight.gridding import complete
from stoop.flight.instrument_errors import prior_std
from stoop.flight.velocity_smoother import Smoothed, smooth_velocity

RECONSTRUCTED: Final = "reconstructed"  #: source of what no sensor measured
SMOOTHED: Final = ("vn_smooth", "ve_smooth", "vd_smooth")


class Limits:
    """Which samples count, which wind is believed, and what is worth a notice."""

    sample_time: Final = 0.1  #: s between the samples that the wind is fitted to
    speed: Final = 3.0  #: m/s over ground; slower is not flying
    flying_share: Final = 0.4  #: of the highest speed; slower is not flying
    edge: Final = 2.0  #: s cut off around take-off and landing
    time: Final = 5.0  #: s of airborne data (and of pitot) below which nothing is estimated
    rest_speed: Final = 0.5  #: m/s
    rest_rate: Final = 0.1  #: rad/s
    implausible: Final = 3.0  #: standard deviations of its prior, that a wind is off
    kappa: Final = 2000.0  #: m, prior; 2 m / (rho S) is 40 m for a small drone, 2000 m for an airliner
    log_wind: Final = 0.5  #: m/s; no logged wind is believed more than this
    sideslip: Final = 0.15  #: rad, rms; a larger scatter says that the vehicle does not weathercock
    heading_error: Final = 1.5 * DEGREE
    delay: Final = 0.015  #: s
    rest_offset: Final = 0.5  #: m/s
    pitot_inconsistency: Final = 1.0  #: m/s
    disagreement: Final = 3.0  #: standard errors


_WIND_SOURCES: Final = {
    "pitot": "from pitot and ground velocity",
    "pitot and sideslip": "from pitot, ground velocity and the rule that sideslip follows the lateral force",
    "pitot and log": "from the log's own estimate, refined by the pitot",
    "sideslip": "from ground velocity and the rule that sideslip follows the lateral force (no pitot)",
    "log": "the mean of the log's own estimate (no pitot)",
}


def with_air(flight: Flight) -> Flight:
    """Reconstruct what air data were not measured, where there is no vane but ground velocity and attitude.

    A rotorcraft without a pitot has no air data; none are needed.
    """
    there, needed = flight.names, (*VELOCITY, *QUATERNION)
    if there & {"alpha", "beta"} or not there >= set(needed):
        return _with_pitot(flight)
    if not complete(np.column_stack([flight.column(name) for name in needed])).any():
        return _with_pitot(flight)
    columns, air = _columns_with_air(flight)
    if (air.method == "none" and flight.carried_by_rotors()) or (
        air.method == "sideslip" and hovered(flight)
    ):
        return flight
    new = columns.keys() - (there if _measured_speed(flight) is not None else there - {"V"})
    # between readings of the velocity accelerometers tell how it changed
    slow = flight.sources["vn"].readings if not set(SPECIFIC_FORCE) <= there else ()
    source = replace(flight.sources["vn"], source=RECONSTRUCTED, readings=slow)
    sources = dict.fromkeys(sorted(new), source)
    # The reconstruction says more of the pitot than its faults do.
    replaced = [fault.notice for fault in flight.faults if fault.variable == "airspeed_pitot"]
    return replace(
        flight,
        data=Gridded(flight.time, columns),
        air=air,
        sources={**flight.sources, **sources},
        notices=(*(one for one in flight.notices if one not in replaced), *air.notices),
    )


def _with_pitot(flight: Flight) -> Flight:
    """Take the pitot's airspeed as V where none was measured and none can be reconstructed."""
    if "V" in flight.names or "airspeed_pitot" not in flight.names:
        return flight
    columns = {name: flight.column(name) for name in VARIABLES if name in flight.names}
    columns["V"] = columns["airspeed_pitot"]
    return replace(
        flight,
        data=Gridded(flight.time, {name: columns[name] for name in VARIABLES if name in columns}),
        sources={**flight.sources, "V": flight.sources["airspeed_pitot"]},
        notices=(*flight.notices, notice("airspeed-of-pitot", "V")),
    )


def without(flight: Flight, windows: Sequence[tuple[float, float]]) -> Flight:
    """Reconstruct the air data anew, learning nothing about wind and pitot inside some windows [s].

    A flight whose air data were measured, or could not be reconstructed, is returned as it is.
    """
    if not windows or flight.air is None or flight.air.method == "none":
        return flight
    columns, air = _columns_with_air(flight, windows)
    if air.method == "none":
        return flight.with_notices([notice("wind-of-predicted-windows", flight.name)])
    kept = tuple(one for one in flight.notices if one not in flight.air.notices)
    return replace(flight, data=Gridded(flight.time, columns), air=air, notices=(*kept, *air.notices))


def _columns_with_air(
    flight: Flight, exclude: Sequence[tuple[float, float]] = ()
) -> tuple[dict[str, FloatArray], AirData]:
    """Return all columns with reconstructed air data; a measured V stays, and is a pitot where there is none."""
    columns = {name: flight.column(name) for name in VARIABLES if name in flight.names}
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
    if source is None or source.source == RECONSTRUCTED or not np.isfinite(flight.column("V")).any():
        return None
    return flight.column("V")


def _stack(columns: Mapping[str, FloatArray], names: Sequence[str]) -> FloatArray:
    return np.column_stack([columns[name] for name in names])


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
    missing = np.full(time.size, np.nan)
    read = defaultdict(lambda: missing, {n: np.asarray(x, dtype=np.float64) for n, x in columns.items()})
    velocity = _stack(read, VELOCITY)
    whole = set(QUATERNION) <= columns.keys()
    attitude = normalized(_stack(read, QUATERNION)) if whole else quaternions_of(_stack(read, EULER))
    lacking = {"velocity": velocity, "attitude": attitude}
    codes = [f"no-air-data-without-{name}" for name, x in lacking.items() if not complete(x).any()]
    if codes := ["no-air-data-short-record"] * (time.size < 10) + codes:
        return {}, AirData("none", notices=(notice(codes[0]),))
    rotation, step = matrices_of(attitude), float(np.median(np.diff(time)))
    motion = smooth_velocity(time, rotation, _stack(read, SPECIFIC_FORCE), velocity, velocity_rate)
    if motion is None:  # without accelerometers the velocity is taken as logged
        none = np.full(3, np.nan)
        motion = Smoothed(velocity, np.full(time.size, np.nan), none, none, *[NAN] * 6)
    # 1 in flight, 0 on the ground, NaN where it is not known
    ground = np.hypot(motion.velocity[:, 0], motion.velocity[:, 1])
    known, fastest = np.isfinite(ground), np.fmax(ground, read["airspeed_pitot"])
    flying = np.full(ground.size, np.nan)
    if known.any():
        usual = np.nanpercentile(fastest[known], 90.0)
        flying[known] = ((ground > Limits.speed) & (fastest > Limits.flying_share * usual))[known]
    window = np.ones(2 * round(Limits.edge / step) + 1)
    touched = np.convolve(flying == 0.0, window)[window.size // 2 :][: flying.size] > 0.5
    used = (flying == 1.0) & ~touched & complete(motion.velocity)
    for start, stop in exclude:
        used &= (time < start) | (time > stop)
    stride = max(1, round(Limits.sample_time / step))
    good = used & np.isfinite(rotation).all(axis=(1, 2))
    taken = np.flatnonzero(good & (np.arange(good.size) % stride == 0))
    lateral = np.nan_to_num(read["ay"][taken] - np.nan_to_num(motion.bias[1]))
    samples = airspeed.Airborne(
        np.asarray(time[taken], dtype=np.float64),
        stride * step,
        motion.velocity[taken],
        rotation[taken, :, 1],
        lateral,
        read["airspeed_pitot"][taken],
    )
    if samples.time.size * samples.step < Limits.time:
        return {}, AirData("none", notices=(notice("no-air-data-short-flight", duration=Limits.time),))
    air = _air_data(time, read, step, samples, motion)
    through = motion.velocity - np.array([air.wind_n, air.wind_e, 0.0])
    speed, alpha, beta = flow(np.einsum("nij,ni->jn", rotation, through).T, Limits.speed)
    fast = (flying == 1.0) & (speed > Limits.speed)
    if "pitot" in air.method:
        corrected = (read["airspeed_pitot"] - air.pitot_offset) * air.pitot_scale
        apart = air.traces["pitot_corrected"] - air.traces["speed_inertial"]
        usual = float(np.median(air.traces["speed_inertial"]))
        share = airspeed.gust_share(apart, float(np.nan_to_num(_unexplained_error(air, usual))))
        speed = np.where(fast & np.isfinite(corrected), speed + share * (corrected - speed), speed)
    found = {"V": speed, "alpha": np.where(fast, alpha, np.nan), "beta": np.where(fast, beta, np.nan)}
    return found | dict(zip(SMOOTHED, motion.velocity.T, strict=True)), air


def flow(velocity: FloatArray, least: float = 0.0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return airspeed, angle of attack and sideslip (n,) of velocities through the air along body axes (n, 3), m/s.

    Sideslip is taken as if no speed were lower than `least`.
    """
    u, v, w = velocity.T
    speed = np.sqrt(u**2 + v**2 + w**2)
    return speed, np.arctan2(w, u), np.arcsin(np.clip(v / np.maximum(speed, least), -1.0, 1.0))


def _air_data(
    time: FloatArray,
    read: Mapping[str, FloatArray],
    step: float,
    samples: airspeed.Airborne,
    motion: Smoothed,
) -> AirData:
    """Fit the wind and describe it; the residuals of the fit are taken as gusts, alike in all directions."""
    # the median reading of the pitot while the vehicle stands still
    pitot, rest = read["airspeed_pitot"], NAN
    still = np.linalg.norm(motion.velocity, axis=1) < Limits.rest_speed
    still &= ~(np.abs(_stack(read, RATES)) > Limits.rest_rate).any(axis=1) & np.isfinite(pitot)
    if np.count_nonzero(still) * step > 1.0:
        rest = float(np.median(pitot[still]))
    wind = _stack(read, ("wind_n", "wind_e"))
    wind = wind[(time >= samples.time[0]) & (time <= samples.time[-1])]
    wind = wind[complete(wind)]
    logged = (wind.mean(axis=0), wind.std(axis=0)) if wind.size and np.any(wind.mean(axis=0)) else None
    names = ("wind.n", "wind.e", "airspeed_pitot.scale", "airspeed_pitot.bias", "beta.bias")
    prior_mean = np.array([0.0, 0.0, 1.0, rest if np.isfinite(rest) else 0.0, 0.0, 0.0])
    prior = prior_mean, np.array([*map(prior_std, names), Limits.kappa])
    sideslip = _sideslip_wind(samples, *prior)
    method, found = _best_wind(samples, logged, prior, sideslip)
    (north, east, slope, offset, *_), std = found.theta.tolist(), found.std.tolist()
    through, speeds = airspeed.air_relative(samples.velocity, found.theta)
    speed = float(np.median(speeds))
    smoothing = float(np.nanmedian(motion.std)) if np.isfinite(motion.std).any() else 0.0
    rms = found.rms[0] if found.rms else NAN
    at = np.searchsorted(time, samples.time)
    traces = {
        "time": samples.time,
        "speed_inertial": speeds,
        "pitot": samples.pitot,
        "pitot_corrected": (samples.pitot - offset) / slope,
        "wind_n_log": read["wind_n"][at],
        "wind_e_log": read["wind_e"][at],
        "beta": np.arcsin(np.clip(np.sum(samples.right * through, axis=1) / speeds, -1.0, 1.0)),
    }
    values: dict[str, Any] = {"wind_n": north, "wind_e": east, "wind_n_std": std[0], "wind_e_std": std[1]}
    if "pitot" in method:
        values |= {"pitot_scale": 1.0 / slope, "pitot_scale_std": std[airspeed.SLOPE] / slope**2}
        values |= {"pitot_offset": offset, "pitot_offset_std": std[airspeed.OFFSET]}
    if sideslip is not None:
        trim, kappa = sideslip.theta[airspeed.TRIM], sideslip.theta[airspeed.KAPPA]
        traces["beta_from_force"] = trim + kappa * samples.lateral / speeds**2
        values["sideslip_wind"] = (*sideslip.theta[:2].tolist(), *sideslip.std[:2].tolist())
    gust = rms / (slope if "pitot" in method else 1.0)
    air = AirData(
        method,
        **values,
        rest_offset=rest,
        residual_rms=rms,
        gust=gust,
        incidence_std=float(np.sqrt(gust**2 + found.wind_std**2 + smoothing**2)) / speed,
        velocity_delay=motion.delay,
        velocity_delay_std=motion.delay_std,
        heading_error=motion.heading_error,
        heading_error_std=motion.heading_error_std,
        accelerometer_bias=tuple(map(float, motion.bias)),  # type: ignore[arg-type]
        accelerometer_bias_std=tuple(map(float, motion.bias_std)),  # type: ignore[arg-type]
        traces=traces,
    )
    density = read["density"]
    rho = float(np.nanmedian(density)) if np.isfinite(density).any() else SEA_LEVEL_DENSITY
    return replace(air, notices=_notices(air, speed, rho, logged))


def _sideslip_wind(samples: airspeed.Airborne, mean: FloatArray, std: FloatArray) -> airspeed.Fit | None:
    """Fit the wind to the sideslip; None when the vehicle does not fly like a weather vane.

    It does when sideslip, less what the lateral force explains, is small, when that force opposes the sideslip, and when the
    wind that follows does not contradict its prior.
    """
    found = airspeed.fit([(airspeed.sideslip_equation, samples)], mean, std)
    speed = float(np.median(airspeed.air_relative(samples.velocity, found.theta)[1]))
    steady = found.rms[0] < Limits.sideslip * speed
    opposing = found.theta[airspeed.KAPPA] < 2.0 * found.std[airspeed.KAPPA]
    apart = (found.theta - mean)[: airspeed.SLOPE] / std[: airspeed.SLOPE]
    plausible = bool(np.all(np.abs(apart) < Limits.implausible))
    return found if steady and opposing and plausible else None


def _best_wind(
    samples: airspeed.Airborne,
    logged: tuple[FloatArray, FloatArray] | None,
    prior: tuple[FloatArray, FloatArray],
    sideslip: airspeed.Fit | None,
) -> tuple[str, airspeed.Fit]:
    """Trust the pitot when it determines the wind, else the most certain of the other estimates."""
    with_pitot = samples.where(np.isfinite(samples.pitot))
    pitot: list[airspeed.Evidence] = []
    if with_pitot.time.size * samples.step > Limits.time:
        pitot = [(airspeed.pitot_equation, with_pitot)]
    options: list[tuple[str, airspeed.Fit]] = []
    if pitot:
        options.append(("pitot", airspeed.fit(pitot, *prior)))
        if options[0][1].wind_std < POOR_WIND:
            return options[0]
        if sideslip is not None:
            both = airspeed.fit([*pitot, (airspeed.sideslip_equation, samples)], *prior)
            options.append(("pitot and sideslip", both))
    elif sideslip is not None:
        options.append(("sideslip", sideslip))
    if logged is not None:
        mean = np.concatenate([logged[0], prior[0][2:]])
        std = np.concatenate([np.maximum(logged[1], Limits.log_wind), prior[1][2:]])
        options.append(("pitot and log" if pitot else "log", airspeed.fit(pitot, mean, std)))
    options = options or [("still air", airspeed.fit([], *prior))]
    return min(options, key=lambda option: option[1].wind_std)


def _notices(
    air: AirData, speed: float, density: float, logged: tuple[FloatArray, FloatArray] | None
) -> tuple[Notice, ...]:
    """Return what was found at a typical true airspeed [m/s] and a density [kg/m3]."""
    found = [notice("wind-unknown")]
    if air.method != "still air":
        wind = {"north": air.wind_n, "east": air.wind_e, "speed": float(np.hypot(air.wind_n, air.wind_e))}
        wind["direction"] = float(np.arctan2(-air.wind_e, -air.wind_n) % (2.0 * np.pi))
        wind |= {"north_std": air.wind_n_std, "east_std": air.wind_e_std}
        code = "steady-wind" if air.wind_known else "steady-wind-poor"
        found = [notice(code, "", **wind, source=_WIND_SOURCES[air.method])]
    found += _pitot_notices(air, speed, density)
    north, east, north_std, east_std = air.sideslip_wind
    if np.isfinite(north) and "sideslip" not in air.method:
        apart = np.array([north - air.wind_n, east - air.wind_e])
        scaled = apart / np.hypot([air.wind_n_std, air.wind_e_std], [north_std, east_std])
        distance = float(np.sqrt(np.mean(scaled**2)))
        code = "sideslip-wind-agrees" if distance < Limits.disagreement else "sideslip-wind-disagrees"
        values = {"north": north, "north_std": north_std, "east": east, "east_std": east_std}
        found.append(notice(code, "", **values, distance=distance))
    if logged is not None and "log" not in air.method:
        (n, e), std = logged[0].tolist(), float(np.hypot(*logged[1]))
        distance = float(np.hypot(n - air.wind_n, e - air.wind_e))
        found.append(notice("logged-wind-unused", north=n, east=e, std=std, distance=distance))
    delay, heading = air.velocity_delay, air.heading_error
    if abs(delay) > max(Limits.delay, 3.0 * air.velocity_delay_std):
        code = "velocity-late" if delay > 0.0 else "velocity-early"
        found.append(notice(code, delay_ms=1e3 * abs(delay), std_ms=1e3 * air.velocity_delay_std))
    if abs(heading) > max(Limits.heading_error, 3.0 * air.heading_error_std):
        found.append(notice("heading-error", "psi", error=-heading, std=air.heading_error_std))
    if np.isfinite(air.incidence_std):
        found.append(notice("incidence-reconstructed", gust=air.gust, std=air.incidence_std, speed=speed))
    return tuple(found)


def _unexplained_error(air: AirData, speed: float) -> float:
    """Return the error of the pitot at a true airspeed less what the pressure that it shows at rest explains, all in m/s."""
    rest = air.rest_offset
    return speed / air.pitot_scale + air.pitot_offset - speed - 0.5 * rest * abs(rest) / speed


def _pitot_notices(air: AirData, speed: float, density: float) -> list[Notice]:
    """Return the calibration, and how the reading at rest agrees with it: a pressure offset fades as 1 / V."""
    found, error = [], speed / air.pitot_scale + air.pitot_offset - speed  # reading minus truth
    if np.isfinite(air.pitot_scale):
        line = {"offset": air.pitot_offset, "offset_std": air.pitot_offset_std, "scale": air.pitot_scale}
        line |= {"scale_std": air.pitot_scale_std, "speed": speed, "error": abs(error)}
        code = "pitot-reads-low" if error < 0.0 else "pitot-reads-high"
        found.append(notice(code, "airspeed_pitot", **line))
        if air.pitot_scale_std / air.pitot_scale**2 > 0.5 * prior_std("airspeed_pitot.scale"):
            found.append(notice("pitot-scale-unknown", "airspeed_pitot"))
    rest = air.rest_offset
    if abs(rest) > Limits.rest_offset:
        pressure = 0.5 * density * rest * abs(rest)
        found.append(notice("pitot-pressure-offset", "airspeed_pitot", reading=rest, pressure=pressure))
        unexplained = _unexplained_error(air, speed)
        if abs(unexplained) > Limits.pitot_inconsistency:  # never of a pitot without calibration: NaN
            values = {"explained": error - unexplained, "speed": speed, "error": error}
            found.append(notice("pitot-offset-inconsistent", "airspeed_pitot", **values))
    return found
