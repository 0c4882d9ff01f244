"""What fitted windows tell of the search vector, the states that they begin with left free.

The states follow the search vector as suits them best, so a sensitivity is that of the window with its state
following. What a residual of such sensitivities tells is exactly what is left of the whole problem once its states
are eliminated (a Schur complement), and it is as wide as the search vector, however many windows there are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.shooting.condense import Weighted, reduced
from stoop.estimate.shooting.search import Meeting, Place
from stoop.estimate.shooting.windows import Window
from stoop.problem.evidence import Evidence, PieceEvidence, unknowns_of


def evidence(meeting: Meeting, place: Place) -> Evidence:
    """Return residuals and sensitivities per SI unit of the search vector; how well windows meet is known beside."""
    layout = meeting.problem.layout
    prior = layout.prior_jacobian() / layout.scales
    information = prior.T @ prior
    pieces = []
    for shots, windows in zip(meeting.shots, meeting.linear(place), strict=True):
        follow = following([meeting.weigh(window) for window in windows], layout.scales)
        blocks = [
            window.by_unknown / layout.scales + window.by_state @ own
            for window, own in zip(windows, follow, strict=True)
        ]
        gaps, slopes = _met(meeting, windows, follow)
        rows = slopes.reshape(-1, len(layout.scales))
        information = information + rows.T @ rows
        residual = -np.concatenate([window.residual for window in windows])
        one = PieceEvidence(
            np.where(np.isfinite(shots.piece.measured), residual, np.nan), np.concatenate(blocks)
        )
        pieces.append(
            replace(one, edges=shots.edges, gaps=gaps, gap_jacobian=slopes) if layout.vehicle.hovers else one
        )
    return Evidence(unknowns_of(layout, place.z), tuple(pieces), information)


def following(windows: Sequence[Weighted], scales: FloatArray) -> list[FloatArray]:
    """Return how the state of each window moves with the search vector, (e, j) each, per SI unit."""
    nodes = reduced(windows, 0.0).nodes
    out = [np.zeros((len(windows[0].by_state), len(scales)))]
    for node in nodes:
        out.append(-(node.unknowns / scales + node.before @ out[-1]))
    return out


def _met(
    meeting: Meeting, windows: Sequence[Window], follow: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return residuals (w - 1, e) of the gaps between windows, and how they depend on the search vector (w - 1, e, j)."""
    scales, close = meeting.problem.layout.scales, meeting.closeness
    moved = [
        window.gap_by_unknown / scales + window.gap_by_state @ follow[w] - follow[w + 1]
        for w, window in enumerate(windows[:-1])
    ]
    gaps = np.array([-close * window.gap for window in windows[:-1]]).reshape(-1, len(close))
    return gaps, np.array([close[:, None] * m for m in moved]).reshape(*gaps.shape, len(scales))
