"""Geometry files: wing, tails, fuselage and control surfaces of an airplane; what is not measured is typical of a template.

Lengths in m, mass in kg, angles in rad; body axes forward-right-down from an origin of the file's own choice, as in vehicle
files. The span of a surface is measured along it, and its position is that of the leading edge of its root: where both
halves meet on the plane of symmetry, or the foot of a fin.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal, get_args

from pydantic import Field, ValidationError

from stoop.extend.errors import VehicleError
from stoop.extend.files import first_complaint, toml
from stoop.extend.vehicles import schema
from stoop_draft.vehicle_draft import proportions
from stoop_draft.vehicle_draft.parts import NOWHERE, Fin, Fuselage, Part, Point, Tail, Wing

Template = Literal["conventional", "v-tail", "flying-wing", "glider", "quadplane"]
WINGED: Final[tuple[str, ...]] = get_args(Template)


class Geometry(Part):
    """Dimensions of an airplane that a tape measure gives.

    `spread` holds, for each number that is typical rather than measured (`wing.taper`), the standard deviation of what it
    may be; it widens what is derived from the number.
    """

    format: Literal["stoop-geometry/1"] = "stoop-geometry/1"
    template: Template
    mass: Annotated[schema.Number, Field(gt=0.0, le=1e6)]  #: kg
    center_of_gravity: Point = NOWHERE  #: m
    wing: Wing
    tail: Tail | None = None
    fin: Fin | None = None
    fuselage: Fuselage = Fuselage()
    spread: dict[str, float] = Field(default_factory=dict, exclude=True)

    @classmethod
    def load(cls, path: Path | str) -> Geometry:
        """Read a geometry file; a `VehicleError` names the file, the key and what to write instead."""
        return cls.parse(toml.read_source(path, "geometry", VehicleError), str(path))

    @classmethod
    def parse(cls, text: str, where: str) -> Geometry:
        """Read a geometry from TOML text; ``where`` names it in messages."""
        return cls.of(toml.parse_source(text, where, VehicleError), where)

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
