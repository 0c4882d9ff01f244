"""Filters of the compiled model: many candidates, each with its own gains, side by side."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.kernels.arrays import fits, matrix
from stoop.kernels.generated import riccati_module
from stoop.kernels.kernel import Kernel

IntArray = NDArray[np.int64]


def innovations(
    kernel: Kernel,
    parameters: FloatArray,
    initial: FloatArray,
    gains: FloatArray,
    which: IntArray,
    inputs: FloatArray,
    measured: FloatArray,
    dt: float,
    states: bool = False,
    threads: int | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return innovations (B, n, n_y) of each candidate, zero where nothing was measured, and states.

    At each sample the state moves by gain times innovation, then flies to the next one.

    Parameters
    ----------
    parameters, initial, dt, threads
        As in :meth:`Kernel.cost`.
    gains : (G, n_e n_y, B) array
        Row e n_y + i leads from innovation i to number e of the move.
    which : (n,) array of int
        Gain of each sample.
    inputs : (n, n_u) array
    measured : (n, n_y) array
        NaN where nothing was measured.
    states : bool
        Whether the states before each measurement, (B, n, n_x), are returned too; else they are empty.
    """
    nx, nu, _, ny = kernel.sizes
    p, x, u, rows = kernel.arguments(parameters, initial, inputs)
    count, n = p.shape[1], len(measured)
    fits("gains", gains, (len(gains), kernel.moves * ny, count))
    fits("measured", measured, (n, ny))
    fits("inputs", inputs, (max(n, rows), nu))
    g = _choices("which", which, n, len(gains))
    seen = np.isfinite(measured)
    z, m, k = matrix(np.where(seen, measured, 0.0)), matrix(seen.astype(np.float64)), matrix(gains)
    out = np.empty((count, n, ny))
    path = np.empty((count, n, nx) if states else (0, 1, 1))
    march = kernel.entry("filter", count)

    def run(a: int, b: int) -> None:
        march(p, x, k, g, u, rows, z, m, float(dt), n, out, path, int(states), a, b, count)

    kernel.share(run, count, threads)
    return out, path


def move(kernel: Kernel, states: FloatArray, moves: FloatArray) -> FloatArray:
    """Return states (n_x, B) after small moves (n_e, B)."""
    fits("states", states, (kernel.sizes[0], states.shape[1]))
    fits("moves", moves, (kernel.moves, states.shape[1]))
    out = np.empty(states.shape)
    kernel.entry("move", states.shape[1])(matrix(states), matrix(moves), out, states.shape[1])
    return out


def riccati(
    kernel: Kernel,
    transition: FloatArray,
    readings: FloatArray,
    process: FloatArray,
    noise: FloatArray,
    seen: FloatArray,
    which: IntArray,
    begin: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return gains (n, n_e n_y), innovation covariances (n, n_y, n_y), covariance (n_e, n_e) after the last sample.

    Parameters
    ----------
    transition, readings, process : (r, n_e, n_e), (r, n_y, n_e), (r, n_e, n_e)
        At points of linearization: what becomes of a move over a sample, what it does to the readings, and the
        process noise over a sample.
    noise : (n_y,)
        Variance of the measurement noise.
    seen : (n, n_y) of 0 and 1
    which : (n,) of int
        Point of linearization of each sample.
    begin : (n_e, n_e)
        Covariance before the first sample.
    """
    ny, ne, n, points = kernel.sizes[3], kernel.moves, len(which), len(transition)
    fits("transition", transition, (points, ne, ne))
    fits("readings", readings, (points, ny, ne))
    fits("process", process, (points, ne, ne))
    fits("noise", noise, (ny,))
    fits("seen", seen, (n, ny))
    fits("begin", begin, (ne, ne))
    g = _choices("which", which, n, points)
    gains, covariances, last = np.empty((n, ne, ny)), np.empty((n, ny, ny)), begin.copy()
    arrays = [matrix(a) for a in (transition, readings, process, noise, seen)]
    riccati_module().run_riccati(*arrays, g, matrix(last), gains, covariances)
    return gains.reshape(n, -1), covariances, last


def _choices(name: str, which: IntArray, count: int, among: int) -> IntArray:
    """Refuse a choice that there is not: compiled code would read beyond the end."""
    fits(name, which, (count,))
    if count and not 0 <= int(which.min()) <= int(which.max()) < among:
        raise ValueError(f"{name}: names one that there is not")
    return np.require(which, dtype=np.int64, requirements=["C", "W"])
