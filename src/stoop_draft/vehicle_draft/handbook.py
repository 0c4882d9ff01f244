"""A priori derivatives of an airplane from its geometry, by textbook formulas, with standard deviations.

Lifting surfaces by strip theory (`vehicle_draft.strips`); downwash, tail efficiency, sidewash, fuselage and drag by the
formulas of DATCOM, Roskam (Airplane Design, part VI), Raymer (Aircraft Design: A Conceptual Approach, 6th ed.) and NACA reports,
named where they stand. Subsonic and incompressible, without propeller stream and flexibility.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop.extend.units import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from stoop.extend.vehicles import EQUATION_1
from stoop_draft.vehicle_draft.apriori import METHOD, Apriori, typical_std
from stoop_draft.vehicle_draft.geometry import Geometry
from stoop_draft.vehicle_draft.parts import Fin, Surface, Tail
from stoop_draft.vehicle_draft.proportions import flaps, mean_chord, quarter_chord
from stoop_draft.vehicle_draft.strips import MOTIONS, Response, Strips, lift_slope, strips, to_flap, to_motion

VISCOSITY: Final = 1.46e-5  #: kinematic, of air at sea level, m2/s
#: lift slope of airfoils, per rad (Raymer, section 12.4: 0.95 of theory)
SECTION: Final = 0.95 * 2.0 * math.pi
#: of thin-airfoil theory at moderate deflections (Roskam VI, fig. 8.14; Nelson, fig. 2.21)
FLAP_EFFICIENCY: Final = 0.8
#: dynamic pressure at a tail over the free stream's (Raymer, section 16.3: 0.85 to 0.95)
TAIL_PRESSURE: Final = 0.9
#: effective over geometric aspect ratio of a fin with body and tail (Raymer, section 16.4)
END_PLATE: Final = 1.55
#: standard deviation of the derivatives by the rate of alpha over their value
LAG_SPREAD: Final = 0.5
#: share of the wash of a roll that arrives at a fin: DATCOM 7.1.2 has all in CQp, none in Cnp
ROLL_SIDEWASH: Final = 0.5


@dataclass(frozen=True)
class WorkingPoint:
    """Where derivatives hold: airspeed in m/s, angle of attack of the body's x axis in rad, lift coefficient."""

    airspeed: float
    alpha: float
    lift: float
    alpha_given: bool = True

    @classmethod
    def of(
        cls, geometry: Geometry, airspeed: float, alpha: float | None, density: float, lift: float | None
    ) -> WorkingPoint:
        """Return the working point of level flight, where lift or angle of attack are not given."""
        if lift is None:
            lift = 2.0 * geometry.mass * STANDARD_GRAVITY / (density * airspeed**2 * geometry.wing.area)
        return cls(airspeed, attitude(geometry, lift) if alpha is None else alpha, lift, alpha is not None)

    def for_geometry(self, geometry: Geometry) -> WorkingPoint:
        """Return the point of another geometry; an angle of attack that was not given is that of its wing."""
        return self if self.alpha_given else replace(self, alpha=attitude(geometry, self.lift))


def derivatives(
    geometry: Geometry,
    airspeed: float,
    alpha: float | None = None,
    density: float = SEA_LEVEL_DENSITY,
    lift: float | None = None,
    method: Callable[[Geometry, WorkingPoint], dict[str, float]] | None = None,
    source: str = "handbook formulas",
) -> dict[str, Apriori]:
    """Return the derivatives of eq. (1) at a working point, body axes, as a vehicle file takes them.

    Parameters
    ----------
    geometry : Geometry
    airspeed : float
        V* of the working point, m/s.
    alpha : float, optional
        alpha*, rad; by default that of the lift.
    density : float
        Of the air, kg/m3.
    lift : float, optional
        Lift coefficient of the working point; by default that of level flight.
    method : callable, optional
        Gives the values at a working point; `nominal` by default.
    source : str
        Names the method.

    Standard deviations are those of the method, and of what is typical of the geometry.
    """
    point = WorkingPoint.of(geometry, airspeed, alpha, density, lift)
    typical = typical_std(geometry, lambda g: nominal(g, point.for_geometry(g)))
    return {
        name: Apriori(value, math.hypot(METHOD[name].std(value), typical[name]), source)
        for name, value in (method or nominal)(geometry, point).items()
    }


