"""Equations of vehicles with rotors: angular accelerations and specific forces, linearized in all free numbers.

The measured motion goes into the vehicle's own equations sample by sample, commands through the delay and lag of the
rotors, and angular accelerations and specific forces come out. They are linear in most coefficients of thrust, torque
and drag; arms, inertia, lag, delay, wind and factors make them mildly nonlinear, so the regression is iterated
(Gauss-Newton). Nothing is integrated, and no start is too far away.

Axes: k = sample, i = acceleration (p', q', r', ax, ay, az), j = unknown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Final

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from stoop.base.arrays import FloatArray, runs
from stoop.base.notices import Notice, notice
from stoop.base.variables import RATES, SPECIFIC_FORCE
from stoop.estimate.regression.least_squares import Domain, Equations, Estimates, Rows, r_squared
from stoop.flight.flight import MIN_SEGMENT
from stoop.problem import Layout, Nuisance, Piece
from stoop.problem.observation import through_air, true_value
from stoop.simulation import parameter_rows
from stoop.simulation.delays import at_samples, first_order_lag, late_inputs
from stoop.simulation.initial import commanded, initial_states, rigid_states
from stoop.vehicle import Vehicle
from stoop.vehicle.schema import WIND

STEP: Final = 1e-5  #: of finite differences, in widths of the bounds or scales of the biases
MOMENTS: Final = ("roll", "pitch", "yaw")
ACCELERATIONS: Final = (*MOMENTS, "forward", "sideways", "vertical")  #: equations, in the order of i
MIN_R2: Final = 0.25  #: of a moment; below, the recorded commands show only how noise attenuates estimates
_LAGGED: Final = tuple(f"rotors.{n}" for n in ("lag", "delay", "gain", "idle", "nominal_voltage"))
_MOTION: Final = (*WIND, *RATES, "phi", "theta", "psi")


@dataclass(frozen=True, eq=False)
class Stretch:
    """Samples of a piece without a hole, and their accelerations."""

    piece: Piece
    samples: slice
    measured: FloatArray  #: (n, i), rad/s2 and m/s2

    def modeled(
        self, vehicle: Vehicle, rows: FloatArray, cache: dict[bytes, FloatArray] | None = None
    ) -> FloatArray:
        """Return the accelerations (n, i) of the equations at the measured motion.

        Kernel parameters `rows` (n_p, 1) contain biases and wind; `cache` holds lagged commands computed before.
        """
        piece, motion = self.piece, {}
        late = at_samples(vehicle, late_inputs(vehicle, piece.inputs, rows, piece.dt))
        inputs = np.ascontiguousarray(late.T[:, self.samples])
        every = np.repeat(rows, inputs.shape[1], axis=1)
        for channel in _MOTION:  # biases removed, relative to the wind
            reading = piece.measured[self.samples, vehicle.outputs.index(channel)]
            motion[channel] = true_value(vehicle, channel, reading, rows[:, 0])
        down = piece.measured[self.samples, vehicle.outputs.index("vd")]
        height = float(piece.start.get("h", 0.0)) - cumulative_trapezoid(down, dx=piece.dt, initial=0)
        rigid = rigid_states(through_air(motion) | {"h": height})
        states = initial_states(vehicle, {}, every, inputs, rigid)
        for i, name in enumerate(vehicle.states):
            if name.endswith(".lag"):
                follower = name.removesuffix(".lag")
                states[i] = lagged_command(vehicle, piece, follower, rows, cache)[self.samples]
        rates, outputs = vehicle.kernel().evaluate(every, states, inputs)
        angular = rates[[vehicle.states.index(c) for c in RATES]].T
        felt = outputs[[vehicle.outputs.index(c) for c in SPECIFIC_FORCE]].T
        # the lever arm turns with the measured angular acceleration, not with the modeled one
        lever = np.cross(self.measured[:, :3] - angular, _sensor_arm(vehicle, rows[:, 0]))
        return np.concatenate([angular, felt + lever], axis=1)


def stretches(vehicle: Vehicle, piece: Piece) -> list[Stretch]:
    """Return the stretches of a piece in which the whole motion was measured, with its accelerations."""
    needed = [vehicle.outputs.index(c) for c in (*_MOTION, *SPECIFIC_FORCE)]
    shortest = max(8, round(MIN_SEGMENT / piece.dt))
    out = []
    for start, stop in runs(np.asarray(np.isfinite(piece.measured[:, needed]).all(axis=1))):
        if stop - start >= shortest:
            run = slice(int(start), int(stop))
            time = piece.time[run]
            rates = [piece.measured[run, vehicle.outputs.index(c)] for c in RATES]
            angular = [CubicSpline(time, rate)(time, 1) for rate in rates]
            felt = [piece.measured[run, vehicle.outputs.index(c)] for c in SPECIFIC_FORCE]
            out.append(Stretch(piece, run, np.array([*angular, *felt]).T))
    return out


def lagged_command(
    vehicle: Vehicle, piece: Piece, name: str, rows: FloatArray, cache: dict[bytes, FloatArray] | None = None
) -> FloatArray:
    """Return the command (n,) of a rotor or control along a piece after delay and lag."""
    prefix = "rotors" if name in vehicle.rotors else f"controls.{name}"
    numbers = _LAGGED if name in vehicle.rotors else tuple(n for n in vehicle.rows if n.startswith(prefix))
    involved = [vehicle.rows[number] for number in numbers if number in vehicle.rows]
    cache = {} if cache is None else cache
    key = b"".join((name.encode(), id(piece).to_bytes(8, "little"), rows[involved, 0].tobytes()))
    if key not in cache:
        late = late_inputs(vehicle, piece.inputs, rows, piece.dt)
        command = commanded(vehicle, name, np.repeat(rows, len(late), axis=1), late.T)
        lag = vehicle.rows.get(f"{prefix}.lag")
        cache[key] = command if lag is None else first_order_lag(command, float(rows[lag, 0]), piece.dt)
    return cache[key]


def _sensor_arm(vehicle: Vehicle, rows: FloatArray) -> FloatArray:
    """Return the position of the accelerometers (3,), m from the center of gravity; zero where the file has none."""
    names = ("sensors.accelerometer_position", "mass.center_of_gravity")
    sensor, center = (
        [rows[vehicle.rows[f"{n}.{c}"]] if f"{n}.{c}" in vehicle.rows else 0.0 for c in "xyz"] for n in names
    )
    return np.subtract(sensor, center) if f"{names[0]}.x" in vehicle.rows else np.zeros(3)


@dataclass(frozen=True, eq=False)
class RotorEquations(Equations):
    """Accelerations of a vehicle with rotors; unknowns are the free numbers, then biases and wind of every maneuver."""

    stretches: tuple[Stretch, ...]
    equations: tuple[str, ...] = ACCELERATIONS  #: those of `ACCELERATIONS` that are used

    linear = False
    explanations: ClassVar[Mapping[str, str]] = {"time": "equation-error-rotors"}
    needed = (
        "velocity over ground, rates, attitude and accelerations must be measured together for some seconds; use "
        "--method multiple-shooting"
    )

    @classmethod
    def of(cls, layout: Layout, pieces: Sequence[Piece]) -> RotorEquations:
        """Return the equations of measured maneuvers."""
        return cls(layout, tuple(s for piece in pieces for s in stretches(layout.vehicle, piece)))

    @property
    def biases(self) -> tuple[Nuisance, ...]:
        """Biases and wind of the layout."""
        return tuple(n for n in self.layout.nuisances if n.is_bias)

    @property
    def places(self) -> tuple[int, ...]:
        """Where the unknowns stand among free parameters and nuisances."""
        d = self.layout.dimension
        return (*range(d), *(d + j for j, n in enumerate(self.layout.nuisances) if n.is_bias))

    def kernel_parameters(self, piece: Piece, values: FloatArray) -> FloatArray:
        """Return kernel parameters (n_p, 1) of a piece for values (j,)."""
        vehicle, d = self.layout.vehicle, self.layout.dimension
        out = parameter_rows(vehicle, piece.changes)
        out[self.layout.rows, 0] = values[:d]
        for bias, value in zip(self.biases, values[d:], strict=True):
            if bias.maneuver == piece.maneuver:
                out[vehicle.rows[bias.name], 0] = value
        return out

    def rows(self, values: FloatArray) -> list[Rows]:
        """Return the rows of every acceleration and stretch at all samples, linearized about values (j,)."""
        vehicle, d, biases, out = self.layout.vehicle, self.layout.dimension, self.biases, []
        for stretch in self.stretches:
            cache: dict[bytes, FloatArray] = {}
            modeled = stretch.modeled(vehicle, self.kernel_parameters(stretch.piece, values), cache)
            slopes = np.zeros((*modeled.shape, len(values)))
            for j, step in enumerate(STEP * self.scales):
                if j >= d and biases[j - d].maneuver != stretch.piece.maneuver:
                    continue
                stepped = values.copy()
                stepped[j] += step
                rows = self.kernel_parameters(stretch.piece, stepped)
                slopes[:, :, j] = (stretch.modeled(vehicle, rows, cache) - modeled) / step
            y = stretch.measured - modeled + slopes @ values
            out += [
                Rows(name, y[:, i], slopes[:, i], stretch.piece.dt, stretch.piece.maneuver)
                for i, name in enumerate(ACCELERATIONS)
                if name in self.equations
            ]
        return out

    def reviewed(self, found: Estimates, domain: Domain) -> tuple[Estimates, RotorEquations]:
        """Return the estimates with R2 of each acceleration, and the equations without moments that commands do not explain.

        The linearized rows cannot give R2: their response contains the model where it was linearized.
        """
        measured, errors = [], []
        for s in self.stretches:
            modeled = s.modeled(self.layout.vehicle, self.kernel_parameters(s.piece, found.values))
            measured.append(domain.rows(s.measured, s.piece.dt))
            errors.append(domain.rows(s.measured - modeled, s.piece.dt))
        y, v = np.concatenate(measured), np.concatenate(errors)
        r2 = {n: r_squared(y[:, i], v[:, i]) for i, n in enumerate(ACCELERATIONS) if n in self.equations}
        kept = tuple(n for n in ACCELERATIONS if n not in MOMENTS or r2.get(n, 1.0) > MIN_R2)
        return replace(found, r2=r2), self if kept == self.equations else replace(self, equations=kept)

    @staticmethod
    def notices(estimates: Estimates) -> list[Notice]:
        """Return which moments were left out."""
        dropped = tuple(n for n in MOMENTS if n not in estimates.r2)
        return [notice("moment-not-explained", "", moments=dropped, limit=MIN_R2)] if dropped else []
