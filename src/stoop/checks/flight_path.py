"""Attitude against the flight path where no accelerometer was recorded, as with motion capture.

Lift, or the thrust of rotors, points along the body's z axis: the side acceleration follows from the bank, and, on wings, lift
grows with the angle between the nose and the path, and a climb costs speed.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import EULER, SPECIFIC_FORCE, VELOCITY
from stoop.checks.engine import Evidence, Key, Range, Residual, Residuals
from stoop.checks.kinematics import LIMITS as AGREEMENT
from stoop.checks.kinematics import Columns
from stoop.checks.lines import Assignment, reading


@dataclass(frozen=True)
class PathLimits:
    """How attitude and path are compared."""

    #: s of differences: a maneuver is short, and motion capture is exact
    span: float = 0.3
    speed: float = 3.0  #: m/s; what is slower does not fly on wings
    least: int = 100  #: samples
    likeness: float = 0.5  #: correlation from which a sign means something
    odds: float = 10.0  #: of a sign against that of flight on wings
    floor: float = 0.5  #: m/s2, of side accelerations: sideslip and gusts


LIMITS: Final = PathLimits()


class FlightPath:
    """The residuals of attitude and path of columns at one rate [Hz]; none where accelerometers tell more."""

    def __init__(self, data: Columns, rate: float, winged: bool) -> None:
        there = {*EULER, *VELOCITY} <= data.keys() and not set(SPECIFIC_FORCE) <= data.keys()
        self.data, self.rate, self.winged, self.there = data, rate, winged, there
        self.steps = max(2, round(LIMITS.span * rate))

    def __call__(self, state: Assignment, changed: Collection[str] | None) -> Residuals:
        """Return what disagrees, where some of those that changed take part."""
        if not self.there or (changed is not None and not {*EULER, *VELOCITY} & set(changed)):
            return {}
        steps = self.steps
        velocity = np.column_stack([self._column(state, name) for name in VELOCITY])
        acceleration = (velocity[steps:] - velocity[:-steps]) * self.rate / steps
        middle = slice(steps // 2, steps // 2 + len(acceleration))
        phi, theta, psi = (self._column(state, name)[middle] for name in EULER)
        side = np.cos(psi) * acceleration[:, 1] - np.sin(psi) * acceleration[:, 0]
        lift = STANDARD_GRAVITY - acceleration[:, 2]  # over the cosines of bank and pitch
        left = side - lift * np.tan(phi) / np.cos(theta)
        span = AGREEMENT.move * self.rate
        out: dict[Key, Evidence] = {("bank", "phi"): Residual(left, side, span, LIMITS.floor**2)}
        if self.winged:
            out |= self._on_wings(velocity[middle], acceleration, theta)
        return out

    def scales(self, state: Assignment) -> dict[tuple[str, ...], float]:
        """Return nothing: what a factor would be is told by other residuals."""
        return {}

    def _on_wings(self, velocity: FloatArray, acceleration: FloatArray, theta: FloatArray) -> Residuals:
        """Return the correlations of lift with the angle of the nose to the path, and of a descent with the gain of speed."""
        speed = np.linalg.norm(velocity, axis=1)
        speed = np.where(speed > LIMITS.speed, speed, np.nan)
        gained = np.sum(velocity * acceleration, axis=1) / speed
        angle = theta + np.arcsin(np.clip(velocity[:, 2] / speed, -1.0, 1.0))
        pairs = {
            ("path-lift", "theta", "vd"): (angle, -acceleration[:, 2] / speed**2),
            ("path-speed", "vd"): (velocity[:, 2] / speed, gained),
        }
        return {key: Range(_likeness(x, y), 0.0, np.inf, LIMITS.odds) for key, (x, y) in pairs.items()}

    def _column(self, state: Assignment, name: str) -> FloatArray:
        column, factor = reading(state, name)
        return factor * self.data[column]


def _likeness(x: FloatArray, y: FloatArray) -> float:
    """Return the correlation of columns (n,); NaN where it says nothing."""
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    if x.size < LIMITS.least or min(np.ptp(x), np.ptp(y)) == 0.0:
        return np.nan
    found = float(np.corrcoef(x, y)[0, 1])
    return found if abs(found) > LIMITS.likeness else np.nan
