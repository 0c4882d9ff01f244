"""Fisher information of windows about the free numbers of a vehicle, from the sensitivities of its simulation.

The sensitivities are taken at the estimates of a quick fit (`stoop_plan.input_design.quick_fit`). One linear step from there, in
parameters, initial states and biases, leaves residuals from which the noise of this flight is estimated, gusts and what the
model lacks included.

A vehicle with rotors is unstable: its windows are cut into short ones that each restart, as they will be fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from stoop import Flight, Vehicle
from stoop.extend import fits
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import FlightError, IdentificationError
from stoop_plan.input_design.candidates import Candidate

#: of a number that is only known to lie in the unit box: one over its variance
WINDOW_LENGTH: Final = 1.0  #: s
BOX_INFORMATION: Final = 12.0
NOISE_WINDOWS: Final = 8  #: from which the noise is estimated
NOISE_ROUNDS: Final = 2  #: of linear step and noise
#: times the usual rms of a piece, beyond which the simulation does not follow the flight
MAX_RESIDUAL: Final = 4.0
NOISE_FLOOR: Final = 0.1  #: of the noise that the vehicle file gives a sensor


@dataclass(frozen=True, eq=False)
class CandidateProblem:
    """A candidate as a least-squares problem, and how many of its pieces make each stretch without a hole."""

    prepared: fits.Prepared
    counts: tuple[int, ...]

    def misfit(self, vehicle: Vehicle, weights: fits.Weights) -> fits.Misfit:
        """Return the problem with this window's nuisances."""
        pieces = self.prepared.pieces
        layout = fits.Layout.of(vehicle, self.prepared.nuisances(vehicle))
        return fits.Misfit(layout, pieces, weights, (tuple(len(p.time) for p in pieces),))


def pieces_of(vehicle: Vehicle, piece: fits.Piece) -> list[fits.Piece]:
    """Cut a piece of a vehicle that hovers, unstable, into windows of about a second that begin where the state was measured."""
    if not vehicle.rotors:
        return [piece]
    out, count = [], max(1, round((piece.time[-1] - piece.time[0]) / WINDOW_LENGTH))
    for a, b in pairwise(np.linspace(0, len(piece.time), count + 1).astype(int)):
        columns = dict(zip(vehicle.outputs, piece.whole[a:b].T, strict=True))
        start, missing = fits.guess_start(vehicle, piece.time[a:b], columns, "")
        if not missing:
            out.append(piece.part(a, b, {**start, "h": piece.start.get("h", 0.0)}))
    return out


def candidate_problem(vehicle: Vehicle, flight: Flight, one: Candidate) -> CandidateProblem | None:
    """Prepare a candidate as for a fit; None where the vehicle's state or its inputs were not measured."""
    try:
        prepared = fits.Prepared.of(vehicle, {flight.name: flight}, [one.window])
    except FlightError:
        return None
    prepared = prepared.without_stuck_channels(vehicle)
    cut = [parts for piece in prepared.pieces if (parts := pieces_of(vehicle, piece))]
    if not cut:
        return None
    pieces = tuple(p for parts in cut for p in parts)
    return CandidateProblem(replace(prepared, pieces=pieces), tuple(len(parts) for parts in cut))


@dataclass(frozen=True, eq=False)
class VehicleInformation:
    """A vehicle, and where its windows are linearized: free numbers (D,) in the unit box, noise of the flight.

    ``usual`` is the root mean square of the whitened residuals of a piece, before any step.
    """

    vehicle: Vehicle
    unit: FloatArray
    weights: fits.Weights
    usual: float

    @cached_property
    def layout(self) -> fits.Layout:
        """Free numbers alone."""
        return fits.Layout.of(self.vehicle, ())

    @property
    def names(self) -> tuple[str, ...]:
        """Free numbers."""
        return tuple(p.name for p in self.layout.parameters)

    @property
    def prior(self) -> FloatArray:
        """Information of the file's priors (D, D), in the unit box."""
        out = np.zeros(len(self.unit))
        out[self.layout.priors[0]] = self.layout.prior_slopes(self.unit) ** 2
        return np.diag(out)

    def information(self, candidate: CandidateProblem) -> FloatArray | None:
        """Return the information (D, D) of a window, in the unit box; None where the simulation diverges.

        Initial states are eliminated piece by piece, then biases; every nuisance has a prior of one, so that no
        elimination is singular. A piece that the simulation does not follow is left out: where it tumbles its
        sensitivities are huge and mean nothing.
        """
        whole = candidate.misfit(self.vehicle, self.weights)
        d, every = whole.dimension, whole.layout.nuisances
        biases = tuple(n for n in every if n.is_bias)
        shared = d + len(biases)
        total = np.zeros((shared, shared))
        # One by one: all sensitivities at once are zero for the most part.
        for i, piece in enumerate(whole.pieces):
            own = tuple(replace(n, piece=0) for n in every if not n.is_bias and n.piece == i)
            layout = fits.Layout.of(self.vehicle, (*biases, *own))
            problem = fits.Misfit(layout, (piece,), self.weights, ((len(piece.time),),))
            r, J = _linearized(problem, self.unit)
            if not np.isfinite(r).all():
                return None
            samples = _blocks(problem)[0]
            if _rms(r[samples]) < MAX_RESIDUAL * self.usual:
                rows = J[samples]
                rows = rows[np.isfinite(rows).all(axis=1)]
                total += _eliminated(rows.T @ rows, shared)
        return _eliminated(total, d)


