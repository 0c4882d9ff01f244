"""The covariance of a filter along a record, sample by sample: plain loops that Numba compiles.

The text of this file is copied to the cache whole, because Numba's cache does not follow imports.
"""

import math
from functools import partial
from typing import Any

import numba as nb
import numpy as np

_FAST = {"contract", "nsz", "arcp", "afn", "reassoc"}
_njit = partial(nb.njit, fastmath=_FAST, error_model="numpy", no_cfunc_wrapper=True)
inline = _njit(forceinline=True, no_cpython_wrapper=True)
compiled = _njit(nogil=True, cache=True)


@inline
def product(A: Any, B: Any, out: Any) -> None:
    """Write A B."""
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            total = 0.0
            for m in range(A.shape[1]):
                total += A[i, m] * B[m, j]
            out[i, j] = total


@inline
def product_transposed(A: Any, B: Any, out: Any) -> None:
    """Write A B'."""
    for i in range(A.shape[0]):
        for j in range(B.shape[0]):
            total = 0.0
            for m in range(A.shape[1]):
                total += A[i, m] * B[j, m]
            out[i, j] = total


@inline
def symmetric(A: Any, out: Any) -> None:
    """Write the mean of A and A'."""
    for i in range(A.shape[0]):
        for j in range(i + 1):
            out[i, j] = 0.5 * (A[i, j] + A[j, i])
            out[j, i] = out[i, j]


@inline
def cholesky(S: Any, L: Any) -> None:
    """Write the lower root of S."""
    for i in range(S.shape[0]):
        for j in range(i + 1):
            total = S[i, j]
            for m in range(j):
                total -= L[i, m] * L[j, m]
            L[i, j] = math.sqrt(total) if i == j else total / L[j, j]


@inline
def solve(L: Any, B: Any, K: Any) -> None:
    """Write K = B' (L L')^-1, for B with a row per row of L."""
    n = L.shape[0]
    for e in range(B.shape[1]):
        for i in range(n):
            total = B[i, e]
            for m in range(i):
                total -= L[i, m] * K[e, m]
            K[e, i] = total / L[i, i]
        for i in range(n - 1, -1, -1):
            total = K[e, i]
            for m in range(i + 1, n):
                total -= L[m, i] * K[e, m]
            K[e, i] = total / L[i, i]


@inline
def shown(S: Any, HP: Any, R: Any, seen: Any) -> None:
    """Add the noise; hide what was not measured."""
    for i in range(S.shape[0]):
        for j in range(S.shape[0]):
            S[i, j] *= seen[i] * seen[j]
        S[i, i] += R[i] if seen[i] > 0.0 else 1.0
        for e in range(HP.shape[1]):
            HP[i, e] *= seen[i]


@inline
def take(P: Any, T: Any, sign: float, Q: Any) -> None:
    """Write Q + sign T onto P."""
    for i in range(P.shape[0]):
        for j in range(P.shape[0]):
            P[i, j] = Q[i, j] + sign * T[i, j]


@compiled
def run_riccati(F: Any, H: Any, Q: Any, R: Any, M: Any, A: Any, P: Any, K: Any, S: Any) -> None:
    """Fill gains and innovation covariances of one candidate.

    At sample k, with what is seen: S = H P H' + R, K = P H' S^-1, P <- P - K H P; then P <- F P F' + Q.
    What is not seen has no gain, and 1 on the diagonal of S.

    Parameters
    ----------
    F, H, Q : (r, n_e, n_e), (r, n_y, n_e), (r, n_e, n_e)
    R : (n_y,)
    M : (n, n_y)
        One where something was measured, else zero.
    A : (n,)
        Point of linearization of each sample.
    P : (n_e, n_e)
        Covariance before the first sample; afterwards that after the last.
    K, S : (n, n_e, n_y), (n, n_y, n_y)
        Filled.
    """
    ne, ny = F.shape[1], H.shape[1]
    HP, L = np.empty((ny, ne)), np.empty((ny, ny))
    T, W = np.empty((ne, ne)), np.empty((ne, ne))
    for k in range(M.shape[0]):
        a = A[k]
        product(H[a], P, HP)
        product_transposed(HP, H[a], S[k])
        shown(S[k], HP, R, M[k])
        cholesky(S[k], L)
        solve(L, HP, K[k])
        product(K[k], HP, T)
        take(W, T, -1.0, P)
        symmetric(W, T)
        product(F[a], T, W)
        product_transposed(W, F[a], T)
        take(W, T, 1.0, Q[a])
        symmetric(W, P)
