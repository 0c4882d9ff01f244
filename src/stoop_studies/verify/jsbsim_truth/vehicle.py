"""What stoop is told of a stock aircraft: mass properties, geometry, surfaces at trim; no aerodynamic number."""

from __future__ import annotations

from typing import Final

from stoop.vehicle import Vehicle
from stoop.vehicle.load import parse_vehicle
from stoop_studies.verify.jsbsim_truth.aircraft import Stock
from stoop_studies.verify.jsbsim_truth.flight import Trim
from stoop_studies.verify.jsbsim_truth.machine import FOOT, INCH, SLUG, Machine

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


def vehicle_of(stock: Stock, jsbsim: Machine, trim: Trim) -> Vehicle:
    """Return the vehicle with every aerodynamic parameter at zero.

    Deflections count from trim, so that the constant terms are the coefficients there.
    """
    text = FILE.format(
        title=stock.title,
        mass=jsbsim["inertia/mass-slugs"] * SLUG,
        center=_triple(point(jsbsim, "inertia/cg")),
        **inertia(jsbsim),
        area=jsbsim["metrics/Sw-sqft"] * FOOT**2,
        chord=jsbsim["metrics/cbarw-ft"] * FOOT,
        span=jsbsim["metrics/bw-ft"] * FOOT,
        airspeed=stock.airspeed,
        alpha=stock.alpha,
        moment_point=_triple(point(jsbsim, "metrics/aero-rp")),
        gravity=jsbsim.apparent_gravity,
        eye=_triple(point(jsbsim, "metrics/eyepoint")),
    )
    parts = [text, _sensors(), _controls(trim), _propulsion(stock, jsbsim), _terms(stock)]
    return parse_vehicle("\n".join(parts), f"jsbsim {stock.model}")


def point(jsbsim: Machine, name: str) -> tuple[float, float, float]:
    """Return a point of the structural frame (inches aft, right, up) in ours (m forward, right, down)."""
    x, y, z = (jsbsim[f"{name}-{axis}-in"] * INCH for axis in "xyz")
    return -x, y, -z


def inertia(jsbsim: Machine) -> dict[str, float]:
    """Return moments and products of inertia, kg m2.

    The property of xz is the element of the inertia matrix, which is minus the product; those of xy and yz
    are the products.
    """
    raw = {
        a: jsbsim[f"inertia/i{a}-slugs_ft2"] * SLUG * FOOT**2 for a in ("xx", "yy", "zz", "xy", "xz", "yz")
    }
    return {**raw, "xz": -raw["xz"]}


def _triple(values: tuple[float, float, float]) -> str:
    return "[" + ", ".join(repr(v) for v in values) + "]"


def _sensors() -> str:
    return "\n".join(f"[sensors.{channel}]\nsigma = {sigma!r}" for channel, sigma in NOISE.items())


def _controls(trim: Trim) -> str:
    return "\n".join(f"[controls.{c}]\noffset = {-value!r}" for c, value in trim.deflections.items())


def _propulsion(stock: Stock, jsbsim: Machine) -> str:
    """Return the thrust as a recorded channel, on the line that force and moment of the engines give."""
    if stock.throttle is None:
        return ""
    arm = jsbsim["moments/m-prop-lbsft"] / jsbsim["forces/fbx-prop-lbs"] * FOOT
    x, y, z = point(jsbsim, "inertia/cg")
    return f'[propulsion]\nkind = "channel"\nposition = {_triple((x, y, z + arm))}'


def _terms(stock: Stock) -> str:
    return "\n".join(_of_coefficient(stock, c) for c in ("CD", "CL", "CQ", "Cl", "Cm", "Cn"))


def _of_coefficient(stock: Stock, coefficient: str) -> str:
    """Return the table of one coefficient; boxes are wide, for tables may bend more than eq. (1) allows."""
    gone, added = stock.dropped.get(coefficient, ()), stock.added.get(coefficient, {})
    wide = {"CDalpha2": "alpha^2"} if coefficient == "CD" and "CDalpha2" not in gone else {}
    return "\n".join(
        [
            f"[aerodynamics.{coefficient}]",
            *(f"{name} = false" for name in gone),
            *(f'{n} = {{ term = "{t}", bounds = [-20.0, 20.0] }}' for n, t in {**wide, **added}.items()),
        ]
    )
