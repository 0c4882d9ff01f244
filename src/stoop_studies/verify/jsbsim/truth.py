"""What stoop is given of a stock aircraft, and what is true of it.

Given are mass properties, geometry and surfaces at trim, but no aerodynamic number. True are the derivatives that
JSBSim's own aerodynamics has at a flight condition, by finite differences through it: JSBSim is put into states about
the trim, one variable off at a time (two where a term is a product), and its aerodynamic force and moment are read. The
terms of the model are fitted to them: where a table is straight that is the central difference; where it bends, the mean
over steps as they occur in flight (quantiles of a normal distribution with the flight's standard deviation), which is
all that a flight can tell.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.stats import norm

from stoop.base.arrays import FloatArray
from stoop.base.units import FOOT, SLUG
from stoop.vehicle import Vehicle, terms
from stoop.vehicle.load import parse_vehicle
from stoop_studies.verify.jsbsim.flight import Aircraft, Recording, Stock, Trim

NOISE: Final = {
    "V": 0.2, "alpha": 0.005, "beta": 0.005, "p": 0.005, "q": 0.005, "r": 0.005,
    "phi": 0.005, "theta": 0.005, "psi": 0.005, "ax": 0.05, "ay": 0.05, "az": 0.05,
}  #: one standard deviation of the white noise on each channel: m/s, rad, rad/s, m/s2  # fmt: skip
FILE: Final = """
format = "stoop-vehicle/1"
name = "{title}"

[mass]
mass = {mass!r}
center_of_gravity = {center}
inertia = {{ xx = {xx!r}, yy = {yy!r}, zz = {zz!r}, xz = {xz!r}, xy = {xy!r}, yz = {yz!r} }}

[reference]
area = {area!r}
chord = {chord!r}
span = {span!r}
airspeed = {airspeed!r}
alpha = {alpha!r}
moment_point = {moment_point}
rate_normalization = "actual"

[environment]
gravity = {gravity!r}

