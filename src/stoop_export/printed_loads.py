"""Force and moment of a vehicle as Python source, printed from the expressions of the compiled kernel.

Names in the source are made here; numbers, channels and actuators are elements of lists, so that no text of a user's file
becomes code, and every number can be changed without printing again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import sympy as sp

from stoop import Vehicle
from stoop.extend.errors import SimulationError
from stoop.extend.vehicles import SymbolicEquations


@dataclass(frozen=True)
class PrintedLoads:
    """Source of two functions, and the order of their arguments.

    Attributes
    ----------
    numbers : of the vehicle, by name
    actuators : rotors, controls, and the channel of the thrust
    channels : recorded channels
    lags : for each actuator the number that holds its lag; None where it has none
    commands : body of ``commands(number, channel)``, of commanded x of rotors, rad and thrust channel
    loads : body of ``loads(number, motion, actuator, rate, channel, altitude)``, of Fx, Fy, Fz, N, and Mx, My, Mz, N m, without
        gravity, about the center of gravity, axes forward, right, down
    """

    numbers: tuple[str, ...]
    actuators: tuple[str, ...]
    channels: tuple[str, ...]
    lags: tuple[str | None, ...]
    commands: str
    loads: str


def printed_loads(vehicle: Vehicle) -> PrintedLoads:
    """Return the loads of a vehicle as source.

    Raises
    ------
    SimulationError
        The vehicle has reduced equations, or needs slopes of channels.
    """
    if vehicle.reduce != "full" or vehicle.motion:
        raise SimulationError(
            f'{vehicle.where}: the export needs the full equations of motion; set model.reduce = "full"'
        )
    if vehicle.sloped:
        raise SimulationError(
            f"{vehicle.where}: the reaction to the spin-up of rotors without a lag needs slopes of channels; give rotors.lag"
        )
    equations, file = SymbolicEquations(vehicle), vehicle.file
    n = equations.numbers
    channels = {c: _item("channel", i) for i, c in enumerate(vehicle.inputs)}
    commands = equations.rotor_commands(channels) | {c: _mixed(n, c, channels) for c in vehicle.controls}
    thrust = None if file.propulsion is None else getattr(file.propulsion, "channel", None)
    if thrust is not None:
        commands[f"propulsion.{thrust}"] = channels[thrust]
    at = {a: _item("actuator", i) for i, a in enumerate(commands)}
    driven = channels | ({thrust: at[f"propulsion.{thrust}"]} if thrust is not None else {})
    rates = {r: _item("rate", i) for i, r in enumerate(commands) if r in vehicle.rotors}
    u, v, w, p, q, r = (_item("motion", i) for i in range(6))
    density = equations.density(sp.Symbol("altitude", real=True), channels)
    turned = rates if "rotors.inertia" in n else {}
    total = equations.load(
        (u, v, w),
        omega=(p, q, r),
        density=density,
        deflections=at,
        channels=driven,
        spins=at,
        spin_rates=turned,
    )
    named = {s: _item("number", i) for i, s in enumerate(n.symbols)}
    lags = (_lag(vehicle, a) for a in commands)
    return PrintedLoads(
        tuple(s.name for s in n.symbols), tuple(commands), vehicle.inputs, tuple(lags),
        _body([*commands.values()], named), _body([*total.force, *total.moment], named),
    )  # fmt: skip


def _item(name: str, index: int) -> Any:
    return sp.Symbol(f"{name}[{index}]", real=True)


def _mixed(n: Any, control: str, channels: dict[str, Any]) -> Any:
    """Return the commanded deflection of a control, rad."""
    base, mix = f"controls.{control}", n.vehicle.file.controls[control].mix
    if mix is None:
        return channels[control] + n.get(f"{base}.offset")
    mixed = (n[f"{base}.mix.{c}"] * (channels[c] - n.get(f"{base}.center.{c}")) for c in mix)
    return sum(mixed, n.get(f"{base}.offset"))


def _lag(vehicle: Vehicle, actuator: str) -> str | None:
    """Return the number that is the lag of an actuator; None where it follows its command at once."""
    name = "rotors.lag" if actuator in vehicle.rotors else f"controls.{actuator}.lag"
    return name if vehicle.value(name, 0.0) > 0.0 else None


def _body(wanted: list[Any], named: dict[Any, Any]) -> str:
    """Return the lines of a function that computes expressions, common parts once."""
    steps, results = sp.cse(
        [sp.sympify(e).xreplace(named) for e in wanted], sp.numbered_symbols("t", real=True), order="none"
    )
    lines = [f"    {s} = {SymbolicEquations.text(e)}" for s, e in steps]
    return "\n".join([*lines, f"    return [{', '.join(SymbolicEquations.text(e) for e in results)}]"])