def attitude(geometry: Geometry, lift: float) -> float:
    """Return the angle of attack of the body's x axis at a lift coefficient, rad.

    The angle of zero lift is that of a thin airfoil with parabolic arcs meeting at 40 % of the chord: -1.81 rad times the
    camber (Abbott and von Doenhoff, Theory of Wing Sections, section 4.3).
    """
    wing = geometry.wing
    return lift / wing_slope(wing) - 1.81 * wing.camber - wing.incidence


def wing_slope(wing: Surface, share: float = 1.0) -> float:
    """Return the lift slope of a surface with a share of its aspect ratio, per rad."""
    taper = wing.taper
    half = math.tan(wing.sweep) - (1.0 - taper) / (1.0 + taper) / wing.aspect_ratio
    return lift_slope(share * wing.aspect_ratio, math.atan(half), SECTION)


def downwash_slope(wing: Surface, tail: Tail) -> float:
    """Return the change of downwash at the tail with angle of attack (DATCOM 4.4.1; Roskam VI, eq. 8.45)."""
    ratio = wing.aspect_ratio
    aspect = 1.0 / ratio - 1.0 / (1.0 + ratio**1.7)
    taper = (10.0 - 3.0 * wing.taper) / 7.0
    arm = max(quarter_chord(wing) - quarter_chord(tail), 0.25 * wing.chord)
    height = (1.0 - abs(tail.position[2] - wing.position[2]) / wing.span) / (2.0 * arm / wing.span) ** (
        1.0 / 3.0
    )
    slope = 4.44 * (aspect * taper * max(height, 0.0) * math.sqrt(math.cos(wing.sweep))) ** 1.19
    return float(min(slope, 0.9))


def sidewash(geometry: Geometry, fin: Fin) -> float:
    """Return (1 + dsigma/dbeta) eta of a fin on the body (DATCOM 5.3.1.1; Roskam VI, eq. 10.28)."""
    wing, body = geometry.wing, geometry.fuselage
    height = (wing.position[2] - body.position[2]) / body.height
    area = 3.06 * fin.area / wing.area / (1.0 + math.cos(wing.sweep))
    return 0.724 + area + 0.4 * float(np.clip(height, -0.5, 0.5)) + 0.009 * wing.aspect_ratio


def _surfaces(geometry: Geometry, alpha: float, lift: float, friction: float) -> dict[str, Strips]:
    center = np.array(geometry.center_of_gravity)
    wing = geometry.wing
    slopes = wing_slope(wing), wing_slope(wing, 0.5)
    load = lift / slopes[0]
    found = {"wing": strips(wing, wing.dihedral, center, slopes, load - alpha)}
    found["wing"] = replace(found["wing"], load=load, profile_drag=friction)
    if (tail := geometry.tail) is not None:
        slope = downwash_slope(wing, tail)
        wash = {"alpha": 1.0 - slope, "q": 1.0 + slope}  # see `lag`
        own = strips(tail, tail.dihedral, center, (wing_slope(tail), wing_slope(tail, 0.5)), -alpha)
        found["tail"] = replace(own, wash=wash, pressure=TAIL_PRESSURE)
    if (fin := geometry.fin) is not None:
        pair = fin.position[1] != 0.0
        slope = wing_slope(fin, END_PLATE)
        wash = {} if geometry.tail is None else {"beta": sidewash(geometry, fin), "p": ROLL_SIDEWASH}
        own = strips(fin, 0.5 * math.pi, center, (slope, slope), -alpha, paired=pair)
        found["fin"] = replace(own, wash=wash, profile_drag=friction)
    return found


