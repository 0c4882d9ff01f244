"""Rotations in numbers: quaternions, Euler angles, matrices, rotation vectors, and vectors that they turn.

Axes everywhere: components last, anything before them: quaternions (..., 4), scalar first; Euler angles (..., 3), rad,
phi, theta, psi (bank, pitch, heading, turned in the order psi, theta, phi); rotation vectors (..., 3), rad; vectors
(..., 3); matrices (..., 3, 3). A rotation takes what is told along body axes (forward, right, down) to the ground's (north,
east, down). The equations of motion have these in symbols (`stoop.vehicle.symbolic.frames`); a test holds the two equal.

References
----------
Stevens, Lewis, Johnson, *Aircraft Control and Simulation*, 3rd ed., sections 1.3 and 1.8 (quaternions, 3-2-1 angles).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stoop.base.arrays import FloatArray


def quaternions_of(angles: FloatArray) -> FloatArray:
    """Return unit quaternions (..., 4) of Euler angles (..., 3), rad; signs as the half angles give them."""
    half = _apart(np.asarray(angles, dtype=float)) / 2.0
    (c1, c2, c3), (s1, s2, s3) = np.cos(half), np.sin(half)
    e0, e1 = c1 * c2 * c3 + s1 * s2 * s3, s1 * c2 * c3 - c1 * s2 * s3
    return _together([e0, e1, c1 * s2 * c3 + s1 * c2 * s3, c1 * c2 * s3 - s1 * s2 * c3])


def euler_angles(q: FloatArray) -> FloatArray:
    """Return Euler angles (..., 3), rad, of unit quaternions (..., 4): phi, psi in (-pi, pi], theta in [-pi/2, pi/2]."""
    w, x, y, z = _apart(q)
    phi = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    theta = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    psi = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return _together([wrap(phi), theta, wrap(psi)])


def wrap(angle: FloatArray) -> FloatArray:
    """Bring angles into (-pi, pi]; NaN stays NaN. Angles already there are returned bit for bit."""
    outside = (angle > np.pi) | (angle <= -np.pi)
    return np.where(outside, np.pi - np.mod(np.pi - angle, 2.0 * np.pi), angle)


def matrices_of(q: FloatArray) -> FloatArray:
    """Return matrices (..., 3, 3) of unit quaternions (..., 4): ground = R body (eq. 1.8-15, transposed)."""
    w, x, y, z = _apart(q)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([_together(row) for row in rows], axis=-2)


def matrices_of_angles(angles: FloatArray) -> FloatArray:
    """Return matrices (..., 3, 3) of Euler angles (..., 3), rad."""
    apart = _apart(np.asarray(angles, dtype=float))
    (c1, c2, c3), (s1, s2, s3) = np.cos(apart), np.sin(apart)
    rows = [
        [c2 * c3, s1 * s2 * c3 - c1 * s3, c1 * s2 * c3 + s1 * s3],
        [c2 * s3, s1 * s2 * s3 + c1 * c3, c1 * s2 * s3 - s1 * c3],
        [-s2, s1 * c2, c1 * c2],
    ]
    return np.stack([_together(row) for row in rows], axis=-2)


def conjugate(q: FloatArray) -> FloatArray:
    """Return the quaternions (..., 4) that turn back."""
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return Hamilton products (..., 4) of quaternions: the rotation b, then a."""
    (a0, a1, a2, a3), (b0, b1, b2, b3) = _apart(a), _apart(b)
    return _together(
        [
            a0 * b0 - (a1 * b1 + a2 * b2 + a3 * b3),
            a0 * b1 + b0 * a1 + (a2 * b3 - a3 * b2),
            a0 * b2 + b0 * a2 + (a3 * b1 - a1 * b3),
            a0 * b3 + b0 * a3 + (a1 * b2 - a2 * b1),
        ]
    )


def quaternions_about(vector: FloatArray) -> FloatArray:
    """Return unit quaternions (..., 4) of rotation vectors (..., 3), rad."""
    angle = np.linalg.norm(vector, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2.0), 0.5 * np.sinc(angle / (2.0 * np.pi)) * vector], axis=-1)


def vectors_of(q: FloatArray) -> FloatArray:
    """Return rotation vectors (..., 3), rad, of unit quaternions (..., 4), the shorter way: up to pi long."""
    sign = np.where(q[..., 0] < 0.0, -1.0, 1.0)
    sine = np.linalg.norm(q[..., 1:], axis=-1)
    angle = 2.0 * np.arctan2(sine, np.abs(q[..., 0]))
    return np.asarray(q[..., 1:] * (sign * angle / np.maximum(sine, 1e-12))[..., None])


def between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the rotation vectors (..., 3), rad, along the axes of the body, that turn quaternions a into b (..., 4)."""
    return vectors_of(product(conjugate(a), b))


def to_ground(q: FloatArray, vector: FloatArray) -> FloatArray:
    """Return vectors (..., 3) along the ground's axes, of those along body axes, for unit quaternions (..., 4)."""
    (e0, e1, e2, e3), (u, v, w) = _apart(q), _apart(vector)
    a, b, c = 2.0 * (e2 * w - e3 * v), 2.0 * (e3 * u - e1 * w), 2.0 * (e1 * v - e2 * u)
    along = u + e0 * a + e2 * c - e3 * b, v + e0 * b + e3 * a - e1 * c, w + e0 * c + e1 * b - e2 * a
    return _together(along)


def to_body(q: FloatArray, vector: FloatArray) -> FloatArray:
    """Return vectors (..., 3) along body axes, of those along the ground's, for unit quaternions (..., 4)."""
    return to_ground(conjugate(q), vector)


def normalized(q: FloatArray) -> FloatArray:
    """Scale each quaternion (..., 4) to unit length; those of no length become NaN."""
    length = np.linalg.norm(q, axis=-1, keepdims=True)
    out: FloatArray = np.full_like(q, np.nan)
    np.divide(q, length, out=out, where=length > 1e-6)
    return out


def continuous(q: FloatArray) -> FloatArray:
    """Choose the sign of each quaternion (n, 4), finite, so that neighbors lie on the same half of the sphere.

    The rotations stay the same; the first keeps its sign.
    """
    flips = np.sum(q[1:] * q[:-1], axis=1) < 0.0
    signs = np.concatenate([[1.0], np.cumprod(np.where(flips, -1.0, 1.0))])[: len(q)]
    turned: FloatArray = q * signs[:, None]
    return turned


def _apart(x: FloatArray) -> FloatArray:
    """Bring components to the front: (..., k) to (k, ...), in a microsecond where a flight asks sample by sample."""
    return x.T if x.ndim < 3 else np.moveaxis(x, -1, 0)


def _together(parts: Sequence[FloatArray]) -> FloatArray:
    """Undo that; in memory the components of one sample lie together."""
    return np.array(parts) if np.ndim(parts[0]) == 0 else np.stack(parts, axis=-1)
