"""The standard atmosphere below 11 km, ISO 2533 and U.S. Standard Atmosphere 1976 (the same there)."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

SEA_LEVEL_DENSITY: Final = 1.225  #: kg/m3
SEA_LEVEL_TEMPERATURE: Final = 288.15  #: K
LAPSE: Final = 0.0065  #: K per m of geopotential altitude
EXPONENT: Final = 9.80665 / (287.05287 * 0.0065) - 1.0
EARTH_RADIUS: Final = 6356766.0  #: m, the standard's nominal one


def standard_density(altitude: Any) -> Any:
    """Return density, kg/m3, at a height above sea level in m (numbers or arrays).

    rho = rho0 (1 - L H / T0)^(g/(R L) - 1) with the geopotential altitude H = r h / (r + h).
    """
    h = np.asarray(altitude, dtype=float)
    geopotential = EARTH_RADIUS * h / (EARTH_RADIUS + h)
    return SEA_LEVEL_DENSITY * (1.0 - LAPSE * geopotential / SEA_LEVEL_TEMPERATURE) ** EXPONENT
