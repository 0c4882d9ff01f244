"""What becomes of a mutant outside the unit box, each a function of (mutants, parents)."""

from __future__ import annotations

import numpy as np

from stoop.base.arrays import FloatArray


def clip(mutants: FloatArray, parents: FloatArray) -> FloatArray:
    """Return mutants set on the bound that they crossed."""
    inside: FloatArray = np.minimum(np.maximum(mutants, 0.0), 1.0)
    return inside


def midpoint(mutants: FloatArray, parents: FloatArray) -> FloatArray:
    """Return mutants set halfway between the parent and the bound that they crossed (as JADE does)."""
    inside: FloatArray = np.where(mutants < 0.0, 0.5 * parents, mutants)
    return np.where(inside > 1.0, 0.5 * (parents + 1.0), inside)
