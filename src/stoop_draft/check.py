"""What contradicts a flight, its mapping or the file of its vehicle, in one call."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stoop import Notice, Vehicle, load_vehicle
from stoop.extend.flights import OneFlight, as_flights
from stoop.extend.notices import attempt
from stoop.extend.vehicles import check_vehicle, inertia_notices
from stoop_draft.checks.engine import empty_columns
from stoop_draft.checks.kinematics import check_rates
from stoop_draft.checks.mapping import Judgment, check_mapping


def check(flight: OneFlight, vehicle: Vehicle | str | Path | None = None) -> tuple[Notice, ...]:
    """Return which lines of the mapping, or of a vehicle file, contradict the data of a flight.

    Parameters
    ----------
    flight : Flight, path of a log, or xarray.Dataset
    vehicle : Vehicle, str or Path, optional
        Or the name of a built-in one, or a vehicle file.

    Raises
    ------
    StoopError
        The flight lacks a channel that the vehicle needs.
    """
    if vehicle is not None and not isinstance(vehicle, Vehicle):
        vehicle = load_vehicle(vehicle)
    (flown,) = as_flights(flight)
    up = flown.in_flight()
    columns = {str(name): np.where(up, flown.column(str(name)), np.nan) for name in flown.channels}
    empty, failed = empty_columns(columns), list[Notice]()
    data = {name: x for name, x in columns.items() if name not in empty}
    judged = attempt(failed, Judgment((), (), {}), check_mapping, {}, data, flown.rate, {})
    known = {fault.variable for fault in flown.faults}
    rates = attempt(failed, [], check_rates, judged.corrected(data), flown.rate, {})
    found = [one for one in (*judged.notices, *rates) if one.subject not in known]
    out = [*(fault.notice for fault in flown.faults), *found, *failed]
    if vehicle is not None:
        flights = {flown.name: flown}
        out += [one for one in check_vehicle(vehicle, flights) if one not in out]
        out += attempt(out, [], inertia_notices, vehicle)
    return tuple(out)
