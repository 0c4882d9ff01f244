"""stoop: from a flight log to a flight-dynamics model one can trust.

>>> import stoop
>>> vehicle = stoop.load_vehicle("vehicle.toml")  # doctest: +SKIP
>>> flight = stoop.load_flight("log.ulg")  # doctest: +SKIP
>>> fit = stoop.fit(vehicle, flight, ["140:145", (160, 168)], validate="187:196")  # doctest: +SKIP
>>> fit.parameters["Clp"].std_error  # doctest: +SKIP
>>> fit.save("result")  # doctest: +SKIP
"""

from __future__ import annotations

from typing import Any

_MODULES = {
    "stoop.api": "assess look reconstruct",
    "stoop.assessment.bootstrap": "Bootstrap",
    "stoop.assessment.profile": "Profile",
    "stoop.base.notices": "Notice",
    "stoop.estimate.fit": "Options",
    "stoop.flight": "Flight",
    "stoop.flight.load": "load_flight save_flight",
    "stoop.results.result": "read_result",
    "stoop.simulation": "trim",
    "stoop.simulation.fly": "simulate_flight",
    "stoop.simulation.maneuver": "load_maneuver",
    "stoop.strategy": "Strategy",
    "stoop.vehicle": "Vehicle",
    "stoop.vehicle.builtin": "load_vehicle",
    "stoop.workflow.fitted_model": "FittedModel",
    "stoop.workflow.flying": "linearize simulate",
    "stoop.workflow.identification": "fit",
    "stoop.workflow.load": "load",
    "stoop.workflow.validation": "validate",
}
PLACES = {name: f"{module}:{name}" for module, names in _MODULES.items() for name in names.split()} | {
    "errors": "stoop:errors",
    "predict": "stoop.workflow.validation:validate",
}
"""Public name -> ``module:name``, imported on first use, so that ``import stoop`` costs nothing. Packages add theirs."""


def _public() -> dict[str, str]:
    from stoop.base.packages import places

    return PLACES | places("functions", PLACES)


def __dir__() -> list[str]:
    return sorted([*_public(), "__version__"])


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("stoop")
    from stoop.base.packages import found, resolved

    if name == "__all__":
        return sorted(n for n, place in _public().items() if found(place.partition(".")[0], f"'{n}'", place))
    if name.startswith("_") or (place := PLACES.get(name) or _public().get(name)) is None:
        from stoop.base.text import nearest

        advice = "" if name.startswith("_") else f"; {nearest(name, _public())}"
        raise AttributeError(f"module 'stoop' has no attribute '{name}'{advice}")
    globals()[name] = resolved(place)
    return globals()[name]
