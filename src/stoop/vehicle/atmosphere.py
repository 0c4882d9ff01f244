"""The standard atmosphere below 11 km, ISO 2533 and U.S. Standard Atmosphere 1976 (the same there)."""

from __future__ import annotations

import functools
from typing import Any, Final

import numpy as np

SEA_LEVEL_DENSITY: Final = 1.225  #: kg/m3
EARTH_RADIUS: Final = 6356766.0  #: m, nominal value of the standard
FLOOR, CEILING = -1000.0, 11000.0  #: m, where the polynomial holds


def standard_density(altitude: Any) -> Any:
    """Return density, kg/m3, at a height above sea level in m (numbers or arrays).

    rho = rho0 (1 - L H / T0)^(g/(R L) - 1) with the geopotential altitude H = r h / (r + h).
    """
    lapse, temperature = 0.0065, 288.15  # K per m of geopotential altitude, K at sea level
    exponent = 9.80665 / (287.05287 * 0.0065) - 1.0
    h = np.asarray(altitude, dtype=float)
    geopotential = EARTH_RADIUS * h / (EARTH_RADIUS + h)
    return SEA_LEVEL_DENSITY * (1.0 - lapse * geopotential / temperature) ** exponent


@functools.cache
def _polynomial() -> tuple[float, ...]:
    """Fit the density over the scaled altitude; within 1e-11 relative."""
    nodes = np.cos(np.pi * (np.arange(200) + 0.5) / 200.0)
    middle, half = (FLOOR + CEILING) / 2.0, (CEILING - FLOOR) / 2.0
    series = np.polynomial.chebyshev.chebfit(nodes, standard_density(middle + half * nodes), 9)
    return tuple(float(c) for c in np.polynomial.chebyshev.cheb2poly(series))


def polynomial_density(altitude: Any) -> Any:
    """Return the density as a polynomial of an altitude symbol, which vectorizes."""
    x = (altitude - (FLOOR + CEILING) / 2) / ((CEILING - FLOOR) / 2)
    *lower, out = _polynomial()
    for c in reversed(lower):
        out = out * x + c
    return out
