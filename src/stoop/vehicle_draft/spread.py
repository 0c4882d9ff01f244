"""Standard deviations of a priori derivatives: of the method, by one table, and of what is typical rather than measured."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from stoop.vehicle_draft.geometry import Geometry


@dataclass(frozen=True)
class Rule:
    """A standard deviation: a share of the value, and what remains where the value is zero; both independent.

    ``floor_lift`` is a further floor in proportion to the lift coefficient of the working point.
    """

    share: float
    floor: float
    floor_lift: float = 0.0

    def std(self, value: float, lift: float = 0.0) -> float:
        """Return the standard deviation of a value."""
        return math.hypot(self.share * value, self.floor, self.floor_lift * lift)


METHOD: Final[dict[str, Rule]] = {
    "CD0": Rule(0.35, 0.01), "CDalpha": Rule(0.4, 0.08), "CDalpha2": Rule(0.4, 0.3), "CDV": Rule(0.0, 0.02),
    "CL0": Rule(0.1, 0.05), "CLalpha": Rule(0.1, 0.2), "CLq": Rule(0.35, 2.0), "CLV": Rule(0.0, 0.1),
    "CLelevator": Rule(0.25, 0.08),
    "Cm0": Rule(0.0, 0.05), "Cmalpha": Rule(0.2, 0.15), "Cmq": Rule(0.25, 2.0), "CmV": Rule(0.0, 0.03),
    "Cmelevator": Rule(0.2, 0.08),
    "CQ0": Rule(0.0, 0.01), "CQbeta": Rule(0.3, 0.08), "CQp": Rule(0.5, 0.1), "CQr": Rule(0.4, 0.1),
    "CQrudder": Rule(0.25, 0.04), "CQV": Rule(0.0, 0.01),
    "Cl0": Rule(0.0, 0.005), "Clbeta": Rule(0.3, 0.03), "Clp": Rule(0.12, 0.04), "Clr": Rule(0.25, 0.04),
    "Claileron": Rule(0.25, 0.02), "Clrudder": Rule(0.5, 0.008),
    "Cn0": Rule(0.0, 0.003), "Cnbeta": Rule(0.3, 0.02), "Cnp": Rule(0.4, 0.03), "Cnr": Rule(0.3, 0.03),
    "Cnaileron": Rule(0.5, 0.01), "Cnrudder": Rule(0.25, 0.01),
}  # fmt: skip
"""Of each term of eq. (1); measured by ``stoop verify handbook``."""
STEP: Final = 0.2  #: of a typical number, in its standard deviations, for the slope of the derivatives


def with_spread(
    geometry: Geometry, values: Callable[[Geometry], dict[str, float]]
) -> tuple[dict[str, float], dict[str, float]]:
    """Return the derivatives, and their standard deviations from what is typical of the geometry, to first order."""
    nominal = values(geometry)
    variance = dict.fromkeys(nominal, 0.0)
    for path, std in geometry.spread.items():
        high, low = (values(shifted(geometry, path, s * STEP * std)) for s in (1.0, -1.0))
        for name in variance:
            variance[name] += ((high[name] - low[name]) / (2.0 * STEP)) ** 2
    return nominal, {name: math.sqrt(v) for name, v in variance.items()}


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
