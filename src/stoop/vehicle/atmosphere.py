"""Density of the standard atmosphere as a polynomial of the altitude, for symbols."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from stoop.base.atmosphere import standard_density

FLOOR, CEILING = -1000.0, 11000.0  #: m, where the polynomial holds


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
