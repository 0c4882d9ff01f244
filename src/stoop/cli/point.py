"""The flight condition that `trim` and `linearize` share: which vehicle, how fast, how high, how steep."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from stoop.cli.page import busy
from stoop.errors import SimulationError

if TYPE_CHECKING:
    from stoop.simulate import Trim
    from stoop.vehicle import Vehicle

SEA_LEVEL_DENSITY: Final = 1.225  #: kg/m3, what `stoop.simulate.trim` assumes where the log would tell
COMPILING: Final = "preparing the equations (some seconds the first time)"
BUILT_IN_HELP: Final = "a built-in vehicle: twin-boom, quad-x, quad-plus, hexa-x, octo-x, quadplane"
VEHICLE_HELP: Final = f"vehicle file (TOML), or {BUILT_IN_HELP}"
LOG_HELP: Final = ".ulg, .bin, .log, .usd, .nc, .mat, .parquet, .csv, a ROS bag, or a folder of CSV files"
MAPPING_HELP: Final = "TOML: columns, units and axes of the log (drafted by stoop map)"


def add_point_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the vehicle and the flight condition."""
    add = parser.add_argument
    add("vehicle", metavar="VEHICLE", help=VEHICLE_HELP)
    add(
        "--airspeed",
        metavar="V",
        type=airspeed,
        help="m/s (default: the vehicle's reference; a vehicle with rotors hovers)",
    )
    add("--altitude", metavar="H", type=altitude, default=200.0, help="m above sea level (default: 200)")
    add("--climb-angle", metavar="DEG", type=climb_angle, default=0.0, help="degrees (default: 0)")
    three: Any = {"nargs": 3, "type": speed}
    add(
        "--velocity",
        metavar=("N", "E", "D"),
        **three,
        help="on rotors: m/s over ground, north, east, down (default: 0 0 0)",
    )
    add("--wind", metavar=("N", "E", "D"), **three, help="on rotors: m/s, blowing north, east, down")
    add("--heading", metavar="DEG", type=heading, default=0.0, help="on rotors: degrees (default: 0)")
    add("--density", metavar="RHO", type=density, help="kg/m3, instead of what the vehicle file says")


def airspeed(text: str) -> float:
    """Read an airspeed in m/s."""
    return _between(text, 0.1, 10_000.0, "m/s")


def altitude(text: str) -> float:
    """Read an altitude in m that the standard atmosphere of the equations reaches."""
    return _between(text, -1000.0, 11_000.0, "m")


def climb_angle(text: str) -> float:
    """Read an angle in degrees; return rad."""
    return math.radians(_between(text, -89.0, 89.0, "degrees"))


def speed(text: str) -> float:
    """Read a component of a velocity in m/s."""
    return _between(text, -200.0, 200.0, "m/s")


def heading(text: str) -> float:
    """Read a heading in degrees; return rad."""
    return math.radians(_between(text, -360.0, 360.0, "degrees"))


def density(text: str) -> float:
    """Read a density in kg/m3."""
    return _between(text, 1e-6, 10_000.0, "kg/m3")


def _between(text: str, low: float, high: float, unit: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number") from None
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"{text} is not between {low:g} and {high:g} {unit}")
    return value


def chosen_vehicle(arguments: argparse.Namespace) -> Vehicle:
    """Return the vehicle with the density and the reduction that the command line asks for."""
    from stoop.vehicle.builtin import resolve_vehicle

    vehicle = resolve_vehicle(arguments.vehicle)
    if arguments.density is not None and vehicle.file.environment.density != "log":
        vehicle = _with_density(vehicle, arguments.density)
    return vehicle if arguments.reduce is None else vehicle.reduced(arguments.reduce)


def _with_density(vehicle: Vehicle, density: float) -> Vehicle:
    from stoop.vehicle.quantity import Quantity

    environment = vehicle.file.environment.model_copy(update={"density": Quantity(value=density)})
    return replace(vehicle, file=vehicle.file.model_copy(update={"environment": environment}))


def chosen_trim(vehicle: Vehicle, arguments: argparse.Namespace) -> Trim:
    """Find the steady flight that the command line asks for.

    A lateral model holds speed and incidence, so its steady flight is that of the full equations.
    """
    from stoop.simulate import trim

    flown = vehicle.reduced("full") if vehicle.reduce == "lateral" else vehicle
    _check_carried(vehicle, arguments)
    with busy(COMPILING):
        return trim(
            flown,
            arguments.airspeed,
            arguments.altitude,
            arguments.climb_angle,
            arguments.density,
            arguments.velocity,
            arguments.wind,
            arguments.heading,
        )


def _check_carried(vehicle: Vehicle, arguments: argparse.Namespace) -> None:
    """Refuse what only a flight on rotors has, or only one on wings."""
    from stoop.simulate.steady import flies_on_rotors

    rotors = flies_on_rotors(vehicle, arguments.airspeed)
    for name in ("velocity", "wind") if not rotors else ():
        if getattr(arguments, name) is not None:
            raise SimulationError(
                f"--{name}: {vehicle.where} flies on its wings here; a steady flight is told by its airspeed alone"
            )
    if rotors and arguments.climb_angle:
        raise SimulationError(
            f"--climb-angle: {vehicle.where} flies on its rotors here; write --velocity, e.g. --velocity 0 0 -2 to climb"
        )


def condition(vehicle: Vehicle, point: Trim, arguments: argparse.Namespace) -> str:
    """Say the flight condition in one line."""
    if "V" not in point.start:
        return _on_rotors(point) + f", {_density_words(vehicle, arguments.density)}"
    return (
        f"steady straight flight at {point.start['V']:g} m/s, {point.start['h']:g} m, "
        f"climb {math.degrees(arguments.climb_angle):g} deg, {_density_words(vehicle, arguments.density)}"
    )


def _on_rotors(point: Trim) -> str:
    def vector(v: tuple[float, ...]) -> str:
        return " ".join(f"{x:g}" for x in v)

    moving, windy = any(point.velocity), any(point.wind)
    what = f"steady flight at {vector(point.velocity)} m/s (north east down)" if moving else "hover"
    wind = f", wind {vector(point.wind)} m/s (north east down)" if windy else ""
    return f"{what} at {point.start['h']:g} m, heading {math.degrees(point.start['psi']):g} deg{wind}"


def _density_words(vehicle: Vehicle, given: float | None) -> str:
    choice = vehicle.file.environment.density
    if choice == "standard":
        return "standard atmosphere"
    if choice != "log":
        return f"density {vehicle.value('environment.density'):g} kg/m3"
    if given is None:
        return f"density {SEA_LEVEL_DENSITY:g} kg/m3 (assumed; the log has it, or give --density)"
    return f"density {given:g} kg/m3"
