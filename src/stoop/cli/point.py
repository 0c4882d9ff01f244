"""The flight condition that `trim` and `linearize` share: which vehicle, how fast, how high, how steep."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from stoop.cli.arguments import COMPILING, VEHICLE_HELP, airspeed, altitude, climb_angle
from stoop.cli.numbers import within
from stoop.cli.page import busy
from stoop.errors import SimulationError

if TYPE_CHECKING:
    from stoop.simulation import Trim
    from stoop.vehicle import Vehicle

SEA_LEVEL_DENSITY: Final = 1.225  #: kg/m3, what `stoop.simulation.trim` assumes where the log would give it


def add_point_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the vehicle and the flight condition."""
    add = parser.add_argument
    speed = "m/s (default: the vehicle's reference; hover for a vehicle with rotors)"
    velocity = "on rotors: m/s over ground, north, east, down (default: 0 0 0)"
    heading = within(-360.0, 360.0, "degrees", math.radians(1.0))
    density = within(1e-6, 10_000.0, "kg/m3")
    three: Any = {"metavar": ("N", "E", "D"), "nargs": 3, "type": within(-200.0, 200.0, "m/s")}
    add("vehicle", metavar="VEHICLE", help=VEHICLE_HELP)
    add("--airspeed", metavar="V", type=airspeed, help=speed)
    add("--altitude", metavar="H", type=altitude, default=200.0, help="m above sea level (default: 200)")
    add("--climb-angle", metavar="DEG", type=climb_angle, default=0.0, help="degrees (default: 0)")
    add("--velocity", **three, help=velocity)
    add("--wind", **three, help="on rotors: m/s, blowing north, east, down")
    add("--heading", metavar="DEG", type=heading, default=0.0, help="on rotors: degrees (default: 0)")
    add("--density", metavar="RHO", type=density, help="kg/m3, instead of what the vehicle file says")


def vehicle_at(arguments: argparse.Namespace) -> Vehicle:
    """Return the vehicle with the density and the reduction that the command line asks for."""
    from stoop.vehicle.builtin import resolve_vehicle
    from stoop.vehicle.schema import Quantity

    vehicle = resolve_vehicle(arguments.vehicle)
    if arguments.density is not None and vehicle.file.environment.density != "log":
        density = {"density": Quantity(value=arguments.density)}
        environment = vehicle.file.environment.model_copy(update=density)
        vehicle = replace(vehicle, file=vehicle.file.model_copy(update={"environment": environment}))
    return vehicle if arguments.reduce is None else vehicle.reduced(arguments.reduce)


def trim_at(vehicle: Vehicle, arguments: argparse.Namespace) -> Trim:
    """Find the steady flight that the command line asks for.

    A lateral model holds speed and incidence, so its steady flight is that of the full equations.
    """
    from stoop.simulation import trim
    from stoop.simulation.trim import flies_on_rotors

    on_rotors = flies_on_rotors(vehicle, arguments.airspeed)
    for name in ("velocity", "wind") if not on_rotors else ():
        if getattr(arguments, name) is not None:
            raise SimulationError(
                f"--{name}: {vehicle.where} flies on its wings here; give its steady flight by its airspeed alone"
            )
    if on_rotors and arguments.climb_angle:
        raise SimulationError(
            f"--climb-angle: {vehicle.where} flies on its rotors here; write --velocity, e.g. --velocity 0 0 -2 to climb"
        )
    flown = vehicle.reduced("full") if vehicle.reduce == "lateral" else vehicle
    with busy(COMPILING):
        return trim(
            flown, arguments.airspeed, arguments.altitude, arguments.climb_angle, arguments.density,
            arguments.velocity, arguments.wind, arguments.heading,
        )  # fmt: skip


def condition(vehicle: Vehicle, point: Trim, arguments: argparse.Namespace) -> str:
    """Return the flight condition in one line."""
    density = _density(vehicle, arguments.density)
    if "V" in point.start:
        speed, climb = point.start["V"], math.degrees(arguments.climb_angle)
        return (
            f"steady straight flight at {speed:g} m/s, {point.start['h']:g} m, climb {climb:g} deg, {density}"
        )
    velocity, wind = (" ".join(f"{x:g}" for x in v) for v in (point.velocity, point.wind))
    what = f"steady flight at {velocity} m/s (north east down)" if any(point.velocity) else "hover"
    windy = f", wind {wind} m/s (north east down)" if any(point.wind) else ""
    heading = math.degrees(point.start["psi"])
    return f"{what} at {point.start['h']:g} m, heading {heading:g} deg{windy}, {density}"


def _density(vehicle: Vehicle, given: float | None) -> str:
    choice = vehicle.file.environment.density
    if choice == "standard":
        return "standard atmosphere"
    if choice != "log":
        return f"density {vehicle.value('environment.density'):g} kg/m3"
    if given is None:
        return f"density {SEA_LEVEL_DENSITY:g} kg/m3 (assumed; the log has it, or give --density)"
    return f"density {given:g} kg/m3"