def nominal(geometry: Geometry, point: WorkingPoint) -> dict[str, float]:
    """Return the terms of eq. (1) that the geometry has, without standard deviations."""
    airspeed, alpha, lift = point.airspeed, point.alpha, point.lift
    wing = geometry.wing
    area, span, chord = wing.area, wing.span, wing.chord
    friction = 2.0 * skin_friction(airspeed * chord / VISCOSITY)
    surfaces = _surfaces(geometry, alpha, lift, friction)
    scale = {"p": 0.5 * span, "r": 0.5 * span, "q": 0.5 * chord}
    values: dict[str, float] = {}
    for motion in MOTIONS:
        parts = {n: to_motion(s, motion, alpha, scale.get(motion, 1.0), area) for n, s in surfaces.items()}
        total = sum(parts.values(), Response(np.zeros(3), np.zeros(3), 0.0))
        _write(values, motion, _coefficients(geometry, total, parts["wing"].roll, alpha, lift))
    for name, flap in flaps(geometry).items():
        table, kind = name.split(".")
        for control in CONTROLS[kind]:
            tail = geometry.tail
            inverted = table == "tail" and control == "rudder" and tail is not None and tail.dihedral < 0.0
            part = to_flap(surfaces[table], flap, control == "elevator", FLAP_EFFICIENCY, area, alpha)
            if inverted:
                part = Response(-part.force, -part.moment, -part.roll)
            roll = part.roll if table == "wing" else 0.0
            _write(values, control, _coefficients(geometry, part, roll, alpha, lift))
    for name, change in fuselage(geometry).items():
        values[name] += change
    values |= _drag(geometry, airspeed, lift, values["CLalpha"])
    values |= dict.fromkeys(("CLV", "CDV", "CmV", "CQV", "CQ0", "Cl0", "Cn0", "Cm0"), 0.0)
    values["CL0"] = lift
    return {name: values[name] for group in EQUATION_1.values() for name in group if name in values}


def lag(geometry: Geometry) -> dict[str, float]:
    """Return the derivatives of CL and Cm by the rate of alpha, as part of CLq and Cmq: the lag of downwash.

    Eq. (1) has no term of the rate of alpha, which in a maneuver is the pitch rate less that of the path, see `with_curved_path`
    (Klein and Morelli, Aircraft System Identification, section 3.4).
    """
    wing, tail = geometry.wing, geometry.tail
    if tail is None:
        return {}
    arm = (geometry.center_of_gravity[0] - quarter_chord(tail)) / wing.chord
    load = wing_slope(tail) * math.cos(tail.dihedral) ** 2 * TAIL_PRESSURE * tail.area / wing.area
    lift = 2.0 * load * arm * downwash_slope(wing, tail)
    return {"CLq": lift, "Cmq": -lift * arm}


def with_curved_path(geometry: Geometry, density: float, found: Mapping[str, Apriori]) -> dict[str, Apriori]:
    """Return derivatives with what the rate of alpha adds to them, the pitch rate apart: lift that is not level turns the path.

    Published derivatives hold at no rate of alpha, of which eq. (1) has no term. That rate times c/2V is the one of the pitch
    less k (CL - CL* (V*/V)^2), k = density S c / 4m. Slow airplanes have most of it in CmV: what is faster than its trim turns
    upward, and its tail meets the downwash of before.
    """
    wing, out = geometry.wing, dict(found)
    share = 0.25 * density * wing.area * wing.chord / geometry.mass
    turning = {name: found[f"CL{name}"].value for name in ("alpha", "elevator") if f"CL{name}" in found}
    turning["V"] = found["CLV"].value + 2.0 * found["CL0"].value
    for by, slope in lag(geometry).items():
        for variable, lift in turning.items():
            name, change = f"{by[:2]}{variable}", -share * slope * lift
            one = found[name]
            out[name] = replace(one, value=one.value + change, std=math.hypot(one.std, LAG_SPREAD * change))
    return out


CONTROLS: Final[Mapping[str, tuple[str, ...]]] = {
    "aileron": ("aileron",),
    "elevon": ("elevator", "aileron"),
    "elevator": ("elevator",),
    "ruddervator": ("elevator", "rudder"),
    "rudder": ("rudder",),
}  #: of eq. (1), by kind of surface


def _write(values: dict[str, float], variable: str, coefficients: Mapping[str, float]) -> None:
    """Add what a motion or a control gives to the terms of eq. (1)."""
    for coefficient, value in coefficients.items():
        name = coefficient + variable
        if name in EQUATION_1[coefficient]:
            values[name] = values.get(name, 0.0) + value


