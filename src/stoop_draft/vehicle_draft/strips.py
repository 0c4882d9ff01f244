"""Strip theory: lifting surfaces as strips, and the coefficients that small motions and deflections give.

The circulation of a strip is that of thin-airfoil theory with the normal wash at its three-quarter chord and the lift slope
of the whole surface: for symmetric loads that of its aspect ratio, for antisymmetric ones that of half of it, as the lifting
line of an elliptic wing has it (Glauert, The Elements of Aerofoil and Airscrew Theory, chapter 11). The chord that carries
load along the span is the mean of the surface's own and the ellipse's for symmetric loads (Schrenk, NACA TM 948), the
ellipse's for antisymmetric ones. The force is rho Gamma x v (Kutta and Joukowski), so that tilted lift (Cnp, Clr), dihedral,
sweep and V-tails need no formulas of their own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop_draft.vehicle_draft.parts import Flap, Surface

COUNT: Final = 24  #: strips of a half
#: of the strips of a half, over its length
EDGES: Final = 0.5 * (1.0 - np.cos(np.linspace(0.0, math.pi, COUNT + 1)))
MOTIONS: Final = ("alpha", "beta", "p", "q", "r")


def lift_slope(aspect_ratio: float, sweep: float, section: float = 2.0 * math.pi) -> float:
    """Return the lift slope of a wing, per rad (Polhamus, NACA TN 3911; DATCOM 4.1.3.2; Raymer eq. 12.6, at Mach 0).

    Parameters
    ----------
    aspect_ratio : span squared over area
    sweep : of the half chord, rad
    section : lift slope of the airfoil, per rad
    """
    share = section / (2.0 * math.pi)
    return (
        section
        * aspect_ratio
        / (2.0 * share + math.sqrt(4.0 * share**2 + aspect_ratio**2 * (1.0 + math.tan(sweep) ** 2)))
    )


def flap_effectiveness(chord: float) -> tuple[float, float]:
    """Return change of incidence and of section moment at the quarter chord by a plain flap, per rad (Glauert, ARC R&M 1095).

    Parameters
    ----------
    chord : of the flap, share of the chord
    """
    hinge = math.acos(2.0 * chord - 1.0)  # theta of the hinge, from the leading edge
    return 1.0 - (hinge - math.sin(hinge)) / math.pi, -0.5 * math.sin(hinge) * (1.0 - math.cos(hinge))


@dataclass(frozen=True)
class Strips:
    """The strips of one surface; vectors (n, 3) in body axes from the center of gravity, m.

    Attributes
    ----------
    quarter, three_quarter : points of the chord
    along : span of each strip as a vector, from left to right or from root to tip
    normal : unit vector downward (to the right, of a fin)
    chord : (n,), of the planform
    loaded : chord (n,) as symmetric and as antisymmetric loads have it
    side : (n,), 1 of right halves, -1 of left ones
    station : (n,), 0 at the root, 1 at the tip
    slopes : lift slope of symmetric and of antisymmetric loads, per rad
    load : normal wash over airspeed at the working point, of the strips that carry the airplane
    wash : share of alpha and of beta that arrives, and of pitch rate with what lags behind
    pressure : dynamic pressure over that of the free stream
    """

    quarter: FloatArray
    three_quarter: FloatArray
    along: FloatArray
    normal: FloatArray
    chord: FloatArray
    loaded: tuple[FloatArray, FloatArray]
    side: FloatArray
    station: FloatArray
    slopes: tuple[float, float]
    load: float = 0.0
    wash: Mapping[str, float] | None = None
    pressure: float = 1.0
    profile_drag: float = 0.0

    def circulation(self, wash: FloatArray) -> FloatArray:
        """Return lift coefficient times chord of the strips for normal washes over airspeed (n,), by parity, m."""
        chord, odd_chord = self.loaded
        if self.side.min() == self.side.max():
            return np.asarray(self.slopes[0] * chord * wash)
        half = len(wash) // 2
        mirrored = np.concatenate([wash[half:], wash[:half]])
        even, odd = 0.5 * (wash + mirrored), 0.5 * (wash - mirrored)
        return np.asarray(self.slopes[0] * chord * even + self.slopes[1] * odd_chord * odd)


def strips(
    surface: Surface,
    dihedral: float,
    center: FloatArray,
    slopes: tuple[float, float],
    pitch: float = 0.0,
    *,
    paired: bool = True,
) -> Strips:
    """Return the strips of a surface; right half first.

    Parameters
    ----------
    surface : Surface
    dihedral : float
        Rad; a right angle for a fin.
    center : (3,)
        Center of gravity, m.
    slopes : tuple
        Lift slopes, see `Strips`.
    pitch : float
        Of the zero-lift line against the body's x axis, rad.
    paired : bool
        Whether there is a left half.
    """
    length = 0.5 * surface.span if dihedral != 0.5 * math.pi else surface.span
    station, width = 0.5 * (EDGES[1:] + EDGES[:-1]), np.diff(EDGES) * length
    own = surface.root_chord * (1.0 - (1.0 - surface.taper) * station)
    if dihedral == 0.5 * math.pi:
        own = own * surface.area / np.sum(own * width)
    ellipse = np.sqrt(1.0 - station**2)
    ellipse *= np.sum(own * width) / np.sum(ellipse * width)
    halves = []
    for side in (1.0, -1.0) if paired else (1.0,):
        root = np.array(surface.position) * [1.0, side, 1.0]
        root[0] -= 0.25 * surface.root_chord
        outward = np.array([-math.tan(surface.sweep), side * math.cos(dihedral), -math.sin(dihedral)])
        quarter = root + station[:, None] * length * outward - center
        normal = np.array(
            [
                math.sin(pitch) * math.cos(dihedral),
                side * math.sin(dihedral),
                math.cos(pitch) * math.cos(dihedral),
            ]
        )
        back = np.array([0.5, 0.0, 0.0]) * own[:, None]
        n = np.ones((COUNT, 1))
        halves.append((quarter, quarter - back, side * outward * width[:, None], normal * n, side * n[:, 0]))
    quarters, points, spans, normals, sides = (np.concatenate(c) for c in zip(*halves, strict=True))
    repeat = len(halves)
    even = np.tile(0.5 * (own + ellipse), repeat)
    return Strips(
        quarters,
        points,
        spans,
        normals,
        np.tile(own, repeat),
        (even, even if dihedral == 0.5 * math.pi else np.tile(ellipse, repeat)),
        sides,
        np.tile(station, repeat),
        slopes,
    )


@dataclass(frozen=True)
class Response:
    """Force over q S and moment over q S (m), (3,) each, body axes; and the rolling moment of antisymmetric circulation."""

    force: FloatArray
    moment: FloatArray
    roll: float

    def __add__(self, other: Response) -> Response:
        """Return the sum over surfaces."""
        return Response(self.force + other.force, self.moment + other.moment, self.roll + other.roll)


def to_motion(own: Strips, motion: str, alpha: float, scale: float, area: float) -> Response:
    """Return what a surface gives per unit of a motion.

    Parameters
    ----------
    own : Strips
    motion : str
        One of `MOTIONS`.
    alpha : float
        Angle of attack of the working point, rad.
    scale : float
        Reference length over twice: a rate is over this, 1/m; 1 for angles.
    area : float
        Reference area, m2.
    """
    steady = np.array([math.cos(alpha), 0.0, math.sin(alpha)])
    share = (own.wash or {}).get(motion, 1.0)
    at_quarter, at_wash = (
        share * _velocity(points, motion, alpha, scale) for points in (own.quarter, own.three_quarter)
    )
    change = own.circulation(np.einsum("ij,ij->i", at_wash, own.normal))
    steady_circulation = own.slopes[0] * own.load * own.loaded[0]
    lift = _lift(own, change, steady) + _lift(own, steady_circulation, at_quarter)
    width = own.chord * np.linalg.norm(own.along[:, 1:], axis=1)
    # lift and side force are across the flow, which turns with alpha and beta
    resistance = 0.0 if motion in ("alpha", "beta") else own.profile_drag
    drag = resistance * width[:, None] * (at_quarter + steady * (at_quarter @ steady)[:, None])
    force = own.pressure / area * (lift - drag)
    moment = np.cross(own.quarter, force).sum(axis=0)
    if motion == "q":
        # apparent camber (Katz and Plotkin, section 5.5: -pi/8 of q c / V), reduced as the lift slope is
        camber = -0.0625 * own.slopes[0] * own.chord**3 / scale
        moment[1] += own.pressure / area * float(np.sum(camber * own.along[:, 1]))
    return Response(force.sum(axis=0), moment, _roll(own, change, area))


def _lift(own: Strips, circulation: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return the force of the strips over dynamic pressure, (n, 3), m2."""
    return np.asarray(circulation[:, None] * np.cross(own.along, velocity))


