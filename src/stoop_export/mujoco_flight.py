"""Target ``mujoco``: a vehicle in MJCF with a callback, flown by MuJoCo beside our own simulation."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Final

import numpy as np

from stoop import Vehicle
from stoop.extend.arrays import FloatArray, rotations
from stoop.extend.verbs import install
from stoop_export.agreement import AXES, Compared, loads_along, rigid_loads
from stoop_export.exporter import FLIP, Exported, encoded, installed, load_script, written
from stoop_export.mujoco_model import mujoco_model
from stoop_export.parameter_sets import RandomizedExporter
from stoop_export.reference_flight import ReferenceFlight
from stoop_export.rotorpy_flight import CHANNELS, TURN, motion, start_of

INSTALL: Final = install("mujoco")


def _put(flown: Any, script: Any, flight: ReferenceFlight, k: int) -> None:
    """Give MuJoCo our state and channels at sample k of a flight."""
    vehicle, rows = flight.vehicle, flight.vehicle.parameter_rows()
    flown.command(flight.inputs[k])
    x, q, velocity, rates = start_of(flight, k)
    actuators = np.array(
        [
            x[f"{a}.lag"]
            if f"{a}.lag" in x
            else vehicle.commanded(a, rows, flight.inputs[k])[0]
            if not a.startswith("propulsion.")
            else flight.inputs[k][vehicle.inputs.index(a.removeprefix("propulsion."))]
            for a in script.CONTENT["actuators"]
        ]
    )
    command = flown.data.ctrl.copy()
    place = (0.0, 0.0, x["h"] - script.CONTENT["altitude"])
    flown.put(place, q, velocity, rates, actuators)
    flown.data.ctrl[:] = command
    flown.forward()


def _turned(flown: Any) -> FloatArray:
    """Return the quaternion of MuJoCo's state, axes forward, right, down."""
    return np.asarray(rotations.normalized(flown.data.qpos[flown.turned] * TURN))


def _accelerations(flown: Any) -> tuple[FloatArray, FloatArray]:
    """Return specific force, m/s2, and angular acceleration, rad/s2, along body axes forward, right, down."""
    specific = FLIP * (flown.data.qacc[flown.velocity] - flown.model.opt.gravity)
    return rotations.to_body(_turned(flown), specific), FLIP * flown.data.qacc[flown.rates]


def mujoco_loads(script: Any, flight: ReferenceFlight) -> FloatArray:
    """Return :data:`AXES` (n, 6) by MuJoCo at the states of a flight, from its accelerations."""
    flown, vehicle, out = script.Vehicle(), flight.vehicle, np.empty((len(flight.time), len(AXES)))
    omega = flight.states[:, [vehicle.states.index(a) for a in "pqr"]]
    for k in range(len(flight.time)):
        _put(flown, script, flight, k)
        specific, turning = _accelerations(flown)
        force = vehicle.value("mass.mass") * specific
        out[k] = rigid_loads(vehicle, force[:, None], omega[k][:, None], turning[:, None])[:, 0]
    return out


def fly_mujoco(script: Any, flight: ReferenceFlight) -> FloatArray:
    """Return :data:`CHANNELS` (n, 12) by MuJoCo at the samples of a flight.

    MuJoCo holds a command over its step: it is given that of the middle, on a straight line between the samples.
    """
    flown, out = script.Vehicle(), np.full((len(flight.time), len(CHANNELS)), np.nan)
    count = round(flight.dt / flown.model.opt.timestep)
    shares = (np.arange(count) + 0.5) / count
    for part in flight.parts():
        _put(flown, script, flight, part.start)
        for k in range(part.start, part.stop):
            flown.command(flight.inputs[k])
            flown.forward()
            specific, _ = _accelerations(flown)
            ground, rates = flown.data.qvel[flown.velocity], flown.data.qvel[flown.rates]
            out[k] = np.concatenate(
                [FLIP * ground, FLIP * rates, rotations.euler_angles(_turned(flown)), specific]
            )
            if k + 1 < part.stop:
                for share in shares:
                    flown.step((1.0 - share) * flight.inputs[k] + share * flight.inputs[k + 1])
    return out


class MuJoCo(RandomizedExporter):
    """A vehicle in MJCF, and a callback with the identified equations."""

    def files(self) -> Exported:
        """Return model, numbers and script."""
        made = mujoco_model(self.vehicle, self.point)
        return Exported(encoded(made.texts), f"{made.name}.xml", (*self.model.unidentified, *self.completed))

    def numbers_of(self, vehicle: Vehicle) -> dict[str, float]:
        """Return the numbers of the vehicle file but those of instruments; the callback takes all."""
        changes = self.steady(vehicle).changes if self.point.changes else None  # a thrust for steady flight
        values = vehicle.parameter_rows(changes)[:, 0].tolist()
        names = (p.name for p in vehicle.parameters)
        return {n: x for n, x in zip(names, values, strict=True) if not n.startswith("sensors.")}

    @cached_property
    def drawn(self) -> tuple[dict[str, FloatArray], int]:
        """The numbers (D,) of the parameter sets that differ from the estimates, which are in the model."""
        (sets, lost), own = super().drawn, self.numbers_of(self.vehicle)
        return {n: x for n, x in sets.items() if np.any(x != own[n])}, lost

    def lacks(self) -> list[str]:
        """Return dead zones, rate limits and delays, and what they make."""
        advice = "The MuJoCo model has no {}: give it channels as rotors and surfaces receive them."
        return self.without_actuators(lambda numbers: advice.format(", ".join(numbers)))

    def fly(self, made: Exported) -> Exported:
        """Fly model and callback along the reference flight."""
        if not installed("mujoco"):
            return made.with_notes([f"Not flown: the package mujoco is not installed; {INSTALL}."])

        def compare(made: Exported, flight: ReferenceFlight) -> Exported:
            with written(made.files) as root:
                script = load_script(root / made.main.replace(".xml", "_mujoco.py"))
                theirs = np.hstack([mujoco_loads(script, flight), fly_mujoco(script, flight)])
            ours = np.hstack([loads_along(flight), motion(flight)])
            return made.with_flights([Compared("MuJoCo", flight.title, (*AXES, *CHANNELS), ours, theirs)])

        return self.along_reference(made, self.point, compare)
