"""A vehicle as a JSBSim aircraft file; every number with all its digits, in JSBSim's own units.

JSBSim converts SI units with rounded factors (2.20462 lb per kg), so the factors here are exact and the file
holds feet, inches, pounds and slugs. Its structural axes point aft, right and up.
"""

from __future__ import annotations

import math
from typing import Final
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement

from stoop.base.units import FOOT, INCH, SLUG
from stoop.errors import VehicleError, one_line
from stoop.export.jsbsim_control import delays, flight_control
from stoop.export.jsbsim_function import leaf, number
from stoop.export.jsbsim_model import THRUST, Physics, aerodynamics, pounds
from stoop.vehicle import Vehicle

POUNDS_PER_SLUG: Final = 32.174049  #: what JSBSim takes a weight to a mass with (FGJSBBase)
_AXES: Final = ("x", "y", "z")
Point = tuple[float, float, float]


def aircraft(vehicle: Vehicle) -> str:
    """Return the text of ``aircraft/NAME/NAME.xml``.

    Raises
    ------
    VehicleError
        What JSBSim cannot fly.
    """
    check(vehicle)
    root = Element("fdm_config", {"name": one_line(vehicle.name), "version": "2.0", "release": "BETA"})
    physics = Physics.of(vehicle)
    root.append(_header(vehicle))
    root.append(_metrics(vehicle))
    root.append(_mass_balance(vehicle))
    root.append(Element("ground_reactions"))
    root.append(flight_control(vehicle))
    if vehicle.file.propulsion is not None:
        root.append(_thrust(vehicle))
    root.append(aerodynamics(vehicle, physics))
    return document(root)


def document(root: Element) -> str:
    """Return an XML document, indented."""
    ET.indent(root, " ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, "unicode") + "\n"


def check(vehicle: Vehicle) -> None:
    """Refuse what JSBSim's equations of motion do not have.

    Raises
    ------
    VehicleError
        With what to do instead.
    """
    if vehicle.rotors:
        raise VehicleError(
            f"{vehicle.where}: rotors are not written for JSBSim, which has no form of their induced flow; "
            "export to state-space or simulink"
        )
    if vehicle.reduce == "lateral":
        raise VehicleError(
            f"{vehicle.where}: the lateral model holds speed and incidence, which JSBSim does not; "
            'export to state-space, or set model.reduce = "full"'
        )
    early = [name for name, seconds in delays(vehicle).items() if seconds < 0.0]
    if early:
        raise VehicleError(
            f"{vehicle.where}: the channel {early[0]} acts before it is recorded (its delay is negative), which "
            "JSBSim cannot fly; set the delay to zero"
        )


def point(vehicle: Vehicle, name: str) -> Point:
    """Return a point of the file, m; the center of gravity where the file has none."""
    for place in (name, "mass.center_of_gravity"):
        if f"{place}.x" in vehicle.rows:
            x, y, z = (vehicle.value(f"{place}.{a}") for a in _AXES)
            return x, y, z
    return 0.0, 0.0, 0.0


def _header(vehicle: Vehicle) -> Element:
    out = Element("fileheader")
    SubElement(out, "author").text = "stoop"
    words = "; ".join((f"{vehicle.name}: made by stoop export, see docs/export.md", *vehicle.file.notes))
    SubElement(out, "description").text = one_line(words)
    return out


def _measured(tag: str, x: float, unit: str) -> Element:
    out = leaf(tag, number(x))
    out.set("unit", unit)
    return out


def location(where: Point, name: str | None = None) -> Element:
    """Return a point, m forward, right, down, in JSBSim's inches aft, right, up."""
    out = Element("location", {"unit": "IN"} if name is None else {"name": name, "unit": "IN"})
    signs = (-1.0, 1.0, -1.0)
    out.extend(leaf(a, number(s * x / INCH + 0.0)) for a, s, x in zip(_AXES, signs, where, strict=True))
    return out


def _metrics(vehicle: Vehicle) -> Element:
    out = Element("metrics")
    out.append(_measured("wingarea", vehicle.value("reference.area") / FOOT**2, "FT2"))
    out.append(_measured("wingspan", vehicle.value("reference.span") / FOOT, "FT"))
    out.append(_measured("chord", vehicle.value("reference.chord") / FOOT, "FT"))
    out.append(location(point(vehicle, "reference.moment_point"), "AERORP"))
    out.append(location(point(vehicle, "sensors.accelerometer_position"), "EYEPOINT"))
    out.append(location(point(vehicle, "mass.center_of_gravity"), "VRP"))
    return out


def _mass_balance(vehicle: Vehicle) -> Element:
    """Return mass properties; JSBSim's products of inertia are elements of the tensor in structural axes."""
    out = Element("mass_balance", {"negated_crossproduct_inertia": "true"})
    moment = SLUG * FOOT**2
    for axes, sign in (("xx", 1.0), ("yy", 1.0), ("zz", 1.0), ("xy", 1.0), ("xz", -1.0), ("yz", 1.0)):
        name = f"mass.inertia.{axes}"
        inertia = vehicle.value(name) if name in vehicle.rows else 0.0
        out.append(_measured(f"i{axes}", sign * inertia / moment + 0.0, "SLUG*FT2"))
    out.append(_measured("emptywt", vehicle.value("mass.mass") / SLUG * POUNDS_PER_SLUG, "LBS"))
    out.append(location(point(vehicle, "mass.center_of_gravity"), "CG"))
    return out


def _thrust(vehicle: Vehicle) -> Element:
    """Return the thrust as an external force along its line."""
    out = Element("external_reactions")
    force = SubElement(out, "force", {"name": "thrust", "frame": "BODY"})
    force.append(pounds(THRUST))
    force.append(location(point(vehicle, "propulsion.position")))
    pitch = vehicle.value("propulsion.pitch") if "propulsion.pitch" in vehicle.rows else 0.0
    direction = SubElement(force, "direction")
    along = (math.cos(pitch), 0.0, -math.sin(pitch))
    direction.extend(leaf(a, number(x + 0.0)) for a, x in zip(_AXES, along, strict=True))
    return out
