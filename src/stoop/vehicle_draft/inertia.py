"""Moments of inertia from mass and size, by radii of gyration.

For airplanes radii are over the span: half the nondimensional radii of Raymer (*Aircraft Design: A Conceptual Approach*,
table of radii of gyration; single engine 0.25 and 0.38, 0.39), moved to what is published of small unmanned aircraft,
`PUBLISHED`. A body that is flat has zz = xx + yy; what stands above the plane makes zz smaller.
For multirotors they are over the root mean square distance of the rotors from the axis: `MULTIROTORS`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from stoop.base.autopilots import Point
from stoop.vehicle_draft.apriori import Apriori


@dataclass(frozen=True)
class Measured:
    """Published mass properties of an airplane: kg, m, kg m2."""

    template: str
    mass: float
    span: float
    xx: float
    yy: float
    zz: float

    def radii(self) -> tuple[float, float, float]:
        """Return radii of gyration over the span."""
        xx, yy, zz = (math.sqrt(i / self.mass) / self.span for i in (self.xx, self.yy, self.zz))
        return xx, yy, zz


#: Aerosonde and Zagi: Beard and McLain, Small Unmanned Aircraft, appendix E; X8: Gryte et al., ICUAS 2018; twin boom:
#: twin_boom.toml; standard_vtol: PX4's simulator
PUBLISHED: Final = {
    "Aerosonde": Measured("v-tail", 13.5, 2.8956, 0.8244, 1.135, 1.759),
    "twin boom": Measured("conventional", 189.4, 5.19, 100.0, 120.0, 200.0),
    "V-tail 8.5 kg (assumed)": Measured("v-tail", 8.5, 2.32, 1.38, 0.84, 2.17),
    "Zagi": Measured("flying-wing", 1.56, 1.4224, 0.1147, 0.0576, 0.1712),
    "Skywalker X8": Measured("flying-wing", 3.364, 2.1, 0.335, 0.140, 0.400),
    "standard_vtol": Measured("quadplane", 5.0, 2.1, 0.478, 0.342, 0.811),
}
#: template -> radii about roll and pitch over the span
RADII: Final[Mapping[str, tuple[float, float]]] = {
    "conventional": (0.14, 0.15),
    "v-tail": (0.13, 0.13),
    "flying-wing": (0.17, 0.12),
    "glider": (0.13, 0.10),
    "quadplane": (0.15, 0.14),
}
FLATNESS: Final = 0.95  #: zz over xx + yy
#: standard deviation of a moment over its value: radii of `PUBLISHED` scatter by half of that
SPREAD: Final = 0.4
#: radii over the root mean square distance of the rotors from an axis
MULTIROTORS: Final = (0.66, 0.66, 0.65)
#: of four that are published the moments are 0.8 to 2 times that
MULTIROTOR_SPREAD: Final = 0.5
PRODUCT_SPREAD: Final = 0.05  #: of xz, over the geometric mean of xx and zz


def of_airplane(template: str, mass: float, span: float) -> dict[str, Apriori]:
    """Return xx, yy, zz and xz of an airplane, kg m2."""
    roll, pitch = RADII[template]
    xx, yy = (mass * (radius * span) ** 2 for radius in (roll, pitch))
    zz = FLATNESS * (xx + yy)
    source = f"usual radius of gyration, {{:.2f}} spans ({template})"
    radii = {"xx": (xx, roll), "yy": (yy, pitch), "zz": (zz, math.sqrt(zz / mass) / span)}
    found = {axis: Apriori(i, SPREAD * i, source.format(radius)) for axis, (i, radius) in radii.items()}
    return {**found, "xz": Apriori(0.0, PRODUCT_SPREAD * math.sqrt(xx * zz), "usually small")}


def of_multirotor(mass: float, positions: Sequence[Point]) -> dict[str, Apriori]:
    """Return xx, yy and zz of a vehicle whose rotors stand at `positions` [m], kg m2."""
    count = max(len(positions), 1)
    squares = [sum(p[k] ** 2 for p in positions) / count for k in (0, 1)]
    distances = (squares[1], squares[0], sum(squares))
    source = "usual radius of gyration, {:.2f} of the rotors' rms distance from this axis"
    return {
        axis: Apriori(i := mass * radius**2 * square, MULTIROTOR_SPREAD * i, source.format(radius))
        for axis, radius, square in zip(("xx", "yy", "zz"), MULTIROTORS, distances, strict=True)
    }
