"""A vehicle's equations as JSBSim functions: controls, aerodynamics and thrust, from the symbols of the compiled kernel.

Inside the functions all is SI, as in the vehicle file; JSBSim's own units appear at their borders only: what is read
(``velocities/vt-fps``) and what an axis or a force returns (pounds, foot-pounds).

JSBSim's ``delay`` of N frames passes a signal N - 1 frames late (1.3.3), and none at all for N = 0. Fractions of a frame
are interpolated here. Its delays, rate limits, hysteresis and lags begin with zeros, so what goes through them is the
deviation from a start value, which is a property.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final
from xml.etree.ElementTree import Element, SubElement

import sympy as sp

from stoop import Vehicle
from stoop.extend.units import UNITS
from stoop.extend.vehicles import MOMENT_ARMS, SymbolicEquations, terms

FOOT, INCH, POUND_FORCE, SLUG = (UNITS[unit].factor for unit in ("ft", "in", "lbf", "slug"))
AXES: Final = {"CL": "LIFT", "CD": "DRAG", "CQ": "SIDE", "Cl": "ROLL", "Cm": "PITCH", "Cn": "YAW"}
AIRSPEED: Final = "stoop/air/V-m_sec"
DENSITY: Final = "stoop/air/density-kg_m3"
PRESSURE_AREA: Final = "stoop/air/dynamic-pressure-area-lbs"
THRUST: Final = "stoop/thrust-N"
_FRAME: Final = "simulation/channel-dt"


def number(value: float) -> str:
    """Return a number as text that reads back as the same double."""
    return repr(float(value))


def leaf(tag: str, text: str) -> Element:
    """Return an element that holds text."""
    out = Element(tag)
    out.text = text
    return out


def value(x: float) -> Element:
    """Return a constant."""
    return leaf("value", number(x))


def prop(name: str) -> Element:
    """Return the value of a property."""
    return leaf("property", name)


def node(tag: str, *children: Element) -> Element:
    """Return an operation on its arguments; a sum or product of one is that one."""
    if tag in ("sum", "product") and len(children) == 1:
        return children[0]
    out = Element(tag)
    out.extend(children)
    return out


def function(name: str, body: Element, description: str = "") -> Element:
    """Return a named function: its value is the property of that name."""
    out = Element("function", {"name": name})
    if description:
        SubElement(out, "description").text = description
    out.append(body)
    return out


def convert(expr: Any, names: Mapping[Any, str]) -> Element:
    """Return the element that computes a SymPy expression, whose symbols are the properties `names`.

    It is made of symbols, numbers, sums, products, whole or half powers, ``Abs`` and arc tangents; NotImplementedError for
    others.
    """
    expr = sp.sympify(expr)
    if expr.is_Symbol:
        return prop(names[expr])
    if expr.is_Number:
        return value(float(expr))
    if expr.is_Add:
        return node("sum", *(convert(a, names) for a in expr.args))
    if expr.is_Mul:  # a denominator as a quotient, so that no reciprocal is rounded
        above, below = sp.fraction(expr)
        if below == 1:
            return node("product", *(convert(a, names) for a in expr.args))
        return node("quotient", convert(above, names), convert(below, names))
    if expr.is_Pow:
        base, exponent = expr.args
        if exponent.is_negative:
            return node("quotient", value(1.0), convert(base**-exponent, names))
        return node("pow", convert(base, names), value(float(exponent)))
    if isinstance(expr, sp.Abs):
        return node("abs", convert(expr.args[0], names))
    if isinstance(expr, sp.atan2 | sp.atan):
        return node(type(expr).__name__, *(convert(a, names) for a in expr.args))
    raise NotImplementedError(f"{type(expr).__name__} has no form in JSBSim")


channel: Final = "stoop/channel/{}".format  #: property that takes a recorded channel
channel_start: Final = "stoop/start/{}".format  #: of the value of a delayed channel before the flight began
#: of where a lagged surface stood before the flight began, rad
lag_start: Final = "stoop/start/{}-rad".format
deflection: Final = "stoop/deflection/{}-rad".format  #: of a surface's deflection, rad
variable: Final = "stoop/variable/{}".format  #: of a variable of the aerodynamic terms
coefficient: Final = "aero/coefficient/{}".format  #: name of the function of an aerodynamic term
_delayed: Final = "stoop/delayed/{}".format  #: property of a channel as the surfaces receive it


class Printer:
    """Symbols of a vehicle's equations, the properties that stand for them, and what has been printed with them.

    Numbers of the vehicle whose names begin with one of `constant` are printed as they are.
    """

    def __init__(self, vehicle: Vehicle, constant: tuple[str, ...] = ("",)) -> None:
        self.vehicle, self.equations = vehicle, SymbolicEquations(vehicle)
        self.numbers = self.equations.numbers
        values = zip(self.numbers.symbols, vehicle.values.tolist(), strict=True)
        self.known = {s: sp.Float(x) for s, x in values if s.name.startswith(constant)}
        self.names: dict[Any, str] = {}
        self.used: set[Any] = set()  #: symbols of what was printed

    def symbol(self, name: str, place: str) -> Any:
        """Return a symbol whose value is a property."""
        made = sp.Symbol(name, real=True)
        self.names[made] = place
        return made

    def rates(self) -> tuple[Any, Any, Any]:
        """Return p, q, r."""
        p, q, r = (self.symbol(a, f"velocities/{a}-aero-rad_sec") for a in "pqr")
        return p, q, r

    def deflections(self) -> dict[str, Any]:
        """Return the deflections of the controls, rad."""
        return {c: self.symbol(f"control {c}", deflection(c)) for c in self.vehicle.controls}

    def element(self, expr: Any) -> Element:
        """Return what computes an expression."""
        expr = sp.sympify(expr).xreplace(self.known)
        self.used |= expr.free_symbols
        return convert(expr, self.names)


def constant_thrust(vehicle: Vehicle) -> dict[str, float]:
    """Return the property of a constant thrust and its value, N; nothing where the thrust is none or no constant."""
    file = vehicle.file.propulsion
    constant = file is not None and file.kind == "constant"
    return {THRUST: vehicle.value("propulsion.thrust")} if constant else {}


def aerodynamics(vehicle: Vehicle) -> Element:
    """Return the aerodynamics section: air, variables of the terms, thrust, and an axis per coefficient."""
    printer = Printer(vehicle)
    element, deflections, density = printer.element, printer.deflections(), printer.symbol("density", DENSITY)
    V = printer.symbol("V", AIRSPEED)
    alpha, beta = (printer.symbol(a, f"aero/{a}-rad") for a in ("alpha", "beta"))
    channels = {c: printer.symbol(f"channel {c}", channel(c)) for c in vehicle.inputs}
    out = Element("aerodynamics")
    out.append(function(AIRSPEED, node("product", prop("velocities/vt-fps"), value(FOOT))))
    out.append(air_density(vehicle))
    factors = (value(0.5), prop(DENSITY), prop(AIRSPEED), prop(AIRSPEED))
    area = value(vehicle.value("reference.area"))
    out.append(function(PRESSURE_AREA, node("product", *factors, area, value(1.0 / POUND_FORCE))))
    number = printer.numbers.__getitem__
    known = terms.values(number, vehicle.actual_rates, V, alpha, beta, printer.rates()) | deflections
    for name, meaning in terms.STATE_VARIABLES.items():
        out.append(function(variable(name), element(known[name]), meaning))
    propulsion = vehicle.file.propulsion
    # a constant one is a property that can be set
    if propulsion is not None and propulsion.kind != "constant":
        out.append(function(THRUST, element(printer.equations.thrust(V, density, channels))))
    symbols = {n: sp.Symbol(n, real=True) for n in (*terms.STATE_VARIABLES, *vehicle.file.controls)}
    names = {s: deflection(n) if n in vehicle.file.controls else variable(n) for n, s in symbols.items()}
    for name, group in vehicle.terms.items():
        if not group:
            continue
        axis = SubElement(out, "axis", {"name": AXES[name]})
        arms = []
        if name in MOMENT_ARMS:
            length, about = MOMENT_ARMS[name]
            stated = f"reference.inertia.{about}"  # moments hold for that inertia
            relative = (
                vehicle.value(f"mass.inertia.{about}{about}") / vehicle.value(stated)
                if stated in vehicle.rows
                else 1
            )
            arms.append(value(relative * vehicle.value(f"reference.{length}") / FOOT))
        for parameter, text in group.items():  # pressure x area (x length) x coefficient x what it multiplies
            tree = terms.parse(text, symbols, vehicle.where)
            factor = convert(terms.convert(tree, symbols), names)
            body = node("product", prop(PRESSURE_AREA), *arms, value(vehicle.value(parameter)), factor)
            axis.append(function(coefficient(parameter), body, f"{name}: {text}"))
    return out


def air_density(vehicle: Vehicle) -> Element:
    """Return the function of the density, kg/m3."""
    source = str(vehicle.file.environment.density)
    density = node("product", prop("atmosphere/rho-slugs_ft3"), value(SLUG / FOOT**3))
    description = ""
    if source == "standard":
        description = "JSBSim's own atmosphere, so that weather set there is felt"
    elif source == "log":
        given = channel("density")
        density = node("ifthen", node("gt", prop(given), value(0.0)), prop(given), density)
        description = "the channel, or JSBSim's own atmosphere while the channel is zero"
    else:
        density = value(vehicle.value("environment.density"))
    return function(DENSITY, density, description)


def delays(vehicle: Vehicle) -> dict[str, float]:
    """Return the delay of each channel that has one, s."""
    return {vehicle.inputs[i]: float(vehicle.values[row]) for i, row in vehicle.input_delays()}


def actuators(vehicle: Vehicle) -> dict[str, tuple[float, float, float]]:
    """Return dead zone, rate limit (per s) and delay (s) of each channel that has one, in the channel's unit."""
    rows = vehicle.parameter_rows()
    found = {vehicle.inputs[a.column]: a.numbers(rows, 1.0)[:, 0].tolist() for a in vehicle.actuators()}
    return {name: (zone, limit, delay) for name, (zone, limit, delay) in found.items()}


