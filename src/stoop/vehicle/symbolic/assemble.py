"""From a vehicle to its equations; reduced models by substitution in the same equations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sympy as sp

from stoop.kernels import SymbolicModel
from stoop.vehicle.symbolic import component, forces, instruments, moves, rigid_body, rotors, turbulence
from stoop.vehicle.symbolic.atmosphere import symbolic_density
from stoop.vehicle.symbolic.frames import air, attitude, over_ground, quaternion_rate, slow_air
from stoop.vehicle.symbolic.latex import equations
from stoop.vehicle.symbolic.symbols import Numbers, Vector, scale
from stoop.vehicle.vehicle import RIGID_STATES, Vehicle, slope_input

_WRAPPED = ("phi", "psi")


def _commands(n: Numbers, channels: Mapping[str, Any]) -> dict[str, Any]:
    """Return the commanded deflection of each control: calibration and mixer, rad."""
    out = {}
    for control in n.vehicle.controls:
        spec = n.vehicle.file.controls[control]
        base = f"controls.{control}"
        if spec.mix is None:
            out[control] = channels[control] + n.get(f"{base}.offset")
            continue
        mixed = sum(n[f"{base}.mix.{c}"] * (channels[c] - n.get(f"{base}.center.{c}")) for c in spec.mix)
        out[control] = mixed + n.get(f"{base}.offset")
    return out


def _density(n: Numbers, altitude: Any, channels: Mapping[str, Any]) -> Any:
    choice = n.vehicle.file.environment.density
    if choice == "log":
        return channels["density"]
    return symbolic_density(altitude) if choice == "standard" else n["environment.density"]


def _lags(
    n: Numbers, states: Mapping[str, Any], commands: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return deflections (lagged where the file says so) and the lag states' rates."""
    deflections, rates = dict(commands), {}
    for control, command in commands.items():
        name = f"{control}.lag"
        if name in states:
            deflections[control] = states[name]
            rates[name] = (command - states[name]) / n[f"controls.{control}.lag"]
    return deflections, rates


def full_model(
    vehicle: Vehicle,
) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any], dict[str, Any], Numbers]:
    """Return symbols of states and channels, rates of states, readings of instruments, numbers."""
    n = Numbers.of(vehicle)
    further = [s for s in vehicle.states if s not in RIGID_STATES]
    x = {s: sp.Symbol(f"state {s}", real=True) for s in (*RIGID_STATES, *further)}
    u = {c: sp.Symbol(f"input {c}", real=True) for c in vehicle.inputs}
    velocity: Vector = (x["u"], x["v"], x["w"])
    omega: Vector = (x["p"], x["q"], x["r"])
    e = (x["e0"], x["e1"], x["e2"], x["e3"])
    through_air = turbulence.relative(n, velocity, x)
    turned, wind = attitude(e), (slow_air if vehicle.has_rotors else air)(through_air)
    deflections, lag_rates = _lags(n, x, _commands(n, u))
    spins, lagging = rotors.spins(n, x, rotors.commands(n, u))
    spin_rates = lagging or rotors.slopes(n, u)
    density = _density(n, x["h"], u)
    s = component.Surroundings(n, wind, density, omega, deflections, u, through_air, spins, spin_rates)
    load = forces.total(s)
    specific = scale(1 / n["mass.mass"], load.force)
    omega_rate = rigid_body.angular_acceleration(n, load.moment, omega)
    velocity_rate = rigid_body.acceleration(specific, n["environment.gravity"], turned.down, velocity, omega)
    climb = -sum(d * v for d, v in zip(turned.down, velocity, strict=True))
    rates = [*velocity_rate, *omega_rate, *quaternion_rate(e, omega), climb]
    felt = instruments.accelerometer(n, specific, omega, omega_rate)
    if vehicle.has_rotors:
        truth = instruments.ground_truth(over_ground(e, velocity), omega, turned, felt)
    else:
        truth = instruments.truth(wind.V, instruments.vane(n, through_air, omega), omega, turned, felt)
    further_rates = lag_rates | {f"{r}.lag": rate for r, rate in lagging.items()} | turbulence.rates(n, x, u)
    return (
        x,
        u,
        dict(zip(RIGID_STATES, rates, strict=True)) | further_rates,
        instruments.readings(n, truth),
        n,
    )


_REDUCTIONS: dict[str, tuple[str, ...]] = {
    "full": (),
    "longitudinal": ("v", "p", "r", "e1", "e3"),
    "lateral": ("q",),
}  #: states that are zero
_HELD: dict[str, tuple[str, ...]] = {"full": (), "longitudinal": (), "lateral": ("u", "w", "q", "h")}


def build_model(vehicle: Vehicle) -> SymbolicModel:
    """Return the equations of a vehicle, reduced as its file says.

    The longitudinal model sets v = p = r = phi = psi = 0; the lateral one holds u, w, h at their initial
    values and q at zero.
    """
    x, u, rates, readings, n = full_model(vehicle)
    zero = {x[s]: sp.Integer(0) for s in _REDUCTIONS[vehicle.reduce]}
    held = _HELD[vehicle.reduce]
    derivatives = [sp.Integer(0) if s in held else rates[s].subs(zero) for s in vehicle.states]
    outputs = [sp.sympify(readings[c]).subs(zero) for c in vehicle.outputs]
    move = {name: sp.Symbol(f"move {name}", real=True) for name in vehicle.moves}
    kept = {s: x[s].subs(zero) for s in vehicle.states}
    return SymbolicModel(
        states=tuple(x[s] for s in vehicle.states),
        inputs=tuple(u[c] for c in vehicle.inputs),
        held=tuple(vehicle.inputs.index(slope_input(c)) for c in vehicle.sloped),
        parameters=n.symbols,
        derivatives=tuple(derivatives),
        outputs=tuple(outputs),
        output_names=vehicle.outputs,
        wrapped=tuple(c in _WRAPPED for c in vehicle.outputs),
        moves=tuple(move.values()),
        moved=moves.moved(vehicle, kept, move),
        latex=equations(vehicle),
    )
