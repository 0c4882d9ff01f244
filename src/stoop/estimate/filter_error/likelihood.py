"""The likelihood of innovations, its gradient and Fisher's information.

For innovations v_k of covariance S_k, both functions of the unknowns,

    -ln L = 1/2 sum_k (v_k' S_k^-1 v_k + ln det S_k) + priors,

    M_ij = sum_k (dv_k/di' S_k^-1 dv_k/dj + 1/2 tr(S_k^-1 dS_k/di S_k^-1 dS_k/dj)) + priors.

References
----------
Maine and Iliff (1981), see the head of the package; for M: S. M. Kay, *Fundamentals of Statistical Signal
Processing: Estimation Theory*, Prentice Hall, 1993, eq. (3.31).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray, IntArray
from stoop.estimate.filter_error.gains import Gain, Gains, Plan
from stoop.estimate.filter_error.linearization import (
    LinearModels,
    Points,
    averaged,
    linearized,
    measured_points,
    undelayed,
)
from stoop.estimate.filter_error.noise import Noise
from stoop.kernels import filtering
from stoop.optimize.normal_equations import gram
from stoop.problem import Misfit
from stoop.simulate.delays import late_inputs

STEP: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Innovations:
    """Innovations of one piece, whitened, and their dependence on the unknowns.

    Attributes
    ----------
    white : (n, n_y)
        S^-1/2 v.
    logdet : float
        Sum of the logarithms of det S.
    entries : (j,) of int
        Unknowns that touch this piece.
    slopes : (n, n_y, j)
        S^-1/2 dv/d(unknown).
    spreads : (G, n_y, n_y, j)
        S^-1/2 dS/d(unknown) S^-1/2 of each gain.
    which : (n,)
        Gain of each sample.
    """

    white: FloatArray
    logdet: float
    entries: IntArray
    slopes: FloatArray
    spreads: FloatArray
    which: IntArray

    @property
    def cost(self) -> float:
        """Twice the negative logarithm of the likelihood, without its constant."""
        return float(np.sum(self.white**2)) + self.logdet

    @cached_property
    def spread_information(self) -> FloatArray:
        """Return the information (j, j) in the size of the innovations."""
        counts = np.bincount(self.which, minlength=len(self.spreads))
        flat = self.spreads.reshape(len(counts), -1, len(self.entries))
        rows = (flat * np.sqrt(0.5 * counts)[:, None, None]).reshape(-1, len(self.entries))
        return gram(np.ascontiguousarray(rows.T))

    @property
    def information(self) -> FloatArray:
        """Fisher's information (j, j)."""
        rows = self.slopes.reshape(-1, len(self.entries))
        return gram(np.ascontiguousarray(rows.T)) + self.spread_information

    @property
    def gradient(self) -> FloatArray:
        """Derivative (j,) of the negative logarithm of the likelihood."""
        linear = self.slopes.reshape(-1, len(self.entries)).T @ self.white.ravel()
        ny = self.white.shape[1]
        surplus = np.zeros((len(self.spreads), ny, ny))
        np.add.at(surplus, self.which, np.eye(ny) - self.white[:, :, None] * self.white[:, None, :])
        return np.asarray(linear + 0.5 * np.einsum("gik,gikj->j", surplus, self.spreads))


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The likelihood of a joint fit as a function of [parameters | nuisances | logarithms of noise].

    Attributes
    ----------
    problem : Misfit
        Layout of the first two parts, pieces and priors.
    noise : Noise
        Layout of the third.
    gain : Gain
    points : tuple of Points
        Where each piece is linearized for the gains of `anchor`.
    anchor : (k,)
        Unknowns whose gains find the states at which any candidate is linearized. So a candidate's points of
        linearization follow its own states: were they fixed, the size of the innovations would seem to depend on
        what shifts states and readings together (a bias of the vane against the lift at zero incidence).
    """

    problem: Misfit
    noise: Noise
    gain: Gain
    points: tuple[Points, ...]
    anchor: FloatArray

    @classmethod
    def of(cls, problem: Misfit, noise: Noise, gain: Gain, anchor: FloatArray) -> Likelihood:
        """Return the likelihood, its first gains linearized at what was measured; late readings are shifted."""
        shifted = replace(problem, pieces=tuple(undelayed(problem, piece) for piece in problem.pieces))
        points = tuple(measured_points(shifted, piece, gain.plan(piece).points) for piece in shifted.pieces)
        return cls(shifted, noise, gain, points, anchor)

    @cached_property
    def plans(self) -> tuple[Plan, ...]:
        """Where each piece is linearized and what was measured."""
        return tuple(self.gain.plan(piece) for piece in self.problem.pieces)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.known + self.noise.size

    @property
    def known(self) -> int:
        """Number of parameters and nuisances; logarithms of noise follow."""
        return self.problem.dimension + self.problem.extra

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the unknowns."""
        low, high = self.noise.bounds
        free = np.full(self.problem.extra, np.inf)
        d = self.problem.dimension
        return np.concatenate([np.zeros(d), -free, low]), np.concatenate([np.ones(d), free, high])

    def cost(self, z: FloatArray) -> float:
        """Return twice the negative logarithm of the posterior; infinite where the filter diverges."""
        total = float(np.sum(self.problem.layout.prior_residuals(z[None, : self.known]) ** 2))
        for i in range(len(self.points)):
            total += self._innovations(z, i, np.empty(0, dtype=np.int64)).cost
        return total if np.isfinite(total) else np.inf

    def innovations(self, z: FloatArray) -> list[Innovations]:
        """Return the innovations of every piece, with slopes."""
        return [self._innovations(z, i, entries) for i, entries in enumerate(self._entries)]

    def gains_at(self, z: FloatArray) -> list[Gains]:
        """Return the gains of every piece with the unknowns z (k,)."""
        each = range(len(self.points))
        starts = [self.problem.candidates(z[None, : self.known], i) for i in each]
        return [self._gains(z[None, :], *starts[i], i) for i in each]

    def prior(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gradient (k,) and information (k, k) of the priors."""
        layout = self.problem.layout
        rows = np.zeros((len(layout.prior_jacobian()), self.size))
        rows[:, : self.known] = layout.prior_jacobian()
        return rows.T @ layout.prior_residuals(z[None, : self.known])[0], rows.T @ rows

    def along(self, z: FloatArray) -> Likelihood:
        """Return the likelihood linearized along the states that the filter finds with these unknowns."""
        points = []
        for i, point in enumerate(self.points):
            rows, start = self.problem.candidates(z[None, : self.known], i)
            states = self._states(i, rows, start)[:, :, 0]
            if not np.isfinite(states).all():
                return self
            points.append(Points(states, point.inputs))
        return replace(self, points=tuple(points), anchor=z)

    @cached_property
    def _entries(self) -> list[IntArray]:
        """Return the unknowns that touch each piece."""
        d, tail = self.problem.dimension, range(self.known, self.size)
        return [
            np.array([*range(d), *(j for j, _ in own), *tail], dtype=np.int64) for own in self.problem.own
        ]

    def _innovations(self, z: FloatArray, index: int, entries: IntArray) -> Innovations:
        steps = np.zeros(self.size)  # backward at an upper bound
        steps[entries] = np.where(z[entries] + STEP > self.bounds[1][entries], -STEP, STEP)
        Z = np.concatenate([z[None, :], z + np.diag(steps)[np.diag(steps).any(axis=1)]])
        rows, start = self.problem.candidates(Z[:, : self.known], index)
        gains = self._gains(Z, rows, start, index)
        v, _ = run_filter(self.problem, index, rows, start, gains)
        return _whitened(v, gains, entries, steps[entries])

    def _gains(self, Z: FloatArray, rows: FloatArray, start: FloatArray, index: int) -> Gains:
        """Return the gains of candidates, each linearized at its own states."""
        models, model = _distinct(Z[:, : self.known])  # the noise of sensors changes no state
        few = np.ascontiguousarray(rows[:, models])
        states = self._states(index, few, np.ascontiguousarray(start[:, models]))
        piece, inputs = self.problem.pieces[index], self.points[index].inputs
        linear = linearized(self.problem.layout.vehicle, few, states, inputs, piece.dt)
        return self._gains_of(index, linear.of(model), Z[:, self.known :])

    def _gains_of(self, index: int, linear: LinearModels, tail: FloatArray) -> Gains:
        process = self.noise.process(tail, linear.drive, self.problem.pieces[index].dt)
        vehicle = self.problem.layout.vehicle
        return self.gain.gains(vehicle, self.plans[index], linear, process, self.noise.variances(tail))

    def _states(self, index: int, rows: FloatArray, start: FloatArray) -> FloatArray:
        """Return the states (n_x, r, B) that the anchor's gains find around each point."""
        base, count = self._anchored[index], rows.shape[1]
        gains = Gains(np.repeat(base.gain, count, axis=2), base.covariance, base.which)
        states = run_filter(self.problem, index, rows, start, gains, states=True)[1]
        return averaged(self.problem.layout.vehicle, states, self.plans[index].points)

    @cached_property
    def _anchored(self) -> list[Gains]:
        """Return the gains of the anchor for each piece."""
        out, vehicle = [], self.problem.layout.vehicle
        for i, (piece, point) in enumerate(zip(self.problem.pieces, self.points, strict=True)):
            rows, _ = self.problem.candidates(self.anchor[None, : self.known], i)
            linear = linearized(vehicle, rows, point.states[:, :, None], point.inputs, piece.dt)
            out.append(self._gains_of(i, linear, self.anchor[None, self.known :]))
        return out


def run_filter(
    problem: Misfit, index: int, rows: FloatArray, start: FloatArray, gains: Gains, states: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Run the filter of every candidate over one piece; those that differ in a delay have inputs of their own."""
    vehicle, piece = problem.layout.vehicle, problem.pieces[index]
    inputs = late_inputs(vehicle, piece.inputs, rows, piece.dt)
    kernel = vehicle.kernel()
    if inputs.ndim == 2:
        return filtering.innovations(
            kernel, rows, start, gains.gain, gains.which, inputs, piece.measured, piece.dt, states
        )
    _, group = np.unique(inputs.reshape(-1, inputs.shape[2]), axis=1, return_inverse=True)
    alike = [np.flatnonzero(group.ravel() == g) for g in range(int(group.max()) + 1)]
    parts = [
        filtering.innovations(
            kernel, rows[:, own], start[:, own], gains.gain[:, :, own], gains.which,
            np.ascontiguousarray(inputs[:, :, own[0]]), piece.measured, piece.dt, states,
        )
        for own in alike
    ]  # fmt: skip
    order = np.argsort(np.concatenate(alike))
    first, second = (
        np.concatenate(part)[order] if part[0].size else part[0] for part in zip(*parts, strict=True)
    )
    return first, second


def _distinct(Z: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the first of each kind of rows, and the kind of every row; most unknowns do not touch a gain."""
    same = np.all(Z[0] == Z, axis=1)
    same[0] = False
    first = np.flatnonzero(~same)
    kind = np.zeros(len(Z), dtype=np.int64)
    kind[first] = np.arange(len(first))
    return first, kind


def _whitened(v: FloatArray, gains: Gains, entries: IntArray, taken: FloatArray) -> Innovations:
    """Whiten innovations (1 + j, n, n_y) by the covariance of the first, and take differences."""
    ny = v.shape[2]
    S = gains.covariance
    if not (np.isfinite(S[0]).all() and np.isfinite(v[0]).all()):
        return Innovations(
            v[0] * np.nan, np.inf, entries, np.zeros((*v.shape[1:], 0)), np.zeros((0, ny, ny, 0)), gains.which
        )
    lower = np.linalg.cholesky(S[0])
    root = np.linalg.inv(lower)
    logs = 2.0 * np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1)
    white = whitened_by(root, v, gains.which)
    slopes = np.moveaxis((white[1:] - white[:1]) / taken[:, None, None], 0, 2)
    spreads = root[None] @ (S[1:] - S[:1]) @ np.swapaxes(root, 1, 2)[None] / taken[:, None, None, None]
    return Innovations(
        np.ascontiguousarray(white[0]),
        float(np.sum(logs[gains.which])),
        entries,
        np.nan_to_num(slopes),
        np.nan_to_num(np.moveaxis(spreads, 0, 3)),
        gains.which,
    )


def whitened_by(root: FloatArray, v: FloatArray, which: IntArray) -> FloatArray:
    """Return the products of roots (G, n_y, n_y) with innovations (B, n, n_y), each sample by the root that it has."""
    if len(root) == len(which):  # a gain for every sample
        return np.asarray(np.matmul(root, v[..., None])[..., 0])
    white = np.empty_like(v)
    for g, matrix in enumerate(root):
        own = slice(None) if len(root) == 1 else np.flatnonzero(which == g)
        white[:, own] = v[:, own] @ matrix.T
    return white
