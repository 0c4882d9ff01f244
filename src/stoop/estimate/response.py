"""First-order response of simulated readings to small changes of the equations, along an estimate.

With the state derivative f and the readings h of an extended vehicle, a change of f by df(t) and of h by dh(t) changes the
readings by dy = C dx + dh, where dx follows from dx' = A dx + df, dx(0) = 0, with A and C the Jacobians of f and h along
the trajectory. One evaluation of the equations over all samples gives df and dh of a change, whatever it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.linalg import expm

from stoop.base.arrays import FloatArray
from stoop.base.variables import WRAPPED
from stoop.problem.misfit import Misfit
from stoop.simulation.delays import delayed, late_inputs, late_outputs
from stoop.vehicle import Vehicle
from stoop.vehicle.extensions import Extension, extended
from stoop.vehicle.vehicle import slope_input

if TYPE_CHECKING:
    from stoop.vehicle.symbolic.arrays import Equations

STEP: Final = 1e-6  #: of a state's size, for the Jacobians


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A piece of a flight as the estimate flies it; n samples."""

    equations: Equations
    rows: FloatArray  #: (n_p,), parameters of the equations
    states: FloatArray  #: (n_x, n)
    inputs: FloatArray  #: (n_u, n), as they arrive
    dt: float  #: s

    @cached_property
    def reference(self) -> tuple[FloatArray, FloatArray]:
        """Derivatives (n_x, n) and readings (n_y, n) of the estimate."""
        return self.equations(self.rows, self.states, self.inputs)

    def change(self, rows: FloatArray, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return df (n_x, n) and dh (n_y, n) of other parameters or inputs."""
        derivative, readings = self.equations(rows, self.states, inputs)
        return derivative - self.reference[0], readings - self.reference[1]

    def responses(self, forcing: FloatArray, direct: FloatArray) -> FloatArray:
        """Return dy (n, n_y, m) of m changes: df (n, n_x, m) and dh (n, n_y, m)."""
        A, C = self._jacobians()
        mean = 0.5 * (A[:-1] + A[1:])
        transition = expm(mean * self.dt)
        pushed = 0.5 * self.dt * (transition @ forcing[:-1] + forcing[1:])
        dx = np.zeros_like(forcing)
        for k in range(len(transition)):
            np.matmul(transition[k], dx[k], out=dx[k + 1])
            dx[k + 1] += pushed[k]
        return np.asarray(C @ dx + direct)

    def _jacobians(self) -> tuple[FloatArray, FloatArray]:
        """Return A (n, n_x, n_x) and C (n, n_y, n_x)."""
        A, C = [], []
        for i, x in enumerate(self.states):
            step = STEP * max(1.0, float(np.max(np.abs(x))))
            ends = []
            for sign in (1.0, -1.0):
                states = self.states.copy()
                states[i] += sign * step
                ends.append(self.equations(self.rows, states, self.inputs))
            A.append((ends[0][0] - ends[1][0]) / (2.0 * step))
            C.append((ends[0][1] - ends[1][1]) / (2.0 * step))
        return np.stack(A).transpose(2, 1, 0).copy(), np.stack(C).transpose(2, 1, 0).copy()


def fly(
    equations: Equations,
    rows: FloatArray,
    start: FloatArray,
    inputs: FloatArray,
    held: tuple[int, ...],
    dt: float,
) -> FloatArray:
    """Return the states (n_x, n) from a start (n_x,) by Runge and Kutta's method, as the kernel takes its steps.

    Inputs (n_u, n) as they arrive are linear between samples; those `held` keep their value until the next one.
    """
    n = inputs.shape[1]
    out = np.empty((len(start), n))
    out[:, 0] = start
    middle = 0.5 * (inputs[:, :-1] + inputs[:, 1:])
    ends = inputs[:, 1:].copy()
    for i in held:
        middle[i] = ends[i] = inputs[i, :-1]
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(n - 1):
            x = out[:, k]
            a = equations(rows, x, inputs[:, k])[0]
            b = equations(rows, x + 0.5 * dt * a, middle[:, k])[0]
            c = equations(rows, x + 0.5 * dt * b, middle[:, k])[0]
            d = equations(rows, x + dt * c, ends[:, k])[0]
            out[:, k + 1] = x + dt / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    return out


@dataclass(frozen=True, eq=False)
class Responses:
    """Whitened responses (n, n_y, m) of each piece to m extensions, per SI unit."""

    extensions: tuple[Extension, ...]
    pieces: tuple[FloatArray, ...]


def simulation_responses(problem: Misfit, z: FloatArray) -> Responses:
    """Return how the simulation at a search vector (D + E,) responds to every extension of its vehicle."""
    from stoop.vehicle.symbolic.arrays import array_equations  # SymPy is imported when it is needed

    base = problem.layout.vehicle
    vehicle, catalogue = extended(base)
    equations, out = array_equations(vehicle), []
    held = tuple(base.inputs.index(slope_input(c)) for c in base.sloped)
    for i, piece in enumerate(problem.pieces):
        known, start = problem.candidates(z[None, :], i)
        rows = vehicle.values.copy()
        for name, row in base.rows.items():
            rows[vehicle.rows[name]] = known[row, 0]
        received = late_inputs(base, piece.inputs, known, piece.dt).T.astype(float)
        states = fly(equations, rows, start[:, 0], received, held, piece.dt)
        trajectory = Trajectory(equations, rows, states, received, piece.dt)
        changes = [_change(one, base, vehicle, trajectory) for one in catalogue]
        dy = trajectory.responses(*(np.stack(parts, axis=2) for parts in zip(*changes, strict=True)))
        late = late_outputs(
            base,
            np.ascontiguousarray(dy.transpose(2, 0, 1)),
            np.repeat(known, len(catalogue), axis=1),
            piece.dt,
        )
        late /= np.array([one.step for one in catalogue])[:, None, None]
        present = np.isfinite(piece.measured)
        white = problem.weights.whiten(np.where(present, late, 0.0), present)
        out.append(np.ascontiguousarray(white.transpose(1, 2, 0)))
    return Responses(catalogue, tuple(out))


def _change(one: Extension, base: Vehicle, vehicle: Vehicle, at: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Return df (n, n_x) and dh (n, n_y) of a step of an extension of the base vehicle."""
    rows, inputs = at.rows.copy(), at.inputs.copy()
    for name in one.numbers:
        rows[vehicle.rows[name]] += one.step
    for name in (name for c in one.inputs for name in (c, slope_input(c)) if name in base.inputs):
        column = base.inputs.index(name)
        inputs[column] = delayed(at.inputs[column], one.step / at.dt)
    df, dh = at.change(rows, inputs)
    for column in (base.outputs.index(c) for c in one.readings):
        reading = (
            np.unwrap(at.reference[1][column]) if base.outputs[column] in WRAPPED else at.reference[1][column]
        )
        dh[column] += delayed(reading, one.step / at.dt) - reading
    return df.T, dh.T
