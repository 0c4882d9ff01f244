"""The aircraft model once more, from the formulas: rotation matrices, cross products, linear solves.

It reads the same vehicle file by its own means, and nothing here is shared with the package. Body axes
forward-right-down, Earth axes north-east-down.
"""

import math
import tomllib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

CHANNELS = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az")
KEPT = {
    "full": CHANNELS,
    "longitudinal": ("V", "alpha", "q", "theta", "ax", "az"),
    "lateral": ("beta", "p", "r", "phi", "psi", "ay"),
}
Extra = Mapping[str, Callable[[Mapping[str, float]], float]]  #: parameter -> what it multiplies


class Numbers:
    """Looks numbers up in a raw file; some may be changed."""

    def __init__(self, raw: Mapping[str, Any], changes: Mapping[str, float]) -> None:
        self.raw, self.changes = raw, changes

    def __call__(self, path: str, default: float = 0.0) -> float:
        if path in self.changes:
            return self.changes[path]
        node: Any = self.raw
        for part in path.split("."):
            node = node["xyz".index(part)] if isinstance(node, list) else node.get(part)
            if node is None:
                return default
        return self._plain(node, default)

    def coefficient(self, name: str) -> float:
        """Return an aerodynamic parameter by its own name."""
        if name in self.changes:
            return self.changes[name]
        for table in self.raw.get("aerodynamics", {}).values():
            if isinstance(table, dict) and name in table:
                return self._plain(table[name], 0.0) if table[name] is not False else 0.0
        return 0.0

    def _plain(self, node: Any, default: float) -> float:
        if isinstance(node, str):
            return self(node.removeprefix("=").strip())
        return float(node.get("value", default)) if isinstance(node, dict) else float(node)

    def point(self, path: str) -> np.ndarray:
        return np.array([self(f"{path}.{axis}") for axis in "xyz"])


def rotation(phi: float, theta: float, psi: float) -> np.ndarray:
    """Return the rotation from body to Earth axes: yaw, pitch, roll."""
    cf, sf, ct, st, cp, sp = (f(a) for a in (phi, theta, psi) for f in (math.cos, math.sin))
    roll = np.array([[1, 0, 0], [0, cf, -sf], [0, sf, cf]])
    pitch = np.array([[ct, 0, st], [0, 1, 0], [-st, 0, ct]])
    yaw = np.array([[cp, -sp, 0], [sp, cp, 0], [0, 0, 1]])
    return yaw @ pitch @ roll


def skew(w: np.ndarray) -> np.ndarray:
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def standard_density(h: float) -> float:
    """Return the density of the standard atmosphere by the gas law, from pressure and temperature."""
    H = 6356766.0 * h / (6356766.0 + h)
    warmth = (288.15 - 0.0065 * H) / 288.15
    pressure = warmth ** (9.80665 / (287.05287 * 0.0065))
    return 1.225 * pressure / warmth


