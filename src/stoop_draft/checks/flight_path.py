"""Attitude against the flight path where no accelerometer was recorded, as with motion capture.

Lift, or the thrust of rotors, points along the body's z axis: the side acceleration follows from the bank, that ahead of rotors
from the pitch; on wings lift grows with the angle between the nose and the path, and a climb costs speed.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop.extend.units import STANDARD_GRAVITY
from stoop_draft.checks.engine import Evidence, Key, Range, Residual, Residuals
from stoop_draft.checks.kinematics import LIMITS as AGREEMENT
from stoop_draft.checks.kinematics import Columns
from stoop_draft.checks.lines import EULER, POSITION, SPECIFIC_FORCE, VELOCITY, Assignment, reading


@dataclass(frozen=True)
class PathLimits:
    """How attitude and path are compared."""

    #: s of differences: a maneuver is short, and motion capture is exact
    span: float = 0.3
    speed: float = 3.0  #: m/s; what is slower does not fly on wings
    least: int = 100  #: samples
    likeness: float = 0.5  #: correlation from which a sign means something
    odds: float = 10.0  #: of a sign against that of flight on wings
    weight: float = 2.0  #: factor within which gravity is what changes the speed
    floor: float = 0.5  #: m/s2, of side accelerations: sideslip and gusts


LIMITS: Final = PathLimits()


class FlightPath:
    """The residuals of attitude and path of columns at one rate [Hz]; none where accelerometers tell more."""

    def __init__(self, data: Columns, rate: float, winged: bool) -> None:
        #: what tells the path: velocities, else positions
        self.path: tuple[str, ...] = next(
            (names for names in (VELOCITY, POSITION) if set(names) <= data.keys()), ()
        )
        there = bool(self.path) and set(EULER) <= data.keys() and not set(SPECIFIC_FORCE) <= data.keys()
        self.data, self.rate, self.winged, self.there = data, rate, winged, there
        self.steps = max(2, round(LIMITS.span * rate))

    def __call__(self, state: Assignment, changed: Collection[str] | None) -> Residuals:
        """Return what disagrees, where some of those that changed take part."""
        if not self.there or (changed is not None and not {*EULER, *self.path} & set(changed)):
            return {}
        velocity, angles = (
            np.column_stack([self._column(state, name) for name in names]) for names in (self.path, EULER)
        )
        if self.path == POSITION:
            velocity, angles = self._slopes(velocity), self._middle(angles)
        acceleration, velocity, angles = self._slopes(velocity), self._middle(velocity), self._middle(angles)
        phi, theta, psi = angles.T
        side = np.cos(psi) * acceleration[:, 1] - np.sin(psi) * acceleration[:, 0]
        lift = STANDARD_GRAVITY - acceleration[:, 2]  # over the cosines of bank and pitch
        left = side - lift * np.tan(phi) / np.cos(theta)
        span = AGREEMENT.move * self.rate
        out: dict[Key, Evidence] = {("bank", "phi"): Residual(left, side, span, LIMITS.floor**2)}
        if self.winged:
            out |= self._on_wings(velocity, acceleration, theta)
        else:  # thrust points along the body's axis ahead as well
            ahead = np.cos(psi) * acceleration[:, 0] + np.sin(psi) * acceleration[:, 1]
            out["bank", "theta"] = Residual(ahead + lift * np.tan(theta), ahead, span, LIMITS.floor**2)
        return out

    def _slopes(self, x: FloatArray) -> FloatArray:
        """Return the slopes (n - steps, k) of columns (n, k) over a span."""
        return (x[self.steps :] - x[: -self.steps]) * self.rate / self.steps

    def _middle(self, x: FloatArray) -> FloatArray:
        """Return the rows (n - steps, k) in the middle of the spans."""
        first = self.steps // 2
        return x[first : first + len(x) - self.steps]

    def scales(self, state: Assignment) -> dict[tuple[str, ...], float]:
        """Return nothing: what a factor would be is told by other residuals."""
        return {}

    def _on_wings(self, velocity: FloatArray, acceleration: FloatArray, theta: FloatArray) -> Residuals:
        """Return the correlations of lift with the angle of the nose to the path, and of a descent with the gain of speed."""
        speed = np.linalg.norm(velocity, axis=1)
        speed = np.where(speed > LIMITS.speed, speed, np.nan)
        gained = np.sum(velocity * acceleration, axis=1) / speed
        angle = theta + np.arcsin(np.clip(velocity[:, 2] / speed, -1.0, 1.0))
        lift, descent = -acceleration[:, 2] / speed**2, velocity[:, 2] / speed
        likeness, (falling, slope) = _likeness(angle, lift)[0], _likeness(descent, gained)
        energy = 1.0 / LIMITS.weight < abs(slope) / STANDARD_GRAVITY < LIMITS.weight
        return {
            ("path-lift", "theta", self.path[2]): Range(likeness, 0.0, np.inf, LIMITS.odds),
            ("path-speed", self.path[2]): Range(falling if energy else np.nan, 0.0, np.inf, LIMITS.odds),
        }

    def _column(self, state: Assignment, name: str) -> FloatArray:
        column, factor = reading(state, name)
        return factor * self.data[column]


def _likeness(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Return the correlation of columns (n,), and the slope of y over x that is as large in both directions.

    NaN where chance gives such a correlation r: m independent pairs with it are exp(-m / 2 ln(1 - r^2)) times as likely as
    without one, and of columns with autocorrelations a_k and b_k, m = n / sum(a_k b_k) are independent [1]_.

    References
    ----------
    .. [1] Bartlett, "Some aspects of the time-correlation problem", J. R. Stat. Soc. 98 (1935) 536.
    """
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    if x.size < LIMITS.least or min(np.ptp(x), np.ptp(y)) == 0.0:
        return np.nan, np.nan
    slope = float(np.std(y) / np.std(x))
    x, y = ((part - part.mean()) / np.std(part) for part in (x, y))
    # Parseval: the sum over lags of products of autocorrelations is that of products of spectra
    spectra = [np.abs(np.fft.fft(part, 2 * x.size)) ** 2 for part in (x, y)]
    pairs = 2.0 * x.size**4 / float(spectra[0] @ spectra[1])
    found = float(x @ y) / x.size
    evidence = -0.5 * pairs * np.log(max(1.0 - found**2, np.finfo(float).tiny))
    certain = abs(found) > LIMITS.likeness and evidence > LIMITS.odds
    return (found, slope) if certain else (np.nan, np.nan)
