"""The likelihood of innovations, its gradient and Fisher's information; the filter with fixed gains for refits.

For innovations v_k of covariance S_k, both functions of the unknowns,

    -ln L = 1/2 sum_k (v_k' S_k^-1 v_k + ln det S_k) + priors,

    M_ij = sum_k (dv_k/di' S_k^-1 dv_k/dj + 1/2 tr(S_k^-1 dS_k/di S_k^-1 dS_k/dj)) + priors.

References
----------
R. E. Maine and K. W. Iliff, "Formulation and implementation of a practical algorithm for parameter estimation with
process and measurement noise", *SIAM Journal on Applied Mathematics* 41(3), 1981, pp. 558-579.
For M: S. M. Kay, *Fundamentals of Statistical Signal Processing: Estimation Theory*, Prentice Hall, 1993, eq. (3.31).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Final

import numpy as np

from stoop.base.arrays import FloatArray, IntArray
from stoop.estimate.filter_gains import RANGE, Gain, Gains, Noise, Plan
from stoop.estimate.linearization import (
    LinearModels,
    Points,
    averaged,
    linearized,
    measured_points,
    perturbation_columns,
)
from stoop.estimate.refit_problem import RefitProblem
from stoop.estimate.response import ExtendedModel, Responses, Trajectory
from stoop.kernels import filtering
from stoop.optimize.normal_equations import project, square
from stoop.problem import Misfit
from stoop.vehicle.delays import distinct_inputs

#: name of the search of filter error, in its states
SCORING: Final = "scoring"
STEP: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Innovations:
    """Innovations of one piece, whitened, and their dependence on the unknowns."""

    #: (n, n_y), S^-1/2 v
    white: FloatArray
    #: sum of the logarithms of det S
    logdet: float
    #: (j,), unknowns that touch this piece
    entries: IntArray
    #: (n, n_y, j), S^-1/2 dv/d(unknown)
    slopes: FloatArray
    #: (G, n_y, n_y, j), S^-1/2 dS/d(unknown) S^-1/2 of each gain
    spreads: FloatArray
    #: (n,), gain of each sample
    which: IntArray

    @classmethod
    def of(cls, v: FloatArray, gains: Gains, entries: IntArray, taken: FloatArray) -> Innovations:
        """Whiten innovations (1 + j, n, n_y) by the covariance of the first, and take differences by steps (j,)."""
        ny, S, which = v.shape[2], gains.covariance, gains.which
        try:
            lower = np.linalg.cholesky(S[0])  # NaN where the covariance is not finite
        except np.linalg.LinAlgError:
            lower = np.full(S[0].shape, np.nan)
        if not (np.isfinite(lower).all() and np.isfinite(v[0]).all()):
            j = len(entries)
            unknown = np.full((*v.shape[1:], j), np.nan), np.full((len(S[0]), ny, ny, j), np.nan)
            return cls(np.full(v.shape[1:], np.nan), np.inf, entries, *unknown, which)
        root = np.linalg.inv(lower)
        logs = 2.0 * np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1)
        white = whitened_by(root, v, which)
        slopes = np.moveaxis((white[1:] - white[:1]) / taken[:, None, None], 0, 2)
        spreads = root[None] @ (S[1:] - S[:1]) @ np.swapaxes(root, 1, 2)[None] / taken[:, None, None, None]
        spreads = _finite(np.moveaxis(spreads, 0, 3))
        first, logdet = np.ascontiguousarray(white[0]), float(np.sum(logs[which]))
        return cls(first, logdet, entries, _finite(slopes), spreads, which)

    @property
    def cost(self) -> float:
        """Twice the negative logarithm of the likelihood, without its constant."""
        return float(np.sum(self.white**2)) + self.logdet

    @cached_property
    def spread_information(self) -> FloatArray:
        """Information (j, j) in the size of the innovations."""
        counts = np.bincount(self.which, minlength=len(self.spreads))
        rows = np.moveaxis(self.spreads, 3, 0) * np.sqrt(0.5 * counts)[:, None, None]
        return square(rows.reshape(len(self.entries), -1))

    @property
    def rows(self) -> FloatArray:
        """The slopes as (j, n n_y), as the filter gives them: no copy."""
        return np.moveaxis(self.slopes, 2, 0).reshape(len(self.entries), -1)

    @property
    def information(self) -> FloatArray:
        """Fisher's information (j, j)."""
        return square(self.rows) + self.spread_information

    @property
    def gradient(self) -> FloatArray:
        """Derivative (j,) of the negative logarithm of the likelihood."""
        linear, ny = project(self.rows, self.white.ravel()), self.white.shape[1]
        surplus = np.zeros((len(self.spreads), ny, ny))
        first = np.flatnonzero(np.diff(self.which, prepend=-1))  # of runs of samples with one gain
        each = np.eye(ny) - self.white[:, :, None] * self.white[:, None, :]
        np.add.at(surplus, self.which[first], np.add.reduceat(each, first, axis=0))
        return np.asarray(linear + 0.5 * np.einsum("gik,gikj->j", surplus, self.spreads))


