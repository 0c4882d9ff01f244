"""What a person gives for a draft, what the logs give, and what is missing, with its usual size."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from stoop import Flight
from stoop.extend.errors import VehicleError
from stoop.extend.vehicles import USUAL
from stoop_draft.vehicle_draft import aerosandbox, handbook
from stoop_draft.vehicle_draft.apriori import Apriori
from stoop_draft.vehicle_draft.autopilot import Setup, read_setup
from stoop_draft.vehicle_draft.controls import recorded
from stoop_draft.vehicle_draft.geometry import WINGED, Geometry
from stoop_draft.vehicle_draft.power import ENGINES, Lift, find_drive, find_rotors, running_rotors

ROTORCRAFT: Final = {"quad": 4, "hexa": 6, "octo": 8}  #: template -> rotors
TEMPLATES: Final = (*WINGED, *ROTORCRAFT)
#: method of a priori derivatives -> its function
AERODYNAMICS: Final[Mapping[str, Callable[..., dict[str, Apriori]]]] = {
    "handbook": handbook.derivatives,
    "aerosandbox": aerosandbox.derivatives,
}
#: kg/m2, over the square of the largest distance between motors: 0.034 kg of 0.09 m to 7 kg of 1.05 m
MASS_BY_FRAME: Final = (3.0, 12.0)


@dataclass(frozen=True)
class Request:
    """What a person gives; SI units."""

    template: str | None = None  #: of `TEMPLATES`
    mass: float | None = None
    span: float | None = None  #: of the wing; of a multirotor the largest distance between motors
    chord: float | None = None
    area: float | None = None
    engine: str | None = None  #: of `ENGINES`
    geometry: Geometry | None = None
    name: str | None = None
    aerodynamics: str = "handbook"  #: of `AERODYNAMICS`


@dataclass(frozen=True)
class Question:
    """Something that is missing."""

    key: str  #: of `Request`
    what: str
    usual: str = ""  #: size, in words
    default: Any = None  #: that is taken where nobody answers; None where there is none

    @property
    def sentence(self) -> str:
        """What is missing, in words."""
        return f"--{self.key} ({self.what}{f'; usual: {self.usual}' if self.usual else ''})"


@dataclass(frozen=True, eq=False)
class Evidence:
    """What logs show."""

    flights: tuple[Flight, ...] = ()
    setup: Setup = field(default_factory=Setup)

    @property
    def flight(self) -> Flight | None:
        """The log whose parameters and channels count."""
        return next((f for f in self.flights if f.parameters), self.flights[0] if self.flights else None)

    def template(self) -> str | None:
        """Return the template that surfaces and motors ask for; None where they say nothing."""
        if self.flight is None:
            return None
        tail = self.setup.tail()
        count = len(self.setup.rotors) or len(running_rotors(self.flight)[0])
        if count and (self.flight.carried_by_rotors() or self.setup.rotors):
            if tail or any(recorded(self.flight, name) for name in ("elevator", "aileron")):
                return "quadplane"
            return next((name for name, size in ROTORCRAFT.items() if size == count), None)
        surfaces = ("elevator", "aileron", "control_pitch", "control_roll", "servo_1")
        return tail or ("conventional" if any(recorded(self.flight, n) for n in surfaces) else None)

    def lift(self, template: str, span: float | None) -> Lift | None:
        """Return the rotors that lift."""
        return find_rotors(self.flight, self.setup, template, span)

    def engine(self, template: str) -> str:
        """Return the engine that the log shows."""
        driven = self.flight is not None and find_drive(self.flight, self.setup) is not None
        return "none" if template == "glider" and not driven else "electric"


def evidence(flights: Sequence[Flight]) -> Evidence:
    """Return what flights show of their vehicle."""
    found = Evidence(tuple(flights))
    if found.flight is None:
        return found
    moving = [str(name) for name in found.flight.channels if recorded(found.flight, str(name))]
    return replace(found, setup=read_setup(found.flight.parameters, moving))


def with_geometry(request: Request) -> Request:
    """Return a request with what its geometry holds.

    Raises
    ------
    VehicleError
        Both give a number, and differ.
    """
    geometry = request.geometry
    if geometry is None:
        return request
    held: dict[str, Any] = {"template": geometry.template, "mass": geometry.mass, "span": geometry.wing.span}
    held |= {"chord": geometry.wing.chord, "area": geometry.wing.area}
    for key, value in held.items():
        given = getattr(request, key)
        same = given == value if isinstance(value, str) else math.isclose(given or 0.0, value, rel_tol=0.02)
        if given is not None and not same:
            text = value if isinstance(value, str) else f"{value:.4g}"
            raise VehicleError(f"--{key}: is {given}, and {text} in the geometry; leave one of them out")
    return replace(request, **held)


def questions(request: Request, known: Evidence) -> list[Question]:
    """Return what a draft still needs, in the order in which it is asked."""
    if request.template is None:
        usual = known.template()
        said = f"{', '.join(TEMPLATES)}"
        return [Question("template", f"one of {said}", "", usual)] if usual is None else []
    out, wings = [], request.template in WINGED
    span, mass = request.span, request.mass
    if mass is None:
        low, high = USUAL.mass_by_span if wings else MASS_BY_FRAME
        size = f"{low * span**2:.2g} to {high * span**2:.2g} kg for this span" if span else ""
        out.append(Question("mass", "as flown, kg", size))
    lift = known.lift(request.template, None) if not wings else None
    if span is None and (wings or lift is None or lift.guessed or known.setup.autopilot == "ArduPilot"):
        low, high = USUAL.mass_by_span if wings else MASS_BY_FRAME
        size = f"{math.sqrt(mass / high):.2g} to {math.sqrt(mass / low):.2g} m for this mass" if mass else ""
        what = "of the wing, m" if wings else "largest distance between motors, m"
        out.append(Question("span", what, size))
    if wings and request.chord is None and request.area is None:
        slim, stout = USUAL.aspect_ratios[::-1]
        size = f"{span / slim:.2g} to {span / stout:.2g} m for this span" if span else ""
        out.append(Question("chord", "mean chord of the wing, m, or --area in m2", size))
    return out


def completed(request: Request, known: Evidence) -> Request:
    """Return a request with what the logs tell; VehicleError says in one line what is missing, with usual sizes."""
    request = with_geometry(request)
    for key, most in (("mass", 1e6), ("span", 200.0), ("chord", 100.0), ("area", 2000.0)):
        value = getattr(request, key)
        if value is not None and not 0.0 < value <= most:
            raise VehicleError(f"--{key}: {value:g} is not between 0 and {most:g}; write it in kg, m or m2")
    known_words = {"template": TEMPLATES, "engine": ENGINES, "aerodynamics": tuple(AERODYNAMICS)}
    for key, choices in known_words.items():
        value = getattr(request, key)
        if value is not None and value not in choices:
            raise VehicleError(f"--{key}: there is no {value}; choose one of {', '.join(choices)}")
    if request.aerodynamics != "handbook" and request.geometry is None:
        raise VehicleError(
            f"--aerodynamics: {request.aerodynamics} needs dimensions of the surfaces; write them to a file for --geometry"
        )
    if request.template is None:
        request = replace(request, template=known.template())
    lacking = [one for one in questions(request, known) if one.default is None]
    if lacking:
        raise VehicleError(f"missing: {'; '.join(one.sentence for one in lacking)}")
    return replace(request, engine=request.engine or known.engine(str(request.template)))
