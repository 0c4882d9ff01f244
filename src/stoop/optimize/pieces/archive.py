"""The archive: parents that lost, kept because the way away from them is a direction worth trying.

References
----------
Zhang and Sanderson (2009), JADE: adaptive differential evolution with optional external archive, IEEE TEC 13,
945-958.
"""

from __future__ import annotations

import numpy as np

from stoop.base.arrays import FloatArray


def remember(
    archive: FloatArray, losers: FloatArray, most: int, generator: np.random.Generator
) -> FloatArray:
    """Return the archive with the losers added; beyond `most`, (m, D), members are forgotten at random.

    Parameters
    ----------
    archive : (a, D)
    losers : (k, D)
    most : int
    generator : numpy Generator
        Moved on only where something is forgotten.
    """
    kept = np.concatenate([archive, losers])
    if len(kept) > most:
        kept = kept[generator.permutation(len(kept))[:most]]
    return kept
