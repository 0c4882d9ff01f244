"""What a vehicle file says that is possible, but that hardly any aircraft is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from stoop.vehicle.vehicle import Vehicle

ROD: Final = 1.0 / math.sqrt(12.0)  #: radius of gyration over length of a uniform rod
FARTHEST: Final = {
    "xx": ROD,
    "yy": 0.5,
    "zz": 0.55,
}  #: radius of gyration over span; a flying wing or a long fuselage
NEAREST: Final = {"xx": 0.05, "yy": 0.03, "zz": 0.08}  #: likewise; all mass near the middle
_USUAL: Final = {"xx": "0.11 to 0.17", "yy": "0.1 to 0.25", "zz": "0.17 to 0.27"}
#: likewise over the largest distance between rotors; farthest, all mass is in the motors
FARTHEST_ROTORS: Final = {"xx": 0.4, "yy": 0.4, "zz": 0.55}
NEAREST_ROTORS: Final = {"xx": 0.07, "yy": 0.07, "zz": 0.1}
_USUAL_ROTORS: Final = {"xx": "0.18 to 0.3", "yy": "0.18 to 0.3", "zz": "0.25 to 0.42"}


def inertia_doubts(vehicle: Vehicle, estimates: Mapping[str, float] | None = None) -> tuple[str, ...]:
    """Challenge moments of inertia by their radii of gyration over the span, or over the distance between rotors.

    About the roll axis even a wing that carries all mass evenly over its span has 0.29; usual aircraft have 0.11 to
    0.17 (half of the nondimensional radii, 0.22 to 0.34, of textbook tables).

    Parameters
    ----------
    vehicle : Vehicle
    estimates : mapping, optional
        Numbers that replace those of the file, by name.

    References
    ----------
    Raymer, "Aircraft Design: A Conceptual Approach", table of nondimensional radii of gyration.
    """
    given = estimates or {}
    mass = given.get("mass.mass", vehicle.value("mass.mass"))
    winged = vehicle.file.reference is not None
    span = given.get("reference.span", vehicle.value("reference.span")) if winged else rotor_distance(vehicle)
    nearest, farthest = (NEAREST, FARTHEST) if winged else (NEAREST_ROTORS, FARTHEST_ROTORS)
    usual, length = (_USUAL, "spans") if winged else (_USUAL_ROTORS, "of the largest distance between rotors")
    out = []
    for axis in farthest if span > 0.0 else ():
        name = f"mass.inertia.{axis}"
        moment = given.get(name, vehicle.value(name))
        radius = math.sqrt(max(moment, 0.0) / mass) / span
        if not nearest[axis] <= radius <= farthest[axis]:
            likely = mass * (span * _middle(usual[axis])) ** 2
            out.append(_doubt(name, moment, f"{radius:.2f} {length}", likely, usual[axis]))
    return tuple(out)


def rotor_distance(vehicle: Vehicle) -> float:
    """Return the largest distance between two rotors, m; zero for fewer than two."""
    places = [[vehicle.value(f"rotor.{name}.position.{axis}") for axis in "xyz"] for name in vehicle.rotors]
    return max((math.dist(a, b) for a in places for b in places), default=0.0)


def _middle(usual: str) -> float:
    low, high = (float(edge) for edge in usual.split(" to "))
    return 0.5 * (low + high)


def _doubt(name: str, moment: float, radius: str, usual: float, among: str) -> str:
    verdict = "large" if moment > usual else "small"
    return (
        f"{name}: {moment:.4g} kg m2 is implausibly {verdict}: a radius of gyration of {radius}, where "
        f"aircraft have {among}, or about {usual:.2g} kg m2 here. Moments, and so all moment coefficients, are wrong by "
        "the same factor; check the unit, or measure it (swing test)."
    )
