"""What uncertainty is computed from: weighted residuals, their sensitivities, and the information in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """One segment at the estimate, weighted by the inverse square root of the noise covariance.

    ``k`` counts everything that was estimated: parameters, initial states of all segments, biases of all
    maneuvers. What does not touch this segment has zeros here.

    Attributes
    ----------
    residual : (n, ny), 1
        W (measured - simulated), with W' W the inverse noise covariance; NaN where there is no measurement.
    jacobian : (n, ny, k), 1 per unit of the unknown
        W d(simulated)/d(unknown); what stands beside a missing measurement is not used.
    """

    residual: FloatArray
    jacobian: FloatArray

    @property
    def present(self) -> npt.NDArray[np.bool_]:
        """Where there is a measurement, (n, ny)."""
        return np.isfinite(self.residual)

    def filled(self) -> tuple[FloatArray, FloatArray]:
        """Return residual and jacobian with zeros for what is missing."""
        there = self.present
        if there.all():
            return self.residual, self.jacobian
        return np.where(there, self.residual, 0.0), np.where(there[:, :, None], self.jacobian, 0.0)


def data_information(segments: Sequence[Sensitivity]) -> FloatArray:
    """Return Fisher's information (k, k) of the measurements alone, for white noise."""
    count = segments[0].jacobian.shape[2]
    total = np.zeros((count, count))
    for segment in segments:
        rows = segment.filled()[1].reshape(-1, count)
        seen = np.flatnonzero(rows.any(axis=0))  # not the initial states and biases of other maneuvers
        part = rows[:, seen]
        total[np.ix_(seen, seen)] += part.T @ part
    return total


def prior_information(std: npt.ArrayLike) -> FloatArray:
    """Return the information (k, k) of independent priors; an infinite or NaN `std` (k,) is no prior."""
    spread = np.asarray(std, dtype=np.float64)
    known = np.isfinite(spread) & (spread > 0.0)
    return np.diag(np.where(known, np.where(known, spread, 1.0) ** -2.0, 0.0))
