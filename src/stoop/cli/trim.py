"""`stoop trim`: the angles, controls and thrust of a steady straight flight, or of a hover."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING, Any

from stoop.cli.page import Page, page, print_json
from stoop.cli.point import add_point_arguments, condition, trim_at, vehicle_at
from stoop.cli.tables import fixed, numbers, shown_unit, words

if TYPE_CHECKING:
    from stoop.simulation import Trim
    from stoop.vehicle import Vehicle

FORMAT = "stoop-trim/1"
ANGLES = ("alpha", "beta", "theta", "phi")
CONSTANT_THRUST = "propulsion.thrust"
NOISE = 1e-12  #: what the solver leaves where zero belongs


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add_point_arguments(parser)
    parser.add_argument("--reduce", choices=["longitudinal"], help="trim these equations only")
    parser.add_argument("--json", action="store_true", help="print JSON (SI units, rad) instead of tables")


def run(arguments: argparse.Namespace) -> int:
    """Trim and print."""
    vehicle = vehicle_at(arguments)
    point = trim_at(vehicle, arguments)
    if arguments.json:
        print_json(trim_document(vehicle, point, arguments.climb_angle))
    else:
        _print(page(), vehicle, point, condition(vehicle, point, arguments))
    return 0


def trim_document(vehicle: Vehicle, point: Trim, climb_angle: float) -> dict[str, Any]:
    """Return the trim for JSON, SI and rad."""
    start, flown = point.start, dict[str, Any]()
    if "V" in start:
        flown = {"airspeed": start["V"], "altitude": start["h"], "climb_angle": climb_angle}
    else:
        flown = {
            "velocity": point.velocity,
            "wind": point.wind,
            "altitude": start["h"],
            "heading": start["psi"],
        }
    return {
        "format": FORMAT,
        "vehicle": vehicle.name,
        "file": vehicle.where,
        "reduce": vehicle.reduce,
        **flown,
        "angles": angles(point),
        "controls": point.deflections,
        "thrust": {n: {"value": value, "unit": _unit(vehicle, n)} for n, value in point.thrust.items()},
        "inputs": channels(vehicle, point),
        "residual": point.residual,
    }


def angles(point: Trim) -> dict[str, float]:
    """Return the angles that the equations have, rad."""
    return {name: point.start[name] for name in ANGLES if name in point.start}


def channels(vehicle: Vehicle, point: Trim) -> dict[str, float]:
    """Return the recorded channels that hold the flight, SI."""
    return {name: float(value) for name, value in zip(vehicle.recorded, point.inputs, strict=False)}


def _unit(vehicle: Vehicle, name: str) -> str:
    """Return the unit of a thrust, be it a number of the vehicle or a channel."""
    from stoop.flight import VARIABLES

    if name == CONSTANT_THRUST:
        return "N"
    return VARIABLES[name].unit if name in VARIABLES else "1"


def _print(out: Page, vehicle: Vehicle, point: Trim, where: str) -> None:
    out.line(vehicle.name)
    out.line(where)
    out.heading("Angles and controls")
    rows = angles(point) | point.deflections
    degrees = [math.degrees(value) for value in rows.values()]
    out.table([words("", rows), fixed("deg", degrees, 4), fixed("rad", rows.values(), 6)])
    if "V" in point.start:
        out.heading("Thrust")
        _print_thrust(out, vehicle, point)
    mixed = {name: value for name, value in channels(vehicle, point).items() if name not in rows}
    if mixed:
        out.heading("Recorded channels that hold it")
        values = [value if abs(value) > NOISE else 0.0 for value in mixed.values()]
        units = [shown_unit(_unit(vehicle, name)) for name in mixed]
        out.table([words("", mixed), numbers("value", values), words("", units)])
    if "V" not in point.start:
        out.heading("Velocity through the air, body axes")
        out.table([words("", "uvw"), fixed("m/s", [point.start[axis] for axis in "uvw"], 4)])
    out.line()
    out.line(f"largest acceleration left over: {point.residual:.1e} (m/s2, rad/s2)")


def _print_thrust(out: Page, vehicle: Vehicle, point: Trim) -> None:
    for name, value in point.thrust.items():
        if name == CONSTANT_THRUST:
            out.line(f"{value:.2f} N (the vehicle file says {vehicle.value(name):.2f} N)")
        else:
            out.line(f"{name} {value:.4f} {shown_unit(_unit(vehicle, name))}".rstrip())
    if not point.thrust:
        out.line("none: the vehicle has no propulsion")
