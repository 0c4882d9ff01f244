"""Usual sizes of what a vehicle file must hold, for messages and for checks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

ADVICE: Final = "or run stoop vehicle new"


@dataclass(frozen=True)
class Gyration:
    """Radii of gyration about one axis, over the length of the vehicle."""

    least: float  #: outside of `least` and `most` hardly any aircraft lies
    most: float
    low: float  #: `low` and `high` are of usual aircraft
    high: float


#: over the span; at most a uniform rod, a flying wing or a long fuselage, at least all mass near the middle. Usual: half of
#: the nondimensional radii of Raymer, "Aircraft Design: A Conceptual Approach", table of radii of gyration
WINGED: Final = {
    "xx": Gyration(0.05, 1.0 / math.sqrt(12.0), 0.11, 0.17),
    "yy": Gyration(0.03, 0.5, 0.1, 0.25),
    "zz": Gyration(0.08, 0.55, 0.17, 0.27),
}
#: over the largest distance between rotors; at most all mass is in the motors
ROTORS_ONLY: Final = {
    "xx": Gyration(0.07, 0.4, 0.18, 0.3),
    "yy": Gyration(0.07, 0.4, 0.18, 0.3),
    "zz": Gyration(0.1, 0.55, 0.25, 0.42),
}


@dataclass(frozen=True)
class Usual:
    """Usual values of what files leave out, with standard deviations, and usual sizes."""

    #: s, of servos and of motors with propellers: hobby servos follow small commands with a bandwidth of 2 to 8 Hz, that is 20 to
    #: 80 ms of first order; propellers of small vehicles take 30 to 100 ms
    lag: float = 0.05
    lag_std: float = 0.03
    #: s, from a command's time stamp to the motion's: pulses of 50 Hz, filters of sensors, logging; negative where
    #: measurements are stamped late
    delay: float = 0.02
    delay_std: float = 0.02
    #: s, from a reading to its time stamp: filters, buses, logging; receivers of GNSS take 0.1 to 0.3 s
    sensor_delay_std: float = 0.15
    sensor_delay_bounds: tuple[float, float] = (-0.1, 0.5)
    #: s, of a delay of commands that was found in the record: what lag and delay share
    found_delay_std: float = 0.05
    #: standard deviation of coefficients of thrust, in parts of them: propeller data against flight
    thrust: float = 0.2
    #: kg/m3, moment of inertia of a propeller over the fifth power of its diameter: of 23 propellers of JSBSim, 0.24 m to
    #: 4.4 m, the quartiles are 0.041 and 0.098, the median is 0.064
    propeller_inertia: float = 0.065
    #: shortest lag that is integrated, in samples: a step of Runge-Kutta is stable to 1 / 0.36
    lag_samples: float = 0.4
    aspect_ratios: tuple[float, float] = (5.0, 14.0)  #: of small airplanes
    #: kg over the square of the span: 0.1 kg of 0.43 m to 13.5 kg of 2.9 m, within a factor of two
    mass_by_span: tuple[float, float] = (0.4, 2.5)


USUAL: Final = Usual()
LIFT: Final = (0.3, 0.9)  #: CL of cruise


def usual_size(key: str, raw: Mapping[str, Any]) -> str:
    """Return the usual size of a number that a file lacks, from what it has; empty where nothing is known of it.

    Parameters
    ----------
    key : place in the file, ``mass.inertia.xx``
    raw : tables of the file
    """
    mass, span, area = (_number(raw, *path) for path in _KNOWN)
    moments = {f"mass.inertia.{axis}": radius for axis, radius in WINGED.items()}
    if key in moments:
        low, high = moments[key].low, moments[key].high
        formula = f"mass ({low:g}..{high:g} span)^2"
        if not (mass and span):
            return f"usual: {formula} of an airplane"
        sizes = _range(mass * (low * span) ** 2, mass * (high * span) ** 2)
        return f"usual: {formula} = {sizes} kg m2 for this mass and span"
    airspeed = math.sqrt(16.0 * mass / area) if area else 0.0
    usual = {
        "mass.mass": (USUAL.mass_by_span, span**2, "kg for this span"),
        "reference.span": (_roots(USUAL.mass_by_span), math.sqrt(mass), "m for this mass"),
        "reference.chord": (_inverse(USUAL.aspect_ratios), span, "m for this span"),
        "reference.area": (_inverse(USUAL.aspect_ratios), span**2, "m2 for this span"),
        "reference.airspeed": (_roots(LIFT), airspeed, "m/s for this mass and area"),
        "propulsion.diameter": ((0.15, 0.24), math.cbrt(mass), "m for this mass"),
    }
    if key in usual:
        (low, high), factor, unit = usual[key]
        return f"usual: {_range(low * factor, high * factor)} {unit}" if factor > 0.0 else ""
    return {"mass.inertia": "xx, yy and zz in kg m2", "mass": "mass and inertia"}.get(key, "")


_KNOWN: Final = (("mass", "mass"), ("reference", "span"), ("reference", "area"))


def _number(raw: Any, *path: str) -> float:
    for part in (*path, "value"):
        raw = raw.get(part) if isinstance(raw, Mapping) else raw
    known = isinstance(raw, int | float) and not isinstance(raw, bool) and 0.0 < raw < 1e9
    return float(raw) if known else 0.0


def _range(low: float, high: float) -> str:
    return f"{low:.2g} to {high:.2g}"


def _inverse(limits: tuple[float, float]) -> tuple[float, float]:
    return 1.0 / limits[1], 1.0 / limits[0]


def _roots(limits: tuple[float, float]) -> tuple[float, float]:
    low, high = _inverse(limits)
    return math.sqrt(low), math.sqrt(high)
