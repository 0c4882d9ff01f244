"""Target ``gazebo``: models for PX4 and ArduPilot in Gazebo, flown by the equations of its systems."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property, partial
from typing import Final

import numpy as np

from stoop import Vehicle
from stoop.extend.arrays import FloatArray, rotations
from stoop_export import gazebo_autopilots, gazebo_files, rotorpy_flight
from stoop_export.agreement import AXES, Compared, loads_along, omission, omitted_shares
from stoop_export.exporter import Exported, FullExporter, encoded
from stoop_export.gazebo_model import GazeboModel, gazebo_model, unsupported_rotor_numbers
from stoop_export.gazebo_plugins import Motor, Surface, damping_loads, motor_loads, wing_loads
from stoop_export.gazebo_wing import unsupported_wing_terms
from stoop_export.jsbsim_flight import Record
from stoop_export.reference_flight import ReferenceFlight, states_of
from stoop_export.rotorpy_flight import CHANNELS

SHORTEST: Final = 0.5  #: of the shortest lag, the longest step


class _Equations:
    """State: velocity and rates along body axes, quaternion, speeds of the motors, angles of the joints."""

    def __init__(self, model: GazeboModel) -> None:
        self.model, self.names = model, model.vehicle.inputs
        self.gravity = np.array([0.0, 0.0, model.vehicle.value("environment.gravity")])
        self.inverse = np.linalg.inv(model.inertia)
        self.motors = slice(10, 10 + len(model.motors))
        actuators: list[Motor | Surface] = [*model.motors, *model.surfaces]
        self.actuators, lags = actuators, np.array([a.lag for a in actuators])
        self.lags, self.prompt = np.where(lags > 0.0, lags, 1.0), lags == 0.0

    def commands(self, inputs: FloatArray) -> FloatArray:
        """Return commanded speeds and angles for recorded channels (n_u,)."""
        known = dict(zip(self.names, inputs.tolist(), strict=True))
        return np.array([a.command(known) for a in self.actuators])

    def loads(self, x: FloatArray, commands: FloatArray) -> FloatArray:
        """Return force and moment (6,) about the center of gravity; what has no lag is where it is commanded to be."""
        velocity, rates = x[:3].tolist(), x[3:6].tolist()
        x = np.concatenate([x[:10], np.where(self.prompt, commands, x[10:])])
        out = motor_loads(self.model.motors, x[self.motors].tolist(), velocity, rates)
        if self.model.damping is not None:
            out = out + damping_loads(self.model.damping, velocity, rates)
        if self.model.wing is not None:
            out = out + wing_loads(self.model.wing, x[self.motors.stop :].tolist(), velocity, rates)
        return np.asarray(out)

    def rates(self, x: FloatArray, inputs: FloatArray) -> FloatArray:
        """Return the derivatives of the state."""
        V, omega, q = x[:3], x[3:6], x[6:10]
        commands = self.commands(inputs)
        load = self.loads(x, commands)
        dV = load[:3] / self.model.mass + rotations.to_body(q[None], self.gravity)[0] - np.cross(omega, V)
        turning = self.inverse @ (load[3:] - np.cross(omega, self.model.inertia @ omega))
        dq = 0.5 * rotations.product(q[None], np.array([[0.0, *omega]]))[0]
        return np.concatenate([dV, turning, dq, (commands - x[10:]) / self.lags])

    def step(self, x: FloatArray, before: FloatArray, after: FloatArray, dt: float) -> FloatArray:
        """Return the state after a step of the Runge-Kutta method of order four, inputs linear in between."""
        middle = 0.5 * (before + after)
        k1 = self.rates(x, before)
        k2 = self.rates(x + 0.5 * dt * k1, middle)
        k3 = self.rates(x + 0.5 * dt * k2, middle)
        k4 = self.rates(x + dt * k3, after)
        out = x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        out[6:10] = rotations.normalized(out[6:10])
        return np.asarray(out)


def fly_gazebo(model: GazeboModel, flight: ReferenceFlight) -> FloatArray:
    """Return :data:`stoop_export.rotorpy_flight.CHANNELS` (n, 12) by the equations of Gazebo.

    At restarts motors and joints are where our own lags are, if the vehicle has lags, else at their commands.
    """
    vehicle, equations = flight.vehicle, _Equations(model)
    lags = equations.lags[~equations.prompt].tolist()
    steps = math.ceil(flight.dt / SHORTEST / min(lags)) if lags else 1
    columns = [vehicle.states.index(n) for n in ("u", "v", "w", "p", "q", "r", "e0", "e1", "e2", "e3")]
    rows, out = vehicle.parameter_rows(), np.full((len(flight.time), 12), np.nan)
    for part in flight.parts():
        own = flight.states[part.start]
        x = np.concatenate([own[columns], equations.commands(_lagged(model, flight, part.start, rows))])
        for k in range(part.start, part.stop):
            q = x[6:10]
            force = equations.loads(x, equations.commands(flight.inputs[k]))[:3] / model.mass
            out[k] = np.concatenate([rotations.to_ground(q, x[:3]), x[3:6], rotations.euler_angles(q), force])
            if k + 1 < part.stop:
                grid = np.linspace(flight.inputs[k], flight.inputs[k + 1], steps + 1)
                for before, after in itertools.pairwise(grid):
                    x = equations.step(x, before, after, flight.dt / steps)
    return out


def gazebo_loads(model: GazeboModel, flight: ReferenceFlight) -> FloatArray:
    """Return force, N, and moment, N m, (n, 6) by the equations of Gazebo at the states of our flight, without gravity."""
    vehicle, equations, rows = flight.vehicle, _Equations(model), flight.vehicle.parameter_rows()
    states = flight.states[:, [vehicle.states.index(n) for n in (*"uvwpqr", "e0", "e1", "e2", "e3")]]
    out = np.empty((len(states), 6))
    for k, own in enumerate(states):
        x = np.concatenate([own, equations.commands(_lagged(model, flight, k, rows))])
        out[k] = equations.loads(x, equations.commands(flight.inputs[k]))
    return out


def flown_alphas(records: Iterable[Record]) -> tuple[float, float] | None:
    """Return the range of the angles of attack, rad, that maneuvers flew on wings, at more than half of V*; None without any."""
    found: list[float] = []
    for record in records:
        vehicle, states = record.vehicle, states_of(record)
        u, w = (states[:, vehicle.states.index(a)] for a in "uw")
        flying = u > 0.5 * vehicle.value("reference.airspeed", math.inf)
        found += np.arctan2(w, u)[flying & np.isfinite(w)].tolist()
    return (min(found), max(found)) if found else None


def _lagged(model: GazeboModel, flight: ReferenceFlight, k: int, rows: FloatArray) -> FloatArray:
    """Return the channels (n_u,) that would hold rotors and surfaces where our lags are at a sample."""
    vehicle, out = flight.vehicle, flight.inputs[k].copy()
    x = dict(zip(vehicle.states, flight.states[k].tolist(), strict=True))
    for name in vehicle.rotors:
        if f"{name}.lag" in x and vehicle.value("rotors.lag") > 0.0:
            column = vehicle.inputs.index(vehicle.file.rotor[name].channel)
            gain = vehicle.value("rotors.gain", 1.0)
            out[column] += (x[f"{name}.lag"] - float(vehicle.commanded(name, rows, out)[0])) / gain
    behind = {c: x[f"{c}.lag"] for c in vehicle.controls if f"{c}.lag" in x}
    if behind:
        out = vehicle.mixed_inputs(behind, out)
    return np.asarray(out)


class Gazebo(FullExporter):
    """Models with all six degrees of freedom, whatever the fit had."""

    @cached_property
    def models(self) -> dict[str, GazeboModel]:
        """The model for each autopilot."""
        alphas = flown_alphas(self.model.maneuvers)
        return {
            title: gazebo_model(self.vehicle, self.point, alphas, title == "ArduPilot")
            for title in ("PX4", "ArduPilot")
        }

    def files(self) -> Exported:
        """Return the models with their worlds and the files of the autopilots."""
        px4, ardupilot = self.models["PX4"], self.models["ArduPilot"]
        notes = [*self.model.unidentified, *self.completed, *gazebo_autopilots.notes(ardupilot)]
        return Exported(encoded(gazebo_files.folders(px4, ardupilot)), f"{px4.name}/model.sdf", tuple(notes))

    def lacks(self) -> list[str]:
        """Return dead zones, rate limits and delays, and what they make."""
        return self.without_actuators(lambda numbers: f"Not exported: {', '.join(numbers)}.")

    def fly(self, made: Exported) -> Exported:
        """Fly hover and cruise by the equations of Gazebo's systems, and return what these leave out."""
        px4 = self.models["PX4"]
        starts = ((px4.hover, unsupported_rotor_numbers), (px4.cruise, unsupported_wing_terms))
        for start, unsupported in starts:
            if start is not None:
                made = self.along_reference(made, start, partial(self._compared, unsupported))
        return made

    def _compared(
        self, unsupported: Callable[[Vehicle], Mapping[str, float]], made: Exported, flight: ReferenceFlight
    ) -> Exported:
        shares = omitted_shares(flight, unsupported(self.vehicle))
        made = made.with_notes(omission("Gazebo", name, x) for name, x in shares.items())
        ours, names = np.hstack([loads_along(flight), rotorpy_flight.motion(flight)]), (*AXES, *CHANNELS)
        flown = []
        for title, model in self.models.items():
            theirs = np.hstack([gazebo_loads(model, flight), fly_gazebo(model, flight)])
            flown.append(Compared(f"Gazebo's equations for {title}", flight.title, names, ours, theirs))
        return made.with_flights(flown)
