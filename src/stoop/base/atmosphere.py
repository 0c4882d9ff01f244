"""The standard atmosphere below 11 km, ISO 2533 and U.S. Standard Atmosphere 1976 (the same there); densities of air."""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.units import STANDARD_GRAVITY

SEA_LEVEL_DENSITY: Final = 1.225  #: kg/m3
SEA_LEVEL_PRESSURE: Final = 101325.0  #: Pa
SEA_LEVEL_TEMPERATURE: Final = 288.15  #: K
LAPSE: Final = 0.0065  #: K/m of geopotential altitude
GAS: Final = 287.05287  #: J/(kg K), of dry air
EARTH_RADIUS: Final = 6356766.0  #: m, nominal value of the standard
EXPONENT: Final = STANDARD_GRAVITY / (GAS * LAPSE)  #: of the pressure's ratio over the temperature's


def standard_density(altitude: FloatArray) -> FloatArray:
    """Return density, kg/m3, at a height above sea level in m (numbers or arrays).

    rho = rho0 (1 - L H / T0)^(g/(R L) - 1) with the geopotential altitude H = r h / (r + h).
    """
    h = np.asarray(altitude, dtype=float)
    geopotential = EARTH_RADIUS * h / (EARTH_RADIUS + h)
    ratio = 1.0 - LAPSE * geopotential / SEA_LEVEL_TEMPERATURE
    return np.asarray(SEA_LEVEL_DENSITY * ratio ** (EXPONENT - 1.0))


def density_at_pressure(pressure: FloatArray) -> FloatArray:
    """Return the standard density, kg/m3, where the static pressure is this one, Pa."""
    return np.asarray(SEA_LEVEL_DENSITY * (pressure / SEA_LEVEL_PRESSURE) ** (1.0 - 1.0 / EXPONENT))


def density_of_gas(pressure: FloatArray, temperature: FloatArray) -> FloatArray:
    """Return the density, kg/m3, of dry air of this pressure, Pa, and temperature, K."""
    return pressure / (GAS * temperature)
