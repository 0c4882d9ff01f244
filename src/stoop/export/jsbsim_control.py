"""Recorded channels to deflections in JSBSim: delay, mixer, lag; what `vehicle-file.md` says of controls.

JSBSim's ``delay`` of N frames passes a signal N - 1 frames late (1.3.3), and none at all for N = 0. Fractions of
a frame are interpolated here. Its delays and lags begin with zeros, so what goes through them is the deviation
from a start value, which is a property.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final
from xml.etree.ElementTree import Element, SubElement

from stoop.export.jsbsim_function import leaf, node, number, prop, value
from stoop.export.jsbsim_model import channel, constant_thrust, deflection
from stoop.simulate import parameter_rows
from stoop.simulate.delays import input_delays
from stoop.simulate.initial import commanded
from stoop.simulate.trim import neutral_inputs
from stoop.vehicle import Vehicle

FRAME: Final = "simulation/channel-dt"


def start(name: str) -> str:
    """Return the property of the value that a delayed channel had before the flight began."""
    return f"stoop/start/{name}"


def lag_start(control: str) -> str:
    """Return the property of where a lagged surface stood before the flight began, rad."""
    return f"stoop/start/{control}-rad"


def delayed(name: str) -> str:
    """Return the property of a channel as the surfaces receive it."""
    return f"stoop/delayed/{name}"


def delays(vehicle: Vehicle) -> dict[str, float]:
    """Return the delay of each channel that has one, s."""
    return {vehicle.inputs[i]: float(vehicle.values[row]) for i, row in input_delays(vehicle)}


def lagged(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the controls whose surface follows with a lag."""
    return tuple(s.removesuffix(".lag") for s in vehicle.states if s.endswith(".lag"))


def flight_control(vehicle: Vehicle) -> Element:
    """Return the flight control section."""
    out = Element("flight_control", {"name": "controls"})
    neutral = neutral_inputs(vehicle, 0.0)
    late = delays(vehicle)
    for name, x in zip(vehicle.inputs, neutral.tolist(), strict=True):
        if name != "none":
            _declare(out, channel(name), x)
        if name in late:
            _declare(out, start(name), x)
    rows = parameter_rows(vehicle)
    for control in lagged(vehicle):
        _declare(out, lag_start(control), float(commanded(vehicle, control, rows, neutral)[0]))
    for name, x in constant_thrust(vehicle).items():
        _declare(out, name, x)
    for name, seconds in late.items():
        out.append(_channel(name, _delay(name, seconds)))
    for control in vehicle.controls:
        out.append(_channel(control, _surface(vehicle, control, late)))
    return out


def _declare(parent: Element, name: str, x: float) -> None:
    SubElement(parent, "property", {"value": number(x)}).text = name


def _channel(name: str, components: Iterator[Element]) -> Element:
    out = Element("channel", {"name": name})
    out.extend(components)
    return out


def _component(name: str, body: Element) -> Element:
    out = Element("fcs_function", {"name": name})
    out.append(node("function", body))
    return out


def _late(name: str, source: str, kind: str, amount: str) -> Element:
    out = Element("actuator", {"name": name})  # the only component of 1.3.3 that minds its delay
    out.append(leaf("input", source))
    SubElement(out, "delay", {"type": kind}).text = amount
    return out


def _delay(name: str, seconds: float) -> Iterator[Element]:
    """Yield what makes a channel late by a time that need not be whole frames."""
    moved, earlier, middle, later = (f"stoop/late/{name}-{i}" for i in range(4))
    yield _component(moved, node("difference", prop(channel(name)), prop(start(name))))
    yield _late(earlier, moved, "time", number(seconds))
    yield _late(middle, earlier, "frames", "2")
    yield _late(later, middle, "frames", "2")
    below = node("lt", value(seconds), prop(FRAME))
    between = node("ifthen", below, _blend(earlier, middle, seconds), _blend(middle, later, seconds))
    yield _component(delayed(name), node("sum", prop(start(name)), between))


def _blend(a: str, b: str, seconds: float) -> Element:
    """Return a value between one frame and the next: how far is the fraction of the delay in frames."""
    weight = node("fraction", node("quotient", value(seconds), prop(FRAME)))
    return node("sum", prop(a), node("product", weight, node("difference", prop(b), prop(a))))


def _surface(vehicle: Vehicle, control: str, late: dict[str, float]) -> Iterator[Element]:
    """Yield mixer and lag of one control."""
    if control not in lagged(vehicle):
        yield _component(deflection(control), _mix(vehicle, control, late))
        return
    moved, follower, begin = f"stoop/command/{control}-rad", f"stoop/lagged/{control}-rad", lag_start(control)
    yield _component(moved, node("difference", _mix(vehicle, control, late), prop(begin)))
    out = Element("lag_filter", {"name": follower})
    out.append(leaf("input", moved))
    out.append(leaf("c1", number(1.0 / vehicle.value(f"controls.{control}.lag"))))
    yield out
    yield _component(deflection(control), node("sum", prop(begin), prop(follower)))


def _mix(vehicle: Vehicle, control: str, late: dict[str, float]) -> Element:
    """Return offset + sum of gain (channel - center)."""
    base, spec = f"controls.{control}", vehicle.file.controls[control]
    parts = []
    for name in vehicle.channels_of(control):
        signal = prop(delayed(name) if name in late else channel(name))
        center = f"{base}.center.{name}"
        if center in vehicle.rows:
            signal = node("difference", signal, value(vehicle.value(center)))
        gain = [] if spec.mix is None else [value(vehicle.value(f"{base}.mix.{name}"))]
        parts.append(node("product", *gain, signal))
    if f"{base}.offset" in vehicle.rows:
        parts.append(value(vehicle.value(f"{base}.offset")))
    return node("sum", *parts)
