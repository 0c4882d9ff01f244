"""The rest of the paper's eq. (1): all 14 longitudinal terms, and the 18 lateral and directional ones.

``longitudinal-full`` flies the paper's elevator; ``lateral`` flies rudder and aileron on all six degrees of
freedom and measures all twelve channels, the longitudinal coefficients known. Each also ``+noise``. Truths that
the paper does not print are ours.
"""

from __future__ import annotations

import functools

from stoop.simulate import parse_maneuver
from stoop.simulate.fly import fly
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop_studies.problems import Posed, take_none
from stoop_studies.problems.experiment import LATERAL, LATERAL_MANEUVER, LEFT_OUT, LONGITUDINAL, MANEUVER
from stoop_studies.problems.paper import Paper

NAMES = ("longitudinal-full", "longitudinal-full+noise", "lateral", "lateral+noise")


def aircraft() -> Vehicle:
    """Return the paper's aircraft with no coefficient of eq. (1) at zero."""
    return resolve_vehicle("twin-boom").with_numbers({n: {"value": v} for n, v in LEFT_OUT.items()})


@functools.cache
def longitudinal() -> Paper:
    """Return the 14 longitudinal terms and their flight; made once in a process."""
    vehicle = aircraft().reduced("longitudinal")
    return Paper(vehicle, fly(vehicle, parse_maneuver(MANEUVER, "longitudinal")), LONGITUDINAL)


@functools.cache
def lateral() -> Paper:
    """Return the 18 lateral and directional terms and their flight; made once in a process."""
    vehicle = aircraft()
    return Paper(vehicle, fly(vehicle, parse_maneuver(LATERAL_MANEUVER, "lateral")), LATERAL)


def names() -> tuple[str, ...]:
    """Return the names of these problems."""
    return NAMES


def pose(name: str, seed: int, box: str = "N", **arguments: object) -> Posed:
    """Pose one of these problems; the seed draws box and noise.

    Parameters
    ----------
    name : str
    seed : int
    box : str
        N, S or W.

    Raises
    ------
    IdentificationError
        Another argument than ``box``, or another box.
    """
    take_none(name, arguments)
    kind, *more = name.split("+")
    case = lateral() if kind == "lateral" else longitudinal()
    noise = "noise" in more
    return case.posed(case.problem(box, seed, noise), noise)