def _blocks(problem: fits.Misfit) -> list[slice]:
    """Return the rows of each piece."""
    channels = len(problem.layout.vehicle.outputs)
    edges = np.cumsum([0, *(channels * len(p.time) for p in problem.pieces)])
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]


def _rms(r: FloatArray) -> float:
    return float(np.sqrt(np.mean(r**2)))


def _eliminated(information: FloatArray, kept: int) -> FloatArray:
    """Return the information about the first unknowns when the others are estimated too, with priors of one."""
    others = information[kept:, kept:] + np.eye(len(information) - kept)
    cross = information[kept:, :kept]
    out = information[:kept, :kept] - cross.T @ np.linalg.solve(others, cross)
    return np.asarray(0.5 * (out + out.T))


def _linearized(problem: fits.Misfit, unit: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return residuals and sensitivities at parameters (D,) in the unit box, nuisances at their guess."""
    z = np.concatenate([unit, np.zeros(problem.extra)])
    with np.errstate(invalid="ignore", over="ignore"):
        r = problem.residuals(z[None, :], 0)[0]
        sound = bool(np.isfinite(r).all())
        J = problem.jacobian(z, 0, r)[0].dense() if sound else np.empty((0, len(z)))
    return r, J


def linearization_point(
    vehicle: Vehicle, candidates: Sequence[CandidateProblem], estimates: Mapping[str, float]
) -> VehicleInformation:
    """Find the noise of the flight from some of its windows, at estimates of free numbers (the file's values for others).

    Raises
    ------
    IdentificationError
        Nothing is free, or the simulation diverges in all windows.
    """
    sample = candidates[:NOISE_WINDOWS]
    layout = fits.Layout.of(vehicle, ())
    if not layout.dimension:
        raise IdentificationError(f"{vehicle.where}: no number is free; set free = true or use --free NAME")
    weights = fits.Weights.of(np.diag(sensor_noise(vehicle)))
    unit = layout.unit(np.array([estimates.get(p.name, p.value) for p in layout.parameters]))
    linear = [(one, p, *_linearized(p, unit)) for one in sample for p in [one.misfit(vehicle, weights)]]
    linear = [one for one in linear if np.isfinite(one[2]).all()]
    if not linear:
        raise IdentificationError(
            f"{vehicle.where}: the simulation diverges in every window from the values in its file; "
            "check values and units, or find windows without --vehicle"
        )
    for _ in range(NOISE_ROUNDS):
        weights = fits.Weights.of(_noise(vehicle, linear, weights))
    rms = []
    for one, *_ in linear:
        problem = one.misfit(vehicle, weights)
        r, _ = _linearized(problem, unit)
        rms += [_rms(r[block]) for block in _blocks(problem)]
    return VehicleInformation(vehicle, unit, weights, float(np.median(rms)))


def _noise(
    vehicle: Vehicle,
    linear: Sequence[tuple[CandidateProblem, fits.Misfit, FloatArray, FloatArray]],
    weights: fits.Weights,
) -> FloatArray:
    """Return the variance (n_y,) of the residuals after a linear step, times their correlation time in samples."""
    stated = np.diag(sensor_noise(vehicle))
    ratio = np.sqrt(stated / np.diag(weights.covariance))
    left = [e for one in linear for e in _residuals_after_step(*one, ratio, np.sqrt(stated))]
    errors = np.concatenate(left)
    seen = np.isfinite(errors).any(axis=0)
    variance = stated.copy()
    variance[seen] = np.nanmean(errors[:, seen] ** 2, axis=0)
    variance = np.maximum(variance, NOISE_FLOOR**2 * stated)
    dt = linear[0][1].pieces[0].dt
    common = float(np.median(fits.correlation_times(left, dt)[seen])) if seen.any() else 1.0
    return np.asarray(variance * common)


def _residuals_after_step(
    one: CandidateProblem,
    problem: fits.Misfit,
    r: FloatArray,
    J: FloatArray,
    ratio: FloatArray,
    sigma: FloatArray,
) -> list[FloatArray]:
    """Return the residuals (n, n_y), SI, of each stretch after a linear step; NaN where nothing was measured."""
    channels, d = len(ratio), problem.dimension
    samples = sum(len(p.time) for p in problem.pieces)
    rows = samples * channels
    scale = np.concatenate([np.tile(ratio, samples), np.ones(len(r) - rows)])
    A, b = J * scale[:, None], r * scale
    finite = np.isfinite(A).all(axis=1)
    normal = A[finite].T @ A[finite]
    normal[np.arange(d), np.arange(d)] += BOX_INFORMATION  # parameters stay in their box
    step = np.linalg.solve(normal + 1e-9 * np.eye(len(normal)), -(A[finite].T @ b[finite]))
    after = (r + np.nan_to_num(J) @ step)[:rows].reshape(-1, channels) * sigma
    measured = np.concatenate([p.measured for p in problem.pieces])
    lengths = np.cumsum([0, *(len(p.time) for p in problem.pieces)])
    ends = lengths[np.cumsum(one.counts)]
    return np.split(np.where(np.isfinite(measured), after, np.nan), ends[:-1])


def sensor_noise(vehicle: Vehicle) -> FloatArray:
    """Return the noise covariance (n_y, n_y) that the vehicle file states."""
    return np.diag([getattr(vehicle.file.sensors, c).sigma ** 2 for c in vehicle.outputs])
