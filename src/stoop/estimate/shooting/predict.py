"""Prediction over short windows: an unstable vehicle is begun anew, from what was measured, before it runs away."""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.shooting.states import measured_states
from stoop.estimate.shooting.windows import Shots, edges
from stoop.problem import Misfit

LENGTH: Final = 1.0  #: s
BEGUN_ANEW: Final = (
    "{window}: predicted in windows of {length:g} s that each begin as measured there (open loop a hovering vehicle leaves its "
    "record whatever the model is), so figures tell accelerations and what becomes of them within a window."
)


def begun_anew(problem: Misfit, index: int) -> FloatArray:
    """Return the simulated readings (n, n_y) of one piece."""
    piece = problem.pieces[index]
    shots = Shots(problem, index, edges(len(piece.time), max(2, round(LENGTH / piece.dt))))
    nodes = measured_states(shots)
    nodes = np.concatenate([nodes, np.zeros((len(shots.blown), shots.count))])
    return shots.flown_from(nodes)