def _roll(own: Strips, circulation: FloatArray, area: float) -> float:
    """Return the rolling moment of a circulation over q S, m."""
    return -own.pressure / area * float(np.sum(circulation * own.quarter[:, 1] * own.along[:, 1]))


def to_flap(
    own: Strips, flap: Flap, symmetric: bool, efficiency: float, area: float, alpha: float
) -> Response:
    """Return what a control surface gives per rad: trailing edges down, or the right one up and the left one down."""
    steady = np.array([math.cos(alpha), 0.0, math.sin(alpha)])
    incidence, section = (efficiency * effect for effect in flap_effectiveness(flap.chord))
    inside = _covered(own, flap)
    sign = inside * (1.0 if symmetric else -own.side)
    change = own.circulation(incidence * sign)
    force = own.pressure / area * _lift(own, change, steady)
    twist = own.pressure / area * section * sign * own.chord**2
    moment = np.cross(own.quarter, force).sum(axis=0) + (twist[:, None] * own.along * [0.0, 1.0, 1.0]).sum(
        axis=0
    )
    return Response(force.sum(axis=0), moment, _roll(own, change, area))


def _covered(own: Strips, flap: Flap) -> FloatArray:
    """Return the share of each strip between the stations of a flap, (n,)."""
    low, high = np.maximum(EDGES[:-1], flap.span[0]), np.minimum(EDGES[1:], flap.span[1])
    share = np.clip(high - low, 0.0, None) / np.diff(EDGES)
    return np.tile(share, len(own.station) // COUNT)


def _velocity(points: FloatArray, motion: str, alpha: float, scale: float) -> FloatArray:
    """Return the velocity of points through the air over airspeed, per unit of a motion, (n, 3)."""
    if motion == "alpha":
        return np.tile([-math.sin(alpha), 0.0, math.cos(alpha)], (len(points), 1))
    if motion == "beta":
        return np.tile([0.0, 1.0, 0.0], (len(points), 1))
    rate = np.array([motion == "p", motion == "q", motion == "r"], dtype=np.float64)
    return np.cross(rate, points) / scale