[sensors]
accelerometer_position = {eye}
"""
VARIABLES: Final = ("V", "alpha", "beta", "p", "q", "r", "elevator", "aileron", "rudder")  #: of the terms
LEVELS: Final = tuple(map(float, norm.ppf((np.arange(16) + 0.5) / 16)))  #: standard deviations off the trim
CORNERS: Final = (-1.0, 1.0)  #: likewise, of both factors of a product
FORCES: Final = ("CD", "CQ", "CL")
MOMENTS: Final = ("Cl", "Cm", "Cn")
CENTER, REFERENCE = "inertia/cg-{}-in", "metrics/aero-rp-{}-in"
Offset = Mapping[str, float]  #: term variable -> its change from the trim


def vehicle_of(aircraft: Aircraft, trim: Trim) -> Vehicle:
    """Return the vehicle with every aerodynamic parameter at zero.

    Deflections count from trim, so that the constant terms are the coefficients there.
    """
    stock = aircraft.stock
    text = FILE.format(
        title=stock.title, mass=aircraft["inertia/mass-slugs"] * SLUG, center=list(aircraft.point(CENTER)),
        **inertia(aircraft), area=aircraft["metrics/Sw-sqft"] * FOOT**2, chord=aircraft["metrics/cbarw-ft"] * FOOT,
        span=aircraft["metrics/bw-ft"] * FOOT, airspeed=stock.airspeed, alpha=stock.alpha,
        moment_point=list(aircraft.point(REFERENCE)), gravity=aircraft.apparent_gravity,
        eye=list(aircraft.point("metrics/eyepoint-{}-in")),
    )  # fmt: skip
    sensors = [f"[sensors.{channel}]\nsigma = {sigma!r}" for channel, sigma in NOISE.items()]
    controls = [f"[controls.{c}]\noffset = {-value!r}" for c, value in trim.deflections.items()]
    tables = [_terms_table(stock, c) for c in ("CD", "CL", "CQ", "Cl", "Cm", "Cn")]
    parts = [text, *sensors, *controls, _propulsion(aircraft), *tables]
    return parse_vehicle("\n".join(parts), f"jsbsim {stock.model}")


def inertia(aircraft: Aircraft) -> dict[str, float]:
    """Return moments and products of inertia, kg m2.

    The property of xz is the element of the inertia matrix, which is minus the product; those of xy and yz
    are the products.
    """
    axes = ("xx", "yy", "zz", "xy", "xz", "yz")
    raw = {a: aircraft[f"inertia/i{a}-slugs_ft2"] * SLUG * FOOT**2 for a in axes}
    return {**raw, "xz": -raw["xz"]}


def _propulsion(aircraft: Aircraft) -> str:
    """Return the thrust as a recorded channel, on the line that force and moment of the engines give."""
    if aircraft.stock.throttle is None:
        return ""
    arm = aircraft["moments/m-prop-lbsft"] / aircraft["forces/fbx-prop-lbs"] * FOOT
    x, y, z = aircraft.point(CENTER)
    return f'[propulsion]\nkind = "channel"\nposition = {[x, y, z + arm]}'


def _terms_table(stock: Stock, coefficient: str) -> str:
    """Return the table of one coefficient; boxes are wide, for tables may bend more than eq. (1) allows."""
    gone, added = stock.dropped.get(coefficient, ()), stock.added.get(coefficient, {})
    wide = {"CDalpha2": "alpha^2"} if coefficient == "CD" and "CDalpha2" not in gone else {}
    lines = [f'{n} = {{ term = "{t}", bounds = [-20.0, 20.0] }}' for n, t in {**wide, **added}.items()]
    return "\n".join([f"[aerodynamics.{coefficient}]", *(f"{name} = false" for name in gone), *lines])


def derivatives(aircraft: Aircraft, trim: Trim, vehicle: Vehicle, flown: Recording) -> dict[str, float]:
    """Return the true value of every aerodynamic term of a vehicle, at the mean altitude of a flight."""
    altitude = float(flown.columns["altitude"].mean())
    middle = replace(trim, state=replace(trim.state, altitude=altitude, phi=0.0))
    offsets = _offsets(_steps(aircraft, vehicle, flown), vehicle)
    places = [_place(aircraft, middle, offset) for offset in offsets]
    known = set(places[0][0])
    out: dict[str, float] = {}
    for coefficient, group in vehicle.terms.items():
        parsed = [terms.parse(text, known, text) for text in group.values()]
        columns = [[float(terms.convert(term, variables)) for variables, _ in places] for term in parsed]
        required = [values[coefficient] for _, values in places]
        found = np.linalg.lstsq(np.array(columns).T, np.array(required), rcond=None)[0]
        out |= dict(zip(group, map(float, found), strict=True))
    return out


def _lengths(aircraft: Aircraft) -> dict[str, float]:
    """Return the length that makes each rate dimensionless, m."""
    names = {"p": "metrics/bw-ft", "q": "metrics/cbarw-ft", "r": "metrics/bw-ft"}
    return {a: aircraft[name] * FOOT for a, name in names.items()}


def _steps(aircraft: Aircraft, vehicle: Vehicle, flown: Recording) -> dict[str, float]:
    """Return the standard deviation of each term variable in a flight."""
    spread = {name: float(np.std(flown.columns[name])) for name in VARIABLES}
    speed = float(np.mean(flown.columns["V"]))
    rates = {a: spread[a] * length / (2.0 * speed) for a, length in _lengths(aircraft).items()}
    return {**spread, **rates, "V": spread["V"] / vehicle.value("reference.airspeed")}


def _offsets(steps: Mapping[str, float], vehicle: Vehicle) -> Iterator[Offset]:
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


def _place(aircraft: Aircraft, trim: Trim, offset: Offset) -> tuple[dict[str, float], dict[str, float]]:
    """Put JSBSim off the trim; return the term variables as it says they are, and its six coefficients there.

    The angle of attack changes as it would in flight there.
    """
    state, stock, lengths = trim.state, aircraft.stock, _lengths(aircraft)
    speed = state.V * (1.0 + offset.get("V", 0.0))
    rates = {a: offset.get(a, 0.0) * 2.0 * speed / length for a, length in lengths.items()}
    angles = {a: getattr(state, a) + offset.get(a, 0.0) for a in ("alpha", "beta")}
    deflections = {c: value + offset.get(c, 0.0) for c, value in trim.deflections.items()}
    aircraft.put(replace(state, V=speed, **rates, **angles), deflections)
    airspeed = aircraft["velocities/vt-fps"] * FOOT
    variables = {
        "V": airspeed / stock.airspeed - 1.0,
        "alpha": aircraft["aero/alpha-rad"] - stock.alpha,
        "beta": aircraft["aero/beta-rad"],
        **{a: aircraft[f"velocities/{a}-aero-rad_sec"] * n / (2.0 * airspeed) for a, n in lengths.items()},
        **{c: aircraft[stock.surfaces[c]] - value for c, value in trim.deflections.items()},
    }
    return variables, coefficients(aircraft)


def coefficients(aircraft: Aircraft) -> dict[str, float]:
    """Return JSBSim's coefficients: force in its wind axes, moment in body axes about its reference point."""
    pressure_area = aircraft["aero/qbar-psf"] * aircraft["metrics/Sw-sqft"]
    wind = aircraft.read([f"forces/fw{a}-aero-lbs" for a in "xyz"]) / pressure_area
    lengths = aircraft.read(["metrics/bw-ft", "metrics/cbarw-ft", "metrics/bw-ft"])
    moment = moment_at_reference(aircraft) / (pressure_area * lengths)
    return dict(zip((*FORCES, *MOMENTS), map(float, (*wind, *moment)), strict=True))


def moment_at_reference(aircraft: Aircraft) -> FloatArray:
    """Return the aerodynamic moment (3,) about the aerodynamic reference point, lbf ft."""
    arm = np.subtract(aircraft.point(REFERENCE), aircraft.point(CENTER)) / FOOT
    force = aircraft.read([f"forces/fb{a}-aero-lbs" for a in "xyz"])
    about_center = aircraft.read([f"moments/{a}-aero-lbsft" for a in "lmn"])
    return np.asarray(about_center - np.cross(arm, force))
