"""Equation error: parameters by least squares on measured accelerations, without a start and without integration.

References
----------
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., Sunflyte, 2016, chapter 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.regression.aircraft import AircraftEquations, complete
from stoop.estimate.regression.least_squares import TimeDomain
from stoop.estimate.regression.rotors import RotorEquations
from stoop.problem import Layout, Piece
from stoop.problem.observation import observation_model
from stoop.vehicle import Vehicle

MIN_COMPLETE: Final = 0.9  #: share of the samples of a piece that the start value of an aircraft needs


def kind_of(vehicle: Vehicle) -> type[AircraftEquations] | type[RotorEquations]:
    """Return the equations of a kind of vehicle; it is decided here and nowhere else."""
    return AircraftEquations if observation_model(vehicle).open_loop else RotorEquations


def start_value(layout: Layout, pieces: Sequence[Piece]) -> FloatArray | None:
    """Return free parameters (D,) in the unit box for the start of a search; None where states were not measured.

    Free numbers that the equations do not have stay as in the file.
    """
    equations = kind_of(layout.vehicle).of(layout, pieces)
    if equations.linear and not all(complete(layout.vehicle, p).mean() > MIN_COMPLETE for p in pieces):
        return None
    found = equations.estimate(TimeDomain(), bounded=True)
    return None if found is None else np.clip(equations.vector(found.values)[: layout.dimension], 0.0, 1.0)
