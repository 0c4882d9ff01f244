"""Steady flight on wings of many vehicles at once that differ in their numbers, and the linear models about it.

The equations are those of :mod:`stoop.simulation.trim` and :mod:`stoop.simulation.linearize`, here for B lanes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.base.units import STANDARD_GRAVITY
from stoop.propagation.newton import solve
from stoop.simulation.initial import commanded, initial_states, mixed_inputs
from stoop.simulation.linearize import state_names
from stoop.simulation.trim import TOLERANCE, WING_ANGLES, neutral_inputs
from stoop.vehicle import Vehicle
from stoop.vehicle.arrays import euler_angles, flow_angles
from stoop.vehicle.defaults import full_command

POWERS: Final = (1.0, 4.0, 16.0)  #: at which a thrust begins: a propeller at rest has no slope
STEP: Final = 1e-5  #: rad, rad/s and shares of a speed, of central differences: error of the order 1e-10
THRUST: Final = "propulsion.thrust"  #: number of a constant thrust


@dataclass(frozen=True, eq=False)
class Steady:
    """Steady flights, one a lane; NaN where there is none."""

    start: Mapping[str, FloatArray]  #: V, alpha, ... (B,), m/s, rad, m
    deflections: Mapping[str, FloatArray]  #: of the controls, rad
    thrust: Mapping[str, FloatArray]  #: number or channel that holds the speed, N or its unit
    climb: FloatArray  #: flight-path angle (B,), rad
    inputs: FloatArray  #: (n_u, B)
    rows: FloatArray  #: kernel parameters (n_p, B)
    solution: FloatArray  #: scaled unknowns (m, B)
    flies: BoolArray  #: (B,)
    overpowered: BoolArray  #: (B,), the throttle would have to be above full


@dataclass(frozen=True, eq=False)
class Wings:
    """The equations of steady flight on wings.

    Level flight has its airspeed or its angle of attack given, and a thrust to find; a glide has no thrust, and its
    flight-path angle is free.
    """

    vehicle: Vehicle
    rows: FloatArray  #: kernel parameters (n_p, B)
    altitude: float
    density: float | None
    angles: tuple[str, ...]  #: unknown
    powered: bool = True
    given: str = "V"  #: or alpha

    @classmethod
    def of(cls, vehicle: Vehicle, rows: FloatArray, altitude: float, density: float) -> Wings:
        """Return the equations of a vehicle, free of sideslip; `without_sideslip` is to be tried first."""
        vehicle = vehicle.reduced("full") if vehicle.reduce == "lateral" else vehicle.coupled_to(())
        angles = WING_ANGLES[vehicle.reduce][0]
        return cls(vehicle, rows, altitude, density, angles, vehicle.file.propulsion is not None)

    @property
    def with_sideslip(self) -> Wings:
        """Return the equations for a vehicle whose controls cannot hold the sideslip at zero."""
        return replace(self, angles=WING_ANGLES[self.vehicle.reduce][-1])

    def lanes(self, rows: FloatArray) -> Wings:
        """Return the equations of other numbers (n_p, B)."""
        return replace(self, rows=rows)

    @cached_property
    def unknowns(self) -> dict[str, float]:
        """Scales by name."""
        vehicle, propulsion = self.vehicle, self.vehicle.file.propulsion
        out = dict.fromkeys((*self.angles, *vehicle.controls), 0.1)
        if self.given != "V":
            out.pop(self.given)
            out["V"] = 0.1 * vehicle.value("reference.airspeed")
        if propulsion is not None and self.powered:
            step = 0.1 * vehicle.value("mass.mass") * STANDARD_GRAVITY
            if "propulsion.speed_gain" in vehicle.rows:
                step = 20.0 / max(vehicle.value("propulsion.speed_gain"), 1e-6)
            out[THRUST if propulsion.kind == "constant" else propulsion.channel] = step
        return out

    @cached_property
    def _quiet(self) -> FloatArray:
        density = 1.225 if self.density is None else self.density
        return neutral_inputs(self.vehicle, density, self.altitude)

    @cached_property
    def _mixing(self) -> tuple[FloatArray, FloatArray]:
        """Channels (n_u,) of neutral controls, and (n_u, c) for a radian of each; about nominal gains."""
        vehicle, quiet = self.vehicle, self._quiet
        neutral = mixed_inputs(vehicle, dict.fromkeys(vehicle.controls, 0.0), quiet)
        columns = [
            mixed_inputs(vehicle, {**dict.fromkeys(vehicle.controls, 0.0), c: 1.0}, quiet) - neutral
            for c in vehicle.controls
        ]
        return neutral, np.array(columns).reshape(len(columns), len(quiet)).T

    def _point(
        self, x: FloatArray, given: FloatArray, rows: FloatArray
    ) -> tuple[dict[str, FloatArray], FloatArray, FloatArray, dict[str, FloatArray]]:
        """Return start, channels (n_u, b), numbers (n_p, b) and thrust of scaled unknowns (m, b)."""
        vehicle = self.vehicle
        values = {n: v * s for v, (n, s) in zip(x, self.unknowns.items(), strict=True)} | {self.given: given}
        start = {name: values.pop(name) for name in ("V", *self.angles)}
        start |= {"h": np.full(x.shape[1], self.altitude)}
        neutral, columns = self._mixing
        controls = [values.pop(c) for c in vehicle.controls]
        inputs = np.repeat(neutral[:, None], x.shape[1], axis=1)
        if controls:
            inputs = inputs + columns @ np.array(controls)
        if not self.powered and THRUST in vehicle.rows:
            values_off = np.array(rows)
            values_off[vehicle.rows[THRUST]] = 0.0
            rows = values_off
        for name, value in values.items():
            if name in vehicle.rows:
                rows = np.array(rows)
                rows[vehicle.rows[name]] = value
            else:
                inputs[vehicle.inputs.index(name)] = value
        return start, inputs, rows, values

    def _rates(self, start: Mapping[str, FloatArray], inputs: FloatArray, rows: FloatArray) -> FloatArray:
        states = initial_states(self.vehicle, start, rows, inputs)
        return self.vehicle.kernel().evaluate(rows, states, np.ascontiguousarray(inputs))[0]

    def steady(self, given: FloatArray, guess: FloatArray | None = None) -> Steady:
        """Return the steady flights at airspeeds, m/s, or angles of attack, rad, (B,), from scaled unknowns (m, B)."""
        states = self.vehicle.states
        balanced = [i for i, s in enumerate(states) if s in ("u", "v", "w", "p", "q", "r")]
        h = states.index("h")

        def residuals(x: FloatArray, lanes: IntArray) -> FloatArray:
            start, inputs, rows, _ = self._point(x, given[lanes], self.rows[:, lanes])
            rates = self._rates(start, inputs, rows)
            return np.vstack([rates[balanced], rates[h] / start["V"]]) if self.powered else rates[balanced]

        starts = [guess] if guess is not None else [self._begin(p, len(given)) for p in POWERS]
        x, error = solve(residuals, starts[0], TOLERANCE)
        for other in starts[1:]:
            failed = np.flatnonzero(error >= TOLERANCE)
            if failed.size:
                again = lambda y, lanes, failed=failed: residuals(y, failed[lanes])  # noqa: E731
                x[:, failed], error[failed] = solve(again, other[:, failed], TOLERANCE)
        start, inputs, rows, thrust = self._point(x, given, self.rows)
        deflections = {c: commanded(self.vehicle, c, rows, inputs) for c in self.vehicle.controls}
        with np.errstate(all="ignore"):
            largest = np.max(np.abs([*(start[a] for a in self.angles), *deflections.values()]), axis=0)
            climb = np.arcsin(np.clip(self._rates(start, inputs, rows)[h] / start["V"], -1.0, 1.0))
            flies = (error < TOLERANCE) & (largest < math.pi / 2.0) & (start["V"] > 0.0)
        lost = np.where(flies, 0.0, np.nan)
        found = {n: v + lost for n, v in start.items()}
        return Steady(
            found, {n: v + lost for n, v in deflections.items()}, {n: v + lost for n, v in thrust.items()},
            climb + lost, inputs, rows, x, flies, self._beyond_power(thrust) & flies,
        )  # fmt: skip

    def _beyond_power(self, thrust: Mapping[str, FloatArray]) -> BoolArray:
        """Tell whether a throttle would have to be above full (B,); a thrust has no limit in the model."""
        out = np.zeros(self.rows.shape[1], dtype=bool)
        for name, value in thrust.items():
            full = full_command(name) if "propulsion.speed_gain" in self.vehicle.rows else None
            if full is not None:
                out |= value > full
        return out

    def _begin(self, power: float, count: int) -> FloatArray:
        first = {"alpha": 0.5, "theta": 0.5, "V": 10.0}
        controls = self.vehicle.controls
        x = [first.get(n, 0.0 if n in (*self.angles, *controls) else power) for n in self.unknowns]
        return np.repeat(np.array(x)[:, None], count, axis=1)

    def linear(self, at: Steady) -> Linear:
        """Return A (B, n, n) and the accelerations by deflections about steady flights; NaN where there is none."""
        vehicle, names = self.vehicle, state_names(self.vehicle, at.start)
        start = {n: np.nan_to_num(v, nan=1.0) for n, v in at.start.items()}

        def rates(change: Mapping[str, FloatArray | float], inputs: FloatArray = at.inputs) -> FloatArray:
            moved = {n: start.get(n, 0.0) + np.asarray(change.get(n, 0.0)) for n in (*start, *change)}
            states = initial_states(vehicle, moved, at.rows, inputs)
            found = vehicle.kernel().evaluate(at.rows, states, np.ascontiguousarray(inputs))[0]
            return minimal_rates(vehicle, names, states, found)

        columns = []
        for name in names:
            step = STEP * (start["V"] if name == "V" else 1.0) if name != "h" else 1.0
            columns.append((rates({name: step}) - rates({name: -np.asarray(step)})) / (2.0 * step))
        A = np.stack(columns, axis=1).transpose(2, 0, 1)
        effects = {}
        for control, column in zip(vehicle.controls, self._mixing[1].T, strict=True):
            if f"{control}.lag" in names:  # deflections act through their lags
                effects[control] = A[:, :, names.index(f"{control}.lag")]
                continue
            up, down = (at.inputs + sign * STEP * column[:, None] for sign in (1.0, -1.0))
            turned = commanded(vehicle, control, at.rows, up) - commanded(vehicle, control, at.rows, down)
            with np.errstate(divide="ignore", invalid="ignore"):
                effects[control] = ((rates({}, up) - rates({}, down)) / turned).T
        lost = np.where(at.flies, 0.0, np.nan)
        return Linear(names, A + lost[:, None, None], {c: e + lost[:, None] for c, e in effects.items()})


@dataclass(frozen=True, eq=False)
class Linear:
    """Linear models, one a lane."""

    names: tuple[str, ...]  #: of the n states, as of :func:`stoop.linearize`
    A: FloatArray  #: (B, n, n)
    effects: Mapping[str, FloatArray]  #: (B, n), rates of the states per radian of each control

    def steady_rate(self, state: str, control: str) -> FloatArray:
        """Return the rate of one axis (B,) per radian that a control holds when its own damping alone balances it."""
        i = self.names.index(state)
        return np.asarray(-self.effects[control][:, i] / self.A[:, i, i])


def minimal_rates(
    vehicle: Vehicle, names: tuple[str, ...], states: FloatArray, rates: FloatArray
) -> FloatArray:
    """Return the derivatives (n, B) of airspeed, flow and attitude angles for those of the kernel's states (n_x, B)."""
    zero = np.zeros(states.shape[1])
    x, dx = (
        dict.fromkeys(("v", "p", "r", "e1", "e3"), zero) | dict(zip(vehicle.states, some, strict=True))
        for some in (states, rates)
    )
    u, v, w = (x[a] for a in "uvw")
    du, dv, dw = (dx[a] for a in "uvw")
    V = flow_angles([u, v, w])[0]
    phi, theta, _ = euler_angles([x[f"e{i}"] for i in range(4)])
    p, q, r = (x[a] for a in "pqr")
    turning = q * np.sin(phi) + r * np.cos(phi)
    plane = u * u + w * w
    dV = (u * du + v * dv + w * dw) / V
    known = {
        "V": dV,
        "alpha": (u * dw - w * du) / plane,
        "beta": (V * dv - v * dV) / (V * np.sqrt(plane)),
        "phi": p + np.tan(theta) * turning,
        "theta": q * np.cos(phi) - r * np.sin(phi),
        "psi": turning / np.cos(theta),
    }
    return np.array([known[n] if n in known else dx[n] for n in names])
