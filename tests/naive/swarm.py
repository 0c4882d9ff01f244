"""The constricted particle swarm, one particle and one variable at a time."""

import math
from collections.abc import Callable

import numpy as np


def moved(
    x: list[list[float]],
    v: list[list[float]],
    best: list[list[float]],
    costs: list[float],
    draws: np.ndarray,
    cost: Callable[[list[float]], float],
) -> None:
    """Move every particle once, in place.

    Parameters
    ----------
    draws : (2, n, D), uniform numbers: for the own best, for the swarm's
    """
    phi = 4.1
    chi = 2.0 / abs(2.0 - phi - math.sqrt(phi * phi - 4.0 * phi))
    leader = list(best[costs.index(min(costs))])
    for i in range(len(x)):
        for j in range(len(x[i])):
            own = 2.05 * draws[0, i, j] * (best[i][j] - x[i][j])
            all_ = 2.05 * draws[1, i, j] * (leader[j] - x[i][j])
            v[i][j] = max(-0.5, min(0.5, chi * (v[i][j] + own + all_)))
            x[i][j] += v[i][j]
            if x[i][j] < 0.0 or x[i][j] > 1.0:
                x[i][j] = min(1.0, max(0.0, x[i][j]))
                v[i][j] *= -0.5
    for i in range(len(x)):
        value = cost(x[i])
        if value < costs[i]:
            best[i], costs[i] = list(x[i]), value
