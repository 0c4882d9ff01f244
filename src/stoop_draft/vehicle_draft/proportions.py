"""Usual proportions of small airplanes, which complete a geometry, and the contradictions that a geometry may hold.

Tail volumes are those of Raymer, Aircraft Design: A Conceptual Approach (6th ed., table 6.4: homebuilt 0.50 and 0.04, single
engine 0.70 and 0.04, sailplane 0.50 and 0.02) and of the airplanes of ``stoop verify handbook``; so are arms, bodies and control
surfaces. Every entry has a standard deviation, since it is a habit and no rule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from stoop.extend.errors import VehicleError
from stoop_draft.vehicle_draft.parts import Fin, Flap, Fuselage, Part, Surface, Tail, Wing

if TYPE_CHECKING:
    from stoop_draft.vehicle_draft.geometry import Geometry

Usual = tuple[float, float]  #: value, standard deviation


@dataclass(frozen=True)
class Proportions:
    """Usual numbers of a template with their standard deviations; angles in rad.

    Lengths are in square roots of the wing's area, ``tail_volume`` is S_h l_h/(S c), ``fin_volume`` S_v l_v/(S b) of all fins,
    ``balance`` the center of gravity aft of the leading edge of the mean aerodynamic chord, in chords.
    """

    taper: Usual = (0.75, 0.2)
    sweep: Usual = (0.02, 0.05)
    dihedral: Usual = (0.06, 0.05)
    incidence: Usual = (0.03, 0.03)
    camber: Usual = (0.03, 0.015)
    thickness: Usual = (0.12, 0.02)
    balance: Usual = (0.29, 0.05)
    arm: Usual = (1.12, 0.15)
    tail_volume: Usual = (0.7, 0.25)
    fin_volume: Usual = (0.05, 0.02)
    tail_dihedral: Usual = (0.0, 0.02)
    tail_height: Usual = (0.0, 0.5)
    body_length: Usual = (1.85, 0.3)
    body_width: Usual = (0.27, 0.09)
    body_ahead: Usual = (0.33, 0.07)
    aileron: tuple[Usual, Usual, Usual] = ((0.24, 0.05), (0.55, 0.1), (0.95, 0.04))
    elevator: tuple[Usual, Usual, Usual] = ((0.4, 0.08), (0.05, 0.05), (0.98, 0.02))
    rudder: tuple[Usual, Usual, Usual] = ((0.4, 0.08), (0.05, 0.05), (0.95, 0.05))
    has_tail: bool = True
    has_fin: bool = True


PROPORTIONS: Final[dict[str, Proportions]] = {
    "conventional": Proportions(),
    "v-tail": Proportions(tail_dihedral=(0.65, 0.1), has_fin=False),
    "glider": Proportions(
        taper=(0.55, 0.2),
        tail_volume=(0.5, 0.1),
        fin_volume=(0.025, 0.008),
        body_width=(0.17, 0.05),
        tail_height=(0.5, 0.5),
    ),
    "quadplane": Proportions(fin_volume=(0.045, 0.015), body_width=(0.3, 0.1)),
    "flying-wing": Proportions(
        taper=(0.6, 0.2),
        sweep=(0.4, 0.12),
        dihedral=(0.01, 0.03),
        camber=(0.015, 0.01),
        balance=(0.17, 0.05),
        fin_volume=(0.012, 0.007),
        body_length=(0.9, 0.25),
        body_width=(0.25, 0.1),
        body_ahead=(0.45, 0.1),
        aileron=((0.17, 0.05), (0.45, 0.12), (0.92, 0.05)),
        has_tail=False,
    ),
}


@dataclass
class _Draft:
    """Numbers as they are completed: those of the file stand, others are typical and leave a spread."""

    given: Geometry
    usual: Proportions
    center: tuple[float, float, float] = (math.nan,) * 3  #: of gravity, m
    tables: dict[str, Part] = field(default_factory=dict)
    spread: dict[str, float] = field(default_factory=dict)

    @property
    def wing(self) -> Wing:
        """The wing, complete."""
        return self.tables["wing"]  # type: ignore[return-value]

    @property
    def body(self) -> Fuselage:
        """The fuselage, complete."""
        return self.tables["fuselage"]  # type: ignore[return-value]

    @property
    def quarter(self) -> Usual:
        """Where the quarter chord of a tail usually lies, x, m."""
        (arm, std), size = self.usual.arm, math.sqrt(self.wing.area)
        return self.center[0] - arm * size, std * size

    def fill(self, name: str, **usual: Usual) -> Any:
        """Fill in what a table lacks, each with (value, standard deviation); return the table."""
        table = self.tables[name]
        update = {}
        for key, (value, std) in usual.items():
            known = getattr(table, key)
            if known is None or not math.isnan(known):
                continue
            update[key] = value
            self.spread[f"{name}.{key}"] = std
        self.tables[name] = table.model_copy(update=update)
        return self.tables[name]

    def place(self, name: str, *usual: Usual) -> Any:
        """Fill in a position, all of it or nothing; return the table."""
        table = self.tables[name]
        if math.isnan(table.position[0]):  # type: ignore[attr-defined]
            self.tables[name] = table.model_copy(update={"position": tuple(v for v, _ in usual)})
            self.spread.update(
                {f"{name}.position.{axis}": s for axis, (_, s) in zip("xyz", usual, strict=True) if s > 0.0}
            )
        return self.tables[name]

    def flap(self, name: str, key: str, usual: tuple[Usual, Usual, Usual]) -> None:
        """Fill in a control surface of a table."""
        flap = getattr(self.tables[name], key)
        chord, inner, outer = usual
        update: dict[str, Any] = {}
        if math.isnan(flap.chord):
            update["chord"], self.spread[f"{name}.{key}.chord"] = chord
        if math.isnan(flap.span[0]):
            update["span"] = (inner[0], outer[0])
            self.spread.update({f"{name}.{key}.span.0": inner[1], f"{name}.{key}.span.1": outer[1]})
        self.tables[name] = self.tables[name].model_copy(update={key: flap.model_copy(update=update)})


def completed(given: Geometry) -> Geometry:
    """Return a geometry whose numbers are all known, checked for contradictions.

    Raises
    ------
    VehicleError
        The wing is not known by two of area, span and chord, or the geometry contradicts itself.
    """
    usual = PROPORTIONS[given.template]
    _check_kinds(given, usual)
    draft = _Draft(given, usual)
    _wing(draft)
    draft.center, wing = given.center_of_gravity, draft.wing
    if math.isnan(draft.center[0]):
        x = quarter_chord(wing) + (0.25 - usual.balance[0]) * mean_chord(wing)
        draft.center = (x, 0.0, wing.position[2])
        draft.spread["center_of_gravity.x"] = usual.balance[1] * wing.chord
    _body(draft)
    if given.tail is not None or usual.has_tail:
        _tail(draft)
    if given.fin is not None or usual.has_fin:
        _fin(draft)
    _flaps(draft)
    more = {"center_of_gravity": draft.center, "spread": draft.spread}
    geometry = given.model_copy(update={**draft.tables, **more})
    check(geometry)
    return geometry


def _wing(draft: _Draft) -> None:
    given, usual = draft.given, draft.usual
    known = {key for key in ("area", "span", "chord") if not math.isnan(getattr(given.wing, key))}
    if len(known) < 2:
        low, high = 9.81 * given.mass / 250.0, 9.81 * given.mass / 40.0
        raise VehicleError(
            f"wing: needs two of area, span and chord, has {' and '.join(sorted(known)) or 'none'}; "
            f"with {given.mass:g} kg the area is usually {low:.2g} to {high:.2g} m2"
        )
    draft.tables["wing"] = given.wing.model_copy(update=_third(given.wing))
    keys = ("taper", "sweep", "dihedral", "incidence", "camber", "thickness")
    draft.fill("wing", **{key: getattr(usual, key) for key in keys})
    _check_area(draft.place("wing", (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)), "wing")


def _body(draft: _Draft) -> None:
    usual, wing, size = draft.usual, draft.wing, math.sqrt(draft.wing.area)
    draft.tables["fuselage"] = draft.given.fuselage
    length, width = ((v * size, s * size) for v, s in (usual.body_length, usual.body_width))
    body: Fuselage = draft.fill("fuselage", length=length, width=width, height=width)
    ahead, std = usual.body_ahead
    nose = wing.position[0] - 0.25 * wing.root_chord + ahead * body.length
    height = (wing.position[2], 0.35 * body.height)
    draft.place("fuselage", (nose, std * body.length), (0.0, 0.0), height)


def _tail(draft: _Draft) -> None:
    usual, wing, body, quarter = draft.usual, draft.wing, draft.body, draft.quarter
    own = draft.given.tail or Tail()
    slope = usual.tail_dihedral if math.isnan(own.dihedral) else (own.dihedral, 0.0)
    arm = draft.center[0] - (quarter[0] if math.isnan(own.position[0]) else own.position[0])
    volume = usual.tail_volume
    factor = wing.area * wing.chord / max(arm, 0.1 * wing.chord) / math.cos(slope[0]) ** 2
    draft.tables["tail"] = _with_area(
        draft, "tail", own, (volume[0] * factor, volume[1] * factor), (4.2, 0.8)
    )
    tail: Tail = draft.fill(
        "tail", taper=(0.75, 0.2), sweep=(0.08, 0.08), dihedral=slope, incidence=(0.0, 0.02)
    )
    x = quarter[0] + 0.25 * tail.root_chord
    z = body.position[2] - usual.tail_height[0] * body.height, usual.tail_height[1] * body.height
    tail = draft.place("tail", (x, quarter[1]), (0.0, 0.0), z)
    _check_area(tail, "tail")


def _fin(draft: _Draft) -> None:
    usual, wing, body, quarter = draft.usual, draft.wing, draft.body, draft.quarter
    own = draft.given.fin or Fin()
    tips = not usual.has_tail
    if tips:  # fins at the tips of a flying wing
        half = 0.5 * wing.span * math.cos(wing.dihedral)
        x = wing.position[0] - 0.25 * wing.root_chord - half * math.tan(wing.sweep)
        spot: tuple[Usual, ...] = (
            (x, 0.1 * wing.chord),
            (half, 0.05 * half),
            (wing.position[2], 0.1 * wing.chord),
        )
    else:
        spot = (quarter, (0.0, 0.0), (body.position[2] - 0.2 * body.height, 0.25 * body.height))
    place = spot[0][0] if math.isnan(own.position[0]) else own.position[0]
    count = 2 if (tips if math.isnan(own.position[0]) else own.position[1] != 0.0) else 1
    volume, std = usual.fin_volume
    factor = wing.area * wing.span / max(draft.center[0] - place, 0.3 * wing.chord) / count
    draft.tables["fin"] = _with_area(draft, "fin", own, (volume * factor, std * factor), (1.5, 0.4))
    fin: Fin = draft.fill("fin", taper=(0.6, 0.2), sweep=(0.35, 0.2))
    shift = 0.0 if tips else 0.25 * fin.root_chord
    fin = draft.place("fin", (spot[0][0] + shift, spot[0][1]), *spot[1:])
    _check_area(fin, "fin")


def _flaps(draft: _Draft) -> None:
    """Fill in the control surfaces of the file; a surface without any has that of the template."""
    usual, v_tail = draft.usual, draft.given.template == "v-tail"
    expected = {"wing": "aileron" if usual.has_tail else "elevon"}
    expected |= {"tail": "ruddervator" if v_tail else "elevator"} if usual.has_tail else {}
    expected |= {"fin": "rudder"} if usual.has_fin and usual.has_tail else {}
    shapes = {"aileron": usual.aileron, "elevon": usual.aileron, "rudder": usual.rudder}
    for name in ("wing", "tail", "fin"):
        if name not in draft.tables:
            continue
        kinds = [key for key, flap in draft.tables[name] if isinstance(flap, Flap)]
        if not kinds and name in expected:
            kinds = [expected[name]]
            draft.tables[name] = draft.tables[name].model_copy(update={kinds[0]: Flap()})
        for kind in kinds:
            draft.flap(name, kind, shapes.get(kind, usual.elevator))


def _third(surface: Surface) -> dict[str, float]:
    if math.isnan(surface.area):
        return {"area": surface.span * surface.chord}
    if math.isnan(surface.span):
        return {"span": surface.area / surface.chord}
    return {"chord": surface.area / surface.span} if math.isnan(surface.chord) else {}


def _with_area(draft: _Draft, name: str, own: Surface, area: Usual, aspect: Usual) -> Surface:
    """Return a tail with area, span and chord; two that are missing are typical."""
    sizes = {key: getattr(own, key) for key in ("area", "span", "chord") if not math.isnan(getattr(own, key))}
    if len(sizes) >= 2:
        return own.model_copy(update=_third(own))
    value, std = area
    if "span" in sizes:
        value = sizes["span"] ** 2 / aspect[0]
    elif "chord" in sizes:
        value = sizes["chord"] ** 2 * aspect[0]
    if "area" not in sizes:
        own = own.model_copy(update={"area": value})
        draft.spread[f"{name}.area"] = std / area[0] * value if not sizes else aspect[1] / aspect[0] * value
    if "span" not in sizes:
        own = own.model_copy(update={"span": math.sqrt(aspect[0] * own.area)})
        draft.spread[f"{name}.span"] = 0.5 * aspect[1] / aspect[0] * own.span
    return own.model_copy(update={"chord": own.area / own.span})


def mean_chord(surface: Surface) -> float:
    """Return the mean aerodynamic chord of a trapezoid, m."""
    taper = surface.taper
    return 2.0 / 3.0 * surface.root_chord * (1.0 + taper + taper**2) / (1.0 + taper)


def quarter_chord(surface: Surface) -> float:
    """Return x of the quarter point of the mean aerodynamic chord, m."""
    station = surface.span / 6.0 * (1.0 + 2.0 * surface.taper) / (1.0 + surface.taper)
    return surface.position[0] - 0.25 * surface.root_chord - station * math.tan(surface.sweep)


def check(geometry: Geometry) -> None:
    """Raise a `VehicleError` for the first contradiction, with its numbers."""
    center, wing = geometry.center_of_gravity[0], geometry.wing
    for name, table in (("wing", wing), ("tail", geometry.tail)):
        if table is not None and table.position[1] != 0.0:
            raise VehicleError(
                f"{name}.position: y is {table.position[1]:g}, but the root lies on the plane of symmetry; write 0.0"
            )
    for name, flap in flaps(geometry).items():
        if not flap.span[0] < flap.span[1]:
            raise VehicleError(
                f"{name}.span: [{flap.span[0]:g}, {flap.span[1]:g}] runs inward; write the inner station first"
            )
    back = wing.position[0] - 2.0 * wing.root_chord - 0.5 * wing.span * abs(math.tan(wing.sweep))
    if not back <= center <= wing.position[0] + 1.5 * wing.root_chord:
        raise VehicleError(
            f"center_of_gravity: x = {center:g} m is far from the wing, whose root begins at {wing.position[0]:g}; "
            "x is positive forward from one origin for all positions"
        )
    aft = quarter_chord(wing)
    for name, surface in (("tail", geometry.tail), ("fin", geometry.fin)):
        if surface is None:
            continue
        own = quarter_chord(surface)
        fins_of_wing = name == "fin" and geometry.tail is None
        if own >= (center if fins_of_wing else min(center, aft)):
            raise VehicleError(
                f"{name}.position: the quarter chord is at x = {own:.3g} m, not behind the center of gravity "
                f"({center:.3g}) and the wing ({aft:.3g}); x is positive forward, so what is aft is negative"
            )
        if surface.area > wing.area:
            raise VehicleError(
                f"{name}.area: {surface.area:.3g} m2 is more than the {wing.area:g} m2 of the wing; check both, and its position"
            )


def _check_area(surface: Surface, name: str) -> None:
    """Refuse an area that is neither span times mean chord nor span times mean aerodynamic chord, within 10 %."""
    ratio = surface.area / (surface.span * surface.chord)
    mean = surface.area / surface.span
    if not 0.9 * mean / mean_chord(surface) <= ratio <= 1.1:
        raise VehicleError(
            f"{name}.area: {surface.area:g} m2 is not span times chord, {surface.span:g} x {surface.chord:g} = "
            f"{surface.span * surface.chord:.3g} m2; correct one of the three or leave one out"
        )


def _check_kinds(given: Geometry, usual: Proportions) -> None:
    """Refuse tails that the template does not have."""
    tail = given.tail
    if tail is not None and not usual.has_tail:
        raise VehicleError(
            "tail: a flying-wing has none; remove the table or choose the template conventional"
        )
    if tail is not None and not math.isnan(tail.dihedral):
        v_tail = abs(tail.dihedral) > 0.35
        if v_tail != (given.template == "v-tail"):
            other = "v-tail" if v_tail else "conventional"
            raise VehicleError(
                f"tail.dihedral: {tail.dihedral:g} rad does not go with the template {given.template}; "
                f"correct it or choose the template {other}"
            )


def flaps(geometry: Geometry) -> dict[str, Flap]:
    """Return the control surfaces by their names in the file (``wing.aileron``)."""
    return {
        f"{name}.{key}": flap
        for name in ("wing", "tail", "fin")
        if (table := getattr(geometry, name)) is not None
        for key, flap in table
        if isinstance(flap, Flap)
    }
