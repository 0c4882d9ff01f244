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


def inertia_doubts(vehicle: Vehicle, estimates: Mapping[str, float] | None = None) -> tuple[str, ...]:
    """Challenge moments of inertia by their radii of gyration over the span.

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
    values = {name: vehicle.value(name) for name in ("mass.mass", "reference.span")} | dict(estimates or {})
    mass, span = values["mass.mass"], values["reference.span"]
    out = []
    for axis, farthest in FARTHEST.items():
        name = f"mass.inertia.{axis}"
        moment = values.get(name, vehicle.value(name))
        radius = math.sqrt(max(moment, 0.0) / mass) / span
        if not NEAREST[axis] <= radius <= farthest:
            out.append(_doubt(name, moment, radius, mass * (span * _middle(axis)) ** 2, _USUAL[axis]))
    return tuple(out)


def _middle(axis: str) -> float:
    low, high = (float(edge) for edge in _USUAL[axis].split(" to "))
    return 0.5 * (low + high)


def _doubt(name: str, moment: float, radius: float, usual: float, among: str) -> str:
    verdict = "large" if moment > usual else "small"
    return (
        f"{name}: {moment:.4g} kg m2 is implausibly {verdict}: a radius of gyration of {radius:.2f} spans, where "
        f"aircraft have {among}, or about {usual:.2g} kg m2 here. Moments, and so all moment coefficients, are wrong by "
        "the same factor; check the unit, or measure it (swing test)."
    )