def _coefficients(
    geometry: Geometry, total: Response, roll: float, alpha: float, lift: float
) -> dict[str, float]:
    """Return force and moment as coefficients; with the yawing moment of the induced drag of antisymmetric lift.

    The induced yawing moment is -3 CL/(pi A) of the rolling moment: the lifting line with its first two terms (Glauert, The
    Elements of Aerofoil and Airscrew Theory, chapter 11).
    """
    span, chord = geometry.wing.span, geometry.wing.chord
    force, moment = total.force, total.moment
    induced = -3.0 * lift / (math.pi * geometry.wing.aspect_ratio) * roll
    return {
        "CL": float(force[0] * math.sin(alpha) - force[2] * math.cos(alpha)),
        "CQ": float(force[1]),
        "Cl": float(moment[0]) / span,
        "Cm": float(moment[1]) / chord,
        "Cn": (float(moment[2]) + induced) / span,
    }


def fuselage(geometry: Geometry) -> dict[str, float]:
    """Return what the body adds, and the wing by its height on it.

    Cmalpha: Gilruth and White, NACA TR 711 (Raymer eq. 16.25). CQbeta: Roskam VI, eq. 10.8 and fig. 10.8. Cnbeta: Raymer
    eq. 16.50 with the volume of an elliptic section and a fullness of 0.6. Clbeta of the wing's height: Raymer eq. 16.45.
    """
    wing, body = geometry.wing, geometry.fuselage
    quarter = wing.position[0] - 0.25 * wing.root_chord
    share = float(np.clip((body.position[0] - quarter) / body.length, 0.1, 0.7))
    factor = float(np.interp(share, _GILRUTH[0], _GILRUTH[1]))
    height = (wing.position[2] - body.position[2]) / (0.5 * body.height)  # below the axis positive
    interference = 1.0 + float(np.clip(0.49 * height, 0.0, 0.49) + np.clip(-0.85 * height, 0.0, 0.85))
    section = 0.25 * math.pi * body.width * body.height
    volume = 0.47 * body.width * body.height * body.length
    depth = float(np.clip(height, -1.0, 1.0)) * 0.5 * body.height
    return {
        "Cmalpha": factor * body.width**2 * body.length / (wing.area * wing.chord),
        "CQbeta": -2.0 * interference * section / wing.area,
        "Cnbeta": -1.3 * volume / (wing.area * wing.span) * body.height / body.width,
        "Clbeta": 1.2 * math.sqrt(wing.aspect_ratio) * depth * (body.width + body.height) / wing.span**2,
    }


#: position of the wing's root quarter chord on the body, and factor per rad
_GILRUTH: Final[tuple[FloatArray, FloatArray]] = (
    np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]),
    np.array([0.115, 0.172, 0.344, 0.487, 0.688, 0.888, 1.146]),
)


def skin_friction(reynolds: float) -> float:
    """Return the mean skin friction of a turbulent flat plate (Raymer eq. 12.27)."""
    return float(0.455 / math.log10(max(reynolds, 1e4)) ** 2.58)


def _drag(geometry: Geometry, airspeed: float, lift: float, slope: float) -> dict[str, float]:
    """Return the drag: friction, and a parabolic polar (Raymer, sections 12.5 and 12.6)."""
    wing, body = geometry.wing, geometry.fuselage
    wetted = 0.0
    fins = 2 if geometry.fin is not None and geometry.fin.position[1] != 0.0 else 1
    for surface, count in ((wing, 1), (geometry.tail, 1), (geometry.fin, fins)):
        if surface is not None:
            friction = skin_friction(airspeed * mean_chord(surface) / VISCOSITY)
            wetted += 2.05 * count * surface.area * friction * 1.3
    girth = 0.5 * math.pi * (body.width + body.height) * body.length * 0.75
    wetted += 1.2 * girth * skin_friction(airspeed * body.length / VISCOSITY)
    efficiency = max(1.78 * (1.0 - 0.045 * wing.aspect_ratio**0.68) - 0.64, 0.4)
    induced = 1.0 / (math.pi * wing.aspect_ratio * efficiency)
    return {
        "CD0": 1.8 * wetted / wing.area + induced * lift**2,
        "CDalpha": 2.0 * induced * lift * slope,
        "CDalpha2": induced * slope**2,
    }
