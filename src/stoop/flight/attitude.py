"""Attitude: quaternions (scalar first, body to NED) and Euler angles (yaw, pitch, roll), without jumps.

References
----------
Stevens, Lewis, Johnson, *Aircraft Control and Simulation*, 3rd ed., section 1.3 (quaternions, 3-2-1 angles).
"""

from __future__ import annotations

import numpy as np

from stoop.logs import FloatArray


def continuous(quaternions: FloatArray) -> FloatArray:
    """Choose the sign of each quaternion so that neighbors lie on the same half of the sphere.

    Parameters
    ----------
    quaternions : (n, 4), scalar first, finite

    Returns
    -------
    (n, 4), the same rotations; the first keeps its sign
    """
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0
    signs = np.concatenate([[1.0], np.cumprod(np.where(flips, -1.0, 1.0))])[: len(quaternions)]
    turned: FloatArray = quaternions * signs[:, None]
    return turned


def normalized(quaternions: FloatArray) -> FloatArray:
    """Scale each quaternion to unit length; those of no length become NaN.

    Parameters
    ----------
    quaternions : (n, 4)
    """
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    out: FloatArray = np.full_like(quaternions, np.nan)
    np.divide(quaternions, length, out=out, where=length > 1e-6)
    return out


def euler_angles(quaternions: FloatArray) -> FloatArray:
    """Quaternions to phi, theta, psi.

    Parameters
    ----------
    quaternions : (n, 4), unit, scalar first, body to NED

    Returns
    -------
    (n, 3) rad; phi and psi in (-pi, pi], theta in [-pi/2, pi/2]
    """
    w, x, y, z = quaternions.T
    phi = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    theta = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    psi = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return np.column_stack([wrap(phi), theta, wrap(psi)])


def quaternions_of(angles: FloatArray) -> FloatArray:
    """phi, theta, psi to quaternions.

    Parameters
    ----------
    angles : (n, 3) rad

    Returns
    -------
    (n, 4), unit, scalar first, body to NED, signs as the half angles give them
    """
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles.T / 2.0), np.sin(angles.T / 2.0)
    return np.column_stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def wrap(angle: FloatArray) -> FloatArray:
    """Bring angles into (-pi, pi]; NaN stays NaN. Angles already there are returned bit for bit."""
    outside = (angle > np.pi) | (angle <= -np.pi)
    return np.where(outside, np.pi - np.mod(np.pi - angle, 2.0 * np.pi), angle)
