"""Process and measurement noise of a filter, in numbers that can be estimated.

Gusts of the vehicle file disturb where there are any; their intensities are numbers of the vehicle, free or not. Without
a table of turbulence white accelerations disturb velocity and rates, one unknown intensity each. The noise of each
measured channel is unknown, unless it is given. Unknown intensities are logarithms: the tail of the search vector.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.problem import Piece
from stoop.vehicle import Vehicle
from stoop.vehicle.vehicle import RIGID_STATES

FIRST_INTENSITY: Final = {"u": 0.3, "v": 0.3, "w": 0.3, "p": 0.1, "q": 0.1, "r": 0.1}  #: per root second
RANGE: Final = (1e-3, 1e3)  #: of the first guess: bounds of an intensity


@dataclass(frozen=True, eq=False)
class Noise:
    """Intensities of process and measurement noise.

    Attributes
    ----------
    vehicle : Vehicle
    first : (n_y,)
        First guess of the standard deviation of each channel, its unit; NaN where nothing was measured.
    given : (n_y,), optional
        Variances that are not estimated.
    """

    vehicle: Vehicle
    first: FloatArray
    given: FloatArray | None = None

    @cached_property
    def disturbed(self) -> tuple[str, ...]:
        """States with a white acceleration of unknown intensity: none where gusts disturb."""
        return () if self.vehicle.gusts else tuple(s for s in self.vehicle.moves if s in RIGID_STATES)

    @cached_property
    def channels(self) -> tuple[int, ...]:
        """Channels whose noise is estimated."""
        return () if self.given is not None else tuple(np.flatnonzero(np.isfinite(self.first)).tolist())

    @property
    def size(self) -> int:
        """Length of the tail."""
        return len(self.disturbed) + len(self.channels)

    @cached_property
    def start(self) -> FloatArray:
        """The tail to begin with."""
        return np.log([*(FIRST_INTENSITY[s] for s in self.disturbed), *self.first[list(self.channels)]])

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the tail."""
        return self.start + np.log(RANGE[0]), self.start + np.log(RANGE[1])

    def process(self, tail: FloatArray, drive: FloatArray, dt: float) -> FloatArray:
        """Return the covariance (B, r, n_e, n_e) that a sample adds.

        Parameters
        ----------
        tail : (B, t)
        drive : (B, r, n_e, n_w)
            Perturbation by one unit of noise held over the sample; noise of unit intensity has the variance 1/dt there.
        dt : float, s
        """
        out: FloatArray = drive @ np.swapaxes(drive, 2, 3) / dt
        for i, name in enumerate(self.disturbed):
            e = self.vehicle.moves.index(name)
            out[:, :, e, e] += np.exp(2.0 * tail[:, i, None]) * dt
        return out

    def variances(self, tail: FloatArray) -> FloatArray:
        """Return the measurement variances (B, n_y), infinite for channels that were never measured."""
        if self.given is not None:
            known = np.where(np.isfinite(self.first), self.given, np.inf)
            return np.repeat(known[None, :], len(tail), axis=0)
        out = np.full((len(tail), len(self.first)), np.inf)
        out[:, list(self.channels)] = np.exp(2.0 * tail[:, len(self.disturbed) :])
        return out

    def describe(self, tail: FloatArray) -> dict[str, float]:
        """Return the estimated process noise by state, its unit per root second."""
        return {s: float(np.exp(tail[i])) for i, s in enumerate(self.disturbed)}


def first_guess(vehicle: Vehicle, pieces: Sequence[Piece]) -> FloatArray:
    """Return the noise (n_y,) that second differences show, NaN for channels that were never measured.

    White noise of variance s^2 has second differences of variance 6 s^2, in which a smooth signal hardly shows.
    """
    out = np.full(len(vehicle.outputs), np.nan)
    for i, channel in enumerate(vehicle.outputs):
        rough = [d[np.isfinite(d)] for d in (np.diff(p.measured[:, i], 2) for p in pieces)]
        found = np.concatenate(rough)
        floor = 1e-2 * getattr(vehicle.file.sensors, channel).sigma
        if found.size:
            out[i] = max(float(np.median(np.abs(found))) / 0.6745 / np.sqrt(6.0), floor)
        elif any(np.isfinite(p.measured[:, i]).any() for p in pieces):
            out[i] = getattr(vehicle.file.sensors, channel).sigma
    return out