def _finite(values: FloatArray) -> FloatArray:
    """Return values with finite numbers in place of others; most often there are none."""
    return values if np.isfinite(values).all() else np.nan_to_num(values)


@dataclass(frozen=True, eq=False)
class Score:
    """Gradient (k,) and Fisher's information (k, k) of the negative logarithm of the posterior."""

    gradient: FloatArray
    information: FloatArray
    pieces: tuple[Innovations, ...]


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The likelihood of a joint fit as a function of [parameters | nuisances | logarithms of noise]."""

    #: layout of the first two parts, pieces without late readings, and priors
    problem: Misfit
    #: layout of the third
    noise: Noise
    gain: Gain
    #: where each piece is linearized for the gains of `anchor`
    points: tuple[Points, ...]
    #: (k,), unknowns whose gains find the states at which any candidate is linearized, so that its points follow its own
    #: states: were they fixed, the size of the innovations would seem to depend on what shifts states and readings
    #: together (a bias of the vane against the lift at zero incidence)
    anchor: FloatArray

    @classmethod
    def of(cls, problem: Misfit, noise: Noise, gain: Gain, anchor: FloatArray) -> Likelihood:
        """Return the likelihood, its first gains linearized at what was measured."""
        vehicle = problem.layout.vehicle
        points = tuple(measured_points(vehicle, piece, gain.plan(piece).points) for piece in problem.pieces)
        return cls(problem, noise, gain, points, anchor)

    def along(self, z: FloatArray) -> Likelihood:
        """Return the likelihood linearized along the states that the filter finds with these unknowns."""
        points = []
        for i, point in enumerate(self.points):
            states = self._states(i, *self.problem.candidates(z[None, : self.known], i))[:, :, 0]
            if not np.isfinite(states).all():
                return self
            points.append(Points(states, point.inputs))
        return replace(self, points=tuple(points), anchor=z)

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
        low, high = (self.noise.start + np.log(edge) for edge in RANGE)
        free, d = np.full(self.problem.extra, np.inf), self.problem.dimension
        return np.concatenate([np.zeros(d), -free, low]), np.concatenate([np.ones(d), free, high])

    def cost(self, z: FloatArray) -> float:
        """Return twice the negative logarithm of the posterior; infinite where the filter diverges or z is not finite."""
        if not np.all(np.isfinite(z)):  # a step by a curvature that is not finite
            return np.inf
        total = float(np.sum(self.problem.layout.prior_residuals(z[None, : self.known]) ** 2))
        for i in range(len(self.points)):
            total += self._innovations(z, i, np.empty(0, dtype=np.int64)).cost
        return total if np.isfinite(total) else np.inf

    def predictions(self, z: FloatArray) -> tuple[FloatArray, ...]:
        """Return the readings (n, n_y) of each piece that the filter predicts from sample to sample, as late as recorded ones."""
        vehicle, out = self.problem.layout.vehicle, []
        for i, piece in enumerate(self.problem.pieces):
            rows, start = self.problem.candidates(z[None, : self.known], i)
            gains = self.gains(z[None, :], rows, start, i)
            states = run_filter(self.problem, i, rows, start, gains, states=True)[1][0]
            inputs = piece.received(vehicle, rows).reshape(len(piece.inputs), -1)
            readings = vehicle.readings_along(rows, states, inputs[: len(states)])
            out.append(vehicle.late_outputs(readings[None], rows, piece.dt)[0])
        return tuple(out)

    def score(self, z: FloatArray) -> Score:
        """Return gradient and information at a point."""
        d, tail, pieces = self.problem.dimension, range(self.known, self.size), []
        gradient, information = self.prior(z)
        for i, own in enumerate(self.problem.own):
            entries = np.array([*range(d), *(j for j, _ in own), *tail], dtype=np.int64)
            piece = self._innovations(z, i, entries)
            gradient[entries] += piece.gradient
            information[np.ix_(entries, entries)] += piece.information
            pieces.append(piece)
        return Score(gradient, information, tuple(pieces))

    def prior(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gradient (k,) and information (k, k) of the priors."""
        rows = np.pad(self.problem.layout.prior_jacobian(z[: self.known]), [(0, 0), (0, self.noise.size)])
        return rows.T @ self.problem.layout.prior_residuals(z[None, : self.known])[0], rows.T @ rows

    def _innovations(self, z: FloatArray, index: int, entries: IntArray) -> Innovations:
        # backward at an upper bound
        steps = np.where(z[entries] + STEP > self.bounds[1][entries], -STEP, STEP)
        Z = np.repeat(z[None, :], 1 + len(entries), axis=0)
        Z[1 + np.arange(len(entries)), entries] += steps
        rows, start = self.problem.candidates(Z[:, : self.known], index)
        gains = self.gains(Z, rows, start, index)
        v, _ = run_filter(self.problem, index, rows, start, gains)
        return Innovations.of(v, gains, entries, steps)

    def gains(self, Z: FloatArray, rows: FloatArray, start: FloatArray, index: int) -> Gains:
        """Return the gains of candidates, each linearized at its own states."""
        # the noise of sensors changes no state
        same = np.all(Z[0, : self.known] == Z[:, : self.known], axis=1)
        same[0] = False
        few, model = np.flatnonzero(~same), np.where(same, 0, np.cumsum(~same) - 1)
        rows = np.ascontiguousarray(rows[:, few])
        states = self._states(index, rows, np.ascontiguousarray(start[:, few]))
        piece, inputs = self.problem.pieces[index], self.points[index].inputs
        linear = linearized(self.problem.layout.vehicle, rows, states, inputs, piece.dt)
        shared = LinearModels(linear.transition[model], linear.readings[model], linear.drive[model])
        return self._gains_of(index, shared, Z[:, self.known :])

    def _gains_of(self, index: int, linear: LinearModels, tail: FloatArray) -> Gains:
        process = self.noise.process(tail, linear.drive, self.problem.pieces[index].dt)
        vehicle = self.problem.layout.vehicle
        return self.gain.gains(vehicle, self.plans[index], linear, process, self.noise.variances(tail))

    def _states(self, index: int, rows: FloatArray, start: FloatArray) -> FloatArray:
        """Return the states (n_x, r, B) that the anchor's gains find around each point."""
        gains = self._anchored[index].repeated(rows.shape[1])
        states = run_filter(self.problem, index, rows, start, gains, states=True)[1]
        return averaged(self.problem.layout.vehicle, states, self.plans[index].points)

    @cached_property
    def _anchored(self) -> list[Gains]:
        """Gains of the anchor for each piece."""
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
    inputs, which = distinct_inputs(vehicle, piece.inputs, rows, piece.dt, piece.before)

    def run(own: Any, received: FloatArray) -> tuple[FloatArray, FloatArray]:
        return filtering.innovations(
            vehicle.kernel(), rows[:, own], start[:, own], gains.gain[:, :, own], gains.which, received, piece.measured,
            piece.dt, states,
        )  # fmt: skip

    if len(inputs) == 1:
        return run(slice(None), inputs[0])
    alike = [np.flatnonzero(which == i) for i in range(len(inputs))]
    parts = [run(own, received) for own, received in zip(alike, inputs, strict=True)]
    order, (v, x) = np.argsort(np.concatenate(alike)), (list(part) for part in zip(*parts, strict=True))
    return np.concatenate(v)[order], np.concatenate(x)[order] if states else x[0]


