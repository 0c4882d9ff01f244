"""`stoop trim` and `linearize`: a steady straight flight or a hover, and the linear model about it."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from stoop.base.files import write_file
from stoop.base.numbers import without_rounding
from stoop.base.text import show
from stoop.cli import options
from stoop.cli.page import blocks, fixed, number, numbers, page, shown_unit, to_json, words
from stoop.cli.progress import LiveLine
from stoop.errors import SimulationError

if TYPE_CHECKING:
    from stoop.simulation import LinearModel, Trim
    from stoop.vehicle import Vehicle

ANGLES: Final = ("alpha", "beta", "theta", "phi")
CONSTANT_THRUST: Final = "propulsion.thrust"
STATE_UNITS: Final = {"h": "m", "u": "m/s", "v": "m/s", "w": "m/s"}


def _trimmed(arguments: argparse.Namespace) -> tuple[Vehicle, Trim, str]:
    """Return the vehicle, the steady flight that the command line asks for, and that in words."""
    from stoop.simulation import trim
    from stoop.simulation.steady_flight import steady_flight
    from stoop.vehicle import Vehicle
    from stoop.vehicle.schema import Quantity
    from stoop.workflow.flying import warn_of_extrapolation
    from stoop.workflow.load import model_or_vehicle

    model, given = model_or_vehicle(arguments.vehicle), arguments.density
    vehicle = model if isinstance(model, Vehicle) else model.vehicle
    choice = vehicle.file.environment.density
    if given is not None and choice != "log":
        environment = vehicle.file.environment.model_copy(update={"density": Quantity(value=given)})
        vehicle = replace(vehicle, file=vehicle.file.model_copy(update={"environment": environment}))
        choice = environment.density
    vehicle = vehicle if arguments.reduce is None else vehicle.reduced(arguments.reduce)
    flight = steady_flight(vehicle, arguments.airspeed)
    for name in flight.refused:
        if getattr(arguments, name):
            raise SimulationError(f"--{name.replace('_', '-')}: {vehicle.where} {flight.advice}")
    # A lateral model holds speed and incidence, so its steady flight is that of the full equations.
    flown = vehicle.reduced("full") if vehicle.reduce == "lateral" else vehicle
    with LiveLine(options.COMPILING):
        point = trim(
            flown, arguments.airspeed, arguments.altitude, arguments.climb_angle, given,
            arguments.velocity, arguments.wind, arguments.heading,
        )  # fmt: skip
    warn_of_extrapolation(model, point)

    if choice == "standard":
        density = "standard atmosphere"
    elif choice != "log":
        density = f"density {vehicle.value('environment.density'):g} kg/m3"
    else:
        density = f"density {point.inputs[flown.inputs.index('density')]:.4g} kg/m3"
        if given is None:
            density += " (standard atmosphere at this altitude; the log has the true one, or give --density)"
    height = point.start["h"]
    if point.on_wings:
        speed, climb = point.start["V"], round(math.degrees(point.climb_angle), 4) + 0.0
        where = f"steady straight flight at {speed:g} m/s, {height:g} m, climb {climb:g} deg, {density}"
        return vehicle, point, where
    velocity, wind = (" ".join(f"{x:g}" for x in v) for v in (point.velocity, point.wind))
    what = f"steady flight at {velocity} m/s (north east down)" if any(point.velocity) else "hover"
    windy = f", wind {wind} m/s (north east down)" if any(point.wind) else ""
    heading = math.degrees(point.start["psi"])
    return vehicle, point, f"{what} at {height:g} m, heading {heading:g} deg{windy}, {density}"


def trim(arguments: argparse.Namespace) -> int:
    """Trim and print."""
    vehicle, point, where = _trimmed(arguments)
    if arguments.json:
        show(to_json(trim_document(vehicle, point)))
        return 0
    out = page()
    out.line(vehicle.name)
    out.line(where)
    out.heading("Angles and controls")
    rows = {n: point.start[n] for n in ANGLES if n in point.start} | point.deflections
    degrees = [math.degrees(value) for value in rows.values()]
    out.table(words("", rows), fixed("deg", degrees, 4), fixed("rad", rows.values(), 6))
    if point.on_wings:
        out.heading("Thrust")
        for name, value in point.thrust.items():
            line = f"{name} {value:.4f} {shown_unit(_thrust_unit(name))}".rstrip()
            if name == CONSTANT_THRUST:
                line = f"{value:.2f} N (the vehicle file says {vehicle.value(name):.2f} N)"
            out.line(line)
        if not point.thrust:
            out.line("none: the vehicle has no propulsion")
    mixed = {name: value for name, value in _channels(vehicle, point).items() if name not in rows}
    if mixed:
        out.heading("Recorded channels that hold it")
        units = [shown_unit(_thrust_unit(name)) for name in mixed]
        out.table(words("", mixed), numbers("value", mixed.values()), words("", units))
    if not point.on_wings:
        out.heading("Velocity through the air, body axes")
        out.table(words("", "uvw"), fixed("m/s", [point.start[axis] for axis in "uvw"], 4))
    out.line()
    residual = number(without_rounding(point.residual, vehicle.value("environment.gravity")), 2)
    out.line(f"largest acceleration left over: {residual} (m/s2, rad/s2)")
    return 0


def trim_document(vehicle: Vehicle, point: Trim) -> dict[str, Any]:
    """Return the trim for JSON, SI and rad."""
    start = point.start
    flown: dict[str, Any] = {"velocity": point.velocity, "wind": point.wind, "altitude": start["h"]}
    if "V" in start:
        climb = without_rounding(point.climb_angle, 1.0)
        flown = {"airspeed": start["V"], "altitude": start["h"], "climb_angle": climb}
    else:
        flown["heading"] = start["psi"]
    return {
        "format": "stoop-trim/1",
        "vehicle": vehicle.name,
        "file": vehicle.where,
        "reduce": vehicle.reduce,
        **flown,
        "angles": {name: without_rounding(start[name], 1.0) for name in ANGLES if name in start},
        "controls": {name: without_rounding(angle, 1.0) for name, angle in point.deflections.items()},
        "thrust": {n: {"value": value, "unit": _thrust_unit(n)} for n, value in point.thrust.items()},
        "inputs": _channels(vehicle, point),
        "residual": point.residual,
    }


def _channels(vehicle: Vehicle, point: Trim) -> dict[str, float]:
    """Return the recorded channels that hold the flight, SI."""
    inputs = zip(vehicle.recorded, point.inputs.tolist(), strict=False)
    return {name: without_rounding(value, 1.0) for name, value in inputs}


def _thrust_unit(name: str) -> str:
    """Return the unit of a thrust, be it a number of the vehicle or a channel."""
    from stoop.base.variables import VARIABLES

    if name == CONSTANT_THRUST:
        return "N"
    return VARIABLES[name].unit if name in VARIABLES else "1"


def linearize(arguments: argparse.Namespace) -> int:
    """Linearize and print, or write."""
    from stoop.simulation import linearize as linear_model
    from stoop.simulation.linearize import left_out

    target: Path | None = arguments.json
    vehicle, point, where = _trimmed(arguments)
    model, out = linear_model(vehicle, point), page()
    if target is None:
        out.line(vehicle.name)
        out.line(f"linear model about {where}")
        _print_model(vehicle, model)
        out.bullets(left_out(vehicle))
        return 0
    text = to_json(linear_document(vehicle, point, model))
    if target == options.STDOUT:
        show(text)
        return 0
    write_file(target, text + "\n")
    out.line(f"wrote {target}: A, B, C, D, modes and trim (SI units, rad)")
    out.bullets(left_out(vehicle))
    return 0


def linear_document(vehicle: Vehicle, point: Trim, model: LinearModel) -> dict[str, Any]:
    """Return the linear model for JSON, SI and rad."""
    figures = ("name", "frequency", "damping", "time_constant")
    modes = [
        {
            **{key: getattr(m, key) for key in figures},
            "eigenvalue": {"real": m.eigenvalue.real, "imag": m.eigenvalue.imag},
        }
        for m in model.modes
    ]
    return {
        "format": "stoop-linear-model/1",
        "vehicle": vehicle.name,
        "file": vehicle.where,
        "reduce": vehicle.reduce,
        "trim": trim_document(vehicle, point),
        "states": model.states,
        "inputs": model.inputs,
        "outputs": model.outputs,
        **{name: getattr(model, name).tolist() for name in "ABCD"},
        "input_delays": model.input_delays.tolist(),
        "output_delays": model.output_delays.tolist(),
        "modes": modes,
    }


def _print_model(vehicle: Vehicle, model: LinearModel) -> None:
    from stoop.base.variables import VARIABLES

    out, modes = page(), model.modes
    amplitudes = []  # how fast each mode dies away or grows
    for mode in modes:
        time = math.log(2.0) * mode.time_constant
        text = f"halves in {time:.2f} s" if time > 0.0 else f"doubles in {-time:.2f} s"
        amplitudes.append(text if math.isfinite(time) else "stays")
    out.heading("Modes")
    periods = [2.0 * math.pi / m.eigenvalue.imag if m.eigenvalue.imag > 0.0 else math.nan for m in modes]
    out.table(
        words("", [mode.name for mode in modes]),
        fixed("rad/s", [mode.frequency for mode in modes], 4),
        fixed("damping", [mode.damping for mode in modes], 4),
        fixed("period s", periods, 3),
        fixed("time constant s", [mode.time_constant for mode in modes], 3),
        words("amplitude", amplitudes),
    )
    out.heading("x' = A x + B u, y = C x + D u (SI units and rad, about the steady flight)")
    # Deflections and their lags are in rad; lags of rotors have no unit.
    known = {name: shown_unit(one.unit) for name, one in VARIABLES.items()} | STATE_UNITS
    known |= {f"{rotor}.lag": "" for rotor in vehicle.rotors}
    for letter, names in (("x", model.states), ("u", model.inputs), ("y", model.outputs)):
        out.line(f"{letter}: " + ", ".join(f"{name} {known.get(name, 'rad')}".rstrip() for name in names))
    sides = {"A": (0, 0), "B": (0, 1), "C": (2, 0), "D": (2, 1)}
    groups = (model.states, model.inputs, model.outputs)
    for name, (rows, heads) in sides.items():
        matrix = getattr(model, name)
        pairs = zip(groups[heads], matrix.T.tolist(), strict=True)
        columns = [numbers(head, column) for head, column in pairs]
        for block in blocks(words(name, groups[rows]), columns, out.width):
            out.line()
            out.table(*block)
