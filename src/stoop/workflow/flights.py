"""Flights as a user gives them: a flight, the path of a log, a table with a column ``time``, a dataset; one or several."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, Union

from stoop.errors import FlightError, VehicleError
from stoop.flight import Flight, load
from stoop.flight.flight import from_columns
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

OneFlight: TypeAlias = Union[Flight, str, Path, "pd.DataFrame", "xr.Dataset"]
Flights: TypeAlias = OneFlight | Sequence[OneFlight]


def as_vehicle(given: Any) -> Vehicle:
    """Return a vehicle from a vehicle, the name of a built-in one or a vehicle file.

    Raises
    ------
    VehicleError
        It is none of these.
    """
    if isinstance(given, Vehicle):
        return given
    if isinstance(given, str | Path):
        return resolve_vehicle(given)
    raise VehicleError(
        f"a vehicle is expected first, not a {type(given).__name__}; give the vehicle, then the flights"
    )


def as_flight(given: Any) -> Flight:
    """Return a flight from a flight, a log, or columns over ``time`` (s) that are variables of the registry in SI.

    Raises
    ------
    FlightError
        It is none of these, or has no ``time``.
    """
    if isinstance(given, Flight):
        return given
    if isinstance(given, str | Path):
        return load(given)
    if isinstance(given, Vehicle):
        raise FlightError(
            f"a flight is expected, not the vehicle {given.name}; give the vehicle before the flight"
        )
    names = [str(name) for name in getattr(given, "data_vars", getattr(given, "columns", ()))]
    if not names:
        kind = type(given).__name__
        raise FlightError(
            f"a flight is expected, not a {kind}; give a Flight, a path, a DataFrame or a Dataset"
        )
    try:
        time = given["time"].to_numpy()
    except KeyError:
        raise FlightError("the table has no column 'time'; add it, seconds at one rate") from None
    columns = {name: given[name].to_numpy() for name in names if name != "time"}
    name = str(given.attrs.get("name", "flight"))
    return from_columns(name, time, columns, source="dataset")


def as_flights(given: Any) -> list[Flight]:
    """Return one or several flights, see :func:`as_flight`."""
    several = given if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    return [as_flight(one) for one in several]
