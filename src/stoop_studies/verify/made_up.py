"""Made-up vehicles for `stoop verify defaults`: perturbed parents, scaled by mass; and what a tape measure says of them.

The derivatives are those of parents (``vehicles/parents.toml``, the built-in multirotors), each multiplied by a draw of its
own. Nothing here reads the handbook of `stoop vehicle new`, which is under test. Area grows with mass to the power 2/3 and
inertia with mass times length squared (scale laws of geometric similarity).
"""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import tomlkit

from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop_studies.verify.study import data_text

GRAVITY: Final = 9.80665  #: m/s2
WINGED: Final = ("conventional", "v-tail", "flying-wing", "glider", "quadplane")
Range = tuple[float, float]


@dataclass(frozen=True)
class Spread:
    """How far a made-up vehicle is from its parent: standard deviations of logarithms, and ranges."""

    derivative: float = 0.2
    #: of CLalpha and Clp, beside what the aspect ratio makes of them (lifting line, A / (A + 2))
    slope: float = 0.05
    area: float = 0.12
    aspect: float = 0.1
    radius: float = 0.1  #: of gyration
    lift: float = 0.1  #: coefficient in cruise
    yaw_inertia: Range = (0.88, 0.98)  #: of the sum of the other two
    lag: Range = (0.02, 0.08)  #: s, of servos
    throw: Range = (0.25, 0.45)  #: rad, of a surface at full command
    cruise_throttle: Range = (0.4, 0.6)
    hover: Range = (0.35, 0.5)  #: command that carries the weight
    tape: Mapping[str, float] = field(default_factory=lambda: {"mass": 0.01, "span": 0.005, "chord": 0.015})


SPREAD: Final = Spread()
#: by number: template, parent, range of mass (kg)
KINDS: Final[tuple[tuple[str, str, Range], ...]] = (
    ("conventional", "navion", (1.0, 4.0)),
    ("v-tail", "vtail", (3.0, 12.0)),
    ("flying-wing", "x8", (0.8, 2.5)),
    ("quad", "quad-x", (0.3, 1.5)),
    ("glider", "glider", (1.5, 6.0)),
    ("conventional", "aerosonde", (8.0, 25.0)),
    ("hexa", "hexa-x", (1.5, 4.0)),
    ("conventional", "twinboom", (10.0, 25.0)),
    ("quadplane", "vtail", (5.0, 15.0)),
    ("flying-wing", "x8", (2.5, 6.0)),
    ("quad", "quad-x", (1.5, 4.0)),
    ("conventional", "navion", (4.0, 12.0)),
    ("v-tail", "aerosonde", (2.0, 8.0)),
    ("glider", "glider", (0.5, 1.5)),
    ("octo", "octo-x", (4.0, 8.0)),
    ("conventional", "navion", (0.5, 1.0)),
    ("flying-wing", "x8", (1.0, 4.0)),
    ("quad", "quad-x", (0.8, 3.0)),
    ("quadplane", "navion", (8.0, 20.0)),
    ("v-tail", "vtail", (8.0, 20.0)),
)
RECORDS: Final = ("px4", "ardupilot", "csv")


@dataclass(frozen=True, eq=False)
class MadeUp:
    """A vehicle that no one has built.

    Attributes
    ----------
    number : int
    template : of `stoop vehicle new`
    record : whose log it writes, one of `RECORDS`
    vehicle : the truth; its channels are commanded deflections (rad), the throttle (0 to 1) and motors (0 to 1)
    throw : surface -> deflection at full command, rad
    tape : mass, span and chord as the user measured them, SI; the span of a multirotor is that between opposite motors
    """

    number: int
    template: str
    record: str
    vehicle: Vehicle
    throw: Mapping[str, float]
    tape: Mapping[str, float]

    @property
    def winged(self) -> bool:
        """Whether it flies on wings."""
        return self.template in WINGED


@functools.cache
def made_up(number: int, kinds: tuple[tuple[str, str, Range], ...] = KINDS) -> MadeUp:
    """Return a vehicle of a fleet by its number."""
    template, parent, masses = kinds[number % len(kinds)]
    rng = np.random.default_rng([14, number])
    mass = float(np.exp(rng.uniform(*np.log(masses))))
    draw = _aircraft if template in WINGED else _multirotor
    text, dimensions = draw(rng, parent, mass, template)
    surfaces = ("elevator", "aileron", "rudder")
    throw = {s: float(rng.uniform(*SPREAD.throw)) for s in surfaces}
    tape = {n: x * (1.0 + SPREAD.tape[n] * rng.standard_normal()) for n, x in dimensions.items()}
    vehicle = parse_vehicle(text, f"made-up {number}")
    return MadeUp(number, template, RECORDS[number % len(RECORDS)], vehicle, throw, tape)


def _factor(rng: np.random.Generator, spread: float) -> float:
    return float(np.exp(spread * rng.standard_normal()))


