"""Equations of vehicles with rotors: angular accelerations and specific forces, linearized in all free numbers.

The measured motion goes into the vehicle's own equations sample by sample, commands through the delay and lag of the
rotors, and angular accelerations and specific forces come out. They are linear in most coefficients of thrust, torque
and drag; arms, inertia, lag, delay, wind and factors make them mildly nonlinear, so the regression is iterated
(Gauss-Newton). No equation of motion is integrated, and no start is too far away.

Newton's and Euler's equations need rates and specific force. A log without velocity is taken to stand in still air, one
without attitude to turn as its rates say, so what depends on them (drag, thrust lost in a climb) keeps its value where
nothing measures it, and thrust, lag and inertia come from gyros, accelerometers and commands alone.

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
from stoop.base.variables import EULER, RATES, SPECIFIC_FORCE
from stoop.estimate.regression.least_squares import (
    AR_ORDER,
    DETERMINED,
    WEIGHT_ROUNDS,
    Domain,
    Equations,
    Estimates,
    Priors,
    Rows,
    r_squared,
    solve,
)
from stoop.flight.flight import MIN_SEGMENT
from stoop.problem import Layout, Nuisance, Piece
from stoop.problem.color import least_squares_autoregression
from stoop.problem.observation import imu_axes, integrated_attitude, through_air, true_values
from stoop.vehicle import Vehicle
from stoop.vehicle.channels import rigid_states
from stoop.vehicle.delays import at_samples, first_order_lag
from stoop.vehicle.schema import WIND

STEP: Final = 1e-5  #: of finite differences, in widths of the bounds or scales of the biases
MOMENTS: Final = ("roll", "pitch", "yaw")
ACCELERATIONS: Final = (*MOMENTS, "forward", "sideways", "vertical")  #: equations, in the order of i
MIN_R2: Final = 0.25  #: of a moment; below, the recorded commands show only how noise attenuates estimates
THRUST_LAW: Final = tuple(
    f"rotors.{n}"
    for n in (
        "T0", "T1", "T2", "inflow", "translational", "lag", "delay", "gain", "idle", "nominal_voltage"
    )
)  #: determined by the vertical force, alike for all rotors  # fmt: skip
_LAGGED: Final = tuple(f"rotors.{n}" for n in ("lag", "delay", "gain", "idle", "nominal_voltage"))
_MOTION: Final = (*WIND, *RATES, *EULER)


@dataclass(frozen=True, eq=False)
class Stretch:
    """Samples of a piece without a hole, and their accelerations."""

    piece: Piece
    samples: slice
    measured: FloatArray  #: (n, i), rad/s2 and m/s2
    #: readings (n,) of velocity, rates and attitude; assumed where not recorded
    motion: Mapping[str, FloatArray]

    def modeled(
        self, vehicle: Vehicle, rows: FloatArray, cache: dict[bytes, FloatArray] | None = None
    ) -> FloatArray:
        """Return the accelerations (n, i) of the equations at the measured motion.

        Kernel parameters `rows` (n_p, 1) contain biases and wind; `cache` holds lagged commands computed before.
        """
        piece = self.piece
        late = at_samples(vehicle, piece.received(vehicle, rows))
        inputs = np.ascontiguousarray(late.T[:, self.samples])
        every = np.repeat(rows, inputs.shape[1], axis=1)
        # biases removed, relative to the wind
        motion = true_values(vehicle, self.motion, rows[:, 0])
        climbed = cumulative_trapezoid(self.motion["vd"], dx=piece.dt, initial=0)
        height = float(piece.start.get("h", 0.0)) - climbed
        rigid = rigid_states(through_air(motion) | {"h": height})
        states = vehicle.initial_states({}, every, inputs, rigid)
        for i, name in enumerate(vehicle.states):
            if name.endswith(".lag"):
                follower = name.removesuffix(".lag")
                states[i] = lagged_command(vehicle, piece, follower, rows, cache)[self.samples]
        rates, outputs = vehicle.kernel().evaluate(every, states, inputs)
        angular = rates[[vehicle.states.index(c) for c in RATES]].T
        felt = outputs[[vehicle.outputs.index(c) for c in SPECIFIC_FORCE]].T
        numbers = {name: float(rows[row, 0]) for name, row in vehicle.rows.items()}
        mounting, axes = imu_axes(vehicle, rows[:, 0]), (RATES, SPECIFIC_FORCE)
        gyro, force = (np.array([numbers.get(f"sensors.{c}.scale", 1.0) for c in some]) for some in axes)
        points = ("sensors.accelerometer_position", "mass.center_of_gravity")
        sensor, center = (np.array([numbers.get(f"{point}.{c}", 0.0) for c in "xyz"]) for point in points)
        arm = sensor - center if "sensors.accelerometer_position.x" in numbers else np.zeros(3)
        # the lever arm turns with the measured angular acceleration, not with the modeled one
        lever = np.cross(self.measured[:, :3] / gyro @ mounting - angular, arm)
        return np.concatenate([angular @ mounting.T * gyro, felt + lever @ mounting.T * force], axis=1)


def stretches(vehicle: Vehicle, piece: Piece) -> list[Stretch]:
    """Return the stretches of a piece in which all that was recorded of the motion is there, with its accelerations.

    Without rates or specific force there are none; velocity and attitude may be missing altogether.
    """
    readings = dict(zip(vehicle.outputs, piece.whole.T, strict=True))
    assumed = {c: np.zeros(len(piece.time)) for c in _MOTION if not np.isfinite(readings[c]).any()}
    assumed |= integrated_attitude(vehicle, piece.start, readings, piece.dt)
    needed = {c for c in _MOTION if c not in assumed} | {*RATES, *SPECIFIC_FORCE}
    shortest = max(8, round(MIN_SEGMENT / piece.dt))
    out = []
    complete = np.asarray(np.isfinite([readings[c] for c in needed]).all(axis=0))
    for start, stop in runs(complete):
        if stop - start >= shortest:
            run = slice(int(start), int(stop))
            motion = {c: (readings | assumed)[c][run] for c in _MOTION}
            angular = [CubicSpline(piece.time[run], motion[c])(piece.time[run], 1) for c in RATES]
            felt = [readings[c][run] for c in SPECIFIC_FORCE]
            out.append(Stretch(piece, run, np.array([*angular, *felt]).T, motion))
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
        late = piece.received(vehicle, rows)
        command = vehicle.commanded(name, np.repeat(rows, len(late), axis=1), late.T)
        lag = vehicle.rows.get(f"{prefix}.lag")
        cache[key] = command if lag is None else first_order_lag(command, float(rows[lag, 0]), piece.dt)
    return cache[key]


@dataclass(frozen=True, eq=False)
class RotorEquations(Equations):
    """Accelerations of a vehicle with rotors; unknowns are the free numbers, then biases and wind of every maneuver."""

    stretches: tuple[Stretch, ...]
    equations: tuple[str, ...] = ACCELERATIONS  #: those of `ACCELERATIONS` that are used

    linear = False
    explanations: ClassVar[Mapping[str, str]] = {"time": "equation-error-rotors"}
    needed = (
        "rates and accelerations must be measured together for some seconds; use --method multiple-shooting"
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
        out = vehicle.parameter_rows(piece.changes)
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
            own, rates = stretch.piece, [(i, n) for i, n in enumerate(ACCELERATIONS) if n in self.equations]
            out += [Rows(name, y[:, i], slopes[:, i], own.dt, own.maneuver) for i, name in rates]
        return out

    def solved(self, rows: Sequence[Rows], priors: Priors, values: FloatArray) -> Estimates:
        """Return the estimates: thrust from the forces first, then those that moments alone determine.

        A vehicle on rotors flies by its rate loop alone, so what disturbs a moment also moves the commands, and ordinary least
        squares attributes it to them. The errors of the moments are therefore taken for an autoregression, with which least
        squares are consistent under feedback as well.
        """
        found = solve(self._thrust_first(rows, priors, values), priors)
        for _ in range(WEIGHT_ROUNDS):
            white = self._whitened(rows, found.values)
            found = solve(self._thrust_first(white, priors, values), priors)
        return found

    def _whitened(self, rows: Sequence[Rows], values: FloatArray) -> list[Rows]:
        """Return the rows, those of moments with errors at values (j,) that are white."""
        taps = {n: np.zeros(AR_ORDER) for n in ACCELERATIONS}
        for name in {r.equation for r in rows} & set(MOMENTS):
            errors = [r.y - r.X @ values for r in rows if r.equation == name]
            taps[name], _ = least_squares_autoregression(errors, AR_ORDER)
        return [r.filtered(taps[r.equation]) for r in rows]

    def _thrust_first(self, rows: Sequence[Rows], priors: Priors, values: FloatArray) -> list[Rows]:
        """Return the rows, without the thrust law in moments where forces determine it.

        Moments know thrust only over inertia, and lag and thrust from a closed loop. Where forces determine a direction of the
        numbers of the thrust law, its columns in the moments are projected onto those of all other unknowns: moments then
        follow it, uncertainty included, and do not move it (a "cut"; Plummer, "Cuts in Bayesian graphical models", Statistics
        and Computing 25, 2015).
        """
        names = [*(p.name for p in self.layout.parameters), *(b.name for b in self.biases)]
        law = np.flatnonzero([n in THRUST_LAW for n in names])
        forces = [r for r in rows if r.equation not in MOMENTS]
        if not law.size or not forces or len(forces) == len(rows):
            return list(rows)
        alone = solve(forces, priors)
        information = np.diag(1.0 / np.minimum(priors.sigma, 1e3 * self.scales) ** 2)
        for r in forces:
            information += r.X.T @ r.X / alone.sigma[r.equation] ** 2
        covariance = np.linalg.inv(information * np.outer(self.scales, self.scales))[np.ix_(law, law)]
        variances, vectors = np.linalg.eigh(covariance)
        known = np.zeros((len(values), int(np.sum(variances < DETERMINED**2))))
        known[law] = vectors[:, variances < DETERMINED**2]
        if not known.size:
            return list(rows)
        others = np.linalg.svd(known)[0][:, known.shape[1] :]
        moments = [r for r in rows if r.equation in MOMENTS]
        left = [np.std(r.y - r.X @ alone.values) or 1.0 for r in moments]
        scaled = np.concatenate([r.X / s for r, s in zip(moments, left, strict=True)]) * self.scales
        follow = np.linalg.lstsq(scaled @ others, scaled @ known, rcond=None)[0]
        turn = others @ (others.T + follow @ known.T) * self.scales[:, None] / self.scales
        cut = [replace(r, X=r.X @ turn, y=r.y + r.X @ (turn @ values - values)) for r in moments]
        rest = iter(cut)
        return [next(rest) if r.equation in MOMENTS else r for r in rows]

    def reviewed(self, found: Estimates, domain: Domain) -> tuple[Estimates, RotorEquations]:
        """Return the estimates with R2 of each acceleration, and the equations without moments that commands do not explain.

        The linearized rows cannot give R2: their response contains the model where it was linearized. R2 of a moment is that of
        its samples or, if larger, of its innovations: slow disturbances, which the rate loop takes up, are not held against it.
        """
        rows, r2 = [], {}
        for s in self.stretches:
            modeled = s.modeled(self.layout.vehicle, self.kernel_parameters(s.piece, found.values))
            y, x = (domain.rows(signals, s.piece.dt) for signals in (s.measured, modeled))
            rates = [(i, n) for i, n in enumerate(ACCELERATIONS) if n in self.equations and len(y)]
            rows += [Rows(name, y[:, i], x[:, i : i + 1], s.piece.dt) for i, name in rates]
        of_errors, of_response = self._whitened(rows, np.ones(1)), self._whitened(rows, np.zeros(1))
        for name in self.equations:
            own, innovations, alone = (
                np.concatenate([np.column_stack([r.y, r.X]) for r in each if r.equation == name])
                for each in (rows, of_errors, of_response)
            )
            r2[name] = r_squared(own[:, 0], own[:, 0] - own[:, 1])
            if name in MOMENTS and np.cov(alone.T)[0, 1] > 0.0:  # commands turn it that way at all
                r2[name] = max(r2[name], r_squared(alone[:, 0], innovations[:, 0] - innovations[:, 1]))
        kept = tuple(n for n in ACCELERATIONS if n not in MOMENTS or r2.get(n, 1.0) > MIN_R2)
        return replace(found, r2=r2), self if kept == self.equations else replace(self, equations=kept)

    def notices(self, estimates: Estimates) -> list[Notice]:
        """Return which moments were left out."""
        dropped = tuple(n for n in MOMENTS if n not in estimates.r2)
        return [notice("moment-not-explained", "", moments=dropped, limit=MIN_R2)] if dropped else []
