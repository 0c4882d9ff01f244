"""Normal equations of windows: the states that windows begin with are eliminated, the search vector is left.

Axes: j = unknown of the search vector, e = number of a move of a window's state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.normal_equations import gram, project


@dataclass(frozen=True, eq=False)
class Weighted:
    """A window, whitened: residual and gap are in standard deviations.

    Attributes
    ----------
    residual : (n n_y,)
    by_unknown, by_state : (j, n n_y), (e, n n_y)
    gap : (e,), empty for the last window
    gap_by_unknown, gap_by_state : (e, j), (e, e)
    closing : (e,)
        What a move of the next window's state takes off the gap.
    """

    residual: FloatArray
    by_unknown: FloatArray
    by_state: FloatArray
    gap: FloatArray
    gap_by_unknown: FloatArray
    gap_by_state: FloatArray
    closing: FloatArray


@dataclass(frozen=True, eq=False)
class Node:
    """A window's state, eliminated: its move is - (own + unknowns dz + before times the move of the one before)."""

    own: FloatArray  #: (e,)
    unknowns: FloatArray  #: (e, j)
    before: FloatArray  #: (e, e)


@dataclass(frozen=True, eq=False)
class Reduced:
    """What is left of a piece.

    Attributes
    ----------
    normal, gradient : (j, j), (j,)
        Of half the cost, the windows' states at their best.
    nodes : tuple of Node
        The eliminated states, first to last.
    gain : float
        What the moves of the windows' states alone take off the cost.
    logdet : float
        Of the information about the states.
    """

    normal: FloatArray
    gradient: FloatArray
    nodes: tuple[Node, ...]
    gain: float
    logdet: float = 0.0

    def moves(self, step: FloatArray) -> FloatArray:
        """Return the moves (w, e) of the windows' states for a step (j,); the first window's is zero."""
        size = len(self.nodes[0].own) if self.nodes else 0
        out, before = [np.zeros(size)], np.zeros(size)
        for node in self.nodes:
            before = -(node.own + node.unknowns @ step + node.before @ before)
            out.append(before)
        return np.array(out)


def reduced(windows: Sequence[Weighted], damping: float) -> Reduced:
    """Eliminate the states of all windows but the first, whose state is the search vector's."""
    normal, gradient, blocks = _assembled(windows)
    nodes: list[Node] = []
    gain = logdet = 0.0
    for w in range(len(windows) - 1, 0, -1):
        A, B, c, before = blocks[w]
        A = A + damping * np.diag(np.diag(A))
        solved: FloatArray = np.asarray(np.linalg.solve(A, np.column_stack([c, B, before])), dtype=np.float64)
        own, unknowns, back = solved[:, 0], solved[:, 1 : 1 + len(normal)], solved[:, 1 + len(normal) :]
        normal, gradient, gain = normal - B.T @ unknowns, gradient - B.T @ own, gain + float(c @ own)
        if w > 1:
            a, b, d, further = blocks[w - 1]
            blocks[w - 1] = (a - before.T @ back, b - before.T @ unknowns, d - before.T @ own, further)
        logdet += float(np.linalg.slogdet(A)[1])
        nodes.append(Node(own, unknowns, back if w > 1 else np.zeros_like(A)))
    return Reduced(0.5 * (normal + normal.T), gradient, tuple(reversed(nodes)), gain, logdet)


Block = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def _assembled(windows: Sequence[Weighted]) -> tuple[FloatArray, FloatArray, list[Block]]:
    """Return normal matrix and gradient of the search vector, and per window those of its state.

    A block holds: state by state (e, e), state by unknown (e, j), gradient (e,), state by the state before (e, e).
    """
    size = len(windows[0].by_unknown)
    many = len(windows[0].by_state)
    normal, gradient, blocks = np.zeros((size, size)), np.zeros(size), []
    for w, window in enumerate(windows):
        normal += gram(window.by_unknown) + window.gap_by_unknown.T @ window.gap_by_unknown
        gradient += project(window.by_unknown, window.residual) + window.gap_by_unknown.T @ window.gap
        A, B, c, before = (
            np.zeros((many, many)),
            np.zeros((many, size)),
            np.zeros(many),
            np.zeros((many, many)),
        )
        if w > 0:
            A += gram(window.by_state) + window.gap_by_state.T @ window.gap_by_state
            B += window.by_state @ window.by_unknown.T + window.gap_by_state.T @ window.gap_by_unknown
            c += project(window.by_state, window.residual) + window.gap_by_state.T @ window.gap
            last = windows[w - 1]
            A += np.diag(last.closing**2)
            B -= last.closing[:, None] * last.gap_by_unknown
            c -= last.closing * last.gap
            before -= last.closing[:, None] * last.gap_by_state
        blocks.append((A, B, c, before))
    return normal, gradient, blocks
