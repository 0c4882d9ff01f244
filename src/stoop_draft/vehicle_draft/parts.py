"""Parts of an airplane's geometry: lifting surfaces, control surfaces and fuselage, as a geometry file describes them."""

from __future__ import annotations

import math
from typing import Annotated, Final

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from stoop.extend.vehicles import schema

UNKNOWN: Final = math.nan  #: of a number that a file leaves out
MAX_ANGLE: Final = 1.2  #: of sweep, dihedral and incidence; above, degrees were meant
Length = Annotated[schema.Number, Field(ge=1e-4, le=200.0)]
Area = Annotated[schema.Number, Field(ge=1e-8, le=2000.0)]


def _radians(value: float) -> float:
    if abs(value) > MAX_ANGLE:
        raise ValueError(
            f"{value:g} rad is {math.degrees(value):.0f} deg; write radians ({math.radians(value):.4g} for {value:g} deg)"
        )
    return value


Angle = Annotated[schema.Number, AfterValidator(_radians)]
Share = Annotated[schema.Number, Field(gt=0.0, lt=1.0)]
Station = Annotated[schema.Number, Field(ge=0.0, le=1.0)]
Point = tuple[schema.Number, schema.Number, schema.Number]
NOWHERE: Final = (UNKNOWN, UNKNOWN, UNKNOWN)


class Part(BaseModel):
    """A table of the file: no unknown keys, immutable; a number that is left out is `UNKNOWN` until `complete`."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Flap(Part):
    """A control surface: share of the chord, and stations between root (0) and tip (1) of each half."""

    chord: Share = UNKNOWN
    span: tuple[Station, Station] = (UNKNOWN, UNKNOWN)


class Surface(Part):
    """A lifting surface; of area, span and chord (mean or mean aerodynamic) two give the third."""

    area: Area = UNKNOWN  #: both halves, m2
    span: Length = UNKNOWN  #: along the surface: both halves, or the height of a fin, m
    chord: Length = UNKNOWN  #: m
    taper: Annotated[schema.Number, Field(gt=0.0, le=2.0)] = UNKNOWN  #: tip chord over root chord
    sweep: Angle = UNKNOWN  #: of the quarter chord, tip aft positive, rad
    position: Point = NOWHERE  #: leading edge of the root, m

    @property
    def aspect_ratio(self) -> float:
        """Span squared over area."""
        return self.span**2 / self.area

    @property
    def root_chord(self) -> float:
        """Chord of the root of the trapezoid, m."""
        return 2.0 * self.area / self.span / (1.0 + self.taper)


class Wing(Surface):
    """The wing; airfoil of the four-digit family with camber at 40 % of the chord."""

    dihedral: Angle = UNKNOWN  #: rad
    incidence: Angle = UNKNOWN  #: of the root chord against the x axis, rad
    camber: Annotated[schema.Number, Field(ge=-0.1, le=0.15)] = UNKNOWN  #: share of the chord
    thickness: Annotated[schema.Number, Field(ge=0.01, le=0.4)] = UNKNOWN  #: share of the chord
    aileron: Flap | None = None
    elevon: Flap | None = None


class Tail(Surface):
    """A horizontal tail, or with dihedral a V-tail (below zero: an inverted one)."""

    dihedral: Angle = UNKNOWN  #: rad
    incidence: Angle = UNKNOWN  #: rad
    elevator: Flap | None = None
    ruddervator: Flap | None = None


class Fin(Surface):
    """A vertical tail; off the plane of symmetry (y not zero) it is one of two, and area and span are those of one."""

    rudder: Flap | None = None


class Fuselage(Part):
    """The body, from its nose backward."""

    length: Length = UNKNOWN  #: m
    width: Length = UNKNOWN  #: m
    height: Length = UNKNOWN  #: m
    position: Point = NOWHERE  #: of the nose, m
