"""A vehicle flown by RotorPy beside our own simulation: restarted at our states, with the same recorded channels."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np

from stoop.extend.arrays import FloatArray, rotations
from stoop.extend.verbs import install
from stoop_export import rotorpy_model
from stoop_export.agreement import AXES, Compared, body_loads, loads_along, omission, omitted_shares
from stoop_export.exporter import FLIP, Exported, Exporter, encoded, installed, load_script, written
from stoop_export.reference_flight import ReferenceFlight

INSTALL: Final = install("rotorpy")
TURN: Final = np.array([1.0, 1.0, -1.0, -1.0])  #: of a quaternion, whose scalar RotorPy has last
CHANNELS: Final = ("vn", "ve", "vd", "p", "q", "r", "phi", "theta", "psi", "fx", "fy", "fz")
"""What is compared: motion, and the specific force at the center of gravity."""
INTEGRATOR: Final = {"method": "RK45", "rtol": 1e-6, "atol": 1e-8}  #: so that the models are compared


def held_flight(flight: ReferenceFlight) -> ReferenceFlight:
    """Return the flight as it is with inputs that are held over a sample, as RotorPy does: at the means of its ends."""
    vehicle, rows, states = flight.vehicle, flight.vehicle.parameter_rows(), flight.states.copy()
    nothing = np.zeros(len(vehicle.gusts))
    for part in flight.parts():
        for k in range(part.start, part.stop - 1):
            held = np.repeat(flight.inputs[k : k + 2].mean(axis=0)[None], 2, axis=0)
            before = flight.states[k] if k == part.start else states[k]
            states[k + 1] = vehicle.next_states(
                rows, before[:, None], held[:, :, None], [nothing], flight.dt
            )[:, 0]
    return replace(flight, states=states)


def motion(flight: ReferenceFlight) -> FloatArray:
    """Return :data:`CHANNELS` (n, 12) of our own flight."""
    vehicle = flight.vehicle
    rows = vehicle.parameter_rows(None, len(flight.states))
    loads = body_loads(vehicle, rows, flight.states.T, flight.inputs.T)
    x = dict(zip(vehicle.states, flight.states.T, strict=True))
    V, omega = (np.column_stack([x[a] for a in axes]) for axes in ("uvw", "pqr"))
    q = np.column_stack([x[f"e{i}"] for i in range(4)])
    force = loads[:3].T / vehicle.value("mass.mass")
    return np.column_stack([rotations.to_ground(q, V), omega, rotations.euler_angles(q), force])


def start_of(flight: ReferenceFlight, k: int) -> tuple[dict[str, float], FloatArray, FloatArray, FloatArray]:
    """Return our states by name at sample k of a flight, and of these the motion along axes forward, left, up.

    It is the quaternion (4,), scalar first, from the world north, west, up; velocity (3,), m/s; rates (3,), rad/s.
    """
    x = dict(zip(flight.vehicle.states, flight.states[k].tolist(), strict=True))
    turned = np.array([x[f"e{i}"] for i in range(4)]) * TURN
    return x, turned, FLIP * [x[a] for a in "uvw"], FLIP * [x[a] for a in "pqr"]


def _state(script: Any, flight: ReferenceFlight, k: int, stock: bool) -> dict[str, FloatArray]:
    """Return the state of RotorPy's own model, or of the identified class, at sample k of a flight."""
    x, q, velocity, rates = start_of(flight, k)
    turning = np.array([x[f"{r}.lag"] for r in flight.vehicle.rotors if f"{r}.lag" in x])
    if not turning.size:
        turning = _channels(flight)[k]
        speeds = script.speeds(turning) if stock else turning
    else:
        speeds = script.turned(turning) if stock else turning
    place = np.array([0.0, 0.0, x["h"] - script.ALTITUDE])
    motion = {"v": rotations.to_ground(q, velocity), "q": np.roll(q, -1), "w": rates}
    return {**script.start(speeds), "x": place, **motion}


def _channels(flight: ReferenceFlight) -> FloatArray:
    """Return the channels (n, 4) of the rotors."""
    vehicle = flight.vehicle
    return flight.inputs[:, [vehicle.inputs.index(rotor.channel) for rotor in vehicle.file.rotor.values()]]


