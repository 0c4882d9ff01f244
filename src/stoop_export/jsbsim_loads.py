"""Force and moment of a whole vehicle as JSBSim functions, printed from the expressions of the compiled kernel.

A vehicle whose loads are more than the coefficients along JSBSim's wind axes (rotors, drag of the body, ground effect) gets
three forces through its center of gravity and three moments about the body axes, as external reactions. Their functions are the
sum over all components, common parts once, in SI. Every number in them but mass properties and lags is a property,
``stoop/number/NAME``, that can be changed in flight. Rotors follow their commands in the flight control section, before the loads
of the same frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final
from xml.etree.ElementTree import Element, SubElement

import sympy as sp

from stoop import Vehicle
from stoop_export.jsbsim_model import (
    DENSITY,
    FOOT,
    POUND_FORCE,
    THRUST,
    Printer,
    air_density,
    component,
    constant_thrust,
    function,
    lag,
    leaf,
    node,
    number,
    prop,
    received,
    time_constant,
    value,
)

number_place: Final = "stoop/number/{}".format  #: property of a number of the vehicle
rotor_speed: Final = "stoop/rotor/{}".format  #: of x of a rotor: its command, or rad/s
rotor_start: Final = "stoop/start/{}-x".format  #: of x of a lagged rotor before the flight began
_slope: Final = "stoop/slope/{}".format  #: of the slope of a channel, per s
slope_start: Final = "stoop/start/{}-slope".format  #: of the slope with which a channel begins, per s
_last: Final = "stoop/last/{}".format  #: of a channel as it was a frame ago
_FRAME: Final = "simulation/channel-dt"
_LOADS: Final = {
    "force": (("x", "N", POUND_FORCE), ("y", "N", POUND_FORCE), ("z", "N", POUND_FORCE)),
    "moment": tuple((a, "Nm", POUND_FORCE * FOOT) for a in ("x", "y", "z")),
}  #: axis, unit and that unit of JSBSim in SI


def summed(vehicle: Vehicle) -> bool:
    """Return whether the loads are written as one sum in body axes; else as coefficients, as of wings alone."""
    file = vehicle.file
    tables = any(table is not None for table in (file.rotors, file.body_drag, file.ground_effect))
    return tables or "propulsion.inertia" in vehicle.rows


def rotor_lag(vehicle: Vehicle) -> float | None:
    """Return the time constant of the rotors' lag, s; None where they have no lag."""
    return time_constant(vehicle.value("rotors.lag"))[0] if "rotors.lag" in vehicle.rows else None


def _channels(printer: Printer) -> dict[str, Any]:
    """Return the channels as they are received, and their slopes."""
    sloped = printer.vehicle.sloped
    places = received(printer.vehicle) | {f"{c}.slope": _slope(c) for c in sloped}
    return {name: printer.symbol(f"channel {name}", place) for name, place in places.items()}


def summed_loads(vehicle: Vehicle, center: Element) -> tuple[list[Element], Element]:
    """Return what the flight control section has more, and the external reactions.

    `center` is the location of the center of gravity.
    """
    # mass properties are JSBSim's own, and lags are filters: what the expressions have of them are constants
    printer = Printer(vehicle, ("mass.", "rotors.lag"))
    # a constant thrust has its property on every vehicle
    own = dict.fromkeys(("propulsion.thrust",), THRUST) if constant_thrust(vehicle) else {}
    unknown = [s for s in printer.numbers.symbols if s not in printer.known]
    printer.names |= {s: own.get(s.name, number_place(s.name)) for s in unknown}
    channels, reactions = list(_rotors(printer)), _reactions(printer, center)
    numbers = [
        _declared(place, vehicle.value(s.name))
        for s in printer.numbers.symbols
        if s in printer.used and (place := printer.names[s]) != THRUST
    ]
    return [*numbers, *channels], reactions


