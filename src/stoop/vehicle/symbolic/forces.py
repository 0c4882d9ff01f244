"""Components: each gives a force and a moment about the centre of gravity, body axes.

A component is a function of the surroundings; a vehicle is the sum of its components.
"""

from __future__ import annotations

from typing import Any

import sympy as sp

from stoop.vehicle import terms
from stoop.vehicle.defaults import COEFFICIENTS
from stoop.vehicle.schema import Propeller
from stoop.vehicle.symbolic.component import ZERO, Load, Surroundings
from stoop.vehicle.symbolic.ground_effect import lift_gain
from stoop.vehicle.symbolic.rotors import body_drag, rotors
from stoop.vehicle.symbolic.symbols import Vector, add, cross, scale


def term_variables(s: Surroundings) -> dict[str, Any]:
    """Return what aerodynamic terms are made of, eq. (1): Delta alpha, beta, rates, speed, controls."""
    actual = s.numbers.vehicle.actual_rates
    flow = terms.values(s.numbers.__getitem__, actual, s.air.V, s.air.alpha, s.air.beta, s.omega)
    return {**flow, **s.deflections}


def coefficients(s: Surroundings) -> dict[str, Any]:
    """Return the six coefficients as sums of terms, eq. (1) and whatever the file adds."""
    known = term_variables(s)
    out = {c: sp.Integer(0) for c in COEFFICIENTS}
    for coefficient, group in s.numbers.vehicle.terms.items():
        for name, text in group.items():
            tree = terms.parse(text, known, name)
            out[coefficient] += s.numbers[name] * terms.convert(tree, known)
    return out | {"CL": out["CL"] * lift_gain(s.numbers, s.channels)}


def aerodynamics(s: Surroundings) -> Load:
    """Return aerodynamic force (the rotation of eq. 2) and moment, moved to the centre of gravity."""
    if s.numbers.vehicle.file.reference is None:
        return Load(ZERO, ZERO)
    n, a, c = s.numbers, s.air, coefficients(s)
    pressure_area = s.density / 2 * n["reference.area"] * a.V2 * a.attached
    drag_and_side = c["CD"] * a.cos_beta + c["CQ"] * a.sin_beta
    force = scale(
        pressure_area,
        (
            c["CL"] * a.sin_alpha - drag_and_side * a.cos_alpha,
            c["CQ"] * a.cos_beta - c["CD"] * a.sin_beta,
            -c["CL"] * a.cos_alpha - drag_and_side * a.sin_alpha,
        ),
    )
    span, chord = n["reference.span"], n["reference.chord"]
    moment = scale(pressure_area, (span * c["Cl"], chord * c["Cm"], span * c["Cn"]))
    return Load(force, add(moment, cross(n.arm("reference.moment_point"), force)))


def thrust(s: Surroundings) -> Any:
    """Return the thrust, N."""
    n, file = s.numbers, s.numbers.vehicle.file.propulsion
    if file is None:
        return sp.Integer(0)
    if file.kind == "constant":
        return n["propulsion.thrust"]
    if isinstance(file, Propeller):
        return _propeller(s, s.channels[file.channel])
    return n["propulsion.scale"] * s.channels[file.channel]


def _propeller(s: Surroundings, command: Any) -> Any:
    """Propeller thrust as a quadratic form in speed and V/D, which has no division by a speed."""
    n = s.numbers
    raw = n["propulsion.speed_gain"] * (command - n["propulsion.idle"])
    speed = (raw + sp.Abs(raw)) / 2
    advance = s.air.V / n["propulsion.diameter"]
    form = n["propulsion.CT0"] * speed**2 + n.get("propulsion.CT1") * speed * advance
    return s.density * n["propulsion.diameter"] ** 4 * (form + n.get("propulsion.CT2") * advance**2)


def propulsion(s: Surroundings) -> Load:
    """Return thrust along its line; its inclination turns it by Taylor polynomials, for angles below 0.5 rad."""
    n = s.numbers
    magnitude = thrust(s)
    if magnitude == 0:
        return Load(ZERO, ZERO)
    force: Vector = (magnitude, sp.Integer(0), sp.Integer(0))
    if "propulsion.pitch" in n:
        cosine, sine = _cosine_sine(n["propulsion.pitch"])
        force = (magnitude * cosine, sp.Integer(0), -magnitude * sine)
    return Load(force, cross(n.arm("propulsion.position"), force))


def _cosine_sine(angle: Any) -> tuple[Any, Any]:
    """Return cosine and sine as Taylor polynomials, within 1e-12 below 0.5 rad (outside the time loop)."""
    x = angle
    cosine = sum(((-1) ** k * x ** (2 * k) / sp.factorial(2 * k) for k in range(7)), sp.Integer(0))
    sine = sum(((-1) ** k * x ** (2 * k + 1) / sp.factorial(2 * k + 1) for k in range(7)), sp.Integer(0))
    return cosine, sine


COMPONENTS = (aerodynamics, propulsion, rotors, body_drag)


def total(s: Surroundings) -> Load:
    """Return the sum over all components."""
    loads = [component(s) for component in COMPONENTS]
    return sum(loads[1:], loads[0])
