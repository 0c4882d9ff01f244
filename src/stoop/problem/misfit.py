"""The cost J = (Z - Y)' Q (Z - Y) of eq. (3) over all pieces of all maneuvers, plus priors.

This is the least-squares problem that an optimizer sees (:class:`stoop.optimize.Problem`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from stoop.base.arrays import FloatArray, IntArray, within_range
from stoop.base.variables import WRAPPED
from stoop.kernels.kernel import Kernel
from stoop.optimize.ledger import inner
from stoop.optimize.normal_equations import TallMatrix, project
from stoop.problem.layout import Layout, Nuisance
from stoop.problem.starts import Starts
from stoop.problem.weights import Weights
from stoop.vehicle import Vehicle, delays

STEP = 1e-7  #: of a forward difference
CACHED = 2**16  #: numbers that are whitened at a time
PRIORS = 64  #: residuals of priors that are a stretch of derivatives
Array = TypeVar("Array", FloatArray, IntArray)
ENERGY = 1.0 / 16.0  #: share of the inputs' on the shortest record; any from 1/32 to 1/8 serves

HISTORY = 1.0  #: s of commands before a piece: what is late arrives from there


@dataclass(frozen=True, eq=False)
class Piece:
    """A contiguous stretch of one maneuver."""

    maneuver: int
    time: FloatArray  #: (n,), s, uniform
    inputs: FloatArray  #: (n, n_u)
    #: (n, n_y), NaN where missing, and between the readings of what was recorded more slowly
    measured: FloatArray
    start: Mapping[str, float]  #: initial state by name (V ... psi, h), where its nuisances are zero
    #: numbers that differ in this maneuver (its loading)
    changes: Mapping[str, float] = field(default_factory=dict)
    moved: tuple[int, ...] = ()  #: samples by which each channel's readings were moved ahead; empty for none
    #: (n_y,) standard deviation of the noise over that in the weights of the problem; empty where it is the same
    relative_noise: tuple[float, ...] = ()
    #: (n, n_y), the same with what was interpolated between readings; None where nothing was
    interpolated: FloatArray | None = None
    #: (m, n_c), recorded channels, the first of the inputs, in the samples before: commands that arrive late; None at the first
    before: FloatArray | None = None

    @property
    def whole(self) -> FloatArray:
        """Readings (n, n_y) with what was interpolated between them: for regressors and first guesses, not for residuals."""
        return self.measured if self.interpolated is None else self.interpolated

    @property
    def dt(self) -> float:
        """Sample period, s."""
        return float(self.time[1] - self.time[0])

    @property
    def commands(self) -> FloatArray:
        """Recorded channels before and in the piece (m + n, n_c); all inputs where nothing is known of before."""
        if self.before is None:
            return self.inputs
        return np.concatenate([self.before, self.inputs[:, : self.before.shape[1]]])

    def part(self, first: int, behind: int, start: Mapping[str, float]) -> Piece:
        """Return the samples from one to before another, with the state that they begin in."""
        before = None
        if self.before is not None:
            begun = len(self.before) + first
            before = self.commands[max(0, begun - round(HISTORY / self.dt)) : begun]
        return replace(
            self,
            time=self.time[first:behind],
            inputs=np.ascontiguousarray(self.inputs[first:behind]),
            measured=np.ascontiguousarray(self.measured[first:behind]),
            start=start,
            interpolated=None if self.interpolated is None else self.interpolated[first:behind],
            before=before,
        )

    def received(self, vehicle: Vehicle, rows: FloatArray) -> FloatArray:
        """Return :func:`~stoop.vehicle.delays.late_inputs` of the piece for kernel parameters (n_p, B)."""
        return vehicle.late_inputs(self.inputs, rows, self.dt, self.before)


@dataclass(frozen=True, eq=False)
class Misfit:
    """A least-squares problem on the unit box."""

    layout: Layout
    pieces: tuple[Piece, ...]
    weights: Weights
    ladder: tuple[tuple[int, ...], ...]  #: samples of each piece on each rung; the last is the whole record

    @cached_property
    def dimension(self) -> int:
        """Number of free parameters."""
        return self.layout.dimension

    @cached_property
    def extra(self) -> int:
        """Number of nuisances."""
        return self.layout.extra

    @cached_property
    def prices(self) -> tuple[float, ...]:
        """Samples of each rung over all samples."""
        whole = sum(self.ladder[-1])
        return tuple(sum(rung) / whole for rung in self.ladder)

    def weighted(self, weights: Weights) -> Misfit:
        """Return the same problem with another Q."""
        return replace(self, weights=weights)

    @cached_property
    def piece_weights(self) -> tuple[Weights, ...]:
        """The weights of each piece, by the noise of its maneuver."""
        own = (p.relative_noise for p in self.pieces)
        return tuple(self.weights.scaled(relative) if relative else self.weights for relative in own)

    @property
    def noise_logdet(self) -> float:
        """Logarithm of the determinant of the noise covariance, the mean over all samples."""
        if not any(p.relative_noise for p in self.pieces):
            return self.weights.logdet
        total = sum(len(p.time) * w.logdet for p, w in zip(self.pieces, self.piece_weights, strict=True))
        return total / sum(len(p.time) for p in self.pieces)

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return J (B,) of parameters (B, D) in the unit box, nuisances at their start."""
        total = self.layout.prior_costs(X)
        for i, count in enumerate(self.ladder[rung]):
            total += self.piece_costs(X, i, count)
        return total

    def piece_costs(self, Z: FloatArray, index: int, count: int) -> FloatArray:
        """Return the part of one piece in J (B,), priors left out, for vectors as :meth:`candidates` takes them."""
        piece = self.pieces[index]
        if not self.weights.separable or self._late_outputs:  # the kernel cannot sum their squares
            white = self._whitened(self._trajectories(Z, index, count), index)
            with np.errstate(invalid="ignore", over="ignore"):
                squares = np.sum(white.reshape(len(Z), -1) ** 2, axis=1)
            return np.where(np.isfinite(squares), squares, np.inf)
        rows, start = self.candidates(Z, index)
        inputs, quality = self._inputs(piece, rows), self._quality[index]
        return self.kernel.cost(rows, start, inputs, piece.measured, quality, piece.dt, count)

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return weighted residuals (B, n_r) of vectors (B, D + E), priors last."""
        read = ((self._readings(p, x, i, n), i) for i, n, p, x in self._candidates_of_all(Z, rung))
        blocks = [self._whitened(*one).reshape(len(Z), -1) for one in read]
        return np.concatenate([*blocks, self.layout.prior_residuals(Z)], axis=1)

    def products(self, Z: FloatArray, rung: int, left: FloatArray) -> FloatArray:
        """Return the weighted residuals (B, n_r) of vectors (B, D + E) times `left` (n_r,), summed along each trajectory."""
        priors = self.layout.prior_residuals(Z)
        total = project(priors, left[len(left) - priors.shape[1] :])
        first = 0
        for i, n, rows, start in self._candidates_of_all(Z, rung):
            own = slice(first, first + n * len(self.layout.vehicle.outputs))
            total += self._products(rows, start, i, left[own], n)
            first = own.stop
        return total

    def piece_products(self, Z: FloatArray, index: int, left: FloatArray) -> FloatArray:
        """Return the weighted residuals (B, n_r) of one piece for vectors (B, D + E) times `left` (n_r,)."""
        return self._products(*self.candidates(Z, index), index, left, len(self.pieces[index].time))

    def _products(
        self, rows: FloatArray, start: FloatArray, index: int, left: FloatArray, count: int
    ) -> FloatArray:
        """Return the whitened residuals of a piece times `left`, (B,), for kernel parameters and initial states."""
        piece = self.pieces[index]
        measured = piece.measured[:count]
        weights = self.piece_weights[index].whiten_back(left.reshape(measured.shape), np.isfinite(measured))
        if self._late or self._late_outputs:  # the kernel sums along trajectories of shared inputs
            errors = self._errors(self._readings(rows, start, index, count), index)
            return project(errors.reshape(len(errors), -1), weights.ravel())
        return self.kernel.products(rows, start, piece.inputs, measured, weights, piece.dt)

    def _candidates_of_all(
        self, Z: FloatArray, rung: int
    ) -> Iterator[tuple[int, int, FloatArray, FloatArray]]:
        """Yield each piece's index, number of samples, kernel parameters (n_p, B) and initial states (n_x, B)."""
        rows, starts = self._starts.candidates(Z, np.arange(len(self.pieces)))
        for i, n in enumerate(self.ladder[rung]):
            own = slice(i * len(Z), (i + 1) * len(Z))
            yield i, n, rows[:, own], starts[:, own]

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[TallMatrix, float]:
        """Return d r / d z (n_r, D + E) by forward differences, a stretch a piece, and the trajectories it took beside that at z.

        An initial state is varied on its own piece only, a bias not at all (its derivative is known).
        """
        parts, spent = list[tuple[IntArray, FloatArray]](), 0.0
        for i, count in enumerate(self.ladder[rung]):
            entries, taken, Z = self._varied(z, i)
            biases, width = self._bias_columns[i], count * len(self.layout.vehicle.outputs)
            # the base, what is varied from it, biases: the kernel's own array, worked on in place
            rows = np.empty((1 + len(entries) + len(biases), width))
            lanes = rows[: 1 + len(entries)].reshape(1 + len(entries), count, -1)
            self._readings(*self.candidates(np.vstack([z, Z]), i), i, count, lanes)
            self._difference(lanes, taken, i)
            for row, column in zip(rows[len(lanes) :], biases.values(), strict=True):
                row[:] = column[:width]
            parts.append((np.array([*entries, *biases], dtype=np.intp), rows[1:]))
            spent += len(entries) * count
        return TallMatrix.stacked([*parts, *self.prior_parts(z)], len(z)), spent / sum(self.ladder[-1])

    def _difference(self, lanes: FloatArray, steps: FloatArray, index: int) -> None:
        """Replace readings (1 + m, n, n_y) after the first by their whitened difference quotients over steps (m,)."""
        present = np.isfinite(self.pieces[index].measured[: lanes.shape[1]])
        weights, whole = self.piece_weights[index], bool(present.all())
        ahead = lanes[1:]
        with np.errstate(invalid="ignore", over="ignore"):
            # few lanes at a time stay in the cache
            few = max(1, CACHED // max(1, lanes[0].size)) if weights.separable else len(ahead)
            for some in _chunks(len(ahead), few):
                own = ahead[some]
                own -= lanes[0]
                if not whole:
                    own *= present
                on_circle(own, self.layout.vehicle.outputs)
                white = weights.whiten(own, present, own)
                np.divide(white, steps[some, None, None], out=own)

    def gradient(self, z: FloatArray, rung: int, r: FloatArray, left: FloatArray) -> FloatArray:
        """Return the :meth:`jacobian` at z, where the residuals are `r`, times `left` (n_r,), without forming it: (D + E,)."""
        out, first = np.zeros(len(z)), 0
        for i, count in enumerate(self.ladder[rung]):
            entries, taken, Z = self._varied(z, i)
            own = slice(first, first + count * len(self.layout.vehicle.outputs))
            rows, start = self.candidates(Z, i)
            ahead = self._products(rows, start, i, left[own], count)
            out[entries] += (ahead - inner(left[own], r[own])) / taken
            for j, column in self._bias_columns[i].items():
                out[j] += inner(column[: own.stop - own.start], left[own])
            first = own.stop
        for (some, rows), values in zip(self.prior_parts(z), _split(left[first:], PRIORS), strict=True):
            out[some] += np.diag(rows) * values
        return out

    def _varied(self, z: FloatArray, index: int) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the entries (m,) that a piece is varied by, the steps (m,) taken, and the vectors (m, D + E) with them."""
        own = (j for j, n in self.own[index] if not n.is_bias)
        entries = np.array([*range(self.dimension), *own], dtype=np.intp)
        each = np.arange(len(entries))
        Z = np.repeat(z[None, :], len(entries), axis=0)
        Z[each, entries] += np.where((entries < self.dimension) & (z[entries] + STEP > 1.0), -STEP, STEP)
        return entries, Z[each, entries] - z[entries], Z

    def prior_parts(self, z: FloatArray) -> list[tuple[IntArray, FloatArray]]:
        """Return unknowns and derivatives of few residuals of priors at a time, each of one unknown."""
        nuisances = np.arange(self.dimension, self.dimension + self.extra)
        entries: IntArray = np.concatenate([self.layout.priors[0], nuisances])
        slopes: FloatArray = np.concatenate([self.layout.prior_slopes(z), np.ones(self.extra)])
        pairs = zip(_split(entries, PRIORS), _split(slopes, PRIORS), strict=True)
        return [(some, np.diag(own)) for some, own in pairs]

    def reference(self, rung: int) -> float:
        """Return the cost of constant readings: each channel stays at its first measurement."""
        total = 0.0
        for i, (piece, count) in enumerate(zip(self.pieces, self.ladder[rung], strict=True)):
            z = piece.measured[:count]
            constant = np.array([column[np.isfinite(column)][:1].sum() for column in z.T])
            total += float(np.sum(self._whitened(np.tile(constant, (1, count, 1)), i) ** 2))
        return total

    def outputs(self, z: FloatArray, index: int) -> FloatArray:
        """Return the simulated readings (n, n_y) of one piece for a vector (D + E,), NaN once they are implausibly large."""
        return within_range(self._trajectories(z[None, :], index, len(self.pieces[index].time))[0])

    def slopes(self, z: FloatArray, index: int) -> tuple[FloatArray, FloatArray]:
        """Return the simulated readings (n, n_y) of one piece and their derivatives (n, n_y, D + E) by differences."""
        Z = z + np.concatenate([np.zeros((1, len(z))), STEP * np.eye(len(z))])
        lanes = self._trajectories(Z, index, len(self.pieces[index].time))
        with np.errstate(invalid="ignore", over="ignore"):
            changes = on_circle(lanes[1:] - lanes[0], self.layout.vehicle.outputs)
        return np.asarray(lanes[0]), np.moveaxis(changes, 0, 2) / STEP

    @cached_property
    def _quality(self) -> list[FloatArray]:
        """Weight (n, n_y) of every sample of each piece, for a diagonal Q."""
        pairs = zip(self.pieces, self.piece_weights, strict=True)
        return [np.where(np.isfinite(p.measured), np.diag(w.root) ** 2, 0.0) for p, w in pairs]

    def _whitened(self, simulated: FloatArray, index: int) -> FloatArray:
        """Return whitened simulated minus measured of a piece, zero where there is no measurement; overwrites simulated."""
        present = np.isfinite(self.pieces[index].measured[: simulated.shape[1]])
        with np.errstate(invalid="ignore", over="ignore"):
            return self.piece_weights[index].whiten(self._errors(simulated, index), present, simulated)

    def _errors(self, simulated: FloatArray, index: int) -> FloatArray:
        """Return simulated minus measured of a piece, zero where there is no measurement; overwrites simulated."""
        measured = self.pieces[index].measured[: simulated.shape[1]]
        present = np.isfinite(measured)
        with np.errstate(invalid="ignore", over="ignore"):  # the last readings before a divergence are huge
            simulated -= np.where(present, measured, 0.0)
            if not present.all():
                simulated *= present
            return on_circle(simulated, self.layout.vehicle.outputs)

    @cached_property
    def _bias_columns(self) -> list[dict[int, FloatArray]]:
        """Derivatives (n * n_y,) of the whitened readings of each piece by its biases, by their place in the vector."""
        vehicle, out = self.layout.vehicle, []
        for piece, own, weights in zip(self.pieces, self.own, self.piece_weights, strict=True):
            present, columns = np.isfinite(piece.measured), {}
            for j, bias in ((j, n) for j, n in own if n.is_bias):
                row = vehicle.rows[bias.name]
                shared = [vehicle.rows[f"sensors.{c}.bias"] == row for c in vehicle.outputs]  # by a tie
                columns[j] = np.asarray(weights.whiten(bias.scale * present * shared, present).ravel())
            out.append(columns)
        return out

    @cached_property
    def own(self) -> list[list[tuple[int, Nuisance]]]:
        """Nuisances of each piece, with their place in the vector."""
        numbered = list(enumerate(self.layout.nuisances, self.dimension))
        return [
            [(j, n) for j, n in numbered if n.piece == i or (n.is_bias and n.maneuver == p.maneuver)]
            for i, p in enumerate(self.pieces)
        ]

    @cached_property
    def _starts(self) -> Starts:
        return Starts.of(self.layout, self.pieces, self.own)

    def candidates(self, Z: FloatArray, index: int) -> tuple[FloatArray, FloatArray]:
        """Return kernel parameters (n_p, B) and initial states (n_x, B) of one piece.

        `Z` is (B, D + E), or (B, D) with all nuisances at their start.
        """
        return self._starts.candidates(Z, np.array([index]))

    @cached_property
    def kernel(self) -> Kernel:
        """The compiled equations of the vehicle."""
        return self.layout.vehicle.kernel()

    @cached_property
    def _late_outputs(self) -> bool:
        return bool(delays.output_delays(self.layout.vehicle))

    @cached_property
    def _actuators(self) -> list[int]:
        return delays.actuator_rows(self.layout.vehicle)

    @cached_property
    def _late(self) -> bool:
        return bool(self._actuators or self.layout.vehicle.sloped)

    def _inputs(self, piece: Piece, rows: FloatArray) -> FloatArray:
        """Return the inputs of a piece as the surfaces receive them."""
        return piece.received(self.layout.vehicle, rows) if self._late else piece.inputs

    def _trajectories(self, Z: FloatArray, index: int, count: int) -> FloatArray:
        return self._readings(*self.candidates(Z, index), index, count)

    def _readings(
        self, rows: FloatArray, start: FloatArray, index: int, count: int, out: FloatArray | None = None
    ) -> FloatArray:
        """Return the readings (B, n, n_y) of a piece for kernel parameters (n_p, B) and initial states (n_x, B).

        Few different actuators, as in a Jacobian, are simulated one after the other, each with inputs for all its candidates.
        """
        piece = self.pieces[index]
        first, which = delays.distinct_actuators(rows[self._actuators])
        usual = int(np.bincount(which).argmax())
        few = 2 * len(first) <= len(which)
        inputs = self._inputs(piece, rows[:, first[usual], None] if few else rows)
        out = self.kernel.trajectories(rows, start, inputs, piece.dt, count, out=out)
        for k in np.delete(np.arange(len(first)), usual) if few else ():
            lanes, inputs = which == k, self._inputs(piece, rows[:, first[k], None])
            out[lanes] = self.kernel.trajectories(rows[:, lanes], start[:, lanes], inputs, piece.dt, count)
        if not self._late_outputs:
            return out
        return self.layout.vehicle.late_outputs(out, rows, piece.dt, piece.moved)


def _chunks(count: int, size: int) -> Iterator[slice]:
    """Yield slices of at most `size` of so many."""
    return (slice(start, min(start + size, count)) for start in range(0, count, size))


def _split(values: Array, size: int) -> list[Array]:
    return [values[some] for some in _chunks(len(values), size)]


def on_circle(errors: FloatArray, outputs: Sequence[str]) -> FloatArray:
    """Take the differences of angles that wrap, among channels (..., n_y), to the nearest turn, in place."""
    for i, channel in enumerate(outputs):
        own = errors[..., i]
        if channel in WRAPPED and own.size and not (own.max() <= np.pi and own.min() >= -np.pi):
            own -= 2.0 * np.pi * np.round(own / (2.0 * np.pi))
    return errors


def horizon_ladder(pieces: Sequence[Piece]) -> tuple[tuple[int, ...], ...]:
    """Return samples per piece and rung: up to a sixteenth of the inputs' energy (about their start), then thrice as far each.

    The first rung ends where the inputs have begun to move, so that a candidate far from the truth, or unstable, has not yet
    diverged; as rungs grow geometrically, the long ones cost nearly all. The first ends within half of the piece, not before
    0.4 s; rungs that would be nearly whole are left out, and the last is the whole record.
    """
    firsts = []
    for piece in pieces:
        n, scale = len(piece.time), np.ptp(piece.inputs, axis=0)
        deflections = (piece.inputs - piece.inputs[0]) / np.where(scale > 0.0, scale, 1.0)
        energy = np.cumsum(np.sum(deflections**2, axis=1))
        begun = int(np.searchsorted(energy, ENERGY * energy[-1])) + 1 if energy[-1] > 0.0 else n // 10
        least = max(20, round(0.4 / piece.dt))
        firsts.append(min(max(begun, least), max(n // 2, least), n))
    whole = tuple(len(p.time) for p in pieces)
    rungs, rung = [], tuple(firsts)
    while sum(rung) < 0.6 * sum(whole):
        rungs.append(rung)
        rung = tuple(min(3 * f, n) for f, n in zip(rung, whole, strict=True))
    return (*rungs, whole)
