"""Target ``pyflyt``: a folder of PyFlyt's QuadX, flown by PyFlyt beside our own simulation.

A command of a motor, ``pwm``, is its speed over the fastest; PyFlyt's lag acts on it as ours on x. The drag of its body is
quadratic, the same along all axes; it has no drag or inflow of rotors. Gains of its rate controller give a first-order
response of `RATE_CONSTANT`; those of the loops around it are PyFlyt's own for a vehicle of 1 kg.

References
----------
J. J. Tai, J. Wong, M. Innocente, N. Horri, J. Brusey, S. K. Phang, "PyFlyt: UAV Simulation Environments for Reinforcement
Learning Research", arXiv:2304.01305, 2023. PyFlyt 0.29: core/drones/quadx.py, core/abstractions/motors.py, boring_bodies.py.
"""

from __future__ import annotations

import json
import warnings
from typing import Any, Final

import numpy as np

from stoop.extend.arrays import FloatArray, rotations
from stoop.extend.verbs import install
from stoop_export.agreement import Compared
from stoop_export.exporter import FLIP, Exported, installed, load_script, written
from stoop_export.learning_quad import REVOLUTIONS, Quad, QuadExporter, channels_behind, urdf
from stoop_export.reference_flight import ReferenceFlight
from stoop_export.rotorpy_flight import CHANNELS, TURN, motion, start_of

INSTALL: Final = install("pyflyt")
LINKS: Final = ("front_right_prop", "back_left_prop", "front_left_prop", "back_right_prop", "body")
AIR_DENSITY: Final = 1.225  #: kg/m3, of PyFlyt's drag
RATE_CONSTANT: Final = 0.1  #: s, of the closed loops of the rates
STEPS: Final = 1200  #: a second, when we fly it: its motors have Euler's method, and forces act along the axes of a step ago
FASTEST_LAG: Final = 1.0 / 240.0  #: s, of a vehicle without one: PyFlyt divides by it
MOTION: Final = CHANNELS[:9]  #: what PyFlyt gives: velocity, rates, angles


class PyFlyt(QuadExporter):
    """A quadrotor for PyFlyt."""

    tool = "PyFlyt"

    def parameters(self, quad: Quad) -> dict[str, Any]:
        """Return numbers of the description and of the motors; speeds are in revolutions per minute."""
        constant = quad.constant / REVOLUTIONS**2
        return {
            "mass": quad.mass,
            "inertia": np.diag(quad.inertia),
            "thrust_coef": constant,
            "torque_coef": float(quad.turns[0]) * quad.torque * constant,
            "total_thrust": 4.0 * quad.constant * quad.fastest**2,
            "tau": max(quad.lag, FASTEST_LAG),
            "drag_coef_xyz": 2.0 * float(quad.drag.mean()) / AIR_DENSITY,
            "gravity": quad.gravity,
            "pwm_gain": quad.speed_gain / quad.fastest,
            "pwm_offset": quad.offset / quad.fastest,
        }

    @property
    def omitted(self) -> dict[str, float]:
        """Numbers of terms that PyFlyt leaves out; its quadratic drag is that of the vehicle."""
        return {n: end for n, end in super().omitted.items() if not n.startswith("body_drag.quadratic")}

    def files(self) -> Exported:
        """Return the folder, and a script."""
        quad = self.quad
        p, folder = self.parameters(quad), f"{quad.name}/{quad.name}"
        content = {
            "channels": quad.channels, "gravity": quad.gravity, "idle": quad.idle,
            "pwm_gain": p["pwm_gain"], "pwm_offset": p["pwm_offset"],
        }  # fmt: skip
        made = {f"{folder}.urdf": urdf(quad, LINKS), f"{folder}.yaml": _yaml(quad, p)}
        return self.with_content(made, content, f"{quad.name}_pyflyt.py", "pyflyt_vehicle")

    def fly(self, made: Exported) -> Exported:
        """Fly the folder along the reference flight, and return what PyFlyt leaves out of it."""

        def compare(made: Exported, flight: ReferenceFlight) -> Exported:
            made = self.with_omissions(made, flight)
            if not installed("PyFlyt"):
                return made.with_notes([f"Not flown: the package PyFlyt is not installed; {INSTALL}."])
            with written(made.files) as root:
                theirs = fly_pyflyt(load_script(root / made.main), flight)
            return made.with_flights(
                [Compared(self.tool, flight.title, MOTION, motion(flight)[:, :9], theirs)]
            )

        return self.along_reference(made, self.point, compare)


