"""A priori derivatives by the vortex lattice of AeroSandbox, in the place of the strip theory of the handbook.

The lattice gives what lifting surfaces do to each other. What it does not have is that of `stoop_draft.vehicle_draft.handbook`:
fuselage, drag, the lag of downwash, and the efficiency of control surfaces in a viscous flow.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Final

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop.extend.errors import VehicleError
from stoop.extend.verbs import install
from stoop_draft.vehicle_draft import handbook
from stoop_draft.vehicle_draft.geometry import Geometry
from stoop_draft.vehicle_draft.parts import Flap, Surface

STATIONS: Final = 9  #: of a half, beside those at the ends of control surfaces
CHORDWISE: Final = 6
ANGLE: Final = 0.02  #: step of angles, rad
RATE: Final = 0.02  #: step of dimensionless rates
SOURCE: Final = "AeroSandbox vortex lattice"
#: motion or control -> step, and what the change of a coefficient is divided by
STEPS: Final = {
    **dict.fromkeys(("alpha", "beta"), (ANGLE, ANGLE)),
    **dict.fromkeys(("p", "q", "r"), (RATE, RATE)),
    **dict.fromkeys(("elevator", "aileron", "rudder"), (ANGLE, ANGLE / handbook.FLAP_EFFICIENCY)),
}
OUTPUTS: Final = {"CL": "CL", "CQ": "CY", "Cl": "Cl", "Cm": "Cm", "Cn": "Cn"}  #: of eq. (1) -> of AeroSandbox


def nominal(geometry: Geometry, point: handbook.WorkingPoint) -> dict[str, float]:
    """Return the terms of eq. (1) at a working point, those of lifting surfaces by the lattice.

    Raises
    ------
    VehicleError
        AeroSandbox is not installed.
    """
    try:
        library = importlib.import_module("aerosandbox")
    except ImportError:
        raise VehicleError(
            f"--aerodynamics: AeroSandbox is not installed; {install('geometry')}, or take the handbook"
        ) from None
    values, base = handbook.nominal(geometry, point), _coefficients(library, geometry, point, {})
    for variable, (step, per) in STEPS.items():
        moved = _coefficients(library, geometry, point, {variable: step})
        found = {name + variable: (moved[name] - base[name]) / per for name in OUTPUTS}
        values |= {name: value for name, value in found.items() if name in values}
    for name, change in (handbook.fuselage(geometry) | handbook.lag(geometry)).items():
        values[name] += change
    return values


#: arguments as those of `handbook.derivatives`
derivatives: Final = partial(handbook.derivatives, method=nominal, source=SOURCE)


def _coefficients(
    library: Any, geometry: Geometry, point: handbook.WorkingPoint, moved: Mapping[str, float]
) -> dict[str, float]:
    """Return the coefficients of the lattice, body axes, with one motion or one control moved."""
    wing, speed = geometry.wing, point.airspeed
    rate = {"p": 2.0 * speed / wing.span, "q": 2.0 * speed / wing.chord, "r": 2.0 * speed / wing.span}
    airplane = library.Airplane(
        wings=_wings(library, geometry, point, moved),
        xyz_ref=[0.0, 0.0, 0.0],
        s_ref=wing.area,
        c_ref=wing.chord,
        b_ref=wing.span,
    )
    flow = library.OperatingPoint(
        velocity=speed,
        alpha=math.degrees(point.alpha + moved.get("alpha", 0.0)),
        beta=math.degrees(moved.get("beta", 0.0)),
        **{axis: per * moved.get(axis, 0.0) for axis, per in rate.items()},
    )
    found = library.VortexLatticeMethod(
        airplane,
        flow,
        spanwise_resolution=1,
        chordwise_resolution=CHORDWISE,
        align_trailing_vortices_with_wind=False,
    ).run()
    return {name: float(np.squeeze(found[key])) for name, key in OUTPUTS.items()}


def _wings(
    library: Any, geometry: Geometry, point: handbook.WorkingPoint, controls: Mapping[str, float]
) -> list[Any]:
    """Return the surfaces of AeroSandbox, flat, the wing at its angle of zero lift; from the center of gravity.

    AeroSandbox turns an airplane about the origin of its geometry (4.2), not about ``xyz_ref``.
    """
    wing, tail, fin = (
        _moved(part, geometry.center_of_gravity) for part in (geometry.wing, geometry.tail, geometry.fin)
    )
    pitch = point.lift / handbook.wing_slope(wing) - point.alpha
    found = [_wing(library, wing, wing.dihedral, pitch, _deflected("wing", wing, controls))]
    if tail is not None:
        sign = -1.0 if tail.dihedral < 0.0 else 1.0
        moved = {"elevator": controls.get("elevator", 0.0), "rudder": sign * controls.get("rudder", 0.0)}
        found.append(_wing(library, tail, tail.dihedral, 0.0, _deflected("tail", tail, moved)))
    if fin is not None:
        deflected = [(flap, 0.0, -controls.get("rudder", 0.0)) for flap in _flaps(fin, "rudder")]
        sides = (1.0, -1.0) if fin.position[1] != 0.0 else (1.0,)
        found += [_half(library, fin, side, deflected) for side in sides]
    return found


def _flaps(surface: Surface, *names: str) -> list[Flap]:
    return [flap for name in names if (flap := getattr(surface, name, None)) is not None]


def _deflected(
    table: str, surface: Surface, controls: Mapping[str, float]
) -> list[tuple[Flap, float, float]]:
    """Return the control surfaces with their deflections, left and right, trailing edge down, rad."""
    found = []
    for kind in ("aileron", "elevon", "elevator", "ruddervator"):
        for flap in _flaps(surface, kind):
            names = handbook.CONTROLS[kind]
            even = sum(controls.get(n, 0.0) for n in names if n == "elevator")
            odd = sum(controls.get(n, 0.0) for n in names if n != "elevator")
            found.append((flap, even + odd, even - odd))
    return found


def _stations(flaps: Sequence[tuple[Flap, float, float]]) -> FloatArray:
    """Return stations from root to tip, close together where a control surface ends."""
    ends = [e for flap, _, _ in flaps for s in flap.span for e in (s - 0.005, s + 0.005)]
    regular = np.sin(np.linspace(0.0, 0.5 * math.pi, STATIONS))
    kept = [s for s in regular if all(abs(s - e) > 0.02 for e in ends) or s in (0.0, 1.0)]
    return np.unique(np.clip([*kept, *ends], 0.0, 1.0))


def _wing(
    library: Any, surface: Surface, dihedral: float, pitch: float, flaps: Sequence[tuple[Flap, float, float]]
) -> Any:
    stations = _stations(flaps)
    places = [*(-stations[:0:-1]), *stations]
    sections = []
    for place in places:
        side, station = math.copysign(1.0, place), abs(place)
        along = station * 0.5 * surface.span
        offset = (
            -along * math.tan(surface.sweep),
            side * along * math.cos(dihedral),
            -along * math.sin(dihedral),
        )
        deflections = [(flap, right if side > 0.0 else left) for flap, left, right in flaps]
        sections.append(_section(library, surface, offset, station, pitch, deflections))
    return library.Wing(xsecs=sections, symmetric=False)


def _half(library: Any, fin: Surface, side: float, flaps: Sequence[tuple[Flap, float, float]]) -> Any:
    sections = []
    for station in _stations(flaps):
        along = station * fin.span
        root = (-along * math.tan(fin.sweep), (side - 1.0) * fin.position[1], -along)
        deflections = [(flap, right) for flap, _, right in flaps]
        sections.append(_section(library, fin, root, station, 0.0, deflections))
    return library.Wing(xsecs=sections, symmetric=False)


def _section(
    library: Any,
    surface: Surface,
    offset: tuple[float, float, float],
    station: float,
    pitch: float,
    flaps: Sequence[tuple[Flap, float]],
) -> Any:
    """Return a section: leading edge, chord and airfoil at a station."""
    area = 2.0 * surface.area / surface.span / (1.0 + surface.taper)
    chord = area * (1.0 - (1.0 - surface.taper) * station)
    quarter = (
        surface.position[0] - 0.25 * area + offset[0],
        surface.position[1] + offset[1],
        surface.position[2] + offset[2],
    )
    airfoil = library.Airfoil("naca0010")
    for flap, deflection in flaps:
        if deflection != 0.0 and flap.span[0] <= station <= flap.span[1]:
            airfoil = airfoil.add_control_surface(
                deflection=math.degrees(deflection), hinge_point_x=1.0 - flap.chord
            )
    edge = [-(quarter[0] + 0.25 * chord), quarter[1], -quarter[2]]  # in its axes: aft, right, up
    return library.WingXSec(xyz_le=edge, chord=chord, twist=math.degrees(pitch), airfoil=airfoil)


def _moved(surface: Any, center: Sequence[float]) -> Any:
    """Return a surface with its position from the center of gravity."""
    if surface is None:
        return None
    position = tuple(a - b for a, b in zip(surface.position, center, strict=True))
    return surface.model_copy(update={"position": position})