class Aircraft:
    """Flies from the text of a vehicle file."""

    def __init__(self, text: str, changes: Mapping[str, float], extra: Extra) -> None:
        self.raw = tomllib.loads(text)
        self.n = Numbers(self.raw, changes)
        self.extra = extra
        self.reduce = self.raw.get("model", {}).get("reduce", "full")
        self.controls = self.raw.get("controls") or {"elevator": {}, "aileron": {}, "rudder": {}}
        self.lagged = [c for c in self.controls if "lag" in self.controls[c]]
        n = self.n
        xx, yy, zz, xz, xy, yz = (n(f"mass.inertia.{a}") for a in ("xx", "yy", "zz", "xz", "xy", "yz"))
        self.inertia = np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])

    def arm(self, table: str, point: str) -> np.ndarray:
        """Return a point relative to the centre of gravity; absent, it lies there."""
        if point not in (self.raw.get(table) or {}):
            return np.zeros(3)
        return self.n.point(f"{table}.{point}") - self.n.point("mass.center_of_gravity")

    def commanded(self, u: Mapping[str, float]) -> dict[str, float]:
        out = {}
        for control, table in self.controls.items():
            mix = table.get("mix", {control: 1.0})
            base = f"controls.{control}"
            out[control] = self.n(f"{base}.offset") + sum(
                self.n(f"{base}.mix.{c}", 1.0) * (u.get(c, 0.0) - self.n(f"{base}.center.{c}")) for c in mix
            )
        return out

    def density(self, h: float, u: Mapping[str, float]) -> float:
        choice = self.raw.get("environment", {}).get("density", "standard")
        if choice == "log":
            return u["density"]
        return standard_density(h) if choice == "standard" else self.n("environment.density")

    def coefficients(
        self, V: float, alpha: float, beta: float, omega: np.ndarray, d: Mapping[str, float]
    ) -> dict[str, float]:
        """Return the six coefficients, eq. (1)."""
        n, k = self.n, self.n.coefficient
        V_ref, b, c = n("reference.airspeed"), n("reference.span"), n("reference.chord")
        U = V_ref if self.raw["reference"].get("rate_normalization") == "reference" else V
        a, dV = alpha - n("reference.alpha"), (V - V_ref) / V_ref
        p, q, r = omega[0] * b / (2 * U), omega[1] * c / (2 * U), omega[2] * b / (2 * U)
        de, da, dr = (d.get(x, 0.0) for x in ("elevator", "aileron", "rudder"))
        out = {
            "CL": k("CL0") + k("CLalpha") * a + k("CLq") * q + k("CLV") * dV + k("CLelevator") * de,
            "CD": k("CD0") + k("CDalpha") * a + k("CDalpha2") * a * a + k("CDV") * dV,
            "Cm": k("Cm0") + k("Cmalpha") * a + k("Cmq") * q + k("CmV") * dV + k("Cmelevator") * de,
            "CQ": k("CQ0")
            + k("CQbeta") * beta
            + k("CQp") * p
            + k("CQr") * r
            + k("CQrudder") * dr
            + k("CQV") * dV,
            "Cl": k("Cl0")
            + k("Clbeta") * beta
            + k("Clp") * p
            + k("Clr") * r
            + k("Claileron") * da
            + k("Clrudder") * dr,
            "Cn": k("Cn0")
            + k("Cnbeta") * beta
            + k("Cnp") * p
            + k("Cnr") * r
            + k("Cnaileron") * da
            + k("Cnrudder") * dr,
        }
        here = {"alpha": a, "beta": beta, "p": p, "q": q, "r": r, "V": dV, **d}
        for name, function in self.extra.items():
            out[name[:2]] += k(name) * function(here)
        if self.reduce == "longitudinal":
            out |= {"CQ": 0.0, "Cl": 0.0, "Cn": 0.0}
        return out

    def thrust(self, V: float, rho: float, u: Mapping[str, float]) -> float:
        table, n = self.raw.get("propulsion"), self.n
        if table is None:
            return 0.0
        if table["kind"] == "constant":
            return n("propulsion.thrust")
        command = u[table.get("channel", "thrust")]
        if table["kind"] == "channel":
            return n("propulsion.scale", 1.0) * command
        D, speed = n("propulsion.diameter"), n("propulsion.speed_gain") * (command - n("propulsion.idle"))
        speed = max(speed, 0.0)
        if speed == 0.0:
            return rho * D**4 * n("propulsion.CT2") * (V / D) ** 2
        J = V / (speed * D)
        return (
            rho
            * speed**2
            * D**4
            * (n("propulsion.CT0") + n("propulsion.CT1") * J + n("propulsion.CT2") * J * J)
        )

    def loads(
        self, x: np.ndarray, u: Mapping[str, float], d: Mapping[str, float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return force, N, and moment about the centre of gravity, N m."""
        velocity, omega, n = x[:3], x[3:6], self.n
        V = float(np.linalg.norm(velocity))
        alpha, beta = math.atan2(velocity[2], velocity[0]), math.asin(velocity[1] / V)
        rho = self.density(x[15], u)
        C = self.coefficients(V, alpha, beta, omega, d)
        qS = 0.5 * rho * V * V * n("reference.area")
        turn_alpha = np.array(
            [[math.cos(alpha), 0, -math.sin(alpha)], [0, 1, 0], [math.sin(alpha), 0, math.cos(alpha)]]
        )
        turn_beta = np.array(
            [[math.cos(beta), -math.sin(beta), 0], [math.sin(beta), math.cos(beta), 0], [0, 0, 1]]
        )
        air = turn_alpha @ turn_beta @ (qS * np.array([-C["CD"], C["CQ"], -C["CL"]]))
        b, c = n("reference.span"), n("reference.chord")
        moment = qS * np.array([b * C["Cl"], c * C["Cm"], b * C["Cn"]])
        if "inertia" in self.raw["reference"]:  # for which the coefficients hold
            moment = moment * np.diag(self.inertia) / np.array([n(f"reference.inertia.{x}") for x in "xyz"])
        moment = moment + np.cross(self.arm("reference", "moment_point"), air)
        pitch = n("propulsion.pitch")
        push = self.thrust(V, rho, u) * np.array([math.cos(pitch), 0.0, -math.sin(pitch)])
        moment = moment + np.cross(self.arm("propulsion", "position"), push)
        if "inertia" in self.raw.get("propulsion", {}):
            turning = (
                2.0
                * math.pi
                * n("propulsion.speed_gain")
                * (u[self.raw["propulsion"]["channel"]] - n("propulsion.idle"))
            )
            line = np.array([math.cos(pitch), 0.0, -math.sin(pitch)])
            moment = moment - np.cross(omega, n("propulsion.inertia") * max(turning, 0.0) * line)
        return air + push, moment

    def deflections(self, x: np.ndarray, u: Mapping[str, float]) -> dict[str, float]:
        return self.commanded(u) | dict(zip(self.lagged, x[16:], strict=True))

    def accelerations(
        self, x: np.ndarray, u: Mapping[str, float]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return specific force, velocity rate and angular acceleration, body axes."""
        force, moment = self.loads(x, u, self.deflections(x, u))
        specific = force / self.n("mass.mass")
        R, omega = x[6:15].reshape(3, 3), x[3:6]
        gravity = R.T @ np.array([0.0, 0.0, self.n("environment.gravity", 9.80665)])
        turning = np.linalg.solve(self.inertia, moment - np.cross(omega, self.inertia @ omega))
        return specific, specific + gravity - np.cross(omega, x[:3]), turning

    def rates(self, x: np.ndarray, u: Mapping[str, float]) -> np.ndarray:
        """Return the rate of [velocity, body rates, rotation, altitude, lagged deflections]."""
        R = x[6:15].reshape(3, 3)
        _, velocity_rate, turning = self.accelerations(x, u)
        command = self.commanded(u)
        lags = [
            (command[c] - d) / self.n(f"controls.{c}.lag") for c, d in zip(self.lagged, x[16:], strict=True)
        ]
        climb = -(R @ x[:3])[2]
        out = np.concatenate([velocity_rate, turning, (R @ skew(x[3:6])).ravel(), [climb], lags])
        held = {"full": [], "longitudinal": [1, 3, 5], "lateral": [0, 2, 4, 15]}[self.reduce]
        out[held] = 0.0
        return out

    def readings(self, x: np.ndarray, u: Mapping[str, float]) -> np.ndarray:
        """Return what the instruments say, eq. (2)."""
        R, omega = x[6:15].reshape(3, 3), x[3:6]
        specific, _, turning = self.accelerations(x, u)
        error = np.array([self.n(f"sensors.wind_error.{axis}") for axis in "xyz"])
        through_air = x[:3] + R.T @ error * (self.reduce == "full")
        pitot = self.n("sensors.V.scale", 0.0) != 0.0
        at_vane = through_air + np.cross(omega, self.arm("sensors", "vane_position"))
        r = self.arm("sensors", "accelerometer_position")
        felt = specific + np.cross(turning, r) + np.cross(omega, np.cross(omega, r))
        mounting = rotation(*(self.n(f"sensors.imu_alignment.{axis}") for axis in "xyz")).T
        truth = {
            "V": float(np.linalg.norm(x[:3] if pitot else through_air)),
            "alpha": math.atan2(at_vane[2], at_vane[0]),
            "beta": math.asin(at_vane[1] / float(np.linalg.norm(at_vane))),
            **dict(zip("pqr", mounting @ omega, strict=True)),
            "phi": math.atan2(R[2, 1], R[2, 2]),
            "theta": -math.asin(R[2, 0]),
            "psi": math.atan2(R[1, 0], R[0, 0]),
            **dict(zip(("ax", "ay", "az"), mounting @ felt, strict=True)),
        }
        kept = KEPT[self.reduce]
        return np.array(
            [self.n(f"sensors.{c}.scale", 1.0) * truth[c] + self.n(f"sensors.{c}.bias") for c in kept]
        )

    def start(self, at: Mapping[str, float], u: Mapping[str, float]) -> np.ndarray:
        """Return the state of V, alpha, beta, p, q, r, phi, theta, psi, h; lagged surfaces follow the command."""
        g = {k: at.get(k, 0.0) for k in ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "h")}
        a, b = g["alpha"], g["beta"]
        velocity = g["V"] * np.array([math.cos(a) * math.cos(b), math.sin(b), math.sin(a) * math.cos(b)])
        R = rotation(g["phi"], g["theta"], g["psi"])
        lags = [self.commanded(u)[c] for c in self.lagged]
        return np.concatenate([velocity, [g["p"], g["q"], g["r"]], R.ravel(), [g["h"]], lags])
