"""The first scout of a search: aerodynamic terms by regression need no start and no integration.

Biased by noise in the regressors. Klein and Morelli, *Aircraft System Identification*, 2nd ed., chapter 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.regression.accelerations import fitted
from stoop.estimate.regression.domain import Time
from stoop.estimate.regression.estimate import boxed, regressed
from stoop.estimate.regression.measured import complete
from stoop.problem import Layout, Piece

MEASURED: Final = 0.9  #: share of the samples that must be whole


def equation_error(layout: Layout, pieces: Sequence[Piece]) -> FloatArray | None:
    """Return free parameters (D,) in the unit box, or None where states were not all measured.

    Numbers that are no aerodynamic terms stay as in the file, unless the vehicle has rotors.
    """
    if layout.vehicle.hovers:
        return _of_accelerations(layout, pieces)
    if not all(complete(layout.vehicle, p).mean() > MEASURED for p in pieces):
        return None
    found = regressed(layout, pieces, Time(), boxed)
    if found is None:
        return None
    values = np.array([p.value for p in layout.parameters])
    values[list(found.places)] = found.solved.values
    return layout.unit(values) if np.isfinite(values).all() else None


def _of_accelerations(layout: Layout, pieces: Sequence[Piece]) -> FloatArray | None:
    found = fitted(layout, pieces, Time(), boxed(layout.parameters))
    return None if found is None else layout.unit(found[1].values[: layout.dimension])
