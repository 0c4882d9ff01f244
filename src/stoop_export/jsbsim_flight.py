"""Maneuvers flown by our own simulation and by JSBSim: given inputs, open loop, on a planet so large that it is flat.

A frame of JSBSim moves the state from t to t + dt with the accelerations found at t, then finds those at t + dt
from the inputs that stand there: inputs for t + dt are set before the frame. What it reports of accelerations at
the pilot is a frame old, so forces and angular accelerations are read instead.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop import Vehicle
from stoop.extend import motion
from stoop.extend.arrays import FloatArray, rotations
from stoop.extend.errors import SimulationError, StoopError
from stoop.extend.variables import FAMILIES
from stoop.extend.vehicles import SymbolicEquations
from stoop.extend.verbs import install
from stoop_export.jsbsim_loads import rotor_lag, rotor_start, slope_start
from stoop_export.jsbsim_model import (
    FOOT,
    POUND_FORCE,
    SLUG,
    actuators,
    channel,
    channel_start,
    constant_thrust,
    lag_start,
    lagged,
    time_constant,
)

AMPLITUDE: Final = 0.03  #: rad, of the inputs of a record
RATE: Final = 100.0  #: Hz, of the samples of a record
FRAME_RATE: Final = 1000.0  #: Hz at least, of JSBSim's frames
PLANET: Final = "flat.xml"
INTEGRATORS: Final = {
    f"simulation/integrator/{part}/{kind}": 5.0
    for part in ("rate", "position")
    for kind in ("rotational", "translational")
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
class Record:
    """A maneuver that is simulated open loop, all of it or from restart to restart.

    Attributes
    ----------
    vehicle : with the numbers that it is flown with, biases too
    start : initial state by :data:`stoop.simulation.START_NAMES`; ``NAME.lag`` adds to a lagged deflection, rad
    time : (n,), s, uniform
    inputs : (n, n_u) as recorded, in the order of ``vehicle.inputs``
    title : str
    measured : (n, n_y), readings of the instruments, NaN where there is none; None for a flight that was not flown
    loaded : whether it flew with numbers of a loading in place of the vehicle file's own
    restarts : sample and state, as `start`, of each restart, where an open loop would diverge
    """

    vehicle: Vehicle
    start: Mapping[str, float]
    time: FloatArray
    inputs: FloatArray
    title: str = ""
    measured: FloatArray | None = None
    loaded: bool = False
    restarts: tuple[tuple[int, Mapping[str, float]], ...] = ()

    def parts(self) -> Iterator[Record]:
        """Yield the flights from each start to the next, the samples of both included."""
        starts = ((0, self.start), *self.restarts)
        for (a, start), (b, _) in pairwise((*starts, (len(self.time) - 1, self.start))):
            part = slice(a, b + 1)
            yield replace(self, start=start, time=self.time[part], inputs=self.inputs[part], restarts=())

    @property
    def dt(self) -> float:
        """Sample period, s."""
        return float(self.time[1] - self.time[0])


def own_readings(record: Record, steps: int = 1) -> FloatArray:
    """Return the readings (n, n_y) of our own simulation.

    Parameters
    ----------
    record : Record
    steps : int
        Runge-Kutta steps per sample. A delay that is no whole number of steps is interpolated with a cubic
        through the samples, which overshoots where the input jumps; with more steps the cubic becomes the line.

    Raises
    ------
    SimulationError
        The simulation diverges.
    """
    if record.restarts:
        return joined(own_readings(part, steps) for part in record.parts())
    vehicle, count = record.vehicle, len(record.inputs)
    fine = np.arange((count - 1) * steps + 1) / steps
    inputs = np.stack([np.interp(fine, np.arange(count), column) for column in record.inputs.T], axis=1)
    rows, dt = vehicle.parameter_rows(), record.dt / steps
    begin = vehicle.initial_states(record.start, rows, inputs[0])
    flown = vehicle.kernel().trajectories(rows, begin, vehicle.late_inputs(inputs, rows, dt), dt)
    out = vehicle.late_outputs(flown[:, ::steps].copy(), rows, record.dt)[0]
    finite = np.isfinite(out).all(axis=1)
    if not finite.all():
        at = record.time[np.argmin(finite)]
        raise SimulationError(
            f"{vehicle.where}: the flight diverges at {at:.2f} s; there is nothing to compare"
        )
    return np.asarray(out)


def joined(parts: Iterable[FloatArray]) -> FloatArray:
    """Return the readings of parts as one flight; at a restart stand those of the part that ends there."""
    first, *rest = parts
    return np.concatenate([first, *(part[1:] for part in rest)])


def differences(names: Sequence[str], a: FloatArray, b: FloatArray) -> FloatArray:
    """Return b - a of channels (n, n_y), angles taken to the nearest turn."""
    out = b - a
    angles = [name in FAMILIES["circular"] for name in names]
    out[:, angles] -= 2.0 * np.pi * np.round(out[:, angles] / (2.0 * np.pi))
    return out


def relative_differences(names: Sequence[str], ours: FloatArray, theirs: FloatArray) -> dict[str, float]:
    """Return the largest difference of each channel over the channel's largest magnitude."""
    difference = np.abs(differences(names, ours, theirs)).max(axis=0)
    largest = np.abs(ours).max(axis=0)
    relative = difference / np.where(largest > 0.0, largest, 1.0)
    return dict(zip(names, relative.tolist(), strict=True))


