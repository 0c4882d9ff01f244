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


def _public() -> dict[str, str]:
    """Return the places of all names, which are imported at their first use, so that ``import stoop`` costs nothing."""
    from pkgutil import iter_modules

    from stoop.base.packages import places

    return places("functions", [module.name for module in iter_modules(__path__)])


def __dir__() -> list[str]:
    return sorted([*_public(), "__version__"])


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("stoop")
    from stoop.base.packages import found, resolved, warn
    from stoop.errors import PackageError

    if name == "__all__":
        return sorted(n for n, place in _public().items() if found(place))
    if name.startswith("_") or (place := _public().get(name)) is None:
        from stoop.base.text import nearest

        advice = "" if name.startswith("_") else f"; {nearest(name, _public())}"
        raise AttributeError(f"module 'stoop' has no attribute '{name}'{advice}")
    try:
        globals()[name] = resolved(place)
    except PackageError as error:
        warn(str(error))  # which `from stoop import` does not show
        raise
    return globals()[name]
