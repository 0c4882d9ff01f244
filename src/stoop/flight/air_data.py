"""What the flight-path reconstruction found, and how it is said to the user."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.units import DEGREE

NAN: Final = float("nan")
NAN3: Final = (NAN, NAN, NAN)
EVIDENT_HEADING: Final = 1.5 * DEGREE
EVIDENT_REST: Final = 0.5  #: m/s
POOR: Final = 1.5  #: m/s, a wind less certain than this
DISAGREE: Final = 3.0  #: standard errors
INCONSISTENT: Final = 1.0  #: m/s
LATE: Final = 0.015  #: s


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
    notes : plain words for the user
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
    accelerometer_bias: tuple[float, float, float] = NAN3
    accelerometer_bias_std: tuple[float, float, float] = NAN3
    notes: tuple[str, ...] = ()
    traces: Mapping[str, FloatArray] = field(default_factory=dict, compare=False, repr=False)


def notes(
    air: AirData, slope_prior: float, speed: float, density: float, log_wind: LogWind
) -> tuple[str, ...]:
    """Say in plain words what was found.

    Parameters
    ----------
    air : without notes
    slope_prior : what the slope of the pitot was uncertain by before the flight
    speed : m/s, typical true airspeed in flight
    density : kg/m3
    log_wind : wind as logged
    """
    lines = [
        _wind(air),
        *_pitot(air, slope_prior, speed),
        *_rest(air, speed, density),
        *_crosscheck(air),
        *_logged(air, log_wind),
        *_motion(air),
        _incidence(air, speed),
    ]
    return tuple(line for line in lines if line)


@dataclass(frozen=True)
class LogWind:
    """Wind as logged while airborne: mean (2,) and wander (2,) (standard deviation), m/s; NaN if none."""

    mean: FloatArray
    wander: FloatArray

    @property
    def known(self) -> bool:
        """Whether the log holds a wind other than zero."""
        return bool(np.isfinite(self.mean).all() and np.any(self.mean != 0.0))


_FROM: Final = {
    "pitot": "from pitot and ground velocity",
    "pitot and sideslip": "from pitot, ground velocity and the rule that sideslip follows the lateral force",
    "pitot and log": "from the log's own estimate, refined by the pitot",
    "sideslip": "from ground velocity and the rule that sideslip follows the lateral force (no pitot)",
    "log": "the mean of the log's own estimate (no pitot)",
    "still air": "unknown and taken as zero: give a pitot, a wind or a flight that turns",
}


def _pm(value: float, std: float, digits: int = 2) -> str:
    return f"{value:.{digits}f} +- {std:.{digits}f}"


def _wind(air: AirData) -> str:
    if air.method == "still air":
        return f"wind: {_FROM[air.method]}; V, alpha and beta are relative to the ground"
    strength = np.hypot(air.wind_n, air.wind_e)
    origin = np.arctan2(-air.wind_e, -air.wind_n) / DEGREE % 360.0
    poor = max(air.wind_n_std, air.wind_e_std) > POOR
    return (
        f"steady wind {strength:.1f} m/s from {origin:.0f} deg (north {_pm(air.wind_n, air.wind_n_std)}, "
        f"east {_pm(air.wind_e, air.wind_e_std)} m/s, one standard error), {_FROM[air.method]}"
        + ("; POORLY DETERMINED: the flight turns too little to tell it" if poor else "")
    )


def _pitot_error(air: AirData, speed: float) -> float:
    """Return reading minus truth at a true airspeed [m/s]."""
    return speed / air.pitot_scale + air.pitot_offset - speed


def _pitot(air: AirData, slope_prior: float, speed: float) -> list[str]:
    if not np.isfinite(air.pitot_scale):
        return []
    error = _pitot_error(air, speed)
    lines = [
        f"pitot: true airspeed = (reading - ({_pm(air.pitot_offset, air.pitot_offset_std, 1)} m/s)) x "
        f"({_pm(air.pitot_scale, air.pitot_scale_std)}); "
        f"at {speed:.0f} m/s it reads {abs(error):.1f} m/s {'low' if error < 0.0 else 'high'}"
    ]
    if air.pitot_scale_std / air.pitot_scale**2 > 0.5 * slope_prior:
        lines.append(
            "pitot: its scale cannot be told from wind and offset in this flight (too straight, or too even "
            "in speed) and is held near 1"
        )
    return lines


def _rest(air: AirData, speed: float, density: float) -> list[str]:
    """Compare the reading at rest with the calibration in flight: a pressure offset fades as 1 / V."""
    if not abs(air.rest_offset) > EVIDENT_REST:
        return []
    pressure = 0.5 * density * air.rest_offset * abs(air.rest_offset)
    lines = [
        f"pitot fault: it reads {air.rest_offset:.1f} m/s at rest, as a pressure offset of {pressure:.1f} Pa "
        "(or wind on the ground) would make it"
    ]
    explained = pressure / (density * speed)
    if np.isfinite(air.pitot_scale) and abs(_pitot_error(air, speed) - explained) > INCONSISTENT:
        lines.append(
            f"pitot fault: that offset is worth {explained:.1f} m/s at {speed:.0f} m/s, but there the "
            f"pitot is off by {_pitot_error(air, speed):.1f} m/s: zero drift alone does not explain it "
            "(suspect a leak, a blocked or badly placed port, or the sensor's scale)"
        )
    return lines


def _crosscheck(air: AirData) -> list[str]:
    north, east, north_std, east_std = air.sideslip_wind
    if not np.isfinite(north) or "sideslip" in air.method:
        return []
    scaled = np.array([north - air.wind_n, east - air.wind_e]) / np.hypot(
        [air.wind_n_std, air.wind_e_std], [north_std, east_std]
    )
    apart = float(np.sqrt(np.mean(scaled**2)))
    return [
        f"cross-check: sideslip and lateral force alone give a wind of north {_pm(north, north_std)}, "
        f"east {_pm(east, east_std)} m/s, which {'agrees' if apart < DISAGREE else 'DISAGREES'} "
        f"({apart:.1f} standard errors apart)"
    ]


def _logged(air: AirData, log_wind: LogWind) -> list[str]:
    if not log_wind.known or "log" in air.method:
        return []
    off = float(np.hypot(*(log_wind.mean - np.array([air.wind_n, air.wind_e]))))
    wander = float(np.hypot(*log_wind.wander))
    return [
        f"the log's own wind (mean north {log_wind.mean[0]:.1f}, east {log_wind.mean[1]:.1f} m/s, "
        f"wandering by {wander:.1f} m/s) is {off:.1f} m/s away and was not used"
    ]


def _motion(air: AirData) -> list[str]:
    lines = []
    if abs(air.velocity_delay) > max(LATE, 3.0 * air.velocity_delay_std):
        shift = _pm(1e3 * abs(air.velocity_delay), 1e3 * air.velocity_delay_std, 0)
        sense = "late" if air.velocity_delay > 0.0 else "early"
        lines.append(f"the logged velocity is {shift} ms {sense} against the accelerometers; corrected")
    if abs(air.heading_error) > max(EVIDENT_HEADING, 3.0 * air.heading_error_std):
        off = _pm(-air.heading_error / DEGREE, air.heading_error_std / DEGREE, 1)
        lines.append(
            f"the logged heading is off by {off} deg against the accelerations seen in turns; "
            "it is not corrected and goes into beta"
        )
    return lines


def _incidence(air: AirData, speed: float) -> str:
    if not np.isfinite(air.incidence_std):
        return ""
    return (
        f"alpha and beta are reconstructed, not measured: a steady wind leaves out gusts of about "
        f"{air.gust:.1f} m/s, so both are uncertain by about {air.incidence_std / DEGREE:.1f} deg "
        f"at {speed:.0f} m/s, mostly slowly varying"
    )
