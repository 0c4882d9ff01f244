"""Density of the standard atmosphere as a polynomial, which vectorizes."""

from __future__ import annotations

import functools
from typing import Any, Final

import numpy as np
import sympy as sp

from stoop.vehicle.atmosphere import standard_density

FLOOR, CEILING = -1000.0, 11000.0  #: m, where the polynomial holds
DEGREE: Final = 9


@functools.cache
def _polynomial() -> tuple[float, ...]:
    """Fit the density over the scaled altitude; within 1e-11 relative."""
    nodes = np.cos(np.pi * (np.arange(200) + 0.5) / 200.0)
    middle, half = (FLOOR + CEILING) / 2.0, (CEILING - FLOOR) / 2.0
    series = np.polynomial.chebyshev.chebfit(nodes, standard_density(middle + half * nodes), DEGREE)
    return tuple(float(c) for c in np.polynomial.chebyshev.cheb2poly(series))


def symbolic_density(altitude: Any) -> Any:
    """Return the density as an expression of the altitude symbol."""
    x = (altitude - (FLOOR + CEILING) / 2) / ((CEILING - FLOOR) / 2)
    out = sp.Float(0)
    for c in reversed(_polynomial()):
        out = out * x + c
    return out
