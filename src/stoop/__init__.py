"""stoop: from a flight log to a flight-dynamics model one can trust.

>>> import stoop
>>> vehicle = stoop.load_vehicle("vehicle.toml")  # doctest: +SKIP
>>> flight = stoop.load_flight("log.ulg")  # doctest: +SKIP
>>> job = stoop.fit(vehicle, flight, ["140:145", "160:168"], validate=["187:196"])  # doctest: +SKIP
>>> print(job)  # doctest: +SKIP
>>> job.save("result")  # doctest: +SKIP
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stoop.checks.vehicle import check
    from stoop.estimate.fit import Options
    from stoop.flight.load import load as load_flight
    from stoop.flight.store import save as save_flight
    from stoop.results.result import read_result
    from stoop.simulation.fly import simulate_flight
    from stoop.simulation.linearize import linearize
    from stoop.simulation.maneuver import load_maneuver
    from stoop.simulation.trim import trim
    from stoop.vehicle import load_vehicle
    from stoop.workflow import identify as fit

_PLACES = {
    "Options": "stoop.estimate.fit",
    "check": "stoop.checks.vehicle",
    "fit": "stoop.workflow",
    "linearize": "stoop.simulation",
    "load_flight": "stoop.flight",
    "load_maneuver": "stoop.simulation",
    "load_vehicle": "stoop.vehicle",
    "read_result": "stoop.results.result",
    "save_flight": "stoop.flight",
    "simulate_flight": "stoop.simulation",
    "trim": "stoop.simulation",
}  #: public name -> room; imported on first use, so that ``import stoop`` costs nothing
_OTHER_NAMES = {"fit": "identify", "load_flight": "load", "save_flight": "save"}

__all__ = [
    "Options",
    "check",
    "fit",
    "linearize",
    "load_flight",
    "load_maneuver",
    "load_vehicle",
    "read_result",
    "save_flight",
    "simulate_flight",
    "trim",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("stoop")
    if name not in _PLACES:
        raise AttributeError(f"module 'stoop' has no attribute '{name}'")
    return getattr(importlib.import_module(_PLACES[name]), _OTHER_NAMES.get(name, name))
