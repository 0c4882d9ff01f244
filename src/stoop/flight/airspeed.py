"""True airspeed where the log holds the equivalent one, as ArduPilot's does.

A pitot feels the dynamic pressure. The equivalent airspeed is the one of air of 1.225 kg/m3 that has it; the true one is larger
by the root of 1.225 over the density: 5 % in 1000 m, 10 % in 2000 m. The density is the logged one, else that of a perfect gas of
the logged pressure and temperature, else that of the standard atmosphere at the pressure, or at the altitude.

References
----------
ISO 2533, Standard atmosphere; here below 11 km. `stoop.vehicle.atmosphere` is its twin; a test holds the two equal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import VARIABLES
from stoop.flight.channels import SourceRate
from stoop.flight.faults import Fault

EQUIVALENT: Final = "airspeed_equivalent"
TRUE: Final = "airspeed_pitot"
GAS_CONSTANT: Final = 287.05287  #: J/(kg K), of dry air
LAPSE_RATE: Final = 0.0065  #: K/m of geopotential altitude
SEA_LEVEL_PRESSURE: Final = 101325.0  #: Pa
SEA_LEVEL_TEMPERATURE: Final = 288.15  #: K
SEA_LEVEL_DENSITY: Final = 1.225  #: kg/m3
EARTH_RADIUS: Final = 6356766.0  #: m, the standard's nominal one
EXPONENT: Final = STANDARD_GRAVITY / (
    GAS_CONSTANT * LAPSE_RATE
)  #: of the pressure's ratio over the temperature's
PLAUSIBLE: Final = {
    "density": (0.3, 1.6),
    "pressure": (2.2e4, 1.2e5),
    "temperature": (200.0, 340.0),
    "altitude": (-500.0, 11e3),
}  #: SI; what is beyond is a sensor's mistake


def density_at_altitude(altitude: FloatArray) -> FloatArray:
    """Return the standard density, kg/m3, at heights above the sea, m."""
    geopotential = EARTH_RADIUS * altitude / (EARTH_RADIUS + altitude)
    return np.asarray(
        SEA_LEVEL_DENSITY * (1.0 - LAPSE_RATE * geopotential / SEA_LEVEL_TEMPERATURE) ** (EXPONENT - 1.0)
    )


def density_at_pressure(pressure: FloatArray) -> FloatArray:
    """Return the standard density, kg/m3, where the static pressure is this one, Pa."""
    return np.asarray(SEA_LEVEL_DENSITY * (pressure / SEA_LEVEL_PRESSURE) ** (1.0 - 1.0 / EXPONENT))


def density_of_gas(pressure: FloatArray, temperature: FloatArray) -> FloatArray:
    """Return the density, kg/m3, of dry air of this pressure, Pa, and temperature, K."""
    return pressure / (GAS_CONSTANT * temperature)


_METHODS: Final[tuple[tuple[tuple[str, ...], Callable[..., FloatArray], str], ...]] = (
    (("density",), np.asarray, "as logged"),
    (("pressure", "temperature"), density_of_gas, "by pressure and temperature"),
    (("pressure",), density_at_pressure, "by the pressure, in the standard atmosphere"),
    (("altitude",), density_at_altitude, "by the altitude, in the standard atmosphere"),
)  #: in order of trust


def with_true_airspeed(
    data: Mapping[str, FloatArray], sources: Mapping[str, SourceRate]
) -> tuple[dict[str, FloatArray], dict[str, SourceRate], list[Notice]]:
    """Add the true airspeed where the equivalent one was logged, and neither V nor the true one; with a notice.

    Parameters
    ----------
    data : variable -> (n,) SI, on one grid
    sources : how each was recorded
    """
    if EQUIVALENT not in data or {TRUE, "V"} & data.keys():
        return dict(data), dict(sources), []
    density, method = _density(data)
    source = sources[EQUIVALENT]
    columns = {**data, TRUE: data[EQUIVALENT] * np.sqrt(SEA_LEVEL_DENSITY / density)}
    median = float(np.median(density))
    values: dict[str, Any] = {
        "source": source.source,
        "density": median,
        "factor": float(np.sqrt(SEA_LEVEL_DENSITY / median)),
    }
    found = (
        notice("true-airspeed", TRUE, method=method, **values)
        if method
        else notice("true-airspeed-of-unknown-density", TRUE, **values)
    )
    return {name: columns[name] for name in VARIABLES if name in columns}, {**sources, TRUE: source}, [found]


def _density(data: Mapping[str, FloatArray]) -> tuple[FloatArray, str]:
    """Return the density (n,), with lines across holes, and by what it is known; that at sea level where nothing tells."""
    count = len(data[EQUIVALENT])
    for names, formula, method in _METHODS:
        if set(names) <= data.keys():
            density = formula(*(_plausible(name, data[name]) for name in names))
            known = np.flatnonzero(np.isfinite(density))
            if known.size:
                return np.interp(np.arange(count), known, density[known]), method
    return np.full(count, SEA_LEVEL_DENSITY), ""


def _plausible(name: str, x: FloatArray) -> FloatArray:
    low, high = PLAUSIBLE[name]
    with np.errstate(invalid="ignore"):
        return np.where((x >= low) & (x <= high), x, np.nan)


def faults_of_true_airspeed(faults: list[Fault], data: Mapping[str, FloatArray]) -> list[Fault]:
    """Return faults of the equivalent airspeed as those of the true one, where that was made of it."""
    made = EQUIVALENT in data and TRUE in data
    return [replace(f, variable=TRUE) if made and f.variable == EQUIVALENT else f for f in faults]
