"""A vehicle as the folder that JSBSim takes as its root: aircraft, flat planet, steady flight, script; and read back.

JSBSim converts SI units with rounded factors (2.20462 lb per kg), so the factors here are exact and the files
hold feet, inches, pounds and slugs, every number with all its digits. Its structural axes point aft, right and up.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement

from stoop import Vehicle
from stoop.extend.errors import VehicleError
from stoop.extend.text import printable
from stoop_export.jsbsim_flight import FRAME_RATE, INTEGRATORS, PLANET, START, Record, file_name, settings
from stoop_export.jsbsim_loads import number_place, summed, summed_loads
from stoop_export.jsbsim_model import (
    FOOT,
    INCH,
    POUND_FORCE,
    SLUG,
    THRUST,
    aerodynamics,
    coefficient,
    delays,
    flight_control,
    leaf,
    node,
    number,
    prop,
    value,
)

POUNDS_PER_SLUG: Final = 32.174049  #: with which JSBSim converts a weight to a mass (FGJSBBase)
STEADY: Final = "steady"
Point = tuple[float, float, float]
_AXES: Final = {"x": -1.0, "y": 1.0, "z": -1.0}  #: signs of JSBSim's structural axes
_METRICS: Final = {
    "wingarea": ("reference.area", FOOT**2, "FT2"),
    "wingspan": ("reference.span", FOOT, "FT"),
    "chord": ("reference.chord", FOOT, "FT"),
}
_LOCATIONS: Final = {
    "AERORP": "reference.moment_point",
    "EYEPOINT": "sensors.accelerometer_position",
    "VRP": "mass.center_of_gravity",
}
_INERTIA: Final = {"xx": 1.0, "yy": 1.0, "zz": 1.0, "xy": 1.0, "xz": -1.0, "yz": 1.0}  #: sign by axes
_INERTIA_UNIT: Final = SLUG * FOOT**2
_INITIAL: Final = {
    "u": ("ubody", "FT/SEC"), "v": ("vbody", "FT/SEC"), "w": ("wbody", "FT/SEC"),
    "phi": ("phi", "RAD"), "theta": ("theta", "RAD"), "psi": ("psi", "RAD"), "h": ("altitude", "FT"),
}  #: element and unit of an initialization file  # fmt: skip


def folder(vehicle: Vehicle, steady: Record | None) -> dict[str, str]:
    """Return the files by their place below the root; with a steady flight, its start and a script that flies it.

    Raises
    ------
    VehicleError
        What JSBSim cannot fly.
    """
    name = file_name(vehicle.name)
    out = {
        f"aircraft/{name}/{name}.xml": aircraft(vehicle),
        PLANET: flat_planet(vehicle.value("environment.gravity")),
    }
    if steady is not None:
        out[f"aircraft/{name}/{STEADY}.xml"] = initialization(steady)
        out[f"scripts/{name}.xml"] = script(steady)
    return out


def aircraft(vehicle: Vehicle) -> str:
    """Return the text of ``aircraft/NAME/NAME.xml``; VehicleError for what JSBSim cannot fly."""
    check(vehicle)
    root = Element("fdm_config", {"name": printable(vehicle.name), "version": "2.0", "release": "BETA"})
    header = SubElement(root, "fileheader")
    SubElement(header, "author").text = "stoop"
    words = "; ".join((f"{vehicle.name}: made by stoop export, see docs/export.md", *vehicle.file.notes))
    SubElement(header, "description").text = printable(words)
    metrics = SubElement(root, "metrics")
    for tag, (name, size, unit) in _METRICS.items():
        if name in vehicle.rows:
            metrics.append(_quantity(tag, vehicle.value(name) / size, unit))
    for tag, name in _LOCATIONS.items():
        metrics.append(location(point(vehicle, name), tag))
    # JSBSim's products of inertia are elements of the tensor in structural axes
    masses = SubElement(root, "mass_balance", {"negated_crossproduct_inertia": "true"})
    for axes, sign in _INERTIA.items():
        inertia = vehicle.value(f"mass.inertia.{axes}", 0.0)
        masses.append(_quantity(f"i{axes}", sign * inertia / _INERTIA_UNIT + 0.0, "SLUG*FT2"))
    masses.append(_quantity("emptywt", vehicle.value("mass.mass") / SLUG * POUNDS_PER_SLUG, "LBS"))
    masses.append(location(point(vehicle, "mass.center_of_gravity"), "CG"))
    root.append(Element("ground_reactions"))
    controls = flight_control(vehicle)
    root.append(controls)
    if summed(vehicle):
        more, reactions = summed_loads(vehicle, location(point(vehicle, "mass.center_of_gravity")))
        controls.extend(more)
        # JSBSim remarks on an absent section, and on axes that nothing names
        root.extend(
            [reactions, node("aerodynamics", *(Element("axis", {"name": a}) for a in ("LIFT", "ROLL")))]
        )
    else:
        if vehicle.file.propulsion is not None:
            root.append(_thrust(vehicle))
        root.append(aerodynamics(vehicle))
    return document(root)


def _thrust(vehicle: Vehicle) -> Element:
    """Return the thrust as an external force along its line."""
    reactions = Element("external_reactions")
    force = SubElement(reactions, "force", {"name": "thrust", "frame": "BODY"})
    SubElement(SubElement(force, "function"), "product").extend([prop(THRUST), value(1.0 / POUND_FORCE)])
    force.append(location(point(vehicle, "propulsion.position")))
    pitch = vehicle.value("propulsion.pitch", 0.0)
    along = (math.cos(pitch), 0.0, -math.sin(pitch))
    direction = SubElement(force, "direction")
    direction.extend(leaf(a, number(x + 0.0)) for a, x in zip(_AXES, along, strict=True))
    return reactions


def document(root: Element) -> str:
    """Return an XML document, indented."""
    ET.indent(root, " ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, "unicode") + "\n"


def check(vehicle: Vehicle) -> None:
    """Refuse what JSBSim's equations of motion do not have: VehicleError with what to do instead."""
    early = [name for name, seconds in delays(vehicle).items() if seconds < 0.0]
    if vehicle.reduce == "lateral":
        problem = (
            "the lateral model holds speed and incidence, which JSBSim does not; "
            'export to state-space, or set model.reduce = "full"'
        )
    elif early:
        problem = (
            f"the channel {early[0]} acts before it is recorded (its delay is negative), which JSBSim cannot fly; "
            "set the delay to zero"
        )
    else:
        return
    raise VehicleError(f"{vehicle.where}: {problem}")


