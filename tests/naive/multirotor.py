"""The multirotor model once more, rotor by rotor, from angular momentum and vectors.

It reads the same vehicle file by its own means, and nothing here is shared with the package. Body axes
forward-right-down, Earth axes north-east-down; velocities relative to the steady wind.
"""

import math
import tomllib
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.optimize import brentq

from naive.aircraft import Aircraft, Numbers, rotation, skew

GROUND = ("vn", "ve", "vd", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az")


class Multirotor:
    """Flies from the text of a vehicle file: state [velocity, body rates, rotation, altitude, x of lagged rotors]."""

    def __init__(self, text: str, changes: Mapping[str, float]) -> None:
        self.raw = tomllib.loads(text)
        self.n = Numbers(self.raw, changes)
        self.names = list(self.raw["rotor"])
        self.shared: dict[str, Any] = self.raw["rotors"]
        xx, yy, zz, xz, xy, yz = (self.n(f"mass.inertia.{a}") for a in ("xx", "yy", "zz", "xz", "xy", "yz"))
        self.inertia = np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])

    def commanded(self, u: Mapping[str, float]) -> np.ndarray:
        """Return x that each rotor is told, before its lag."""
        out = []
        for name in self.names:
            moved = u[self.raw["rotor"][name]["channel"]] - self.n("rotors.idle", 0.0)
            x = max(self.n("rotors.gain", 1.0) * moved, 0.0)
            if "nominal_voltage" in self.shared:
                x *= u["voltage"] / self.n("rotors.nominal_voltage")
            out.append(x)
        return np.array(out)

    density = Aircraft.density

    def polynomial(self, letter: str, x: float) -> float:
        return float(sum(self.n(f"rotors.{letter}{i}") * x**i for i in range(3)))

    def rotor(
        self, name: str, x: float, xdot: float, velocity: np.ndarray, omega: np.ndarray, rho: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return force and moment about the centre of gravity of one rotor."""
        n, table = self.n, self.raw["rotor"][name]
        tip = n.point(f"rotor.{name}.axis") if "axis" in table else np.array([0.0, 0.0, -1.0])
        tip = tip / np.linalg.norm(tip)
        arm = n.point(f"rotor.{name}.position") - n.point("mass.center_of_gravity")
        here = velocity + np.cross(omega, arm)
        climb = float(here @ tip)
        sideways = here - climb * tip
        share = n(f"rotor.{name}.factor", 1.0) * rho / 1.225
        area = math.pi * n("rotors.radius") ** 2
        drawn = self.drawn(name, x, climb, float(np.linalg.norm(sideways)), area) if area else 0.0
        climb += drawn
        across = n("rotors.translational") * float(sideways @ sideways)
        thrust = share * (self.polynomial("T", x) - n("rotors.inflow") * x * climb + across)
        force = thrust * tip - share * (n("rotors.drag") * x + n("rotors.drag_inflow") * climb) * sideways
        if area and abs(drawn) > 1.0:  # the momentum that the thrust takes, in whatever density
            taken = 2.0 * rho * area * drawn * math.hypot(climb, float(np.linalg.norm(sideways)))
            np.testing.assert_allclose(thrust, taken, rtol=1e-4)
        told = "torque_ratio" in self.shared
        torque = n("rotors.torque_ratio") * thrust if told else share * self.polynomial("Q", x)
        torque *= n(f"rotor.{name}.torque_factor", 1.0)
        # Counterclockwise as seen from the tip is a rotation vector along the tip; the air's torque is against it.
        turning = tip if table["spin"] == "ccw" else -tip
        momentum_rate = n("rotors.inertia") * (xdot * turning + np.cross(omega, x * turning))
        return force, np.cross(arm, force) - torque * turning - momentum_rate

    def drawn(self, name: str, x: float, climb: float, sideways: float, area: float) -> float:
        """Return the velocity that a disc draws, by bisection of thrust against momentum."""
        n = self.n
        rest = self.polynomial("T", x) + n("rotors.translational") * sideways**2

        def excess(v: float) -> float:
            thrust = n(f"rotor.{name}.factor", 1.0) * (rest - n("rotors.inflow") * x * (climb + v))
            return 2.0 * 1.225 * area * v * math.sqrt((climb + v) ** 2 + sideways**2 + 0.05**2) - thrust

        return float(brentq(excess, max(0.0, -climb), 100.0, xtol=1e-13))

    def loads(
        self, velocity: np.ndarray, omega: np.ndarray, x: np.ndarray, xdot: np.ndarray, rho: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the force, N, and the moment about the centre of gravity, N m, of rotors and body."""
        force, moment = np.zeros(3), np.zeros(3)
        for i, name in enumerate(self.names):
            f, m = self.rotor(name, float(x[i]), float(xdot[i]), velocity, omega, rho)
            force, moment = force + f, moment + m
        drag = {k: self.n.point(f"body_drag.{k}") for k in self.raw.get("body_drag", {})}
        zero = np.zeros(3)
        force -= (
            drag.get("linear", zero) * velocity + drag.get("quadratic", zero) * np.abs(velocity) * velocity
        )
        return force, moment - drag.get("rotation", zero) * omega

    def _turning(self, s: np.ndarray, u: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        told = self.commanded(u)
        if "lag" not in self.shared:
            return told, self._faster(u)
        return s[16:], (told - s[16:]) / self.n("rotors.lag")

    def _faster(self, u: Mapping[str, float]) -> np.ndarray:
        """Return how fast commands change, by what they are a moment before and after."""
        moment = 1e-4
        before, after = (
            {c: v + side * moment * u.get(f"{c}.slope", 0.0) for c, v in u.items()} for side in (-1.0, 1.0)
        )
        return (self.commanded(after) - self.commanded(before)) / (2.0 * moment)

    def accelerations(
        self, s: np.ndarray, u: Mapping[str, float]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return specific force, velocity rate and angular acceleration, body axes."""
        velocity, omega = s[:3], s[3:6]
        x, xdot = self._turning(s, u)
        force, moment = self.loads(velocity, omega, x, xdot, self.density(float(s[15]), u))
        specific = force / self.n("mass.mass")
        gravity = s[6:15].reshape(3, 3).T @ np.array([0.0, 0.0, self.n("environment.gravity", 9.80665)])
        angular = np.linalg.solve(self.inertia, moment - np.cross(omega, self.inertia @ omega))
        return specific, specific + gravity - np.cross(omega, velocity), angular

    def rates(self, s: np.ndarray, u: Mapping[str, float]) -> np.ndarray:
        """Return the time derivative of the state."""
        R, omega = s[6:15].reshape(3, 3), s[3:6]
        _, velocity_rate, angular = self.accelerations(s, u)
        lags = self._turning(s, u)[1] if "lag" in self.shared else np.empty(0)
        climb = -(R @ s[:3])[2]
        return np.concatenate([velocity_rate, angular, (R @ skew(omega)).ravel(), [climb], lags])

    def readings(self, s: np.ndarray, u: Mapping[str, float]) -> np.ndarray:
        """Return what is observed, in the order of GROUND."""
        R, omega = s[6:15].reshape(3, 3), s[3:6]
        specific, _, angular = self.accelerations(s, u)
        r = np.zeros(3)
        if "accelerometer_position" in self.raw.get("sensors", {}):
            r = self.n.point("sensors.accelerometer_position") - self.n.point("mass.center_of_gravity")
        felt = specific + np.cross(angular, r) + np.cross(omega, np.cross(omega, r))
        mounting = rotation(*(self.n(f"sensors.imu_alignment.{axis}") for axis in "xyz")).T
        angles = [math.atan2(R[2, 1], R[2, 2]), -math.asin(R[2, 0]), math.atan2(R[1, 0], R[0, 0])]
        truth = np.concatenate([R @ s[:3], mounting @ omega, angles, mounting @ felt])
        scale = np.array([self.n(f"sensors.{c}.scale", 1.0) for c in GROUND])
        return scale * truth + np.array([self.n(f"sensors.{c}.bias") for c in GROUND])

    def start(self, at: Mapping[str, float], u: Mapping[str, float]) -> np.ndarray:
        """Return the state of u, v, w, p, q, r, phi, theta, psi, h; lagged rotors follow the command."""
        g = {k: at.get(k, 0.0) for k in ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "h")}
        lags = self.commanded(u) if "lag" in self.shared else np.empty(0)
        R = rotation(g["phi"], g["theta"], g["psi"])
        return np.concatenate([[g[k] for k in ("u", "v", "w", "p", "q", "r")], R.ravel(), [g["h"]], lags])
