"""A verb that prints, and the function that computes what it prints."""

import argparse
import math
from collections.abc import Iterable

import stoop
from stoop.extend.errors import SimulationError
from stoop.extend.verbs import column, page


def angles(vehicle: stoop.Vehicle, airspeeds: Iterable[float]) -> dict[float, float]:
    """Return the angle of attack (rad) of level flight by airspeed (m/s), NaN where there is none."""
    found = {}
    for airspeed in airspeeds:
        try:
            found[airspeed] = stoop.trim(vehicle, airspeed).start["alpha"]
        except SimulationError:
            found[airspeed] = math.nan
    return found


def speeds(arguments: argparse.Namespace) -> int:
    """Run the verb."""
    vehicle = stoop.load_vehicle(arguments.vehicle)
    found = angles(vehicle, arguments.airspeeds)
    page().line(vehicle.name)
    page().table(column("m/s", found, 1), column("deg", map(math.degrees, found.values()), 2))
    return 0
