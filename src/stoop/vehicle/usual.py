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
ASPECT_RATIOS: Final = (5.0, 14.0)  #: of small airplanes
#: kg over the square of the span: 0.1 kg of 0.43 m to 13.5 kg of 2.9 m, within a factor of two
MASS_BY_SPAN: Final = (0.4, 2.5)
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
    usual = {
        "mass.mass": (MASS_BY_SPAN, span**2, "kg for this span"),
        "reference.span": (_roots(MASS_BY_SPAN), math.sqrt(mass), "m for this mass"),
        "reference.chord": (_inverse(ASPECT_RATIOS), span, "m for this span"),
        "reference.area": (_inverse(ASPECT_RATIOS), span**2, "m2 for this span"),
        "reference.airspeed": (
            _roots(LIFT),
            math.sqrt(16.0 * mass / area) if area else 0.0,
            "m/s for this mass and area",
        ),
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
