"""Selection: who lives on."""

from __future__ import annotations

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray


def greedy(
    parents: FloatArray, costs: FloatArray, trials: FloatArray, trial_costs: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Let a trial replace its parent where it costs less (the paper's eq. 8).

    Returns
    -------
    survivors : (n, D)
    survivor_costs : (n,)
    won : (n,), where the trial replaced the parent
    """
    won = trial_costs < costs
    return np.where(won[:, None], trials, parents), np.where(won, trial_costs, costs), won
