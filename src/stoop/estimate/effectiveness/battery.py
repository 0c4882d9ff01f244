"""What the battery's voltage still does to the commanded lift after vehicle or autopilot have corrected for it.

The lift that a hover needs does not depend on the battery. Where commanded lift and voltage go together among flights of
one configuration, the correction leaves that slope; it is fitted within each such group (each has a mean of its own).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray

UNKNOWN: Final = 0.3  #: standard deviation of the slope before any flight; without a correction thrust goes with voltage squared
REPEATS: Final = 0.01  #: relative scatter of the lift between flights, believed like `FEW` flights
FEW: Final = 3.0


@dataclass(frozen=True)
class Battery:
    """Relative change of the commanded lift per relative change of the voltage, and its standard error."""

    slope: float = 0.0
    std: float = UNKNOWN


def battery(lifts: Sequence[FloatArray], voltages: Sequence[FloatArray]) -> Battery:
    """Return the slope of groups of flights, shrunk towards zero by how little they tell of it.

    Parameters
    ----------
    lifts : arrays (k,), any unit
    voltages : arrays (k,), V; a group with an unknown one tells nothing
    """
    known = [i for i, v in enumerate(voltages) if v.size > 1 and np.isfinite(v).all()]
    if not known:
        return Battery()
    y = np.concatenate([lifts[i] / lifts[i].mean() - 1.0 for i in known])
    x = np.concatenate([voltages[i] / voltages[i].mean() - 1.0 for i in known])
    plain = float(x @ y) / max(float(x @ x), 1e-12)
    freedom = max(y.size - len(known) - 1, 0)
    noise = (FEW * REPEATS**2 + float(np.sum((y - plain * x) ** 2))) / (FEW + freedom)
    information = float(x @ x) / noise + UNKNOWN**-2
    return Battery(float(x @ y) / noise / information, information**-0.5)