def _yaml(quad: Quad, p: dict[str, Any]) -> str:
    """Return the parameters of QuadX."""
    hover = quad.hover / quad.fastest
    per_pwm = 2.0 * quad.constant * quad.fastest**2 * hover  # N, of one rotor at hover
    forward, side = quad.arms
    arms = np.array([side, forward, abs(quad.torque)])
    kp = np.diag(quad.inertia) / (4.0 * per_pwm * arms * RATE_CONSTANT)
    gains = {
        "ang_vel": (kp.tolist(), [0.0] * 3, [0.0] * 3, [1.0] * 3),
        "ang_pos": ([2.0] * 3, [0.0] * 3, [0.0] * 3, [3.0] * 3),
        "lin_vel": ([0.3] * 2, [0.03] * 2, [0.0] * 2, [0.4] * 2),
        "lin_pos": ([1.0] * 2, [0.0] * 2, [0.0] * 2, [2.0] * 2),
        "z_pos": (1.0, 0.0, 0.0, 1.0),
        "z_vel": (0.5, hover, 0.0, 1.0),
    }
    numbers = {
        "motor_params": {
            **{k: p[k] for k in ("total_thrust", "thrust_coef", "torque_coef")}, "noise_ratio": 0.0, "tau": p["tau"],
        },
        "drag_params": {"drag_coef_xyz": p["drag_coef_xyz"], "drag_area_xyz": 1.0, "drag_coef_pqr": 0.0},
        "control_params": {n: dict(zip(("kp", "ki", "kd", "lim"), g, strict=True)) for n, g in gains.items()},
    }  # fmt: skip
    return json.dumps(numbers, indent=1) + "\n"  # YAML contains JSON


def fly_pyflyt(script: Any, flight: ReferenceFlight, steps: int = STEPS) -> FloatArray:
    """Return :data:`MOTION` (n, 9) by PyFlyt at the samples of a flight, with so many steps a second."""
    vehicle, out = flight.vehicle, np.full((len(flight.time), len(MOTION)), np.nan)
    with warnings.catch_warnings(action="ignore"):  # PyFlyt recommends 240 steps a second
        flown = script.aviary(physics_hz=steps)
    flown.setTimeStep(1.0 / steps)
    (drone,) = flown.drones
    columns = [vehicle.inputs.index(c) for c in script.CONTENT["channels"]]
    count = round(steps * flight.dt)
    shares = (np.arange(count) + 0.5) / count
    for part in flight.parts():
        _, q, *motions = start_of(flight, part.start)
        flown.resetBasePositionAndOrientation(drone.Id, (0.0, 0.0, 100.0), np.roll(q, -1).tolist())
        flown.resetBaseVelocity(drone.Id, *(rotations.to_ground(q, x).tolist() for x in motions))
        drone.update_state()
        drone.motors.throttle[:] = script.pwm(channels_behind(flight, part.start, script.CONTENT["channels"]))
        for k in range(part.start, part.stop):
            now, after = flight.inputs[k][columns], flight.inputs[min(k + 1, part.stop - 1)][columns]
            _, turned = flown.getBasePositionAndOrientation(drone.Id)
            velocity, rates = map(np.array, flown.getBaseVelocity(drone.Id))
            q = rotations.normalized(np.roll(turned, 1) * TURN)
            out[k] = [*(FLIP * velocity), *rotations.to_body(q, FLIP * rates), *rotations.euler_angles(q)]
            for share in shares:
                drone.pwm = script.pwm((1.0 - share) * now + share * after)
                drone.update_physics()
                flown.stepSimulation()
                drone.update_state()
    flown.disconnect()
    return out