def whitened_by(root: FloatArray, v: FloatArray, which: IntArray) -> FloatArray:
    """Return the products of roots (G, n_y, n_y) with innovations (B, n, n_y), each sample by the root that it has."""
    if len(root) == len(which):  # a gain for every sample
        return np.asarray(np.matmul(root, v[..., None])[..., 0])
    white = np.empty_like(v)
    for g, matrix in enumerate(root):
        own = slice(None) if len(root) == 1 else np.flatnonzero(which == g)
        white[:, own] = v[:, own] @ matrix.T
    return white


@dataclass(frozen=True, eq=False)
class FrozenFilter(RefitProblem):
    """Innovations as residuals of parameters and nuisances, the gains fixed at an estimate.

    With gains K and innovation covariances S fixed, the whitened innovations S^-1/2 v are residuals as those of a
    simulation are. Adding noise to them is the bootstrap of a state-space model in innovations form (D. S. Stoffer and
    K. D. Wall, *Journal of the American Statistical Association* 86(416), 1991, pp. 1024-1033). Noise intensities stay
    at their estimates. `gains` are those of each piece, for one candidate; late readings are shifted.
    """

    kind: ClassVar = "filter"
    problem: Misfit
    gains: tuple[Gains, ...]

    @classmethod
    def of(cls, likelihood: Likelihood, z: FloatArray) -> FrozenFilter:
        """Return the problem with the gains at the unknowns z (k,), noise intensities included."""
        problem, one = likelihood.problem, z[None, :]
        starts = [problem.candidates(one[:, : likelihood.known], i) for i in range(len(problem.pieces))]
        return cls(problem, tuple(likelihood.gains(one, *start, i) for i, start in enumerate(starts)))

    @classmethod
    def restored(cls, problem: Misfit, arrays: Mapping[str, Any]) -> FrozenFilter:
        """Return the problem from its `arrays`."""
        names = ("gain", "covariance", "which")
        each = range(len(problem.pieces))
        return cls(problem, tuple(Gains(*(arrays[f"gains.{n}.{i}"] for n in names)) for i in each))

    @property
    def deviations(self) -> tuple[FloatArray, ...]:
        """Standard deviations (n, n_y) of the innovations of each piece, NaN where nothing was measured."""
        found = []
        for piece, gains in zip(self.problem.pieces, self.gains, strict=True):
            variance = np.diagonal(gains.covariance[0], axis1=1, axis2=2)[gains.which]
            found.append(np.where(np.isfinite(piece.measured), np.sqrt(variance), np.nan))
        return tuple(found)

    def standardized(self, z: FloatArray) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Return the innovations (n, n_y) of each piece over their standard deviations, and these, at z (D + E,).

        Innovations are NaN where nothing was measured.
        """
        out = []
        for i, (piece, gains) in enumerate(zip(self.problem.pieces, self.gains, strict=True)):
            v = run_filter(self.problem, i, *self.problem.candidates(z[None, :], i), gains)[0][0]
            expected = np.sqrt(np.diagonal(gains.covariance[0], axis1=1, axis2=2))[gains.which]
            out.append((np.where(np.isfinite(piece.measured), v / expected, np.nan), expected))
        return tuple(out)

    @property
    def arrays(self) -> dict[str, Any]:
        """Arrays that :meth:`restored` takes beside `problem`."""
        names = ("gain", "covariance", "which")
        return {f"gains.{n}.{i}": getattr(g, n) for i, g in enumerate(self.gains) for n in names}

    @cached_property
    def roots(self) -> tuple[FloatArray, ...]:
        """S^-1/2 of each piece's gains, (G, n_y, n_y)."""
        return tuple(np.linalg.inv(np.linalg.cholesky(g.covariance[0])) for g in self.gains)

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return whitened predicted minus measured readings, then the residuals of the priors, (B, n_r)."""
        parts = []
        for i, (root, gains) in enumerate(zip(self.roots, self.gains, strict=True)):
            v, _ = run_filter(self.problem, i, *self.problem.candidates(Z, i), gains.repeated(len(Z)))
            parts.append(-whitened_by(root, v, gains.which).reshape(len(Z), -1))
        return np.concatenate([*parts, self.problem.layout.prior_residuals(Z)], axis=1)

    def responses(self, z: FloatArray) -> Responses:
        """Return how the innovations respond to extensions of the vehicle at z (D + E,), the gains fixed."""
        model, trajectories, out = ExtendedModel.of(self.problem.layout.vehicle), [], []
        for i, (piece, gains) in enumerate(zip(self.problem.pieces, self.gains, strict=True)):
            known, start = self.problem.candidates(z[None, :], i)
            _, path = run_filter(self.problem, i, known, start, gains, states=True)
            states = np.ascontiguousarray(path[0].T)
            present, columns = np.isfinite(piece.measured), perturbation_columns(model.base, states)
            gain = gains.gain[:, :, 0].reshape(len(gains.gain), len(columns), -1)[gains.which]
            correction = np.moveaxis(columns, 2, 0).transpose(0, 2, 1) @ (gain * present[:, None, :])
            rows, record = model.rows(known[:, 0]), model.received(piece, known)
            flown = (rows, states, record, np.arange(len(piece.time)))
            trajectories.append(Trajectory(model.equations, *flown, piece.dt, correction))
        found = model.responses(trajectories, self.problem.pieces)
        each = zip(self.problem.pieces, self.roots, self.gains, found, strict=True)
        for piece, root, gains, (_, responses) in each:
            dy = np.moveaxis(responses, 2, 0) * np.isfinite(piece.measured)
            out.append(np.ascontiguousarray(np.moveaxis(whitened_by(root, dy, gains.which), 0, 2)))
        return Responses(model.extensions, tuple(out))

    def in_units(self, white: Sequence[FloatArray]) -> list[FloatArray]:
        """Return whitened values (n, n_y) of each piece in the channels' units."""
        lower = [np.asarray(np.linalg.inv(root), dtype=np.float64) for root in self.roots]
        each = zip(lower, white, self.gains, strict=True)
        return [whitened_by(matrix, w[None], g.which)[0] for matrix, w, g in each]