def every_control(vehicle: Vehicle, point: motion.Trim, duration: float = 30.0) -> motion.Maneuver:
    """Return a 3-2-1-1 on each control one after the other, then a doublet on each."""
    gap = 0.45 * duration / max(len(vehicle.controls), 1)
    inputs = [
        {"control": c, "shape": shape, "start": first + i * gap, "step": min(step, gap / 8.0), "amplitude": AMPLITUDE}
        for shape, first, step in (("3-2-1-1", 0.03 * duration, 0.3), ("doublet", 0.53 * duration, 0.6))
        for i, c in enumerate(vehicle.controls)
    ]  # fmt: skip
    start = {"airspeed": point.start["V"], "altitude": point.start["h"]}
    return motion.Maneuver.model_validate({"duration": duration, "rate": RATE, **start, "input": inputs})


def maneuver_record(vehicle: Vehicle, point: motion.Trim, maneuver: motion.Maneuver) -> Record:
    """Return a maneuver from a steady flight, with the vehicle's numbers that this sets: a constant thrust."""
    flown = vehicle.with_numbers({name: {"value": value} for name, value in point.changes.items()})
    inputs = point.inputs_about(flown, maneuver.deflections(), len(maneuver.time))
    return Record(flown, point.start, maneuver.time, inputs)


def steady_record(vehicle: Vehicle, point: motion.Trim, duration: float = 30.0) -> Record:
    """Return a steady flight."""
    return maneuver_record(vehicle, point, motion.Maneuver(duration=duration, rate=RATE))


def excitation_record(vehicle: Vehicle, point: motion.Trim) -> Record | None:
    """Return :func:`every_control` in 30, 10 or 3 s, the first in which it does not diverge; None where it always does."""
    for duration in (30.0, 10.0, 3.0):
        out = maneuver_record(vehicle, point, every_control(vehicle, point, duration))
        with suppress(SimulationError):
            own_readings(out)
            return replace(
                out, title=f"{duration:g} s open loop from the steady flight, every control in turn"
            )
    return None


def file_name(name: str) -> str:
    """Return a name for files and folders that any system takes."""
    return re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-").lower()[:60].strip("-") or "vehicle"


@dataclass(frozen=True, eq=False)
class Settings:
    """What JSBSim is given for a record.

    Attributes
    ----------
    start : mapping of :data:`START`, SI and rad; body axes, relative to still air
    inputs : mapping of property to (n,), linear between samples
    constants : mapping of property to value for the whole flight
    """

    start: Mapping[str, float]
    inputs: Mapping[str, FloatArray]
    constants: Mapping[str, float]


