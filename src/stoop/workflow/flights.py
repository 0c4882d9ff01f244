"""Flights as a user gives them: a flight, the path of a log, a table or mapping with ``time``, a dataset; one or several."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, Union

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray
from stoop.base.units import FACTORS
from stoop.base.variables import VARIABLES
from stoop.errors import FlightError
from stoop.flight import Flight, load_flight
from stoop.flight.flight import from_columns
from stoop.flight.load import load_several, with_contradictions
from stoop.vehicle import Vehicle

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

OneFlight: TypeAlias = Union[Flight, str, Path, "pd.DataFrame", "xr.Dataset", Mapping[str, npt.ArrayLike]]
Flights: TypeAlias = OneFlight | Sequence[OneFlight]


def as_flight(given: Any) -> Flight:
    """Return a flight from a flight, a log, or columns over ``time`` (s) that are variables of the registry in SI.

    Units, signs and axes of columns are checked as `load_flight` checks those of a log.

    Raises
    ------
    FlightError
        It is none of these, has no ``time``, or angles in degrees.
    """
    if isinstance(given, Flight):
        return given
    if isinstance(given, str | Path):
        return load_flight(given)
    if isinstance(given, Vehicle):
        raise FlightError(
            f"a flight is expected, not the vehicle {given.name}; give the vehicle before the flight"
        )
    if isinstance(given, Mapping) and not hasattr(given, "data_vars"):
        given = _table(given)
    names = list(getattr(given, "data_vars", getattr(given, "columns", ())))
    if not names:
        kind = type(given).__name__
        raise FlightError(
            f"a flight is expected, not a {kind}; give a Flight, a path, a dict of columns, a DataFrame or a Dataset"
        )
    if "time" not in given and getattr(getattr(given, "index", None), "name", None) == "time":
        given = given.reset_index()
    if "time" not in given:
        raise FlightError(
            "the table has no column 'time'; add it, or rename its time axis so, seconds at one rate"
        )
    time = given["time"].to_numpy()
    if time.dtype.kind in "mM" and time.size:
        time = (time - time.flat[0]) / np.timedelta64(1, "s")
    columns = {str(name): _numbers(str(name), given[name].to_numpy()) for name in names if name != "time"}
    for key in columns.keys() & VARIABLES.keys():
        stated, unit = str(given[key].attrs.get("units", "")), VARIABLES[key].unit
        if stated in FACTORS and stated != unit and unit != "1":
            raise FlightError(f"column '{key}' is in {stated} by its attribute 'units'; give it in {unit}")
    name = re.sub(r"[/\\@#:\0]", "-", str(given.attrs.get("name", "flight")))
    return with_contradictions(from_columns(name, _numbers("time", time), columns, source="dataset"))


def _table(columns: Mapping[str, Any]) -> pd.DataFrame:
    """Return columns (n,) by name as a table; raises `FlightError` if they are of other shapes."""
    import pandas as pd

    try:
        return pd.DataFrame(dict(columns))
    except (ValueError, TypeError) as error:
        raise FlightError(
            f"the dict holds no equally long columns of numbers ({error}); give {{'time': ..., 'V': ...}}, several flights "
            "as a list"
        ) from None


def _numbers(name: str, values: npt.NDArray[Any]) -> FloatArray:
    """Return a column of numbers; raises `FlightError` if it holds something else."""
    kind = "dates" if values.dtype.kind in "mM" else "text"
    try:
        if values.dtype.kind in "biufO":
            return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        pass
    raise FlightError(f"column '{name}' holds {kind}, not numbers; leave it out or give SI numbers")


def as_flights(given: Any) -> list[Flight]:
    """Return one or several flights, see :func:`as_flight`; logs are read onto grids of one rate."""
    several = given if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    made = [None if isinstance(one, str | Path) else as_flight(one) for one in several]
    if not made:
        raise FlightError("no flight is given; give a flight, the path of a log, or a list of them")
    paths = [one for one in several if isinstance(one, str | Path)]
    logs = iter(load_several(paths, beside=[*filter(None, made)]))
    return [next(logs) if flight is None else flight for flight in made]
