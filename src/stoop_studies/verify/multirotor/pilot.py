"""An autopilot of proportional gains that holds a velocity, and shakes the vehicle while it does."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop_studies.verify.multirotor.craft import HEADING, RATE

GRAVITY: Final = 9.8
HOVER: Final = 0.42  #: command that about carries the weight
SIGNS: Final = np.array(
    [[-1, 1, 1, 1], [1, -1, 1, 1], [1, 1, -1, 1], [-1, -1, -1, 1]]
)  #: roll, pitch, yaw, heave
GAINS: Final = np.array([1 / 520.0, 1 / 520.0, 1 / 47.0, 1 / 43.0])  #: command per rad/s2 and m/s2
FASTEST: Final = 0.25  #: rad, of bank and pitch


class Pilot:
    """What is sent to the motors, from what the vehicle does.

    Attributes
    ----------
    wanted : (n, 3), m/s
        Velocity north, east, down.
    shaken : (n, 4)
        Added accelerations: roll, pitch, yaw (rad/s2), heave (m/s2).
    """

    def __init__(self, wanted: FloatArray, shaken: FloatArray) -> None:
        self.wanted, self.shaken = wanted, shaken
        self.lacking = 0.0

    def __call__(self, k: int, now: Mapping[str, float]) -> FloatArray:
        """Return the commands (4,) for sample ``k``, from the state one sample before."""
        north, east, down = (
            w - now[v] for w, v in zip(self.wanted[k].tolist(), ("vn", "ve", "vd"), strict=True)
        )
        c, s = np.cos(now["psi"]), np.sin(now["psi"])
        ahead, right = c * north + s * east, c * east - s * north
        theta = float(np.clip(-1.5 * ahead / GRAVITY, -FASTEST, FASTEST))
        phi = float(np.clip(1.5 * right / GRAVITY, -FASTEST, FASTEST))
        self.lacking += down / RATE
        turning = np.array(
            [
                40.0 * (phi - now["phi"]) - 9.0 * now["p"],
                40.0 * (theta - now["theta"]) - 9.0 * now["q"],
                4.0 * (HEADING - now["psi"]) - 4.0 * now["r"],
                -2.0 * down - 1.0 * self.lacking,
            ]
        )
        return np.asarray(np.clip(HOVER + SIGNS @ (GAINS * (turning + self.shaken[k])), 0.05, 1.0))