def settings(record: Record, rate: float = FRAME_RATE) -> Settings:
    """Return what JSBSim is given for a record, with frames of a rate, Hz, of at least so much."""
    vehicle, rows = record.vehicle, record.vehicle.parameter_rows()
    begin = vehicle.initial_states(record.start, rows, record.inputs[0])[:, 0].tolist()
    states = dict(zip(vehicle.states, begin, strict=True))
    rigid = {k: states.get(k, 0.0) for k in "uvwhpqr"}
    start = rigid | {a: float(record.start.get(a, 0.0)) for a in FAMILIES["euler"]}
    columns = {n: record.inputs[:, i] for i, n in enumerate(vehicle.inputs) if n != "none"}
    constants = {channel_start(n): float(columns[n][0]) for n in actuators(vehicle)}
    starts = {
        c: (lag_start(c), time_constant(vehicle.value(f"controls.{c}.lag"))[0]) for c in lagged(vehicle)
    }
    if (constant := rotor_lag(vehicle)) is not None:
        starts |= {r: (rotor_start(r), constant) for r in vehicle.file.rotor}
    for name, (place, seconds) in starts.items():
        # The lag filter y1 = ca (x1 + x0) + cb y0 runs once before the flight, with zeros behind it; so the surface
        # begins at S + ca (x0 - S) for a start value S and a command x0.
        step = record.dt / frames_per_sample(record.dt, rate) / seconds
        command = float(vehicle.commanded(name, rows, record.inputs[0])[0])
        offset = float(record.start.get(f"{name}.lag", 0.0))
        constants[place] = command + offset * (2.0 + step) / 2.0
    for name in vehicle.sloped:
        first, second = columns[name][:2] if name not in actuators(vehicle) else columns[name][[0, 0]]
        constants[slope_start(name)] = float(second - first) / record.dt
    constants |= constant_thrust(vehicle)
    return Settings(start, {channel(n): c for n, c in columns.items()}, constants)


def simulator(root: Path | None) -> Any:
    """Return a silent JSBSim that looks for aircraft in ``root/aircraft``, or among its own; StoopError without jsbsim."""
    try:
        import jsbsim as imported
    except ModuleNotFoundError:
        raise StoopError(f"JSBSim: the package is not installed; {install('jsbsim')}") from None
    jsbsim: Any = imported
    jsbsim.FGJSBBase().debug_lvl = 0
    out = jsbsim.FGFDMExec(None if root is None else str(root))
    out.set_debug_level(0)
    return out


def frames_per_sample(dt: float, rate: float = FRAME_RATE) -> int:
    """Return how many frames of JSBSim a sample needs for a rate, Hz, of at least so much."""
    return max(1, math.ceil(dt * rate - 1e-9))


@dataclass(frozen=True, eq=False)
class Simulation:
    """JSBSim with an exported aircraft in it, at the start of a record.

    Attributes
    ----------
    fdm : its executive
    frames : of a sample
    inputs : (n,) of each property that the host sets along the record
    nodes : of these properties
    watched : nodes of :data:`READ`, each with its unit
    """

    fdm: Any
    frames: int
    inputs: Mapping[str, FloatArray]
    nodes: tuple[Any, ...]
    watched: tuple[tuple[Any, float], ...]

    def read(self) -> dict[str, float]:
        """Return the quantities of :data:`READ`, SI and rad."""
        return {n: node.get_double_value() * unit for n, (node, unit) in zip(READ, self.watched, strict=True)}

    def advance(self, before: FloatArray, after: FloatArray) -> None:
        """Let a sample pass, while the channels (n_u,) run on a straight line between two samples."""
        for j in range(1, self.frames + 1):
            here = before + (after - before) * (j / self.frames)
            for node, x in zip(self.nodes, here.tolist(), strict=True):
                node.set_double_value(x)
            self.fdm.run()


@dataclass(frozen=True, eq=False)
class Host:
    """How a backend runs JSBSim: frames per second, integrators, and what it drives the aircraft by.

    Attributes
    ----------
    rate : Hz, of JSBSim's frames, at least
    properties : that it sets; JSBSim's own integrators without those
    to_commands : from what JSBSim is given for a record by channels to what this host gives
    """

    rate: float = FRAME_RATE
    properties: Mapping[str, float] = field(default_factory=lambda: INTEGRATORS)
    to_commands: Callable[[Record, Settings], Settings] = lambda record, given: given

    def settings(self, record: Record) -> Settings:
        """Return what this host gives JSBSim for a record."""
        return self.to_commands(record, settings(record, self.rate))


EXPORTED: Final = Host()


