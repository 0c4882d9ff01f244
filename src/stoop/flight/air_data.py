"""Result of the air data reconstruction, and the notices that it gives rise to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.units import DEGREE

NAN: Final = float("nan")
MIN_HEADING_ERROR: Final = 1.5 * DEGREE
MIN_REST_OFFSET: Final = 0.5  #: m/s
POOR_WIND_STD: Final = 1.5  #: m/s, a wind less certain than this
MAX_DISAGREEMENT: Final = 3.0  #: standard errors
MAX_PITOT_INCONSISTENCY: Final = 1.0  #: m/s
MIN_DELAY: Final = 0.015  #: s


@dataclass(frozen=True)
class AirData:
    """What the reconstruction found; NaN where the flight holds no such thing.

    Attributes
    ----------
    method : "pitot", "pitot and sideslip", "pitot and log", "sideslip", "log" (where the wind is from),
        "still air" (it is unknown and taken as zero) or "none" (nothing was reconstructed)
    wind_n, wind_e : m/s, towards which the air moves; steady over the flight
    wind_n_std, wind_e_std : m/s, standard errors, the color of the residuals counted
    pitot_scale, pitot_offset : true airspeed = (airspeed_pitot - pitot_offset) * pitot_scale; 1, m/s
    pitot_scale_std, pitot_offset_std : standard errors
    rest_offset : m/s, median reading of the pitot on the ground
    residual_rms : m/s, of the residual that the wind was fitted to
    sideslip_wind : (north, east, standard errors of both) m/s, from sideslip and lateral force alone
    gust : m/s, estimate of what a steady wind leaves out, per axis
    incidence_std : rad, standard error of alpha and beta from gusts and the error of the wind together
    velocity_delay, velocity_delay_std : s, by which the logged velocity is late (corrected when evident)
    heading_error, heading_error_std : rad, true minus logged heading, mean of the flight (not corrected)
    accelerometer_bias, accelerometer_bias_std : (3,) m/s2, body axes
    notices : for the user
    traces : name -> (n,), airborne samples to plot: time, speed_inertial (|v - w|), pitot, pitot_corrected,
        wind_n_log, wind_e_log, beta, beta_from_force
    """

    method: str
    wind_n: float = NAN
    wind_e: float = NAN
    wind_n_std: float = NAN
    wind_e_std: float = NAN
    pitot_scale: float = NAN
    pitot_scale_std: float = NAN
    pitot_offset: float = NAN
    pitot_offset_std: float = NAN
    rest_offset: float = NAN
    residual_rms: float = NAN
    sideslip_wind: tuple[float, float, float, float] = (NAN, NAN, NAN, NAN)
    gust: float = NAN
    incidence_std: float = NAN
    velocity_delay: float = NAN
    velocity_delay_std: float = NAN
    heading_error: float = NAN
    heading_error_std: float = NAN
    accelerometer_bias: tuple[float, float, float] = (NAN, NAN, NAN)
    accelerometer_bias_std: tuple[float, float, float] = (NAN, NAN, NAN)
    notices: tuple[Notice, ...] = ()
    traces: Mapping[str, FloatArray] = field(default_factory=dict, compare=False, repr=False)

    def pitot_error(self, speed: float) -> float:
        """Return reading minus truth at a true airspeed [m/s]."""
        return speed / self.pitot_scale + self.pitot_offset - speed


@dataclass(frozen=True)
class LogWind:
    """Wind as logged while airborne: mean (2,) and standard deviation (2,), m/s; NaN if none."""

    mean: FloatArray
    std: FloatArray

    @property
    def known(self) -> bool:
        """Whether the log holds a wind other than zero."""
        return bool(np.isfinite(self.mean).all() and np.any(self.mean != 0.0))


_WIND_SOURCES: Final = {
    "pitot": "from pitot and ground velocity",
    "pitot and sideslip": "from pitot, ground velocity and the rule that sideslip follows the lateral force",
    "pitot and log": "from the log's own estimate, refined by the pitot",
    "sideslip": "from ground velocity and the rule that sideslip follows the lateral force (no pitot)",
    "log": "the mean of the log's own estimate (no pitot)",
}


def air_data_notices(
    air: AirData, slope_prior: float, speed: float, density: float, log_wind: LogWind
) -> tuple[Notice, ...]:
    """Return what was found as notices.

    Parameters
    ----------
    air : without notices
    slope_prior : standard deviation of the slope of the pitot before the flight
    speed : m/s, typical true airspeed in flight
    density : kg/m3
    log_wind : wind as logged
    """
    found = [_wind(air), *_pitot(air, slope_prior, speed, density), *_other_winds(air, log_wind)]
    delay, heading = air.velocity_delay, air.heading_error
    if abs(delay) > max(MIN_DELAY, 3.0 * air.velocity_delay_std):
        code = "velocity-late" if delay > 0.0 else "velocity-early"
        found.append(notice(code, delay_ms=1e3 * abs(delay), std_ms=1e3 * air.velocity_delay_std))
    if abs(heading) > max(MIN_HEADING_ERROR, 3.0 * air.heading_error_std):
        found.append(notice("heading-error", "psi", error=-heading, std=air.heading_error_std))
    if np.isfinite(air.incidence_std):
        found.append(notice("incidence-reconstructed", gust=air.gust, std=air.incidence_std, speed=speed))
    return tuple(found)


def _wind(air: AirData) -> Notice:
    if air.method == "still air":
        return notice("wind-unknown")
    poor = max(air.wind_n_std, air.wind_e_std) > POOR_WIND_STD
    return notice(
        "steady-wind-poor" if poor else "steady-wind",
        speed=float(np.hypot(air.wind_n, air.wind_e)),
        direction=float(np.arctan2(-air.wind_e, -air.wind_n) % (2.0 * np.pi)),
        north=air.wind_n,
        north_std=air.wind_n_std,
        east=air.wind_e,
        east_std=air.wind_e_std,
        source=_WIND_SOURCES[air.method],
    )


def _pitot(air: AirData, slope_prior: float, speed: float, density: float) -> Iterator[Notice]:
    """Yield the calibration, and how the reading at rest agrees with it: a pressure offset fades as 1 / V."""
    calibrated = bool(np.isfinite(air.pitot_scale))
    if calibrated:
        error = air.pitot_error(speed)
        yield notice(
            "pitot-reads-low" if error < 0.0 else "pitot-reads-high",
            "airspeed_pitot",
            offset=air.pitot_offset,
            offset_std=air.pitot_offset_std,
            scale=air.pitot_scale,
            scale_std=air.pitot_scale_std,
            speed=speed,
            error=abs(error),
        )
        if air.pitot_scale_std / air.pitot_scale**2 > 0.5 * slope_prior:
            yield notice("pitot-scale-unknown", "airspeed_pitot")
    rest = air.rest_offset
    if abs(rest) > MIN_REST_OFFSET:
        pressure = 0.5 * density * rest * abs(rest)
        yield notice("pitot-pressure-offset", "airspeed_pitot", reading=rest, pressure=pressure)
        explained = pressure / (density * speed)
        if calibrated and abs(air.pitot_error(speed) - explained) > MAX_PITOT_INCONSISTENCY:
            error = air.pitot_error(speed)
            yield notice(
                "pitot-offset-inconsistent", "airspeed_pitot", explained=explained, speed=speed, error=error
            )


def _other_winds(air: AirData, log_wind: LogWind) -> Iterator[Notice]:
    """Compare the wind with that of the sideslip alone and with the logged one, where they were not used."""
    north, east, north_std, east_std = air.sideslip_wind
    if np.isfinite(north) and "sideslip" not in air.method:
        scaled = np.array([north - air.wind_n, east - air.wind_e]) / np.hypot(
            [air.wind_n_std, air.wind_e_std], [north_std, east_std]
        )
        distance = float(np.sqrt(np.mean(scaled**2)))
        yield notice(
            "sideslip-wind-agrees" if distance < MAX_DISAGREEMENT else "sideslip-wind-disagrees",
            north=north,
            north_std=north_std,
            east=east,
            east_std=east_std,
            distance=distance,
        )
    if log_wind.known and "log" not in air.method:
        yield notice(
            "logged-wind-unused",
            north=float(log_wind.mean[0]),
            east=float(log_wind.mean[1]),
            std=float(np.hypot(*log_wind.std)),
            distance=float(np.hypot(*(log_wind.mean - np.array([air.wind_n, air.wind_e])))),
        )
