"""stoop: from a flight log to a flight-dynamics model one can trust.

>>> import stoop
>>> vehicle = stoop.load_vehicle("vehicle.toml")  # doctest: +SKIP
>>> flight = stoop.load_flight("log.ulg")  # doctest: +SKIP
>>> fit = stoop.fit(vehicle, flight, ["140:145", (160, 168)], validate="187:196")  # doctest: +SKIP
>>> fit.parameters["Clp"].std_error  # doctest: +SKIP
>>> fit.save("result")  # doctest: +SKIP
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stoop import errors
    from stoop.api import (
        assess,
        check,
        design,
        export,
        fit,
        frequency_responses,
        look,
        new_vehicle,
        predict,
        propagate,
        reconstruct,
        save_design,
    )
    from stoop.base.notices import Notice
    from stoop.estimate.fit import Options
    from stoop.exporters.jsbsim_autopilot import fly_in_jsbsim
    from stoop.flight import Flight
    from stoop.flight.load import load as load_flight
    from stoop.flight.load import save as save_flight
    from stoop.results.result import read_result
    from stoop.simulation.fly import simulate, simulate_flight
    from stoop.simulation.linearize import linearize
    from stoop.simulation.maneuver import load_maneuver
    from stoop.simulation.trim import trim
    from stoop.vehicle import Vehicle
    from stoop.vehicle.builtin import resolve_vehicle as load_vehicle
    from stoop.workflow import Bootstrap, Posterior, Profile

_PLACES = {
    **dict.fromkeys(
        (
            "assess",
            "check",
            "design",
            "export",
            "fit",
            "frequency_responses",
            "look",
            "new_vehicle",
            "predict",
            "propagate",
            "reconstruct",
            "save_design",
        ),
        "stoop.api",
    ),
    **dict.fromkeys(("linearize", "trim"), "stoop.simulation"),
    **dict.fromkeys(("simulate", "simulate_flight"), "stoop.simulation.fly"),
    "fly_in_jsbsim": "stoop.exporters.jsbsim_autopilot",
    "load_maneuver": "stoop.simulation.maneuver",
    **dict.fromkeys(("Bootstrap", "Posterior", "Profile"), "stoop.workflow"),
    "Flight": "stoop.flight",
    "Notice": "stoop.base.notices",
    "Options": "stoop.estimate.fit",
    "Vehicle": "stoop.vehicle",
    "load_flight": "stoop.flight",
    "load_vehicle": "stoop.vehicle.builtin",
    "read_result": "stoop.results.result",
    "save_flight": "stoop.flight",
}  #: public name -> module; imported on first use, so that ``import stoop`` costs nothing
_OTHER_NAMES = {"load_flight": "load", "load_vehicle": "resolve_vehicle", "save_flight": "save"}

__all__ = [
    "Bootstrap",
    "Flight",
    "Notice",
    "Options",
    "Posterior",
    "Profile",
    "Vehicle",
    "assess",
    "check",
    "design",
    "errors",
    "export",
    "fit",
    "fly_in_jsbsim",
    "frequency_responses",
    "linearize",
    "load_flight",
    "load_maneuver",
    "load_vehicle",
    "look",
    "new_vehicle",
    "predict",
    "propagate",
    "read_result",
    "reconstruct",
    "save_design",
    "save_flight",
    "simulate",
    "simulate_flight",
    "trim",
]


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("stoop")
    if name == "errors":
        return importlib.import_module("stoop.errors")
    if name not in _PLACES:
        raise AttributeError(f"module 'stoop' has no attribute '{name}'")
    found = getattr(importlib.import_module(_PLACES[name]), _OTHER_NAMES.get(name, name))
    globals()[name] = found
    return found
