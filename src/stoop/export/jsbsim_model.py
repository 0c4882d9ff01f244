"""A vehicle's aerodynamics and thrust as JSBSim functions, from the symbols that make the compiled kernel.

Inside the functions all is SI, as in the vehicle file; JSBSim's own units appear at their borders only:
what is read (``velocities/vt-fps``) and what an axis or a force returns (pounds, foot-pounds).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final
from xml.etree.ElementTree import Element, SubElement

import sympy as sp

from stoop.base.units import FOOT, POUND_FORCE, SLUG
from stoop.export.jsbsim_function import convert, function, node, prop, value
from stoop.vehicle import Vehicle, terms
from stoop.vehicle.symbolic import component, forces
from stoop.vehicle.symbolic.frames import Air
from stoop.vehicle.symbolic.symbols import Numbers

AXES: Final = {"CL": "LIFT", "CD": "DRAG", "CQ": "SIDE", "Cl": "ROLL", "Cm": "PITCH", "Cn": "YAW"}
_LENGTHS: Final = {"Cl": "span", "Cm": "chord", "Cn": "span"}
AIRSPEED: Final = "stoop/air/V-m_sec"
DENSITY: Final = "stoop/air/density-kg_m3"
PRESSURE_AREA: Final = "stoop/air/dynamic-pressure-area-lbs"
THRUST: Final = "stoop/thrust-N"


def channel(name: str) -> str:
    """Return the property that takes a recorded channel."""
    return f"stoop/channel/{name}"


def deflection(control: str) -> str:
    """Return the property of a surface's deflection, rad."""
    return f"stoop/deflection/{control}-rad"


def variable(name: str) -> str:
    """Return the property of a variable of the aerodynamic terms."""
    return f"stoop/variable/{name}"


def coefficient(name: str) -> str:
    """Return the name of the function of an aerodynamic term."""
    return f"aero/coefficient/{name}"


@dataclass(frozen=True, eq=False)
class Physics:
    """The symbols of a vehicle's loads, what property each is in JSBSim, and the numbers in place.

    Attributes
    ----------
    surroundings : Surroundings
    names : mapping of symbol to property
    numbers : mapping of symbol to its value, SI
    """

    surroundings: component.Surroundings
    names: dict[Any, str]
    numbers: dict[Any, float]

    @classmethod
    def of(cls, vehicle: Vehicle) -> Physics:
        """Make symbols for what JSBSim knows: air-relative motion, density, rates, deflections, channels."""
        names: dict[Any, str] = {}

        def symbol(name: str, place: str) -> Any:
            made = sp.Symbol(name, real=True)
            names[made] = place
            return made

        V = symbol("V", AIRSPEED)
        alpha, beta = symbol("alpha", "aero/alpha-rad"), symbol("beta", "aero/beta-rad")
        air = Air(V, V**2, alpha, beta, sp.cos(alpha), sp.sin(alpha), sp.cos(beta), sp.sin(beta))
        p, q, r = (symbol(a, f"velocities/{a}-aero-rad_sec") for a in "pqr")
        density = symbol("density", DENSITY)
        deflections = {c: symbol(f"control {c}", deflection(c)) for c in vehicle.controls}
        channels = {c: symbol(f"channel {c}", channel(c)) for c in vehicle.inputs}
        n = Numbers.of(vehicle)
        numbers = dict(zip(n.symbols, vehicle.values.tolist(), strict=True))
        return cls(component.Surroundings(n, air, density, (p, q, r), deflections, channels), names, numbers)

    def element(self, expr: Any) -> Element:
        """Return the element that computes an expression with the vehicle's numbers in place."""
        return convert(
            sp.sympify(expr).xreplace({s: sp.Float(v) for s, v in self.numbers.items()}), self.names
        )


def air_functions(vehicle: Vehicle) -> Iterator[Element]:
    """Yield airspeed, density and dynamic pressure times area."""
    area = vehicle.value("reference.area")
    yield function(AIRSPEED, node("product", prop("velocities/vt-fps"), value(FOOT)))
    yield function(DENSITY, _density(vehicle), _DENSITY_WORDS.get(str(vehicle.file.environment.density), ""))
    squared = (prop(AIRSPEED), prop(AIRSPEED))
    product = node("product", value(0.5), prop(DENSITY), *squared, value(area), value(1.0 / POUND_FORCE))
    yield function(PRESSURE_AREA, product)


_DENSITY_WORDS: Final = {
    "standard": "JSBSim's own atmosphere, so that weather set there is felt",
    "log": "the channel, or JSBSim's own atmosphere while the channel is zero",
}


def _density(vehicle: Vehicle) -> Element:
    choice = vehicle.file.environment.density
    own = node("product", prop("atmosphere/rho-slugs_ft3"), value(SLUG / FOOT**3))
    if choice == "standard":
        return own
    if choice == "log":
        given = channel("density")
        return node("ifthen", node("gt", prop(given), value(0.0)), prop(given), own)
    return value(vehicle.value("environment.density"))


def variable_functions(physics: Physics) -> Iterator[Element]:
    """Yield what aerodynamic terms are made of, without the controls."""
    known = forces.term_variables(physics.surroundings)
    for name, meaning in terms.STATE_VARIABLES.items():
        yield function(variable(name), physics.element(known[name]), meaning)


def axis_elements(vehicle: Vehicle) -> Iterator[Element]:
    """Yield one axis per coefficient: pressure x area (x length) x coefficient x what it multiplies."""
    symbols = {n: sp.Symbol(n, real=True) for n in (*terms.STATE_VARIABLES, *vehicle.file.controls)}
    names = {s: deflection(n) if n in vehicle.file.controls else variable(n) for n, s in symbols.items()}
    for name, group in vehicle.terms.items():
        if not group:
            continue
        out = Element("axis", {"name": AXES[name]})
        length = _LENGTHS.get(name)
        arms = [] if length is None else [value(vehicle.value(f"reference.{length}") / FOOT)]
        for parameter, text in group.items():
            tree = terms.parse(text, symbols, vehicle.where)
            factor = convert(terms.convert(tree, symbols), names)
            body = node("product", prop(PRESSURE_AREA), *arms, value(vehicle.value(parameter)), factor)
            out.append(function(coefficient(parameter), body, f"{name}: {text}"))
        yield out


def thrust_functions(physics: Physics) -> Iterator[Element]:
    """Yield the thrust in N, where it follows from a channel; a constant one is a property that can be set."""
    file = physics.surroundings.numbers.vehicle.file.propulsion
    if file is not None and file.kind != "constant":
        yield function(THRUST, physics.element(forces.thrust(physics.surroundings)))


def constant_thrust(vehicle: Vehicle) -> dict[str, float]:
    """Return the property of a constant thrust and its value, N; nothing where the thrust is none or no constant."""
    file = vehicle.file.propulsion
    constant = file is not None and file.kind == "constant"
    return {THRUST: vehicle.value("propulsion.thrust")} if constant else {}


def aerodynamics(vehicle: Vehicle, physics: Physics) -> Element:
    """Return the aerodynamics section."""
    out = Element("aerodynamics")
    out.extend(air_functions(vehicle))
    out.extend(variable_functions(physics))
    out.extend(thrust_functions(physics))
    for axis in axis_elements(vehicle):
        out.append(axis)
    return out


def pounds(name: str) -> Element:
    """Return a function whose value is a property in N, in pounds."""
    out = Element("function")
    body = SubElement(out, "product")
    body.extend([prop(name), value(1.0 / POUND_FORCE)])
    return out
