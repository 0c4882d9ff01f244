"""An angle and its rate differ by the factor of a degree: which of the two has the wrong unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import quaternions_of, to_ground
from stoop.base.units import DEGREE
from stoop.base.variables import EULER
from stoop.errors import LogError
from stoop.flight.channels import finite
from stoop.logs.mapping import read_toml

RATES: Final = ("p", "q", "r")
IN_DEGREES: Final = ("deg", "deg/s")
SPAN: Final = 0.5  #: s over which velocity is differenced
BETTER: Final = (
    0.95  #: of the other residual, noise of hundreds of samples in both; less tells who agrees with gravity
)
LEAST: Final = 100  #: samples that say anything

Values = Mapping[str, tuple[FloatArray, FloatArray]]


def declared(mapping: str) -> dict[str, str]:
    """Return variable -> unit as a mapping file says it; nothing where there is no such file."""
    if not Path(mapping).is_file():
        return {}
    try:
        table = read_toml(Path(mapping)).get("variables", {})
    except LogError:
        return {}
    lines = table.items() if isinstance(table, dict) else ()
    return {name: str(line["unit"]) for name, line in lines if isinstance(line, dict) and "unit" in line}


def guilty(angle: str, rate: str, factor: float, values: Values, units: Mapping[str, str]) -> tuple[str, str]:
    """Return the variable whose unit is wrong, and the unit that its column has.

    Parameters
    ----------
    angle, rate : a pair whose factor is that of a degree, or its inverse
    factor : how many times faster the angle changes than the rate says
    values : variable -> time (n,) s and values (n,) SI, as mapped
    units : variable -> unit that the mapping says
    """
    large, small = (angle, rate) if factor > 1.0 else (rate, angle)
    plain = {large: _unit(large, degrees=True), small: _unit(small, degrees=False)}
    if units.get(small, "") not in IN_DEGREES:
        accused = large  # what is no degree in the mapping cannot be too small by 57.3
    elif units.get(large, "") in IN_DEGREES:
        accused = small
    else:
        accused = _odd(large, small, units) or _against_gravity(angle, rate, factor, values, units) or large
    return accused, plain[accused]


def _unit(name: str, degrees: bool) -> str:
    return ("deg" if degrees else "rad") + ("/s" if name in RATES else "")


def _odd(large: str, small: str, units: Mapping[str, str]) -> str:
    """Return which of two has another unit than its siblings, which lie in the same sensor; empty if both or none."""
    found = []
    for name in (large, small):
        siblings = [other for other in (RATES if name in RATES else EULER) if other != name]
        said = {units[other] for other in siblings if other in units}
        if said and units.get(name) not in said:
            found.append(name)
    return found[0] if len(found) == 1 else ""


def _against_gravity(angle: str, rate: str, factor: float, values: Values, units: Mapping[str, str]) -> str:
    """Return which is wrong by the velocity over ground: specific force, turned by the attitude, and gravity make it."""
    need = {*EULER, "ax", "ay", "az", "vn", "ve", "vd"}
    if angle not in EULER or not need <= values.keys():
        return ""
    scale = DEGREE if factor > 1.0 else 1.0 / DEGREE
    alike = [name for name in EULER if units.get(name) == units.get(angle)]
    as_mapped, scaled = (_residual(values, alike, by) for by in (1.0, scale))
    if as_mapped < BETTER * scaled:
        return rate
    return angle if scaled < BETTER * as_mapped else ""


def _residual(values: Values, angles: Sequence[str], scale: float) -> float:
    """Return the rms by which the horizontal velocity changes otherwise than attitude and specific force say, m/s."""
    time = values[angles[0]][0]
    steps = max(1, round(SPAN / float(np.median(np.diff(time))))) if time.size > LEAST else time.size
    if time.size <= LEAST + steps:
        return np.nan
    x = {name: _at(time, *values[name]) for name in (*EULER, "ax", "ay", "az", "vn", "ve")}
    x.update({name: scale * x[name] for name in angles})
    q = quaternions_of(np.column_stack([x[name] for name in EULER]))
    turned = to_ground(q, np.column_stack([x[name] for name in ("ax", "ay", "az")]))
    sums = np.cumsum(turned[:, :2] * np.gradient(time)[:, None], axis=0)
    change = np.column_stack([x["vn"], x["ve"]]) - sums
    off = change[steps:] - change[:-steps]
    return float(np.sqrt(np.nanmean(off**2))) if np.isfinite(off).any() else np.nan


def _at(time: FloatArray, t: FloatArray, x: FloatArray) -> FloatArray:
    known, values = finite(t, x)
    return np.interp(time, known, values) if known.size else np.full(time.size, np.nan)
