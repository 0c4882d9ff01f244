"""How far the wind wanders from window to window, by maximum likelihood.

A vehicle that hovers is flown through the wind of its windows, and the winds of neighbors differ by a random step. Their
size is what decides how much of a velocity a gust explains, so it is estimated with the rest: of the linearized problem,
states, winds and search vector integrated out (the Laplace approximation of the likelihood). In calm air it goes to zero
and the winds are one.

References
----------
H. E. Rauch, F. Tung and C. T. Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA Journal 3(8), 1965.
D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4(3), 1992, section 4 (the evidence for a scale).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.optimize import minimize_scalar

from stoop.estimate.shooting.condense import reduced
from stoop.estimate.shooting.search import Meeting, Place
from stoop.estimate.shooting.windows import Window

RANGE: Final = (1e-3, 3.0)  #: m/s
ROUNDS: Final = 2
UNSEEN: Final = 1e-12  #: of the greatest eigenvalue: rounding
PARTS: Final = ((-3, -2), (-1,))  #: of the scales: level, vertical


def wandering(meeting: Meeting, place: Place) -> Meeting:
    """Return the problem with the likeliest size of the steps of the wind; itself where there are none."""
    gaps = sum(shots.count - 1 for shots in meeting.shots)
    if not meeting.problem.layout.vehicle.hovers or gaps < 3:
        return meeting
    windows = meeting.linear(place)
    for _ in range(ROUNDS):
        for part in PARTS:
            meeting = _likeliest(meeting, part, place, windows, gaps)
    return meeting


def _likeliest(
    meeting: Meeting, part: Sequence[int], place: Place, linear: Sequence[Sequence[Window]], gaps: int
) -> Meeting:
    def unlikely(logarithm: float) -> float:
        return _unlikely(_scaled(meeting, part, float(np.exp(logarithm))), place, linear, gaps)

    low, high = np.log(RANGE)
    found = minimize_scalar(unlikely, bounds=(low, high), method="bounded", options={"xatol": 0.05})
    return _scaled(meeting, part, float(np.exp(found.x)))


def _scaled(meeting: Meeting, part: Sequence[int], size: float) -> Meeting:
    scales = meeting.scales.copy()
    scales[list(part)] = size
    return replace(meeting, scales=scales)


def _unlikely(meeting: Meeting, place: Place, linear: Sequence[Sequence[Window]], gaps: int) -> float:
    """Return twice the negative logarithm of the likelihood, less what does not depend on the wind."""
    layout = meeting.problem.layout
    prior = layout.prior_jacobian()
    normal, gradient = prior.T @ prior, prior.T @ layout.prior_residuals(place.z[None, :])[0]
    cost = logdet = 0.0
    for windows in linear:
        weighed = [meeting.weigh(window) for window in windows]
        found = reduced(weighed, 0.0)
        cost += sum(float(w.gap @ w.gap) for w in weighed) - found.gain
        normal, gradient, logdet = normal + found.normal, gradient + found.gradient, logdet + found.logdet
    told = np.diag(normal) > 0.0  # what no window sees has no part in it
    normal, gradient = normal[np.ix_(told, told)], gradient[told]
    size = np.sqrt(np.diag(normal))
    values, vectors = np.linalg.eigh(normal / np.outer(size, size))
    kept = np.maximum(values, UNSEEN * values[-1])
    along = vectors.T @ (gradient / size)
    total = logdet + float(np.sum(np.log(kept))) + 2.0 * float(np.sum(np.log(size)))
    return (
        cost
        - float(np.sum(along**2 / kept))
        + total
        + 2.0 * gaps * float(np.sum(np.log(meeting.scales[-3:])))
    )
