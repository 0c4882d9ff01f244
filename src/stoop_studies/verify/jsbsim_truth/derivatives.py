"""The derivatives that JSBSim's own aerodynamics has at a flight condition, by finite differences through it.

JSBSim is put into states about the trim, one variable off at a time (two where a term is a product), and its
aerodynamic force and moment are read. The terms of the model are fitted to them: where a table is straight that
is the central difference; where it bends, the mean over steps as they occur in flight (quantiles of a normal
distribution with the flight's standard deviation), which is all that a flight can tell.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.stats import norm

from stoop.base.arrays import FloatArray
from stoop.vehicle import Vehicle, terms
from stoop_studies.verify.jsbsim_truth.aircraft import Stock
from stoop_studies.verify.jsbsim_truth.flight import Recording, Trim, written
from stoop_studies.verify.jsbsim_truth.machine import FOOT, Machine
from stoop_studies.verify.jsbsim_truth.vehicle import point

VARIABLES: Final = ("V", "alpha", "beta", "p", "q", "r", "elevator", "aileron", "rudder")  #: of the terms
LEVELS: Final = tuple(
    float(v) for v in norm.ppf((np.arange(16) + 0.5) / 16)
)  #: standard deviations off the trim
CORNERS: Final = (-1.0, 1.0)  #: likewise, of both factors of a product
FORCES: Final = ("CD", "CQ", "CL")
MOMENTS: Final = ("Cl", "Cm", "Cn")


@dataclass(frozen=True)
class Place:
    """Term variables as JSBSim says they are at a point, and its six coefficients there."""

    variables: Mapping[str, float]
    coefficients: Mapping[str, float]


def derivatives(
    stock: Stock, jsbsim: Machine, trim: Trim, vehicle: Vehicle, flown: Recording
) -> dict[str, float]:
    """Return the true value of every aerodynamic term of a vehicle, at the mean altitude of a flight."""
    middle = replace(trim, state=replace(trim.state, altitude=flown.altitude, phi=0.0))
    offsets = _offsets(_steps(jsbsim, vehicle, flown), vehicle)
    places = [_place(stock, jsbsim, middle, offset) for offset in offsets]
    out: dict[str, float] = {}
    for coefficient, group in vehicle.terms.items():
        columns = [[_value(text, place) for place in places] for text in group.values()]
        wanted = [place.coefficients[coefficient] for place in places]
        found = np.linalg.lstsq(np.array(columns).T, np.array(wanted), rcond=None)[0]
        out |= dict(zip(group, map(float, found), strict=True))
    return out


def _value(text: str, place: Place) -> float:
    names = set(place.variables)
    return float(terms.convert(terms.parse(text, names, text), place.variables))


def _steps(jsbsim: Machine, vehicle: Vehicle, flown: Recording) -> dict[str, float]:
    """Return the standard deviation of each term variable in a flight."""
    columns = flown.columns
    spread = {name: float(np.std(columns[name])) for name in VARIABLES}
    speed = float(np.mean(columns["V"]))
    rates = {a: spread[a] * _length(jsbsim, a) / (2.0 * speed) for a in "pqr"}
    return {**spread, **rates, "V": spread["V"] / vehicle.value("reference.airspeed")}


def _length(jsbsim: Machine, rate: str) -> float:
    """Return the length that makes a rate dimensionless, m."""
    return jsbsim["metrics/cbarw-ft" if rate == "q" else "metrics/bw-ft"] * FOOT


def _offsets(steps: Mapping[str, float], vehicle: Vehicle) -> Iterator[dict[str, float]]:
    """Give the trim, steps to either side, and corners where a term is a product."""
    yield {}
    for name, step in steps.items():
        yield from ({name: level * step} for level in LEVELS)
    known = set(VARIABLES)
    texts = {text for group in vehicle.terms.values() for text in group.values()}
    for used in sorted({tuple(sorted(terms.variables(terms.parse(t, known, t)))) for t in texts}):
        if len(used) > 1:
            for levels in itertools.product(CORNERS, repeat=len(used)):
                yield {name: level * steps[name] for name, level in zip(used, levels, strict=True)}


def _place(stock: Stock, jsbsim: Machine, trim: Trim, offset: Mapping[str, float]) -> Place:
    """Put JSBSim off the trim and read it; the angle of attack changes as it would in flight there."""
    state = trim.state
    length = {a: _length(jsbsim, a) for a in "pqr"}
    speed = state.V * (1.0 + offset.get("V", 0.0))
    turned = {a: offset.get(a, 0.0) * 2.0 * speed / length[a] for a in "pqr"}
    angles = {a: getattr(state, a) + offset.get(a, 0.0) for a in ("alpha", "beta")}
    moved = {c: value + offset.get(c, 0.0) for c, value in trim.deflections.items()}
    jsbsim.put(replace(state, V=speed, **turned, **angles), written(stock, moved))
    airspeed = jsbsim["velocities/vt-fps"] * FOOT
    variables = {
        "V": airspeed / stock.airspeed - 1.0,
        "alpha": jsbsim["aero/alpha-rad"] - stock.alpha,
        "beta": jsbsim["aero/beta-rad"],
        **{a: jsbsim[f"velocities/{a}-aero-rad_sec"] * length[a] / (2.0 * airspeed) for a in "pqr"},
        **{c: jsbsim[stock.surfaces[c]] - value for c, value in trim.deflections.items()},
    }
    return Place(variables, coefficients(jsbsim))


def coefficients(jsbsim: Machine) -> dict[str, float]:
    """Return JSBSim's coefficients: force in its wind axes, moment in body axes about its reference point."""
    pressure_area = jsbsim["aero/qbar-psf"] * jsbsim["metrics/Sw-sqft"]
    wind = jsbsim.read([f"forces/fw{a}-aero-lbs" for a in "xyz"]) / pressure_area
    lengths = jsbsim.read(["metrics/bw-ft", "metrics/cbarw-ft", "metrics/bw-ft"])
    moment = moment_at_reference(jsbsim) / (pressure_area * lengths)
    return dict(zip((*FORCES, *MOMENTS), map(float, (*wind, *moment)), strict=True))


def moment_at_reference(jsbsim: Machine) -> FloatArray:
    """Return the aerodynamic moment (3,) about the aerodynamic reference point, lbf ft."""
    arm = np.subtract(point(jsbsim, "metrics/aero-rp"), point(jsbsim, "inertia/cg")) / FOOT
    force = jsbsim.read([f"forces/fb{a}-aero-lbs" for a in "xyz"])
    about_center = jsbsim.read([f"moments/{a}-aero-lbsft" for a in "lmn"])
    return np.asarray(about_center - np.cross(arm, force))