def rotorpy_loads(script: Any, flight: ReferenceFlight, stock: bool) -> FloatArray:
    """Return :data:`AXES` (n, 6) by RotorPy at the states of a flight, from its accelerations."""
    rotorpy = (script.stock if stock else script.Identified)()
    channels, out = _channels(flight), np.empty((len(flight.time), len(AXES)))
    for k, own in enumerate(channels):
        state = _state(script, flight, k, stock)
        command = script.speeds(own) if stock else own
        rates = rotorpy.statedot(state, {"cmd_motor_speeds": command}, flight.dt)
        q, omega = np.roll(state["q"], 1) * TURN, state["w"]
        force = rotations.to_body(q, FLIP * (rotorpy.mass * rates["vdot"] - rotorpy.weight))
        moment = rotorpy.inertia @ rates["wdot"] + np.cross(omega, rotorpy.inertia @ omega)
        out[k] = np.concatenate([force, FLIP * moment])
    return out


def fly_rotorpy(script: Any, flight: ReferenceFlight, stock: bool) -> FloatArray:
    """Return :data:`CHANNELS` (n, 12) of RotorPy's own model, or of the identified class, at the samples of a flight.

    RotorPy holds a command over a step: it is given the mean of those at the two samples.
    """
    # The flight is that before `held_flight`: its states are those of the restarts.
    rotorpy = (script.stock if stock else script.Identified)(integrator_kwargs=INTEGRATOR)
    channels = _channels(flight)
    out = np.full((len(flight.time), len(CHANNELS)), np.nan)
    for part in flight.parts():
        state = _state(script, flight, part.start, stock)
        for k in range(part.start, part.stop):
            command = script.speeds(channels[k]) if stock else channels[k]
            rates = rotorpy.statedot(state, {"cmd_motor_speeds": command}, flight.dt)
            q = rotations.normalized(np.roll(state["q"], 1) * TURN)
            force = rotations.to_body(q, FLIP * (rates["vdot"] - rotorpy.weight / rotorpy.mass))
            out[k] = np.concatenate([FLIP * state["v"], FLIP * state["w"], rotations.euler_angles(q), force])
            if k + 1 < part.stop:
                ahead = script.speeds(channels[k + 1]) if stock else channels[k + 1]
                mean = {"cmd_motor_speeds": 0.5 * (command + ahead)}
                state = rotorpy.step(state, mean, flight.dt)
    return out


class RotorPy(Exporter):
    """A quadrotor for RotorPy: its own model, and a class with the identified equations."""

    def files(self) -> Exported:
        """Return parameters and script."""
        made = rotorpy_model.rotorpy_model(self.vehicle, self.point)
        return Exported(encoded(made.texts), f"{made.name}_rotorpy.py", self.model.unidentified)

    def lacks(self) -> list[str]:
        """Return dead zones, rate limits and delays, and what they make."""
        advice = "RotorPy has no {}: give it channels as rotors receive them."
        return self.without_actuators(lambda numbers: advice.format(", ".join(numbers)))

    def fly(self, made: Exported) -> Exported:
        """Fly both vehicles along the reference flight, and return what RotorPy's own model leaves out of it."""

        def compare(made: Exported, flight: ReferenceFlight) -> Exported:
            shares = omitted_shares(flight, rotorpy_model.limits(self.vehicle))
            made = made.with_notes(omission("RotorPy's own model", name, x) for name, x in shares.items())
            if not installed("rotorpy"):
                return made.with_notes([f"Not flown: the package rotorpy is not installed; {INSTALL}."])
            with written(made.files) as root:
                module = load_script(root / made.main)
            ours, flown = np.hstack([loads_along(flight), motion(held_flight(flight))]), []
            for title, stock in (("the identified equations", False), ("RotorPy's own model", True)):
                theirs = np.hstack([rotorpy_loads(module, flight, stock), fly_rotorpy(module, flight, stock)])
                flown.append(
                    Compared(f"RotorPy with {title}", flight.title, (*AXES, *CHANNELS), ours, theirs)
                )
            return made.with_flights(flown)

        return self.along_reference(made, self.point, compare)
