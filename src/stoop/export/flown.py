"""The same record flown by our own equations and by JSBSim, both as the vehicle's instruments would read it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import quaternions_of
from stoop.base.variables import EULER, WRAPPED
from stoop.errors import SimulationError
from stoop.export import jsbsim_flight
from stoop.export.jsbsim_control import delays, lag_start, lagged
from stoop.export.jsbsim_control import start as start_of
from stoop.export.jsbsim_model import channel, constant_thrust
from stoop.simulate import initial_states, parameter_rows
from stoop.simulate.delays import late_inputs, late_outputs
from stoop.simulate.initial import commanded, rigid_states
from stoop.vehicle import Vehicle


@dataclass(frozen=True, eq=False)
class Record:
    """A piece of flight to be flown open loop.

    Attributes
    ----------
    vehicle : Vehicle
        With the numbers that it is flown with, biases too.
    start : mapping
        Initial state by :data:`stoop.simulate.START_NAMES`; ``NAME.lag`` adds to a lagged deflection, rad.
    time : (n,), s, uniform
    inputs : (n, n_u)
        As recorded, in the order of ``vehicle.inputs``.
    """

    vehicle: Vehicle
    start: Mapping[str, float]
    time: FloatArray
    inputs: FloatArray

    @property
    def dt(self) -> float:
        """Sample period, s."""
        return float(self.time[1] - self.time[0])


def own_readings(record: Record, steps: int = 1) -> FloatArray:
    """Return what our own simulation reads: (n, n_y).

    Parameters
    ----------
    record : Record
    steps : int
        Runge-Kutta steps per sample. A delay that is no whole number of steps is interpolated with a cubic
        through the samples, which overshoots where the input jumps; with more steps the cubic becomes the line.

    Raises
    ------
    SimulationError
        It diverges.
    """
    vehicle = record.vehicle
    rows, inputs, dt = parameter_rows(vehicle), _between(record.inputs, steps), record.dt / steps
    begin = initial_states(vehicle, record.start, rows, inputs[0])
    flown = vehicle.kernel().trajectories(rows, begin, late_inputs(vehicle, inputs, rows, dt), dt)
    out = late_outputs(vehicle, flown[:, ::steps].copy(), rows, record.dt)[0]
    if not np.isfinite(out).all():
        last = record.time[int(np.argmin(np.isfinite(out).all(axis=1)))]
        raise SimulationError(
            f"{vehicle.where}: the flight diverges at {last:.2f} s; there is nothing to compare"
        )
    return np.asarray(out)


def _between(inputs: FloatArray, steps: int) -> FloatArray:
    """Return (n, n_u) inputs at more points of the lines between them."""
    coarse = np.arange(len(inputs))
    fine = np.arange((len(inputs) - 1) * steps + 1) / steps
    return np.stack([np.interp(fine, coarse, column) for column in inputs.T], axis=1)


def jsbsim_readings(
    root: Path,
    name: str,
    record: Record,
    planet: Path | None,
    rate: float = jsbsim_flight.FRAME_RATE,
) -> FloatArray:
    """Return what JSBSim flies, read by the same instruments: (n, n_y).

    Parameters
    ----------
    root : Path
        JSBSim's root folder.
    name : str
        Folder of the aircraft in it.
    record : Record
    planet : Path or None
        A planet file; JSBSim's own Earth without one.
    rate : float, Hz
        Of JSBSim's frames, at least.
    """
    flown = jsbsim_flight.fly(root, sortie(name, record, planet, rate))
    vehicle = record.vehicle
    out = instruments(vehicle)(flown).T[None]
    return np.asarray(late_outputs(vehicle, out, parameter_rows(vehicle), record.dt)[0])


def sortie(
    name: str, record: Record, planet: Path | None, rate: float = jsbsim_flight.FRAME_RATE
) -> jsbsim_flight.Sortie:
    """Return what JSBSim is to fly."""
    vehicle = record.vehicle
    rigid = {k: float(v[0]) for k, v in rigid_states(record.start).items() if k in (*"uvwpqr", "h")}
    start = rigid | {a: float(record.start.get(a, 0.0)) for a in EULER}
    columns = {n: record.inputs[:, i] for i, n in enumerate(vehicle.inputs) if n != "none"}
    held = {start_of(n): float(columns[n][0]) for n in delays(vehicle)}
    frames = jsbsim_flight.frames_per_sample(record.dt, rate)
    held |= {lag_start(c): _surface_start(record, c, record.dt / frames) for c in lagged(vehicle)}
    held |= constant_thrust(vehicle)
    return jsbsim_flight.Sortie(
        name, start, record.time, {channel(n): c for n, c in columns.items()}, held, planet, frames
    )


def _surface_start(record: Record, control: str, dt: float) -> float:
    """Return the start value that makes JSBSim's lag filter begin where the surface of the record does.

    The filter y1 = ca (x1 + x0) + cb y0 runs once before the flight, with zeros behind it; so the surface begins
    at S + ca (x0 - S) for a start value S and a command x0.
    """
    vehicle = record.vehicle
    step = dt / vehicle.value(f"controls.{control}.lag")
    command = float(commanded(vehicle, control, parameter_rows(vehicle), record.inputs[0])[0])
    return command + float(record.start.get(f"{control}.lag", 0.0)) * (2.0 + step) / 2.0


def instruments(vehicle: Vehicle) -> Any:
    """Return the function that reads (n_y, n) instruments off what JSBSim flew."""
    import sympy as sp

    from stoop.vehicle.symbolic import instruments as read
    from stoop.vehicle.symbolic.frames import air, attitude
    from stoop.vehicle.symbolic.symbols import Numbers

    n = Numbers.of(vehicle)
    names = ("u", "v", "w", "p", "q", "r", "pdot", "qdot", "rdot", "X", "Y", "Z", "e0", "e1", "e2", "e3")
    s = {name: sp.Symbol(f"jsbsim {name}", real=True) for name in names}
    velocity, omega = (s["u"], s["v"], s["w"]), (s["p"], s["q"], s["r"])
    felt = read.accelerometer(n, (s["X"], s["Y"], s["Z"]), omega, (s["pdot"], s["qdot"], s["rdot"]))
    turned = attitude((s["e0"], s["e1"], s["e2"], s["e3"]))
    truth = read.truth(air(velocity).V, read.vane(n, velocity, omega), omega, turned, felt)
    readings = read.readings(n, truth)
    numbers = dict(zip(n.symbols, vehicle.values.tolist(), strict=True))
    expressions = [sp.sympify(readings[c]).xreplace(numbers) for c in vehicle.outputs]
    function = sp.lambdify(list(s.values()), expressions, "numpy")

    def apply(flown: Mapping[str, FloatArray]) -> FloatArray:
        force = dict(zip("XYZ", jsbsim_flight.specific_force(flown), strict=True))
        angles = np.column_stack([flown[a] for a in EULER])
        turn = dict(zip(names[-4:], quaternions_of(angles).T, strict=True))
        known = {**flown, **force, **turn}
        columns = function(*(known[name] for name in names))
        return np.stack([np.broadcast_to(c, flown["u"].shape) for c in columns])

    return apply


def differences(vehicle: Vehicle, a: FloatArray, b: FloatArray) -> FloatArray:
    """Return b - a of readings (n, n_y), angles taken to the nearest turn."""
    out = b - a
    for i, name in enumerate(vehicle.outputs):
        if name in WRAPPED:
            out[:, i] -= 2.0 * np.pi * np.round(out[:, i] / (2.0 * np.pi))
    return out


def relative_differences(vehicle: Vehicle, ours: FloatArray, theirs: FloatArray) -> dict[str, float]:
    """Return the largest difference of each channel over the channel's largest magnitude."""
    apart = np.abs(differences(vehicle, ours, theirs)).max(axis=0)
    largest = np.abs(ours).max(axis=0)
    return {
        c: float(d / m) if m > 0.0 else float(d)
        for c, d, m in zip(vehicle.outputs, apart, largest, strict=True)
    }
