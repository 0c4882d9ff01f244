"""The folder that JSBSim takes as its root: aircraft, a flat planet, a steady flight to start from, a script."""

from __future__ import annotations

from typing import Final
from xml.etree.ElementTree import Element, SubElement

from stoop.base.units import FOOT
from stoop.errors import one_line
from stoop.export.flown import Record, sortie
from stoop.export.jsbsim_aircraft import aircraft, document
from stoop.export.jsbsim_flight import FRAME_RATE, INTEGRATORS, START
from stoop.export.jsbsim_function import leaf, number
from stoop.export.names import file_name
from stoop.vehicle import Vehicle

RADIUS: Final = 1e10  #: m; over it the air turns by 1e-7 rad in a kilometer, and gravity falls by as much
PLANET: Final = "flat.xml"
STEADY: Final = "steady"
_INITIAL: Final = {
    "u": ("ubody", "FT/SEC"), "v": ("vbody", "FT/SEC"), "w": ("wbody", "FT/SEC"),
    "phi": ("phi", "RAD"), "theta": ("theta", "RAD"), "psi": ("psi", "RAD"), "h": ("altitude", "FT"),
}  #: element and unit of an initialization file  # fmt: skip


def folder(vehicle: Vehicle, steady: Record | None) -> dict[str, str]:
    """Return the files by their place below the root.

    Parameters
    ----------
    vehicle : Vehicle
    steady : Record, optional
        A steady flight, of which the start is used.

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
        out[f"aircraft/{name}/{STEADY}.xml"] = initialization(steady, name)
        out[f"scripts/{name}.xml"] = script(steady, name)
    return out


def flat_planet(gravity: float) -> str:
    """Return a planet that does not turn and is too large to be round: constant gravity, m/s2."""
    radius = RADIUS / FOOT
    out = Element("planet", {"name": "flat"})
    for tag, x, unit in (
        ("semimajor_axis", radius, "FT"),
        ("semiminor_axis", radius, "FT"),
        ("rotation_rate", 0.0, "RAD/SEC"),
        ("GM", gravity / FOOT * radius**2, "FT3/SEC2"),
        ("J2", 0.0, None),
    ):
        item = SubElement(out, tag, {} if unit is None else {"unit": unit})
        item.text = number(x)
    return document(out)


def initialization(steady: Record, name: str) -> str:
    """Return the start of a steady flight as JSBSim reads it."""
    start = sortie(name, steady, None).start
    out = Element("initialize", {"name": STEADY})
    for key, (tag, unit) in _INITIAL.items():
        item = leaf(tag, number(start[key] / START[key][1]))
        item.set("unit", unit)
        out.append(item)
    for tag in ("latitude", "longitude"):
        out.append(leaf(tag, "0.0"))
    return document(out)


def script(steady: Record, name: str) -> str:
    """Return a script that holds the steady flight for its time."""
    flown = sortie(name, steady, None)
    out = Element("runscript", {"name": one_line(steady.vehicle.name)})
    SubElement(out, "description").text = "A steady flight; made by stoop export"
    SubElement(out, "use", {"aircraft": name, "initialize": STEADY})
    length = float(steady.time[-1] - steady.time[0])
    run = SubElement(out, "run", {"start": "0.0", "end": number(length), "dt": number(1.0 / FRAME_RATE)})
    held = {**INTEGRATORS, **flown.held, **{n: float(column[0]) for n, column in flown.inputs.items()}}
    for place, x in held.items():
        SubElement(run, "property", {"value": number(x)}).text = place
    return document(out)