def lagged(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the controls whose surface follows with a lag."""
    with_state = (c for c in vehicle.controls if f"{c}.lag" in vehicle.states)
    return tuple(c for c in with_state if vehicle.value(f"controls.{c}.lag", 1.0) > 0.0)


def received(vehicle: Vehicle) -> dict[str, str]:
    """Return the property of each channel as surfaces and rotors receive it."""
    late = actuators(vehicle)
    return {name: _delayed(name) if name in late else channel(name) for name in vehicle.inputs}


def flight_control(vehicle: Vehicle) -> Element:
    """Return the flight control section: properties of channels and start values, then actuators, mixers and lags."""
    out = Element("flight_control", {"name": "controls"})
    neutral = vehicle.neutral_inputs(0.0)
    late, rows = actuators(vehicle), vehicle.parameter_rows()
    declared: list[tuple[str, float]] = []
    for name, x in zip(vehicle.inputs, neutral.tolist(), strict=True):
        declared += [(channel(name), x)] if name != "none" else []
        declared += [(channel_start(name), x)] if name in late else []
    for control in lagged(vehicle):
        declared.append((lag_start(control), float(vehicle.commanded(control, rows, neutral)[0])))
    for name, x in [*declared, *constant_thrust(vehicle).items()]:
        SubElement(out, "property", {"value": number(x)}).text = name
    for name, numbers in late.items():
        SubElement(out, "channel", {"name": name}).extend(_actuator(name, *numbers))
    for control in vehicle.controls:
        SubElement(out, "channel", {"name": control}).extend(_surface(vehicle, control))
    return out


def component(name: str, body: Element) -> Element:
    """Return a component of the flight control section: its output is the property of its name."""
    out = Element("fcs_function", {"name": name})
    out.append(node("function", body))
    return out


def _actuator(name: str, dead_zone: float, limit: float, seconds: float) -> Iterator[Element]:
    """Yield the dead zone and the rate limit of a channel, and its delay by a time that need not be whole frames."""

    def actuator(name: str, source: str, tag: str, amount: str, **more: str) -> Element:
        out = Element("actuator", {"name": name})  # the only component of 1.3.3 that respects its delay
        out.append(leaf("input", source))
        SubElement(out, tag, more).text = amount
        return out

    def blend(a: str, b: str) -> Element:
        """Interpolate between one frame and the next by the fraction of the delay in frames."""
        weight = node("fraction", node("quotient", value(seconds), prop(_FRAME)))
        return node("sum", prop(a), node("product", weight, node("difference", prop(b), prop(a))))

    deviation, earlier, middle, later = (f"stoop/late/{name}-{i}" for i in range(4))
    yield component(deviation, node("difference", prop(channel(name)), prop(channel_start(name))))
    if dead_zone > 0.0:
        deviation, source = f"stoop/play/{name}", deviation
        yield actuator(deviation, source, "hysteresis_width", number(dead_zone))
    if limit < math.inf:
        deviation, source = f"stoop/limited/{name}", deviation
        yield actuator(deviation, source, "rate_limit", number(limit))
    moved = prop(deviation)
    if seconds > 0.0:
        yield actuator(earlier, deviation, "delay", number(seconds), type="time")
        yield actuator(middle, earlier, "delay", "2", type="frames")
        yield actuator(later, middle, "delay", "2", type="frames")
        short = node("lt", value(seconds), prop(_FRAME))
        moved = node("ifthen", short, blend(earlier, middle), blend(middle, later))
    yield component(_delayed(name), node("sum", prop(channel_start(name)), moved))


def _surface(vehicle: Vehicle, control: str) -> Iterator[Element]:
    """Yield mixer, offset + sum of gain (channel - center), and lag of one control."""
    place = received(vehicle)
    base, spec = f"controls.{control}", vehicle.file.controls[control]
    parts = []
    for name in vehicle.channels_of(control):
        signal = prop(place[name])
        center = f"{base}.center.{name}"
        if center in vehicle.rows:
            signal = node("difference", signal, value(vehicle.value(center)))
        gain = [] if spec.mix is None else [value(vehicle.value(f"{base}.mix.{name}"))]
        parts.append(node("product", *gain, signal))
    if f"{base}.offset" in vehicle.rows:
        parts.append(value(vehicle.value(f"{base}.offset")))
    mixed = node("sum", *parts)
    if control not in lagged(vehicle):
        yield component(deflection(control), mixed)
        return
    deflected = deflection(control)
    yield from lag(f"{control}-rad", mixed, lag_start(control), vehicle.value(f"{base}.lag"), deflected)


def lag(name: str, command: Element, start: str, seconds: float, out: str) -> Iterator[Element]:
    """Yield what follows a command with a first-order lag, as property `out`; `start` is that of where it begins."""
    deviation, follower = f"stoop/command/{name}", f"stoop/lagged/{name}"
    constant, share = time_constant(seconds)
    yield component(deviation, node("difference", command, prop(start)))
    made = Element("lag_filter", {"name": follower})
    made.append(leaf("input", deviation))
    made.append(leaf("c1", number(1.0 / constant)))
    yield made
    parts = [prop(start), prop(follower)]
    if share > 0.0:
        parts.append(node("product", value(share), node("difference", prop(deviation), prop(follower))))
    yield component(out, node("sum", *parts))


def time_constant(seconds: float) -> tuple[float, float]:
    """Return time constant, s, and direct share of a lag, as :func:`stoop.vehicle.symbolic.forces.lagged` has them."""
    shortest = SymbolicEquations.SHORTEST_LAG
    ahead = max(shortest - seconds, 0.0) ** 2 / (2.0 * shortest)
    return ahead + seconds, ahead / (ahead + seconds)
