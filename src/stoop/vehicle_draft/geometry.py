"""Geometry files: wing, tails, fuselage and control surfaces of an airplane; what is not measured is typical of a template.

Lengths in m, mass in kg, angles in rad; body axes forward-right-down from an origin of the file's own choice, as in vehicle
files. The span of a surface is measured along it, and its position is that of the leading edge of its root: where both
halves meet on the plane of symmetry, or the foot of a fin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from stoop.base.schema_errors import first_complaint
from stoop.base.toml import parse_source, read_source
from stoop.errors import VehicleError
from stoop.vehicle.schema import Number

UNKNOWN: Final = math.nan  #: of a number that a file leaves out
MAX_ANGLE: Final = 1.2  #: of sweep, dihedral and incidence; above, degrees were meant
Length = Annotated[Number, Field(ge=1e-4, le=200.0)]
Area = Annotated[Number, Field(ge=1e-8, le=2000.0)]


def _radians(value: float) -> float:
    if abs(value) > MAX_ANGLE:
        raise ValueError(
            f"{value:g} rad is {math.degrees(value):.0f} deg; write radians ({math.radians(value):.4g} for {value:g} deg)"
        )
    return value


Angle = Annotated[Number, AfterValidator(_radians)]
Share = Annotated[Number, Field(gt=0.0, lt=1.0)]
Station = Annotated[Number, Field(ge=0.0, le=1.0)]
Point = tuple[Number, Number, Number]
Template = Literal["conventional", "v-tail", "flying-wing", "glider", "quadplane"]
WINGED: Final[tuple[str, ...]] = get_args(Template)
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
    taper: Annotated[Number, Field(gt=0.0, le=2.0)] = UNKNOWN  #: tip chord over root chord
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
    camber: Annotated[Number, Field(ge=-0.1, le=0.15)] = UNKNOWN  #: share of the chord
    thickness: Annotated[Number, Field(ge=0.01, le=0.4)] = UNKNOWN  #: share of the chord
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


class Geometry(Part):
    """What a tape measure tells of an airplane.

    `spread` holds, for each number that is typical rather than measured (`wing.taper`), the standard deviation of what it
    may be; it widens what is derived from the number.
    """

    format: Literal["stoop-geometry/1"] = "stoop-geometry/1"
    template: Template
    mass: Annotated[Number, Field(gt=0.0, le=1e6)]  #: kg
    center_of_gravity: Point = NOWHERE  #: m
    wing: Wing
    tail: Tail | None = None
    fin: Fin | None = None
    fuselage: Fuselage = Fuselage()
    spread: dict[str, float] = Field(default_factory=dict, exclude=True)

    @classmethod
    def load(cls, path: Path | str) -> Geometry:
        """Read a geometry file; a `VehicleError` names the file, the key and what to write instead."""
        return cls.parse(read_source(path, "geometry", VehicleError), str(path))

    @classmethod
    def parse(cls, text: str, where: str) -> Geometry:
        """Read a geometry from TOML text; ``where`` names it in messages."""
        return cls.of(parse_source(text, where, VehicleError), where)

    @classmethod
    def typical(
        cls, template: str, mass: float, span: float, chord: float | None = None, area: float | None = None
    ) -> Geometry:
        """Return the geometry of a small unmanned airplane of which only this is known; SI units."""
        sizes = {"span": span, "chord": chord, "area": area}
        wing = {key: float(size) for key, size in sizes.items() if size is not None}
        return cls.of({"template": template, "mass": float(mass), "wing": wing}, "geometry")

    @classmethod
    def of(cls, raw: Mapping[str, Any], where: str) -> Geometry:
        """Return the geometry of the tables of a file, completed and checked.

        Raises
        ------
        VehicleError
            Something is missing without which nothing is typical, impossible, or contradicts the rest.
        """
        from stoop.vehicle_draft import proportions

        if raw.get("template") in ("quad", "hexa", "octo"):
            raise VehicleError(
                f"{where}: template: {raw['template']} has no wing; choose one of {', '.join(WINGED)}"
            )
        if "spread" in raw:
            raise VehicleError(f"{where}: spread: unknown key; remove it")
        try:
            given = cls.model_validate(raw)
        except ValidationError as error:
            raise VehicleError(f"{where}: {first_complaint(error, raw, cls)}") from None
        try:
            return proportions.completed(given)
        except VehicleError as error:
            raise VehicleError(f"{where}: {error}") from None
