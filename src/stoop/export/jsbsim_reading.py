"""Read an exported aircraft back: what it says of mass, geometry and coefficients, in SI, by the vehicle's names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element

from stoop.base.units import FOOT, INCH, SLUG
from stoop.export.jsbsim_aircraft import POUNDS_PER_SLUG
from stoop.export.jsbsim_model import coefficient
from stoop.vehicle import Vehicle

_PREFIX: Final = coefficient("")
_METRICS: Final = {
    "wingarea": ("reference.area", FOOT**2),
    "wingspan": ("reference.span", FOOT),
    "chord": ("reference.chord", FOOT),
}
_SIGNS: Final = {"xz": -1.0}
_POINTS: Final = {
    "AERORP": "reference.moment_point",
    "EYEPOINT": "sensors.accelerometer_position",
    "CG": "mass.center_of_gravity",
}


def numbers(text: str) -> dict[str, float]:
    """Return mass properties, geometry and aerodynamic coefficients of an aircraft file that stoop wrote, SI.

    The text is trusted: it is read to see what writing has changed.
    """
    root = ET.fromstring(text)  # noqa: S314 - our own
    out = dict(_coefficients(root))
    for tag, (name, unit) in _METRICS.items():
        out[name] = _value(root, f"metrics/{tag}") * unit
    out["mass.mass"] = _value(root, "mass_balance/emptywt") / POUNDS_PER_SLUG * SLUG
    for axes in ("xx", "yy", "zz", "xz", "xy", "yz"):
        inertia = _value(root, f"mass_balance/i{axes}") * SLUG * FOOT**2
        out[f"mass.inertia.{axes}"] = _SIGNS.get(axes, 1.0) * inertia
    for place in root.iter("location"):
        out |= _point(place)
    return out


def _value(root: Element, path: str) -> float:
    return float(root.findtext(path) or "nan")


def _point(place: Element) -> dict[str, float]:
    name = _POINTS.get(place.get("name", ""))
    if name is None:
        return {}
    signs = {"x": -1.0, "y": 1.0, "z": -1.0}
    return {f"{name}.{a}": s * _value(place, a) * INCH for a, s in signs.items()}


def _coefficients(root: Element) -> Iterator[tuple[str, float]]:
    """Yield aerodynamic terms: the last number of the product but one element, which is what it multiplies."""
    for axis in root.iterfind("aerodynamics/axis"):
        for function in axis.iterfind("function"):
            body = function.find("product")
            if body is not None:
                yield function.get("name", "").removeprefix(_PREFIX), float(list(body)[-2].text or "nan")


def changed(vehicle: Vehicle, text: str) -> Mapping[str, float]:
    """Return by how much of itself each number differs from the vehicle's; of a zero, by how much."""
    read = numbers(text)
    own = {name: vehicle.value(name) for name in read if name in vehicle.rows}
    return {name: abs(read[name] - x) / (abs(x) or 1.0) for name, x in own.items()}
