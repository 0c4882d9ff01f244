"""Runge-Kutta of order four, one candidate at a time, in plain Python."""

from collections.abc import Callable

import numpy as np

Function = Callable[[np.ndarray, np.ndarray], np.ndarray]


def march(rates: Function, readings: Function, x: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
    """Return the readings (n, n_y) from state x under inputs (n, n_u), linear between samples."""
    out = []
    for k in range(len(u)):
        out.append(readings(x, u[k]))
        here, there = u[k], u[min(k + 1, len(u) - 1)]
        middle = (here + there) / 2
        k1 = rates(x, here)
        k2 = rates(x + dt / 2 * k1, middle)
        k3 = rates(x + dt / 2 * k2, middle)
        k4 = rates(x + dt * k3, there)
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array(out)


def cost(y: np.ndarray, z: np.ndarray, w: np.ndarray, wrapped: tuple[bool, ...]) -> float:
    """Return the weighted sum of squares, eq. (3), where z is finite."""
    total = 0.0
    for k in range(len(y)):
        for i in range(y.shape[1]):
            if np.isfinite(z[k, i]) and w[k, i] > 0:
                e = y[k, i] - z[k, i]
                if wrapped[i]:
                    e = np.angle(np.exp(1j * e))
                total += w[k, i] * e * e
    return total
