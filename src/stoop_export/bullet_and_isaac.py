"""Targets ``gym-pybullet-drones`` and ``isaac``: descriptions (URDF) of a quadrotor with what each simulator reads beside them.

gym-pybullet-drones reads an element ``properties`` before the links; commands are speeds of rotors, rpm, without a lag; its
optional drag is the sum of the speeds times the velocity. Isaac Lab (`MultirotorCfg`, `ThrusterCfg`) and Aerial Gym (a class
of configuration) command thrusts, whose square root has the lag; they draw its constant and the lag from ranges.

References
----------
J. Panerati et al., "Learning to Fly: a Gym Environment with PyBullet Physics for Reinforcement Learning of Multi-agent
Quadcopter Control", IROS 2021; gym-pybullet-drones, envs/BaseAviary.py.
M. Kulkarni, W. Rehberg, K. Alexis, "Aerial Gym Simulator", IEEE RA-L, 2025; config/robot_config/base_quad_config.py.
Isaac Lab, isaaclab_contrib/actuators/thruster_cfg.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop_export.exporter import Exported
from stoop_export.learning_quad import REVOLUTIONS, Quad, QuadExporter, urdf
from stoop_export.reference_flight import ReferenceFlight

BULLET_ORDER: Final = (2, 1, 3, 0)  #: front left, rear left, rear right, front right, by places in ours
BULLET_LINKS: Final = ("prop0_link", "prop1_link", "prop2_link", "prop3_link", "center_of_mass_link")
ISAAC_LINKS: Final = ("rotor_0", "rotor_1", "rotor_2", "rotor_3")
FASTEST: Final = 30.0  #: km/h, set-point of the velocity at full action
INTERVAL: Final = (2.5, 97.5)  #: percentiles of the draws, of a range
NOT_FLOWN: Final = "Not flown: stoop does not install {}; the files follow its reader."


class _Described(QuadExporter):
    """A target whose files are not flown."""

    def fly(self, made: Exported) -> Exported:
        """Return the files with what the simulator leaves out of the reference flight."""

        def compare(made: Exported, flight: ReferenceFlight) -> Exported:
            return self.with_omissions(made, flight).with_notes([NOT_FLOWN.format(self.tool)])

        return self.along_reference(made, self.point, compare)


class GymPyBulletDrones(_Described):
    """A quadrotor for gym-pybullet-drones."""

    tool = "gym-pybullet-drones"
    has = ("rotors.drag", "ground_effect.rotor")

    def parameters(self, quad: Quad) -> dict[str, Any]:
        """Return the attributes of ``properties``, mass and moments of inertia; speeds are in revolutions per minute."""
        constant = quad.constant / REVOLUTIONS**2
        drag = quad.damping / (4.0 * quad.hover)
        radius = self.vehicle.value("rotors.radius", 0.4 * float(np.hypot(*quad.arms)))
        return {
            "mass": quad.mass,
            "inertia": np.diag(quad.inertia),
            "arm": float(np.hypot(*quad.arms)),
            "kf": constant,
            "km": -float(quad.turns[0]) * quad.torque * constant,
            "thrust2weight": 4.0 * quad.constant * quad.fastest**2 / (quad.mass * quad.gravity),
            "max_speed_kmh": FASTEST,
            "gnd_eff_coeff": self.vehicle.value("ground_effect.rotor", 0.0),
            "prop_radius": self.vehicle.value("ground_effect.radius", radius),
            "drag_coeff_xy": float(drag[:2].mean()),
            "drag_coeff_z": float(drag[2]),
            "dw_coeff_1": 0.0,
            "dw_coeff_2": 0.0,
            "dw_coeff_3": 0.0,
        }

    def files(self) -> Exported:
        """Return the description, and the numbers that take recorded channels to speeds."""
        quad = self.quad
        own = {n: repr(float(x)) for n, x in self.parameters(quad).items() if n not in ("mass", "inertia")}
        order = [quad.channels[i] for i in BULLET_ORDER]
        content = {
            "channels": order,
            "idle": quad.idle,
            "rpm_gain": quad.speed_gain * REVOLUTIONS,
            "rpm_offset": quad.offset * REVOLUTIONS,
            "gravity": quad.gravity,
        }
        placed = replace(quad, places=quad.places[list(BULLET_ORDER)])
        main = f"{quad.name}.urdf"
        return self.with_content(
            {main: urdf(placed, BULLET_LINKS, Element("properties", own))}, content, main
        )

    def lacks(self) -> list[str]:
        """Return the lag of the motors beside what all targets name."""
        note = f"{self.tool} has no lag of motors ({self.quad.lag:g} s here): give it speeds behind that lag."
        return [*super().lacks(), *([note] if self.quad.lag > 0.0 else [])]


class Isaac(_Described):
    """A quadrotor for Isaac Lab, which has no drag, and Aerial Gym, which has."""

    tool = "Isaac Lab"

    def parameters(self, quad: Quad) -> dict[str, Any]:
        """Return mass properties, thrusters and damping; speeds are in revolutions per second."""
        return {
            "mass": quad.mass,
            "inertia": np.diag(quad.inertia),
            "thrust_const": quad.constant * (2.0 * np.pi) ** 2,
            "max_thrust": quad.constant * quad.fastest**2,
            "tau": quad.lag,
            "torque_to_thrust_ratio": quad.torque,
            "linear_damping": quad.damping,
            "quadratic_damping": quad.drag,
        }

    def files(self) -> Exported:
        """Return description and configurations."""
        return self._with_ranges({n: np.asarray(x)[None] for n, x in self.parameters(self.quad).items()})

    def _with_ranges(self, sets: Mapping[str, FloatArray]) -> Exported:
        """Return the files with ranges over parameter sets, by name (D, ...)."""
        quad = self.quad
        own = self.parameters(quad)
        ends = {n: np.percentile(x, INTERVAL, axis=0).tolist() for n, x in sets.items()}
        matrix = np.zeros((6, 4))
        matrix[2] = 1.0
        matrix[3], matrix[4] = quad.places[:, 1], -quad.places[:, 0]
        matrix[5] = -quad.turns * quad.torque
        content = {
            "name": quad.name,
            "rotors": list(ISAAC_LINKS),
            "rotor_directions": [int(x) for x in quad.turns],
            "channels": quad.channels,
            "allocation_matrix": matrix.tolist(),
            "hover_rps": quad.hover / (2.0 * np.pi),
            "nominal": {n: np.asarray(x).tolist() for n, x in own.items()},
            "ranges": ends,
        }
        made, kinds = (
            {f"{quad.name}.urdf": urdf(quad, ISAAC_LINKS)},
            ("isaac_lab_config", "aerial_gym_config"),
        )
        return self.with_content(made, content, f"{quad.name}.urdf", *kinds)

    def with_draws(self, made: Exported) -> Exported:
        """Return the files with ranges over the parameter sets, and the sets."""
        if not self.model.draws:
            return made
        ranged = self._with_ranges(self.drawn[0])
        note = (
            "Isaac Lab and Aerial Gym draw the constant of the thrust and the lag only, each from the middle 95 % of its draws, "
            f"without correlations; {self.quad.name}.json has the ranges of all numbers."
        )
        return super().with_draws(ranged).with_notes([note])