def _aircraft(
    rng: np.random.Generator, name: str, mass: float, template: str
) -> tuple[str, dict[str, float]]:
    """Return the file of an aircraft and its mass, span and chord."""
    parent: dict[str, Any] = tomllib.loads(data_text("parents.toml"))[name]
    area = parent["area"] * (mass / parent["mass"]) ** (2.0 / 3.0) * _factor(rng, SPREAD.area)
    span = float(np.sqrt(parent["aspect"] * _factor(rng, SPREAD.aspect) * area))
    chord = area / span
    lift = parent["CL"] * _factor(rng, SPREAD.lift)
    airspeed = float(np.sqrt(2.0 * mass * GRAVITY / (SEA_LEVEL_DENSITY * area * lift)))
    kx, ky = (r * _factor(rng, SPREAD.radius) for r in parent["radii"])
    xx, yy = mass * (0.5 * kx * span) ** 2, mass * (ky * span) ** 2
    zz = (xx + yy) * rng.uniform(*SPREAD.yaw_inertia)
    inertia = {"xx": xx, "yy": yy, "zz": zz, "xz": parent["xz"] * zz}
    ratio = span / chord
    slope = ratio / (ratio + 2.0) * (parent["aspect"] + 2.0) / parent["aspect"]
    nearly_fixed = {n: slope * _factor(rng, SPREAD.slope) for n in ("CLalpha", "Clp")}
    factors = {n: _factor(rng, SPREAD.derivative) for n in parent["derivatives"]} | nearly_fixed
    derivatives = {n: v * factors[n] for n, v in parent["derivatives"].items()}
    derivatives |= {"CL0": lift, "Cm0": 0.02 * rng.standard_normal(), "CQ0": 0.002 * rng.standard_normal()}
    derivatives |= {"Cl0": 0.0005 * rng.standard_normal(), "Cn0": 0.0003 * rng.standard_normal()}
    surfaces = ("elevator", "aileron") if template == "flying-wing" else ("elevator", "aileron", "rudder")
    lag = float(rng.uniform(*SPREAD.lag))
    document: dict[str, Any] = {
        "format": "stoop-vehicle/1",
        "name": f"made-up {template} {mass:.1f} kg",
        "mass": {"mass": mass, "inertia": inertia},
        "reference": {
            "area": area, "chord": chord, "span": span, "airspeed": airspeed,
            "alpha": rng.uniform(0.02, 0.06), "rate_normalization": "actual",
        },
        "environment": {"density": "standard"},
        "controls": {s: {"lag": lag} for s in surfaces},
        "aerodynamics": _terms(derivatives),
    }  # fmt: skip
    if template != "glider":
        document["propulsion"] = _propeller(rng, airspeed, derivatives["CD0"], area)
    return tomlkit.dumps(document), {"mass": mass, "span": span, "chord": chord}


def _terms(derivatives: Mapping[str, float]) -> dict[str, Any]:
    """Return the tables of the terms of eq. (1) that have a value; there are no others."""
    factors = {"0": "1", "alpha2": "alpha^2"}
    tables: dict[str, Any] = {"default": False}
    for name, value in derivatives.items():
        coefficient, factor = name[:2], name[2:]
        tables.setdefault(coefficient, {})[name] = {
            "term": factors.get(factor, factor),
            "value": float(value),
        }
    return tables


def _propeller(rng: np.random.Generator, airspeed: float, drag: float, area: float) -> dict[str, Any]:
    """Return a propeller that holds the airspeed near half throttle, at an advance ratio of about 0.65."""
    ratio, coefficients = rng.uniform(0.58, 0.7), {"CT0": rng.uniform(0.1, 0.13), "CT1": -0.06, "CT2": -0.08}
    thrust = coefficients["CT0"] + coefficients["CT1"] * ratio + coefficients["CT2"] * ratio**2
    diameter = float(np.sqrt(0.5 * drag * area * ratio**2 / thrust))
    gain = airspeed / (ratio * diameter) / rng.uniform(*SPREAD.cruise_throttle)
    numbers = {"speed_gain": gain, "diameter": diameter, **coefficients}
    return {
        "kind": "propeller",
        "channel": "control_throttle",
        **{n: float(x) for n, x in numbers.items()},
    }


def _multirotor(
    rng: np.random.Generator, name: str, mass: float, template: str
) -> tuple[str, dict[str, float]]:
    """Return the file of a multirotor and its mass and span."""
    parent = builtin_vehicle(name)
    document: Any = tomlkit.parse(parent.text)
    share = mass / parent.value("mass.mass")
    length = share ** (1.0 / 3.0) * _factor(rng, SPREAD.aspect)
    document["name"], document["mass"]["mass"] = f"made-up {template} {mass:.1f} kg", mass
    inertia = document["mass"]["inertia"]
    for axis in ("xx", "yy", "zz"):
        inertia[axis] = float(inertia[axis]) * share * length**2
    radius = _factor(rng, SPREAD.radius), _factor(rng, SPREAD.radius)
    inertia["xx"] *= radius[0]
    inertia["yy"] *= radius[0] * _factor(rng, 0.5 * SPREAD.radius)
    inertia["zz"] = min(inertia["zz"] * radius[1], 0.97 * (inertia["xx"] + inertia["yy"]))
    rotors, arms = document["rotors"], []
    count, hover = len(document["rotor"]), rng.uniform(*SPREAD.hover)
    bend = rng.uniform(0.4, 0.8)  # share of T1 x in the thrust of hover
    weight = mass * GRAVITY / count
    rotors["T1"], rotors["T2"] = float(bend * weight / hover), float((1.0 - bend) * weight / hover**2)
    rotors["lag"] = float(rng.uniform(*SPREAD.lag))
    for key, power in (("inflow", 2.0 / 3.0), ("drag", 2.0 / 3.0), ("torque_ratio", 1.0 / 3.0)):
        rotors[key] = float(rotors[key]) * share**power * _factor(rng, SPREAD.derivative)
    for rotor in document["rotor"].values():
        rotor["position"] = [float(x) * length for x in rotor["position"]]
        arms.append(float(np.hypot(*rotor["position"][:2])))
    document["body_drag"]["quadratic"] = [
        float(x) * share ** (2.0 / 3.0) for x in document["body_drag"]["quadratic"]
    ]
    return tomlkit.dumps(document), {"mass": mass, "span": 2.0 * max(arms)}
