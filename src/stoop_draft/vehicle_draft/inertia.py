"""Moments of inertia from mass and size, by radii of gyration.

For airplanes the radius about roll is over the span, that about pitch over the geometric mean of span and chord, as stubby
wings have long bodies: means of `PUBLISHED`. A body that is flat has zz = xx + yy; what stands above the plane makes zz smaller.
For multirotors they are over the root mean square distance of the rotors from the axis: `MULTIROTORS`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from stoop.extend.units import STANDARD_GRAVITY, UNITS
from stoop_draft.vehicle_draft.apriori import Apriori


@dataclass(frozen=True)
class Measured:
    """Published mass properties of an airplane: kg, m, kg m2."""

    template: str
    mass: float
    span: float
    chord: float
    xx: float
    yy: float
    zz: float

    @classmethod
    def in_feet(cls, weight: float, span: float, chord: float, *moments: float) -> Measured:
        """Return those of a conventional airplane in lbf, ft and slug ft2."""
        mass = weight * UNITS["lbf"].factor / STANDARD_GRAVITY
        xx, yy, zz = (i * UNITS["slug"].factor * UNITS["ft"].factor ** 2 for i in moments)
        return cls("conventional", mass, span * UNITS["ft"].factor, chord * UNITS["ft"].factor, xx, yy, zz)


#: Aerosonde and Zagi: Beard and McLain, Small Unmanned Aircraft, appendix E; X8: Gryte et al., ICUAS 2018; twin boom:
#: twin_boom.toml; standard_vtol: PX4's simulator, its chord assumed; F-16: Stevens and Lewis, Aircraft Control and Simulation,
#: appendix A; Cessna 182 to S-211: Roskam, Airplane Flight Dynamics and Automatic Flight Controls I, appendix B; others: Nelson,
#: Flight Stability and Automatic Control, appendix B
PUBLISHED: Final = {
    "Aerosonde": Measured("v-tail", 13.5, 2.8956, 0.18994, 0.8244, 1.135, 1.759),
    "twin boom": Measured("conventional", 189.4, 5.19, 0.55, 100.0, 120.0, 200.0),
    "V-tail 8.5 kg (assumed)": Measured("v-tail", 8.5, 2.32, 0.285, 1.38, 0.84, 2.17),
    "Zagi": Measured("flying-wing", 1.56, 1.4224, 0.3302, 0.1147, 0.0576, 0.1712),
    "Skywalker X8": Measured("flying-wing", 3.364, 2.1, 0.3571, 0.335, 0.140, 0.400),
    "standard_vtol": Measured("quadplane", 5.0, 2.1, 0.29, 0.478, 0.342, 0.811),
    "Navion": Measured.in_feet(2750.0, 33.4, 5.7, 1048.0, 3000.0, 3530.0),
    "F-104A": Measured.in_feet(16300.0, 21.94, 9.55, 3549.0, 58611.0, 59669.0),
    "Jetstar": Measured.in_feet(38204.0, 53.75, 10.93, 118773.0, 135869.0, 243504.0),
    "Convair 880": Measured.in_feet(126000.0, 120.0, 18.94, 1.51e6, 2.51e6, 4.1e6),
    "Boeing 747": Measured.in_feet(636600.0, 195.68, 27.31, 18.2e6, 33.1e6, 49.7e6),
    "A-4D": Measured.in_feet(17578.0, 27.5, 10.8, 8090.0, 25900.0, 29200.0),
    "F-16": Measured.in_feet(20500.0, 30.0, 11.32, 9496.0, 55814.0, 63100.0),
    "Cessna 182": Measured.in_feet(2650.0, 36.0, 4.9, 948.0, 1346.0, 1967.0),
    "Cessna 310": Measured.in_feet(4600.0, 36.9, 4.79, 8884.0, 1939.0, 11001.0),
    "Beech 99": Measured.in_feet(11000.0, 46.0, 6.5, 15189.0, 20250.0, 34141.0),
    "T-37": Measured.in_feet(6360.0, 33.8, 5.47, 7985.0, 3326.0, 11183.0),
    "Learjet 24": Measured.in_feet(13000.0, 34.0, 7.0, 28000.0, 18800.0, 47000.0),
    "S-211": Measured.in_feet(4000.0, 26.3, 5.4, 800.0, 4800.0, 5200.0),
}
#: template -> radii about roll over the span, about pitch over the root of span times chord
RADII: Final[Mapping[str, tuple[float, float]]] = {
    "conventional": (0.146, 0.44),
    "v-tail": (0.13, 0.39),
    "flying-wing": (0.17, 0.26),
    "glider": (0.13, 0.40),
    "quadplane": (0.15, 0.36),
}
#: zz over xx + yy; of `PUBLISHED` 0.84 to 1.02, in the mean 0.95: here one with room for `PRODUCT_SPREAD` (Wensing)
FLATNESS: Final = 0.9
#: standard deviation of the logarithm of a moment, as the radii of `PUBLISHED` scatter
SPREAD: Final = 0.5
#: radii over the root mean square distance of the rotors from an axis
MULTIROTORS: Final = (0.66, 0.66, 0.65)
#: of four that are published the moments are 0.8 to 2 times that
MULTIROTOR_SPREAD: Final = 0.5
PRODUCT_SPREAD: Final = 0.05  #: of xz, over the geometric mean of xx and zz


def of_airplane(template: str, mass: float, span: float, chord: float) -> dict[str, Apriori]:
    """Return xx, yy, zz and xz of an airplane, kg m2."""
    roll, pitch = RADII[template]
    xx, yy = mass * (roll * span) ** 2, mass * pitch**2 * span * chord
    zz = FLATNESS * (xx + yy)
    source = f"usual radius of gyration, {{:.2f}} spans ({template})"
    radii = {axis: (i, math.sqrt(i / mass) / span) for axis, i in (("xx", xx), ("yy", yy), ("zz", zz))}
    found = {axis: Apriori(i, SPREAD * i, source.format(radius)) for axis, (i, radius) in radii.items()}
    return {**found, "xz": Apriori(0.0, PRODUCT_SPREAD * math.sqrt(xx * zz), "usually small")}


def of_multirotor(mass: float, positions: Sequence[tuple[float, float, float]]) -> dict[str, Apriori]:
    """Return xx, yy and zz of a vehicle whose rotors stand at `positions` [m], kg m2."""
    count = max(len(positions), 1)
    squares = [sum(p[k] ** 2 for p in positions) / count for k in (0, 1)]
    distances = (squares[1], squares[0], sum(squares))
    source = "usual radius of gyration, {:.2f} of the rotors' rms distance from this axis"
    return {
        axis: Apriori(i := mass * radius**2 * square, MULTIROTOR_SPREAD * i, source.format(radius))
        for axis, radius, square in zip(("xx", "yy", "zz"), MULTIROTORS, distances, strict=True)
    }
