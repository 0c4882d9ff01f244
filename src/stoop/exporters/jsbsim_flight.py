"""Fly an exported aircraft in JSBSim: given inputs, open loop, on a planet so large that it is flat.

A frame of JSBSim moves the state from t to t + dt with the accelerations found at t, then finds those at t + dt
from the inputs that stand there: inputs for t + dt are set before the frame. What it reports of accelerations at
the pilot is a frame old, so forces and angular accelerations are read instead.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import quaternions_of
from stoop.base.units import FOOT, POUND_FORCE, SLUG
from stoop.base.variables import EULER
from stoop.errors import SimulationError, StoopError
from stoop.exporters.jsbsim_model import channel, channel_start, constant_thrust, delays, lag_start, lagged
from stoop.exporters.record import Record
from stoop.simulation import parameter_rows
from stoop.simulation.delays import late_outputs
from stoop.simulation.initial import commanded, rigid_states
from stoop.vehicle import Vehicle

FRAME_RATE: Final = 1000.0  #: Hz at least
MIDDLE_LATITUDE: Final = math.pi / 4.0  #: rad, where the Earth pulls as the standard gravity does
INTEGRATORS: Final = {
    "simulation/integrator/rate/rotational": 5.0,
    "simulation/integrator/rate/translational": 5.0,
    "simulation/integrator/position/rotational": 5.0,
    "simulation/integrator/position/translational": 5.0,
}  #: Adams-Bashforth of order four
READ: Final[dict[str, tuple[str, float]]] = {
    "u": ("velocities/u-aero-fps", FOOT), "v": ("velocities/v-aero-fps", FOOT), "w": ("velocities/w-aero-fps", FOOT),
    "p": ("velocities/p-rad_sec", 1.0), "q": ("velocities/q-rad_sec", 1.0), "r": ("velocities/r-rad_sec", 1.0),
    "phi": ("attitude/phi-rad", 1.0), "theta": ("attitude/theta-rad", 1.0), "psi": ("attitude/psi-rad", 1.0),
    "h": ("position/h-sl-ft", FOOT),
    "X": ("forces/fbx-total-lbs", POUND_FORCE), "Y": ("forces/fby-total-lbs", POUND_FORCE),
    "Z": ("forces/fbz-total-lbs", POUND_FORCE),
    "mass": ("inertia/mass-slugs", SLUG),
    "pdot": ("accelerations/pdot-rad_sec2", 1.0), "qdot": ("accelerations/qdot-rad_sec2", 1.0),
    "rdot": ("accelerations/rdot-rad_sec2", 1.0),
}  #: name -> property and its unit in SI  # fmt: skip
START: Final[dict[str, tuple[str, float]]] = {
    "u": ("ic/u-fps", FOOT), "v": ("ic/v-fps", FOOT), "w": ("ic/w-fps", FOOT),
    "p": ("ic/p-rad_sec", 1.0), "q": ("ic/q-rad_sec", 1.0), "r": ("ic/r-rad_sec", 1.0),
    "phi": ("ic/phi-rad", 1.0), "theta": ("ic/theta-rad", 1.0), "psi": ("ic/psi-true-rad", 1.0),
    "h": ("ic/h-sl-ft", FOOT),
}  #: name -> property of the initial conditions and its unit in SI  # fmt: skip


@dataclass(frozen=True, eq=False)
class Sortie:
    """What is flown.

    Attributes
    ----------
    aircraft : str
        Name of a folder in ``root/aircraft``.
    start : mapping
        Of :data:`START`, SI and rad; body axes, relative to still air.
    time : (n,), s, uniform
    inputs : mapping of property to (n,)
        Linear between samples.
    held : mapping of property to value
        Set for the whole flight.
    planet : Path, optional
        A planet file; JSBSim's Earth when absent.
    frames : int
        Of JSBSim per sample.
    """

    aircraft: str
    start: Mapping[str, float]
    time: FloatArray
    inputs: Mapping[str, FloatArray]
    held: Mapping[str, float]
    planet: Path | None
    frames: int


def simulator(root: Path | None) -> Any:
    """Return a silent JSBSim that looks for aircraft in ``root/aircraft``, or among its own where there is none.

    Raises
    ------
    StoopError
        The package is not installed.
    """
    try:
        import jsbsim as imported
    except ModuleNotFoundError:
        raise StoopError("JSBSim: the package is not installed; pip install 'stoop[jsbsim]'") from None
    jsbsim: Any = imported
    jsbsim.FGJSBBase().debug_lvl = 0
    out = jsbsim.FGFDMExec(None if root is None else str(root))
    out.set_debug_level(0)
    return out


def frames_per_sample(dt: float, rate: float = FRAME_RATE) -> int:
    """Return how many frames of JSBSim a sample needs for a rate, Hz, of at least so much."""
    return max(1, math.ceil(dt * rate - 1e-9))


def fly(root: Path, sortie: Sortie) -> dict[str, FloatArray]:
    """Return what :data:`READ` names at each sample, SI and rad.

    Raises
    ------
    SimulationError
        JSBSim does not load the aircraft, or the flight diverges.
    """
    dt = float(sortie.time[1] - sortie.time[0])
    many = sortie.frames
    fdm = _ready(simulator(root), sortie, dt / many)
    nodes = [fdm.get_property_manager().get_node(name) for name in sortie.inputs]
    columns = np.stack(list(sortie.inputs.values()), axis=1) if nodes else np.zeros((len(sortie.time), 0))
    out = np.full((len(sortie.time), len(READ)), np.nan)
    watched = [(fdm.get_property_manager().get_node(name), unit) for name, unit in READ.values()]
    out[0] = [n.get_double_value() * unit for n, unit in watched]
    for k in range(1, len(sortie.time)):
        for j in range(1, many + 1):
            here = columns[k - 1] + (columns[k] - columns[k - 1]) * (j / many)
            for n, x in zip(nodes, here.tolist(), strict=True):
                n.set_double_value(x)
            fdm.run()
        out[k] = [n.get_double_value() * unit for n, unit in watched]
        if not np.isfinite(out[k]).all():
            raise SimulationError(f"{sortie.aircraft}: diverges in JSBSim at {sortie.time[k]:.2f} s")
    return dict(zip(READ, out.T, strict=True))


def _ready(fdm: Any, sortie: Sortie, dt: float) -> Any:
    """Load, and stand at the start."""
    fdm.set_dt(dt)
    if sortie.planet is not None:
        _insist(fdm.load_planet(str(sortie.planet), False), sortie, "its planet")
    _insist(fdm.load_model(sortie.aircraft), sortie, "its aircraft file")
    if sortie.planet is not None:
        fdm["simulation/gravity-model"] = 0.0
    first = {name: float(column[0]) for name, column in sortie.inputs.items()}
    _set(fdm, {**INTEGRATORS, **sortie.held, **first})
    latitude = MIDDLE_LATITUDE if sortie.planet is None else 0.0
    _set(fdm, {"ic/lat-geod-rad": latitude, "ic/long-gc-rad": 0.0})
    _set(fdm, {place: float(sortie.start.get(n, 0.0)) / unit for n, (place, unit) in START.items()})
    _insist(fdm.run_ic(), sortie, "its initial conditions")
    return fdm


def _set(fdm: Any, values: Mapping[str, float]) -> None:
    for name, x in values.items():
        fdm[name] = x


def _insist(done: bool, sortie: Sortie, what: str) -> None:
    if not done:
        raise SimulationError(f"{sortie.aircraft}: JSBSim does not take {what}; export it again")


def specific_force(flown: Mapping[str, FloatArray]) -> FloatArray:
    """Return (3, n) force other than weight over mass, body axes, m/s2."""
    return np.stack([flown[a] / flown["mass"] for a in "XYZ"])


def jsbsim_readings(
    root: Path,
    name: str,
    record: Record,
    planet: Path | None,
    rate: float = FRAME_RATE,
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
    flown = fly(root, sortie(name, record, planet, rate))
    vehicle = record.vehicle
    out = instruments(vehicle)(flown).T[None]
    return np.asarray(late_outputs(vehicle, out, parameter_rows(vehicle), record.dt)[0])


def sortie(name: str, record: Record, planet: Path | None, rate: float = FRAME_RATE) -> Sortie:
    """Return what JSBSim is to fly."""
    vehicle = record.vehicle
    rigid = {k: float(v[0]) for k, v in rigid_states(record.start).items() if k in (*"uvwpqr", "h")}
    start = rigid | {a: float(record.start.get(a, 0.0)) for a in EULER}
    columns = {n: record.inputs[:, i] for i, n in enumerate(vehicle.inputs) if n != "none"}
    held = {channel_start(n): float(columns[n][0]) for n in delays(vehicle)}
    frames = frames_per_sample(record.dt, rate)
    held |= {lag_start(c): _surface_start(record, c, record.dt / frames) for c in lagged(vehicle)}
    held |= constant_thrust(vehicle)
    return Sortie(name, start, record.time, {channel(n): c for n, c in columns.items()}, held, planet, frames)


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

    from stoop.vehicle.symbolic import readings
    from stoop.vehicle.symbolic.frames import Numbers, air, attitude, vane

    n = Numbers.of(vehicle)
    names = ("u", "v", "w", "p", "q", "r", "pdot", "qdot", "rdot", "X", "Y", "Z", "e0", "e1", "e2", "e3")
    s = {name: sp.Symbol(f"jsbsim {name}", real=True) for name in names}
    velocity, omega = (s["u"], s["v"], s["w"]), (s["p"], s["q"], s["r"])
    specific, omega_rate = (s["X"], s["Y"], s["Z"]), (s["pdot"], s["qdot"], s["rdot"])
    turned, flow = attitude((s["e0"], s["e1"], s["e2"], s["e3"])), vane(n, velocity, omega)
    observed = {"V": air(velocity).V, "alpha": flow.alpha, "beta": flow.beta}
    read = readings(n, observed, turned, specific, omega, omega_rate)
    numbers = dict(zip(n.symbols, vehicle.values.tolist(), strict=True))
    expressions = [sp.sympify(read[c]).xreplace(numbers) for c in vehicle.outputs]
    function = sp.lambdify(list(s.values()), expressions, "numpy")

    def apply(flown: Mapping[str, FloatArray]) -> FloatArray:
        force = dict(zip("XYZ", specific_force(flown), strict=True))
        angles = np.column_stack([flown[a] for a in EULER])
        turn = dict(zip(names[-4:], quaternions_of(angles).T, strict=True))
        known = {**flown, **force, **turn}
        columns = function(*(known[name] for name in names))
        return np.stack([np.broadcast_to(c, flown["u"].shape) for c in columns])

    return apply
