"""A Kalman filter in plain matrices, one sample after the other."""

import numpy as np

Arrays = list[np.ndarray]


def kalman(
    F: np.ndarray, H: np.ndarray, Q: np.ndarray, R: np.ndarray, x: np.ndarray, P: np.ndarray, z: np.ndarray
) -> tuple[Arrays, Arrays, Arrays, float]:
    """Return innovations, their covariances and gains of what was measured, and twice the negative log-likelihood."""
    innovations, covariances, gains, cost = [], [], [], 0.0
    for row in z:
        seen = np.flatnonzero(np.isfinite(row))
        h = H[seen]
        S = h @ P @ h.T + np.diag(R[seen])
        K = P @ h.T @ np.linalg.inv(S)
        v = row[seen] - h @ x
        cost += float(v @ np.linalg.inv(S) @ v + np.log(np.linalg.det(S))) if len(seen) else 0.0
        innovations.append(v)
        covariances.append(S)
        gains.append(K)
        x = F @ (x + K @ v)
        P = F @ (P - K @ h @ P) @ F.T + Q
    return innovations, covariances, gains, cost
