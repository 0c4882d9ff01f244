"""Target ``crazyflow``: the parameter file of drone-models, whose first-principles model Crazyflow flies, and how it flies.

Thrust is a quadratic polynomial of the speed of rotation; x of a rotor is such a speed here, so that the static thrust is that of
the vehicle file at all commands. Drag is linear in the velocity along each body axis, at the center of gravity.

References
----------
drone-models 0.1: data/params.toml, first_principles/model.py (its gyroscopic moment about x has the sign of rotors that turn
the other way).
"""

from __future__ import annotations

import json
import math
from typing import Any, Final

import numpy as np

from stoop.extend.arrays import FloatArray, rotations
from stoop.extend.verbs import install
from stoop_export.agreement import Compared
from stoop_export.exporter import FLIP, Exported, installed, load_script, written
from stoop_export.learning_quad import REVOLUTIONS, Quad, QuadExporter, channels_behind
from stoop_export.reference_flight import ReferenceFlight
from stoop_export.rotorpy_flight import CHANNELS, TURN, motion, start_of

INSTALL: Final = install("crazyflow")
FASTEST_LAG: Final = 0.005  #: s, of a vehicle without one
HIGHEST_PWM: Final = 65535.0  #: of the firmware of the Crazyflie
_OWN: Final = ("rotors.drag", "rotors.inertia", *(f"body_drag.linear.{a}" for a in "xyz"))


class Crazyflow(QuadExporter):
    """A quadrotor for drone-models and Crazyflow."""

    tool = "drone-models"
    has = _OWN

    def parameters(self, quad: Quad) -> dict[str, Any]:
        """Return a section of the parameter file; speeds are in revolutions per minute."""
        arm = float(np.mean(quad.arms))
        rate = 1.0 / max(quad.lag, FASTEST_LAG)
        thrust = [quad.static[i] / REVOLUTIONS**i for i in range(3)]
        return {
            "gravity_vec": [0.0, 0.0, -quad.gravity],
            "mass": quad.mass,
            "L": arm,
            "J": quad.inertia.tolist(),
            "rpm2thrust": thrust,
            "rpm2torque": [quad.torque * c for c in thrust],
            "thrust2torque": quad.torque,
            "rotor_dyn_coef": [rate, 0.0, rate, 0.0],
            "rotor_dyn_coef_simple": rate,
            "thrust_dyn_coef": rate,
            "mixing_matrix": [(quad.places[:, 1] / arm).tolist(), (-quad.places[:, 0] / arm).tolist(), (-quad.turns).tolist()],
            "drag_matrix": np.diag(-quad.damping).tolist(),
            "prop_inertia": quad.rotor_inertia,
            "thrust_min": 0.0,
            "thrust_max": float(np.polyval(quad.static[::-1], quad.scale * (quad.full - quad.idle))),
            "pwm_min": 0.0,
            "pwm_max": HIGHEST_PWM,
        }  # fmt: skip

    def files(self) -> Exported:
        """Return the parameter file, and a script."""
        quad = self.quad
        rows = (
            f"{n} = {json.dumps(x)}" for n, x in self.parameters(quad).items()
        )  # TOML has JSON's numbers and arrays
        content = {"channels": quad.channels, "idle": quad.idle, "rpm": quad.scale * REVOLUTIONS}
        made = {"params.toml": "\n".join([f"[{quad.name}]", *rows]) + "\n"}
        return self.with_content(made, content, f"{quad.name}_crazyflow.py", "crazyflow_vehicle")

    def fly(self, made: Exported) -> Exported:
        """Fly the parameters along the reference flight, and return what drone-models leaves out of it."""

        def compare(made: Exported, flight: ReferenceFlight) -> Exported:
            made = self.with_omissions(made, flight)
            if not installed("drone_models"):
                return made.with_notes([f"Not flown: the package drone-models is not installed; {INSTALL}."])
            with written(made.files) as root:
                theirs = fly_drone_models(load_script(root / made.main), flight)
            return made.with_flights([Compared(self.tool, flight.title, CHANNELS, motion(flight), theirs)])

        return self.along_reference(made, self.point, compare)


def fly_drone_models(script: Any, flight: ReferenceFlight) -> FloatArray:
    """Return :data:`CHANNELS` (n, 12) by drone-models at the samples of a flight, by the Runge-Kutta method of order four.

    Its state is position, quaternion with the scalar last, velocity, rates, speeds of rotors; axes are forward, left, up. Its
    rate of the quaternion is not for integration (its docstring): that of the rates along body axes is taken.
    """
    model, vehicle = script.dynamics(), flight.vehicle
    columns = [vehicle.inputs.index(c) for c in script.CONTENT["channels"]]
    gravity = np.array(script.parameters()["gravity_vec"])
    out = np.full((len(flight.time), len(CHANNELS)), np.nan)
    steps = math.ceil(2.0 * flight.dt / max(vehicle.value("rotors.lag", 0.0), FASTEST_LAG))

    def rates(x: FloatArray, channels: FloatArray) -> FloatArray:
        q = x[3:7] / np.linalg.norm(x[3:7])
        velocity, _, force, turning, spin = model(x[:3], q, x[7:10], x[10:13], script.rpm(channels), x[13:])
        turned = 0.5 * rotations.product(np.roll(q, 1)[None], np.array([[0.0, *x[10:13]]]))[0]
        return np.concatenate([velocity, np.roll(turned, -1), force, turning, spin])

    def begin(k: int) -> FloatArray:
        _, q, velocity, omega = start_of(flight, k)
        speeds = script.rpm(channels_behind(flight, k, script.CONTENT["channels"]))
        return np.concatenate([np.zeros(3), np.roll(q, -1), rotations.to_ground(q, velocity), omega, speeds])

    for part in flight.parts():
        x = begin(part.start)
        for k in range(part.start, part.stop):
            q = rotations.normalized(np.roll(x[3:7], 1) * TURN)
            force = rotations.to_body(q, FLIP * (rates(x, flight.inputs[k][columns])[7:10] - gravity))
            out[k] = np.concatenate([FLIP * x[7:10], FLIP * x[10:13], rotations.euler_angles(q), force])
            if k + 1 < part.stop:
                u = np.linspace(flight.inputs[k][columns], flight.inputs[k + 1][columns], 2 * steps + 1)
                h = flight.dt / steps
                for i in range(steps):
                    k1 = rates(x, u[2 * i])
                    k2 = rates(x + 0.5 * h * k1, u[2 * i + 1])
                    k3 = rates(x + 0.5 * h * k2, u[2 * i + 1])
                    k4 = rates(x + h * k3, u[2 * i + 2])
                    x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return out
