"""The method ``two-stage``: flight-path reconstruction first, then forces and moments along the reconstructed states.

The first stage needs no aerodynamics. With the specific force f and the rates omega that were measured, less their biases b,
as inputs, the kinematics of body-axes velocity and attitude

    x' = F(x, f - b_f, omega - b_omega),  x = (u, v, w, phi, theta),

are compared with airspeed, flow angles and attitude. Biases are unknown where the vehicle file has them free. States of all
samples and biases are those of greatest posterior probability: Gauss-Newton on the whole trajectory, an iterated smoother, with
white noise of accelerometers and gyros between samples. The second stage fits the free terms to force and moment
coefficients along these states by least squares, which is output error of a model without states of its own. Its regressors
have hardly any noise left; in equation error that noise biases the estimates.

References
----------
R. V. Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., AIAA, 2015, chapters 6 (two-step method) and 10 (flight
path reconstruction).
J. A. Mulder, Q. P. Chu, J. K. Sridhar, J. H. Breeman and M. Laban, "Non-linear aircraft flight path reconstruction review and
new advances", *Progress in Aerospace Sciences* 35(7), 1999, pp. 673-726.
B. M. Bell, "The iterated Kalman smoother as a Gauss-Newton method", *SIAM Journal on Optimization* 4(3), 1994, pp. 626-636.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Final, Self

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.sparse import coo_array, vstack
from scipy.sparse.linalg import spsolve

from stoop.base.arrays import FloatArray, IntArray
from stoop.base.notices import Notice, notice
from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import RATES, SPECIFIC_FORCE
from stoop.errors import IdentificationError
from stoop.estimate.filter_gains import first_guess
from stoop.estimate.regression.aircraft import AircraftEquations, History, Motion
from stoop.estimate.regression.least_squares import Estimates, TimeDomain
from stoop.estimate.regression.method import regression
from stoop.problem import Layout, Piece
from stoop.problem.observation import observation_model, true_values
from stoop.vehicle import Vehicle
from stoop.vehicle.channels import rigid_states
from stoop.vehicle.symbolic.frames import body_acceleration, euler_rates

INERTIAL: Final = (*SPECIFIC_FORCE, *RATES)
READ: Final = ("V", "alpha", "beta", "phi", "theta")
#: states (of u, v, w, phi, theta) that the equations of a reduced model have; the others are as measured
MODELED: Final = {"full": (0, 1, 2, 3, 4), "longitudinal": (0, 2, 4), "lateral": (1, 3)}
MAX_STEPS: Final = 20
#: of a step, in standard deviations of the readings, rms
TOLERANCE: Final = 1e-3
#: m/s, rad, m/s2, rad/s, for derivatives
DIFFERENCE: Final = 1e-5


def rates(states: FloatArray, inertial: FloatArray) -> FloatArray:
    """Return the rates (5, n) of u, v, w, phi, theta for specific force and rates (6, n) at the center of gravity."""
    u, v, w, phi, theta = states
    ax, ay, az, p, q, r = inertial
    sines = (np.sin(phi), np.cos(phi)), (np.sin(theta), np.cos(theta))
    (sin_phi, cos_phi), (sin_theta, cos_theta) = sines
    down = (-sin_theta, sin_phi * cos_theta, cos_phi * cos_theta)
    acceleration = body_acceleration((ax, ay, az), STANDARD_GRAVITY, down, (u, v, w), (p, q, r))
    return np.stack([*acceleration, *euler_rates((p, q, r), *sines)[:2]])


def readings(states: FloatArray) -> FloatArray:
    """Return V, alpha, beta, phi, theta (5, n) at the center of gravity."""
    u, v, w, phi, theta = states
    V = np.sqrt(u * u + v * v + w * w)
    return np.stack([V, np.arctan2(w, u), np.arcsin(v / np.maximum(V, 1e-3)), phi, theta])


def derivatives(function: Callable[[FloatArray], FloatArray], x: FloatArray) -> FloatArray:
    """Return the derivatives (n, i, j) of values (i, n) by arguments (j, n), by central differences."""
    steps = DIFFERENCE * np.eye(len(x))[:, :, None]
    slopes = [(function(x + step) - function(x - step)) / (2.0 * DIFFERENCE) for step in steps]
    return np.ascontiguousarray(np.stack(slopes, axis=1).transpose(2, 0, 1))


def blocks(values: FloatArray, columns: IntArray, width: int) -> coo_array:
    """Return a sparse matrix with blocks (m, r, c) below each other, each from its own column (m,)."""
    m, r, c = values.shape
    rows = np.repeat(np.arange(m * r), c)
    places = (columns[:, None, None] + np.arange(c) + np.zeros((1, r, 1), dtype=np.int64)).ravel()
    return coo_array((values.ravel(), (rows, places)), shape=(m * r, width))


@dataclass(frozen=True, eq=False)
class Path:
    """What was measured along n samples of a piece, SI, at the center of gravity, along body axes."""

    #: (5, n), u, v, w, phi, theta as measured
    states: FloatArray
    #: (6, n), specific force and rates, and their standard deviations (6,)
    inertial: FloatArray
    noise: FloatArray
    #: (5, n), V, alpha, beta, phi, theta, and their standard deviations (5,), infinite where not measured
    measured: FloatArray
    sigma: FloatArray
    #: (n - 1,), s, from sample to sample; infinite over a hole
    dt: FloatArray
    #: states that are reconstructed
    modeled: tuple[int, ...]
    #: inertial channels that were measured
    sensed: tuple[int, ...]
    #: channels (of specific force, rates, then readings) with an unknown bias, and its prior standard deviation
    biased: tuple[int, ...]
    prior: FloatArray

    def rows(self, states: FloatArray, bias: FloatArray) -> tuple[FloatArray, coo_array]:
        """Return whitened residuals (N,) and their derivatives (N, n s + b): kinematics, readings, priors of the biases."""
        some, n, b = list(self.modeled), states.shape[1], len(self.biased)
        s, inertial = len(some), self.inertial - bias[:6, None]
        at, width = s * np.arange(n), n * s + b
        slope = rates(states, inertial)[some].T
        A = derivatives(lambda x: rates(x, inertial), states)[:, some][:, :, some]
        B = derivatives(lambda y: rates(states, y), inertial)[:, some]
        there, own = np.isfinite(self.dt), list(self.sensed)
        dt = np.where(there, self.dt, 1.0)[:, None, None]
        driven = B[:-1, :, own] * self.noise[own] * dt
        white = np.linalg.inv(np.linalg.cholesky(driven @ driven.transpose(0, 2, 1))) * there[:, None, None]
        gap = np.diff(states[some]).T - 0.5 * dt[:, 0] * (slope[1:] + slope[:-1])
        behind, ahead = white @ (-np.eye(s) - 0.5 * dt * A[:-1]), white @ (np.eye(s) - 0.5 * dt * A[1:])
        of_bias = np.eye(11)[:, list(self.biased)]
        pushed = 0.5 * dt * (white @ (B[1:] + B[:-1])) @ of_bias[:6]
        H = derivatives(readings, states)[:, :, some] / self.sigma[:, None]
        shifted = np.repeat((of_bias[6:] / self.sigma[:, None])[None], n, axis=0)
        left = (readings(states) + bias[6:, None] - self.measured) / self.sigma[:, None]
        last = np.full(n, n * s)
        slopes = [
            blocks(behind, at[:-1], width) + blocks(ahead, at[1:], width) + blocks(pushed, last[1:], width),
            blocks(H, at, width) + blocks(shifted, last, width),
            blocks(np.diag(1.0 / self.prior)[None], last[:1], width),
        ]
        residual = [(white @ gap[:, :, None]).ravel(), left.T.ravel(), bias[list(self.biased)] / self.prior]
        return np.concatenate(residual), vstack(slopes)

    def reconstructed(self) -> tuple[FloatArray, FloatArray, bool]:
        """Return the likeliest states (5, n), biases (11,) of specific force, rates, readings, and whether they converged."""
        states, bias, some = self.states.copy(), np.zeros(11), list(self.modeled)
        count = states.shape[1] * len(some)
        for _ in range(MAX_STEPS):
            residual, slopes = self.rows(states, bias)
            step = -spsolve((slopes.T @ slopes).tocsc(), slopes.T @ residual)
            before = readings(states)
            states[some] += step[:count].reshape(-1, len(some)).T
            bias[list(self.biased)] += step[count:]
            change = (readings(states) - before) / self.sigma[:, None]
            if not (size := np.sqrt(np.mean(change**2))) > TOLERANCE:
                return states, bias, bool(np.isfinite(size) and np.isfinite(states).all())
        return states, bias, False


def specific_force(vehicle: Vehicle, motion: Motion, time: FloatArray) -> FloatArray:
    """Return the specific force (3, n) at the center of gravity along body axes; zero where it was not measured."""
    force = {**dict.fromkeys(SPECIFIC_FORCE, np.zeros(len(time))), **true_values(vehicle, motion.readings)}
    found, rows = np.stack([force[c] for c in SPECIFIC_FORCE]), vehicle.rows
    if "sensors.accelerometer_position.x" in rows:
        center = [f"mass.center_of_gravity.{axis}" for axis in "xyz"]
        arm = np.array([vehicle.value(f"sensors.accelerometer_position.{axis}") for axis in "xyz"])
        arm = arm - np.array([vehicle.value(name) if name in rows else 0.0 for name in center])
        omega = np.stack([motion.states[c] for c in RATES], axis=1)
        turned = np.cross(CubicSpline(time, omega)(time, 1), arm) + np.cross(omega, np.cross(omega, arm))
        found = found - turned.T
    return found


def reconstructed(vehicle: Vehicle, piece: Piece, noise: Mapping[str, float]) -> tuple[Motion, bool]:
    """Return the motion of a piece with the reconstructed states, and whether these converged.

    The `noise` is the standard deviation of each output, its unit. States that are not finite stay as measured.
    """
    motion = Motion.of(vehicle, piece)
    time, states = piece.time[motion.samples], motion.states
    if len(time) < 2:
        return motion, True
    rigid, known = rigid_states(states), {p.name: p for p in vehicle.parameters if p.free}
    free = {i: known[n] for i, c in enumerate((*INERTIAL, *READ)) if (n := f"sensors.{c}.bias") in known}
    path = Path(
        np.stack([*(rigid[n] for n in "uvw"), states["phi"], states["theta"]]),
        np.concatenate([specific_force(vehicle, motion, time), [states[c] for c in RATES]]),
        np.array([noise.get(c, 1.0) for c in INERTIAL]),
        np.stack([states[c] for c in READ]),
        np.array([noise.get(c, np.inf) for c in READ]),
        np.where(np.diff(motion.samples) == 1, piece.dt, np.inf),
        MODELED[vehicle.reduce],
        tuple(i for i, c in enumerate(INERTIAL) if c in vehicle.outputs),
        tuple(free),
        np.array([p.prior or 1.0 for p in free.values()]),
    )
    found, bias, converged = path.reconstructed()
    if not np.isfinite(found).all():
        return motion, False
    biases = dict(zip(INERTIAL, bias.tolist(), strict=False))
    flown = dict(zip(READ, readings(found), strict=True))
    flown |= {c: states[c] - biases[c] for c in RATES}
    read = {c: y - biases[c] for c, y in motion.readings.items()}
    return replace(motion, states={**states, **flown}, readings=read), converged


@dataclass(frozen=True, eq=False)
class ReconstructedEquations(AircraftEquations):
    """The coefficients of an aircraft along reconstructed states."""

    #: s, start of each piece whose reconstruction did not converge
    not_converged: tuple[float, ...] = ()
    explanations: ClassVar[Mapping[str, str]] = {"time": "two-stage"}

    @classmethod
    def of_vehicle(cls, vehicle: Vehicle) -> type[Self]:
        """Return the equations of an aircraft; an IdentificationError refuses a vehicle with rotors."""
        if not observation_model(vehicle).open_loop:
            raise IdentificationError(
                f"{vehicle.where}: two-stage is for aircraft; use --method equation-error or multiple-shooting"
            )
        return cls

    @classmethod
    def of(cls, layout: Layout, pieces: Sequence[Piece]) -> Self:
        """Return the equations of measured maneuvers; sensors are as good as their file says, or worse."""
        vehicle = layout.vehicle
        stated = np.array([getattr(vehicle.file.sensors, c).sigma for c in vehicle.outputs])
        sigma = np.fmax(first_guess(vehicle, pieces), stated)
        noise, lost = dict(zip(vehicle.outputs, sigma.tolist(), strict=True)), list[float]()

        def motion(vehicle: Vehicle, piece: Piece) -> Motion:
            found, converged = reconstructed(vehicle, piece, noise)
            lost.extend([] if converged else [float(piece.time[0])])
            return found

        found = tuple(h for piece in pieces for h in History.of(vehicle, piece, motion))
        return cls(layout, found, tuple(lost))

    def notices(self, _: Estimates) -> list[Notice]:
        """Return where the flight path is doubtful."""
        return [notice("path-not-converged", times=self.not_converged)] if self.not_converged else []


two_stage: Final = partial(regression, domain=TimeDomain(), kinds=ReconstructedEquations.of_vehicle)
