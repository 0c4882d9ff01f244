"""Numbers of files drafted by defaults beside those of files by hand, as docs/vehicle-new.md has them."""

from __future__ import annotations

import numpy as np
import pytest

from docs.pages import DOCS, table
from stoop.results.result import Result
from stoop.vehicle import Vehicle

PAGE = DOCS / "vehicle-new.md"
INERTIA = {"Cl": ("mass.inertia.xx", "x"), "Cm": ("mass.inertia.yy", "y"), "Cn": ("mass.inertia.zz", "z")}
AIR_DENSITY = 1.19  #: kg/m3, of the V-tail's flight
Number = tuple[float, float]  #: estimate and standard error


def estimate(result: Result, *names: str, slopes: tuple[float, ...] = (1.0,)) -> Number:
    """Return the sum of parameters times `slopes`, and its standard error by their covariance."""
    at, g = [result.covariance.names.index(name) for name in names], np.resize(slopes, len(names))
    values = np.array([result.parameters[name].estimate for name in names])
    return float(g @ values), float(np.sqrt(g @ result.covariance.matrix[np.ix_(at, at)] @ g))


def apart(one: Number, other: Number) -> float:
    return (other[0] - one[0]) / float(np.hypot(one[1], other[1]))


def check_rows(heading: str, by_hand: dict[str, Number], by_defaults: dict[str, Number]) -> None:
    """Hold a table of the page against numbers: estimates within 0.2 standard errors, these within a tenth."""
    rows = table(PAGE, heading, "number").rows
    for name, *cells, said in rows:
        found = by_hand[name], by_defaults[name]
        for cell, (value, error) in zip(cells, found, strict=True):
            shown, std = (float(part) for part in cell.replace("(", "").replace(")", "").split("±"))
            assert value == pytest.approx(shown, abs=0.2 * error), name
            assert error == pytest.approx(std, rel=0.1), name
        assert apart(*found) == pytest.approx(float(said), abs=0.3), name


def static_thrust(result: Result, vehicle: Vehicle) -> Number:
    """Return the thrust at full command and no airspeed, N."""
    speed, diameter = (vehicle.value(f"propulsion.{name}") for name in ("speed_gain", "diameter"))
    return estimate(result, "propulsion.CT0", slopes=(AIR_DENSITY * speed**2 * diameter**4,))


def in_the_units_of(drafted: Vehicle, vehicle: Vehicle, result: Result, name: str) -> Number:
    """Return an estimate as the draft states it: moments for its inertia, rates over its V*."""
    scale = 1.0
    if name[2:] in ("p", "q", "r"):
        scale = drafted.value("reference.airspeed") / vehicle.value("reference.airspeed")
    if name[:2] not in INERTIA:
        return estimate(result, name, slopes=(scale,))
    moment, axis = INERTIA[name[:2]]
    value, inertia = (result.parameters[n].estimate for n in (name, moment))
    scale *= drafted.value(f"reference.inertia.{axis}") / inertia
    _, error = estimate(result, name, moment, slopes=(scale, -scale * value / inertia))
    return scale * value, error
