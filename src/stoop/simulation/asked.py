"""What the autopilot of a hovering vehicle is asked to fly: set-points made smooth enough to follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import matrices_of, product, quaternions_about, quaternions_of
from stoop.base.variables import EULER
from stoop.simulation.paths import traveled
from stoop.simulation.steady import Trim

GRAVITY: Final = 9.80665
_SOON: Final = 0.4  #: s, in which a set-point is reached unless that takes too much
MOST: Final = np.array([3.0, 3.0, 1.5, 0.5])  #: m/s2 north, east, down, and rad/s of heading


@dataclass(frozen=True, eq=False)
class Asked:
    """Attitude and motion that are asked for, at each sample.

    Attributes
    ----------
    velocity, position : (n, 3), m/s and m
        North-east-down.
    quaternion : (n, 4)
        Body to Earth.
    rotation : (n, 3, 3)
        The same.
    turning : (n,), rad/s
        Rate of heading.
    up : (n,), m/s2
        Specific force beyond that of the steady flight.
    """

    velocity: FloatArray
    position: FloatArray
    quaternion: FloatArray
    rotation: FloatArray
    turning: FloatArray
    up: FloatArray


def asked(signals: Mapping[str, FloatArray], point: Trim, count: int, dt: float) -> Asked:
    """Return what set-points ask for, over a trim.

    The attitude tilts the thrust of the trim into the wanted acceleration and turns about it into the heading.

    Parameters
    ----------
    signals : mapping
        Names of :data:`~stoop.simulation.maneuver.SETPOINTS` -> (n,) changes from the trim.
    count : int
        n
    dt : float, s
    """
    none = np.zeros(count)
    heading, turning = _followed(signals.get("heading", none)[:, None], MOST[3:], dt)
    absolute = point.start["psi"] + heading[:, 0]
    forward, right = signals.get("forward", none), signals.get("right", none)
    wanted = np.column_stack(
        [
            signals.get("north", none) + forward * np.cos(absolute) - right * np.sin(absolute),
            signals.get("east", none) + forward * np.sin(absolute) + right * np.cos(absolute),
            signals.get("down", none),
        ]
    )
    change, acceleration = _followed(wanted, MOST[:3], dt)
    velocity = np.asarray(point.velocity) + change
    q = _attitude(point, acceleration, heading[:, 0])
    return Asked(velocity, traveled(velocity, dt), q, matrices_of(q), turning[:, 0], -acceleration[:, 2])


def _followed(wanted: FloatArray, most: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """Return signals (n, k) that follow wanted ones at no more than a rate ``most`` (k,), and their rates."""
    out, rates = np.zeros_like(wanted), np.zeros_like(wanted)
    if not wanted.any():
        return out, rates
    soon = max(_SOON, dt)
    now = np.zeros(wanted.shape[1])
    for k, goal in enumerate(wanted):
        rates[k] = np.minimum(np.maximum((goal - now) / soon, -most), most)
        out[k] = now
        now = now + dt * rates[k]
    return out, rates


def _attitude(point: Trim, acceleration: FloatArray, heading: FloatArray) -> FloatArray:
    """Return quaternions (n, 4): the trim's, turned about its own down axis, then tilted about level axes."""
    trim = quaternions_of(np.array([point.start[name] for name in EULER]))
    around = np.column_stack([np.zeros((len(heading), 2)), heading])
    yawed = product(trim, quaternions_about(around))
    tilt = np.column_stack([acceleration[:, 1], -acceleration[:, 0], np.zeros(len(heading))]) / GRAVITY
    # A rotation about an axis of the Earth is one about that axis as the body sees it.
    return product(yawed, quaternions_about(np.einsum("bji,bj->bi", matrices_of(yawed), tilt)))