def begin(root: Path, name: str, record: Record, planet: Path | None, host: Host = EXPORTED) -> Simulation:
    """Put an exported aircraft into JSBSim, at the start of a record; parameters as of :func:`jsbsim_readings`.

    Raises
    ------
    SimulationError
        JSBSim does not load the aircraft.
    """

    def check(done: bool, what: str) -> None:
        if not done:
            raise SimulationError(f"{name}: JSBSim does not take {what}; export it again")

    given, frames = host.settings(record), frames_per_sample(record.dt, host.rate)
    fdm = simulator(root)
    fdm.set_dt(record.dt / frames)
    latitude, own = math.pi / 4.0, {}  # at 45 deg the Earth pulls as the standard gravity does
    if planet is not None:
        check(fdm.load_planet(str(planet), False), "its planet")
        latitude, own = 0.0, {"simulation/gravity-model": 0.0}
    check(fdm.load_model(name), "its aircraft file")
    first = {place: float(column[0]) for place, column in given.inputs.items()}
    where = {"ic/lat-geod-rad": latitude, "ic/long-gc-rad": 0.0}
    start = {place: float(given.start.get(n, 0.0)) / unit for n, (place, unit) in START.items()}
    for place, x in {**own, **host.properties, **given.constants, **first, **where, **start}.items():
        fdm[place] = x
    check(fdm.run_ic(), "its initial conditions")
    properties = fdm.get_property_manager()
    nodes = tuple(properties.get_node(place) for place in given.inputs)
    watched = tuple((properties.get_node(place), unit) for place, unit in READ.values())
    return Simulation(fdm, frames, given.inputs, nodes, watched)


def fly(
    root: Path, name: str, record: Record, planet: Path | None, host: Host = EXPORTED
) -> dict[str, FloatArray]:
    """Return the quantities of :data:`READ` at each sample, SI and rad; parameters as of :func:`jsbsim_readings`.

    Raises
    ------
    SimulationError
        JSBSim does not load the aircraft, or the flight diverges.
    """
    simulation = begin(root, name, record, planet, host)
    given = list(simulation.inputs.values())
    columns = np.stack(given, axis=1) if given else np.zeros((len(record.time), 0))
    rows = [simulation.read()]
    for k in range(1, len(record.time)):
        simulation.advance(columns[k - 1], columns[k])
        rows.append(simulation.read())
        if not np.isfinite([*rows[-1].values()]).all():
            raise SimulationError(f"{name}: diverges in JSBSim at {record.time[k]:.2f} s")
    return {n: np.array([row[n] for row in rows]) for n in READ}


def jsbsim_readings(
    root: Path, name: str, record: Record, planet: Path | None, host: Host = EXPORTED
) -> FloatArray:
    """Return the flight of JSBSim, read by the same instruments: (n, n_y).

    Parameters
    ----------
    root : JSBSim's root folder
    name : folder of the aircraft in it
    record : Record
    planet : a planet file; JSBSim's own Earth without one
    host : Host
    """
    read = instruments(record.vehicle)
    return joined(read(fly(root, name, part, planet, host), part.dt) for part in record.parts())


def instruments(vehicle: Vehicle) -> Callable[[Mapping[str, FloatArray], float], FloatArray]:
    """Return what takes a flight of :data:`READ`, (n,) each, SI and rad, and its sample period to readings (n, n_y)."""
    import sympy as sp

    equations = SymbolicEquations(vehicle)
    names = ("u", "v", "w", "p", "q", "r", "pdot", "qdot", "rdot", "X", "Y", "Z", "e0", "e1", "e2", "e3")
    s = [sp.Symbol(f"jsbsim {key}", real=True) for key in names]
    velocity, omega, omega_rate, specific = (tuple(s[i : i + 3]) for i in range(0, 12, 3))
    read = equations.readings((s[12], s[13], s[14], s[15]), velocity, omega, omega_rate, specific)
    numbers = dict(zip(equations.numbers.symbols, vehicle.values.tolist(), strict=True))
    function = sp.lambdify(s, [sp.sympify(read[c]).xreplace(numbers) for c in vehicle.outputs], "numpy")

    def read_flight(flown: Mapping[str, FloatArray], dt: float) -> FloatArray:
        forces = {axis: flown[axis] / flown["mass"] for axis in "XYZ"}  # specific, without weight
        turn = dict(
            zip(
                names[-4:],
                rotations.quaternions_of(np.column_stack([flown[a] for a in FAMILIES["euler"]])).T,
                strict=True,
            )
        )
        known = {**flown, **forces, **turn}
        columns = function(*(known[key] for key in names))
        out = np.stack([np.broadcast_to(c, flown["u"].shape) for c in columns]).T[None]
        return np.asarray(vehicle.late_outputs(out, vehicle.parameter_rows(), dt)[0])

    return read_flight
