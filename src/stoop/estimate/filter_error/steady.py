"""The gain at which a filter settles: the discrete algebraic Riccati equation, for many candidates at once.

By the structure-preserving doubling algorithm: each iteration covers twice as many samples as the one before.

References
----------
E. K.-W. Chu, H.-Y. Fan, W.-W. Lin and C.-S. Wang, "Structure-preserving algorithms for periodic discrete-time
algebraic Riccati equations", *International Journal of Control* 77(8), 2004, pp. 767-788 (period one).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray

DOUBLINGS: Final = 60
RESTS: Final = 1e-10  #: relative change of the covariance; the next one is about its square


def covariance(
    transition: FloatArray, readings: FloatArray, process: FloatArray, information: FloatArray
) -> FloatArray:
    """Return P = F P F' - F P H' (H P H' + R)^-1 H P F' + Q, before a measurement is taken.

    Parameters
    ----------
    transition, process : (B, n, n)
        F and Q.
    readings : (B, n_y, n)
        H.
    information : (B, n_y)
        Inverse of the diagonal of R; zero for what is never measured.

    Returns
    -------
    (B, n, n)
        NaN where there is no such covariance, or it overflows.
    """
    A = np.swapaxes(transition, 1, 2).copy()
    G = np.swapaxes(readings, 1, 2) @ (information[:, :, None] * readings)
    P, one = process.copy(), np.eye(A.shape[1])
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for _ in range(DOUBLINGS):
            before = P
            A, G, P = _doubled(A, G, P, one)
            if np.all(~(np.abs(P - before).max(axis=(1, 2)) > RESTS * np.abs(P).max(axis=(1, 2)))):
                break
    return P


def _doubled(
    A: FloatArray, G: FloatArray, P: FloatArray, one: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return one doubling; a candidate that is lost becomes NaN."""
    W = one + G @ P
    lost = ~np.isfinite(W).all(axis=(1, 2))
    W[lost] = one
    solved = np.linalg.solve(W, np.concatenate([A, G], axis=2))
    solved[lost] = np.nan
    n = A.shape[1]
    V, U = solved[:, :, :n], solved[:, :, n:]
    after = P + np.swapaxes(A, 1, 2) @ P @ V
    return A @ V, _symmetric(G + A @ U @ np.swapaxes(A, 1, 2)), _symmetric(after)


def _symmetric(M: FloatArray) -> FloatArray:
    return 0.5 * (M + np.swapaxes(M, 1, 2))
