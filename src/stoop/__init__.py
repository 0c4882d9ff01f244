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
    from stoop.api import assess, check, look, new_vehicle, reconstruct, save_design
    from stoop.base.notices import Notice
    from stoop.estimate.fit import Options
    from stoop.exporters.jsbsim_autopilot import fly_in_jsbsim
    from stoop.flight import Flight
    from stoop.flight.load import load as load_flight
    from stoop.flight.load import save as save_flight
    from stoop.results.result import read_result
    from stoop.simulation import trim
    from stoop.simulation.fly import simulate_flight
    from stoop.simulation.maneuver import load_maneuver
    from stoop.strategy import Strategy
    from stoop.vehicle import Vehicle
    from stoop.vehicle.builtin import resolve_vehicle as load_vehicle
    from stoop.workflow import Bootstrap, Posterior, Profile
    from stoop.workflow.derivatives import derivatives
    from stoop.workflow.design import design
    from stoop.workflow.export import export
    from stoop.workflow.fitted_model import FittedModel
    from stoop.workflow.flying import linearize, simulate
    from stoop.workflow.frequency import frequency, frequency_responses
    from stoop.workflow.identification import identify as fit
    from stoop.workflow.load import load
    from stoop.workflow.propagation import propagate
    from stoop.workflow.tuning import tune
    from stoop.workflow.validation import validate
    from stoop.workflow.validation import validate as predict
    from stoop_fleet.store import open_fleet
    from stoop_fleet.update import update_fleet

_PLACES = {
    **dict.fromkeys(("assess", "check", "look", "new_vehicle", "reconstruct", "save_design"), "stoop.api"),
    "Notice": "stoop.base.notices",
    "Options": "stoop.estimate.fit",
    "Strategy": "stoop.strategy",
    "fly_in_jsbsim": "stoop.exporters.jsbsim_autopilot",
    "open_fleet": "stoop_fleet.store",
    **dict.fromkeys(("Flight", "load_flight", "save_flight"), "stoop.flight"),
    "read_result": "stoop.results.result",
    "simulate_flight": "stoop.simulation.fly",
    "load_maneuver": "stoop.simulation.maneuver",
    "trim": "stoop.simulation",
    "Vehicle": "stoop.vehicle",
    "load_vehicle": "stoop.vehicle.builtin",
    **dict.fromkeys(("Bootstrap", "Posterior", "Profile"), "stoop.workflow"),
    "derivatives": "stoop.workflow.derivatives",
    "design": "stoop.workflow.design",
    "export": "stoop.workflow.export",
    "FittedModel": "stoop.workflow.fitted_model",
    **dict.fromkeys(("linearize", "simulate"), "stoop.workflow.flying"),
    **dict.fromkeys(("frequency", "frequency_responses"), "stoop.workflow.frequency"),
    "fit": "stoop.workflow.identification",
    "load": "stoop.workflow.load",
    "propagate": "stoop.workflow.propagation",
    **dict.fromkeys(("predict", "validate"), "stoop.workflow.validation"),
    "tune": "stoop.workflow.tuning",
    "update_fleet": "stoop_fleet.update",
}
"""Public name -> module; imported on first use, so that ``import stoop`` costs nothing."""
_OTHER_NAMES = {
    "fit": "identify",
    "load_flight": "load",
    "load_vehicle": "resolve_vehicle",
    "predict": "validate",
    "save_flight": "save",
}

__all__ = [
    "Bootstrap",
    "FittedModel",
    "Flight",
    "Notice",
    "Options",
    "Posterior",
    "Profile",
    "Strategy",
    "Vehicle",
    "assess",
    "check",
    "derivatives",
    "design",
    "errors",
    "export",
    "fit",
    "fly_in_jsbsim",
    "frequency",
    "frequency_responses",
    "linearize",
    "load",
    "load_flight",
    "load_maneuver",
    "load_vehicle",
    "look",
    "new_vehicle",
    "open_fleet",
    "predict",
    "propagate",
    "read_result",
    "reconstruct",
    "save_design",
    "save_flight",
    "simulate",
    "simulate_flight",
    "trim",
    "tune",
    "update_fleet",
    "validate",
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
        from stoop.base.text import nearest

        advice = "" if name.startswith("_") else f"; {nearest(name, __all__)}"
        raise AttributeError(f"module 'stoop' has no attribute '{name}'{advice}")
    found = getattr(importlib.import_module(_PLACES[name]), _OTHER_NAMES.get(name, name))
    globals()[name] = found
    return found