def point(vehicle: Vehicle, name: str) -> Point:
    """Return a point of the file, m; the center of gravity where the file has none."""
    place = name if f"{name}.x" in vehicle.rows else "mass.center_of_gravity"
    x, y, z = (vehicle.value(f"{place}.{a}", 0.0) for a in _AXES)
    return x, y, z


def _quantity(tag: str, x: float, unit: str) -> Element:
    out = leaf(tag, number(x))
    out.set("unit", unit)
    return out


def location(where: Point, name: str | None = None) -> Element:
    """Return a point, m forward, right, down, in JSBSim's inches aft, right, up."""
    out = Element("location", {"unit": "IN"} if name is None else {"name": name, "unit": "IN"})
    out.extend(leaf(a, number(s * x / INCH + 0.0)) for (a, s), x in zip(_AXES.items(), where, strict=True))
    return out


def flat_planet(gravity: float) -> str:
    """Return a planet that does not turn and is too large to be round: constant gravity, m/s2.

    Its radius is 1e10 m; over it the air turns by 1e-7 rad in a kilometer, and gravity falls by as much.
    """
    radius = 1e10 / FOOT
    out = Element("planet", {"name": "flat"})
    out.extend(_quantity(f"{axis}_axis", radius, "FT") for axis in ("semimajor", "semiminor"))
    out.append(_quantity("rotation_rate", 0.0, "RAD/SEC"))
    out.append(_quantity("GM", gravity / FOOT * radius**2, "FT3/SEC2"))
    out.append(leaf("J2", number(0.0)))
    return document(out)


def initialization(steady: Record) -> str:
    """Return the start of a steady flight as JSBSim reads it."""
    out, start = Element("initialize", {"name": STEADY}), settings(steady).start
    for key, (tag, unit) in _INITIAL.items():
        out.append(_quantity(tag, start[key] / START[key][1], unit))
    out.extend(leaf(tag, "0.0") for tag in ("latitude", "longitude"))
    return document(out)


def script(steady: Record) -> str:
    """Return a script that flies the steady flight for its time."""
    out, given = Element("runscript", {"name": printable(steady.vehicle.name)}), settings(steady)
    SubElement(out, "description").text = "A steady flight; made by stoop export"
    SubElement(out, "use", {"aircraft": file_name(steady.vehicle.name), "initialize": STEADY})
    length = number(float(steady.time[-1] - steady.time[0]))
    run = SubElement(out, "run", {"start": "0.0", "end": length, "dt": number(1.0 / FRAME_RATE)})
    inputs = {n: float(column[0]) for n, column in given.inputs.items()}
    for place, x in {**INTEGRATORS, **given.constants, **inputs}.items():
        SubElement(run, "property", {"value": number(x)}).text = place
    return document(out)


def read_numbers(text: str) -> dict[str, float]:
    """Return mass properties, geometry and aerodynamic coefficients of an aircraft file that stoop wrote (trusted), SI."""
    root = ET.fromstring(text)  # noqa: S314 - our own

    def number_at(node: Element, path: str) -> float:
        return float(node.findtext(path) or "nan")

    out = {}
    for term in root.iterfind("aerodynamics/axis/function[product]"):
        # the last but one factor of the product: the last is what it multiplies
        factors = list(term.iterfind("product/*"))
        out[term.get("name", "").removeprefix(coefficient(""))] = float(factors[-2].text or "nan")
    for declared in root.iterfind("flight_control/property"):
        name = (declared.text or "").removeprefix(number_place(""))
        out |= {name: float(declared.get("value", "nan"))} if name != declared.text else {}
    for tag, (name, size, _) in _METRICS.items():
        if root.find(f"metrics/{tag}") is not None:
            out[name] = number_at(root, f"metrics/{tag}") * size
    out["mass.mass"] = number_at(root, "mass_balance/emptywt") / POUNDS_PER_SLUG * SLUG
    for axes, sign in _INERTIA.items():
        out[f"mass.inertia.{axes}"] = sign * (number_at(root, f"mass_balance/i{axes}") * _INERTIA_UNIT)
    for place in root.iter("location"):
        if point_name := {**_LOCATIONS, "CG": "mass.center_of_gravity"}.get(place.get("name", "")):
            out |= {f"{point_name}.{a}": s * number_at(place, a) * INCH for a, s in _AXES.items()}
    return out


def relative_errors(vehicle: Vehicle, text: str) -> Mapping[str, float]:
    """Return the relative difference of each written number from the vehicle's; of a zero, the absolute one."""
    read = read_numbers(text)
    own = {name: vehicle.value(name) for name in read if name in vehicle.rows}
    return {name: abs(read[name] - x) / (abs(x) or 1.0) for name, x in own.items()}
