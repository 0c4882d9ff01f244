"""A priori knowledge of a number of a vehicle: value, standard deviation, and where it is from.

Standard deviations of derivatives are those of the method, by one table, and those of what is typical rather than measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from stoop_draft.vehicle_draft.geometry import Geometry


@dataclass(frozen=True)
class Apriori:
    """A number that is known before the flight.

    Attributes
    ----------
    value : SI units and radians
    std : standard deviation of what is known about it, in the same unit
    source : a method or a record, in a few words; a comment of the vehicle file
    """

    value: float
    std: float
    source: str


@dataclass(frozen=True)
class Rule:
    """A standard deviation: a share of the value, and what remains where the value is zero; both independent."""

    share: float
    floor: float

    def std(self, value: float) -> float:
        """Return the standard deviation of a value."""
        return math.hypot(self.share * value, self.floor)


METHOD: Final[dict[str, Rule]] = {
    "CD0": Rule(0.35, 0.01), "CDalpha": Rule(0.25, 0.06), "CDalpha2": Rule(0.4, 0.3), "CDV": Rule(0.0, 0.02),
    "CL0": Rule(0.15, 0.05), "CLalpha": Rule(0.08, 0.15), "CLq": Rule(0.35, 2.0), "CLV": Rule(0.0, 0.1),
    "CLelevator": Rule(0.25, 0.08),
    "Cm0": Rule(0, 0.1), "Cmalpha": Rule(0.25, 0.45), "Cmq": Rule(0.2, 2), "CmV": Rule(0.0, 0.05),
    "Cmelevator": Rule(0.2, 0.06),
    "CQ0": Rule(0.0, 0.01), "CQbeta": Rule(0.3, 0.1), "CQp": Rule(0.4, 0.08), "CQr": Rule(0.3, 0.08),
    "CQrudder": Rule(0.25, 0.04), "CQV": Rule(0.0, 0.01),
    "Cl0": Rule(0.0, 0.005), "Clbeta": Rule(0.25, 0.02), "Clp": Rule(0.1, 0.04), "Clr": Rule(0.3, 0.05),
    "Claileron": Rule(0.2, 0.015), "Clrudder": Rule(0.5, 0.008),
    "Cn0": Rule(0.0, 0.003), "Cnbeta": Rule(0.3, 0.035), "Cnp": Rule(0.4, 0.045), "Cnr": Rule(0.2, 0.015),
    "Cnaileron": Rule(0.4, 0.01), "Cnrudder": Rule(0.2, 0.01),
}  # fmt: skip
"""Of each term of eq. (1); measured by ``stoop verify handbook``."""
STEP: Final = 0.2  #: of a typical number, in its standard deviations, for the slope of the derivatives


def typical_std(geometry: Geometry, values: Callable[[Geometry], dict[str, float]]) -> dict[str, float]:
    """Return the standard deviations of derivatives that come from what is typical of the geometry, to first order."""
    variance: dict[str, float] = {}
    for path, std in geometry.spread.items():
        high, low = (values(shifted(geometry, path, s * STEP * std)) for s in (1.0, -1.0))
        for name, value in high.items():
            variance[name] = variance.get(name, 0.0) + ((value - low[name]) / (2.0 * STEP)) ** 2
    return {name: math.sqrt(variance.get(name, 0.0)) for name in METHOD}


def shifted(geometry: Geometry, path: str, change: float) -> Geometry:
    """Return a geometry with one number, named as in `Geometry.spread`, changed."""
    return _shifted(geometry, path.split("."), change)  # type: ignore[no-any-return]


def _shifted(value: Any, keys: list[str], change: float) -> Any:
    if not keys:
        return value + change
    if isinstance(value, tuple):
        index = int(keys[0]) if keys[0].isdigit() else "xyz".index(keys[0])
        changed = _shifted(value[index], keys[1:], change)
        return (*value[:index], changed, *value[index + 1 :])
    return value.model_copy(update={keys[0]: _shifted(getattr(value, keys[0]), keys[1:], change)})