def _rotors(printer: Printer) -> Iterator[Element]:
    """Yield properties and channels of the flight control section that take recorded channels to rotor speeds."""
    vehicle = printer.vehicle
    constant = rotor_lag(vehicle)
    positions = {
        f"{r}.lag": printer.symbol(f"position {r}", f"stoop/lagged-x/{r}") for r in vehicle.file.rotor
    }
    inputs = _channels(printer)
    commands = printer.equations.rotor_commands(inputs)
    rates = printer.equations.spin_rates(positions, inputs)  # of x, where that acts on the body
    inertia = "rotors.inertia" in vehicle.rows
    for name in vehicle.file.rotor if constant is not None else ():
        yield _declared(rotor_start(name), 0.0)
    for name in vehicle.sloped:
        for place in (_last(name), slope_start(name)):
            yield _declared(place, 0.0)
        now = received(vehicle)[name]
        passed = node("quotient", node("difference", prop(now), prop(_last(name))), prop(_FRAME))
        begun = node("gt", prop(_FRAME), value(0.0))  # before the flight a frame has no length
        kept = component(f"stoop/kept/{name}", prop(now))
        kept.append(leaf("output", _last(name)))
        out = Element("channel", {"name": f"slope of {name}"})
        out.append(component(_slope(name), node("ifthen", begun, passed, prop(slope_start(name)))))
        out.append(kept)
        yield out
    for name, command in commands.items():
        out = Element("channel", {"name": f"rotor {name}"})
        if constant is None:
            out.append(component(rotor_speed(name), printer.element(command)))
        else:
            seconds, follower = vehicle.value("rotors.lag"), f"{name}-x"
            out.extend(lag(follower, printer.element(command), rotor_start(name), seconds, rotor_speed(name)))
            if inertia:
                behind = node(
                    "difference", prop(f"stoop/command/{follower}"), prop(f"stoop/lagged/{follower}")
                )
                out.append(component(f"stoop/rate/{name}", node("product", value(1.0 / constant), behind)))
        if inertia and constant is None:
            out.append(component(f"stoop/rate/{name}", printer.element(rates[name])))
        yield out


def _reactions(printer: Printer, center: Element) -> Element:
    """Return the external reactions that are the loads of a vehicle."""
    vehicle = printer.vehicle
    speeds = {a: f"stoop/air/{a}-m_sec" for a in "uvw"}
    u, v, w = (printer.symbol(f"air {a}", place) for a, place in speeds.items())
    spins = {r: printer.symbol(f"x {r}", rotor_speed(r)) for r in vehicle.file.rotor}
    turned = vehicle.file.rotor if "rotors.inertia" in vehicle.rows else ()
    total = printer.equations.load(
        (u, v, w),
        omega=printer.rates(),
        density=printer.symbol("density", DENSITY),
        deflections=printer.deflections(),
        channels=_channels(printer),
        spins=spins,
        spin_rates={r: printer.symbol(f"rate {r}", f"stoop/rate/{r}") for r in turned},
    )
    steps, results = sp.cse(
        [sp.sympify(e).xreplace(printer.known) for e in (*total.force, *total.moment)],
        sp.numbered_symbols("step", real=True),
        order="none",
    )
    out = Element("external_reactions")
    for axis, place in speeds.items():
        out.append(function(place, node("product", prop(f"velocities/{axis}-aero-fps"), value(FOOT))))
    out.append(air_density(vehicle))
    for symbol, expr in steps:
        out.append(function(place := f"stoop/step/{symbol.name}", printer.element(expr)))
        printer.names[symbol] = place
    axes = [(kind, *axis) for kind, group in _LOADS.items() for axis in group]
    for (kind, axis, unit, size), expr in zip(axes, results, strict=True):
        out.append(function(place := f"stoop/{kind}/{axis}-{unit}", printer.element(expr)))
        made = Element(kind, {"name": f"{kind}-{axis}", "frame": "BODY"})
        SubElement(made, "function").append(node("product", prop(place), value(1.0 / size)))
        if kind == "force":
            made.append(center)
        direction = SubElement(made, "direction")
        direction.extend(leaf(a, number(float(a == axis))) for a in ("x", "y", "z"))
        out.append(made)
    return out


def _declared(place: str, x: float) -> Element:
    """Return a property and its value."""
    out = leaf("property", place)
    out.set("value", number(x))
    return out
