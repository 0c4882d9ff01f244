"""What windows tell of the free numbers of a vehicle: Fisher's information, from the sensitivities of its simulation.

The simulation starts from the file's values, or from those of a regression where they fit better. One linear step
from there, by numbers, initial states and biases, leaves residuals that say how noisy the flight is, gusts and what
the model lacks included; so the prediction is of this flight, and not of a sensor's data sheet.

A vehicle with rotors is unstable: its windows are cut into short ones that each begin anew, as they will be fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from stoop.assess.covariance import invert, marked, standard_errors
from stoop.base.arrays import FloatArray
from stoop.design.setup import BOX
from stoop.design.windows.candidates import Candidate
from stoop.design.windows.choice import Evidence
from stoop.errors import FlightError, IdentificationError
from stoop.estimate.fit import starts
from stoop.estimate.noise import correlation_times
from stoop.estimate.shooting.windows import WINDOW_LENGTH
from stoop.flight import Flight
from stoop.problem import Layout, Misfit, Piece, Weights
from stoop.problem.observation import guess_start, observation_model, state_channels
from stoop.problem.prepare import Prepared, nuisances, prepare, without_stuck_channels
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle

SAMPLED: Final = 8  #: windows that the noise is read from
ROUNDS: Final = 2  #: of linear step and noise
WILD: Final = (
    4.0  #: times the usual residual of a piece, from which the simulation does not follow the flight
)
FLOOR: Final = 0.1  #: of the noise that the vehicle file gives a sensor


@dataclass(frozen=True, eq=False)
class Posed:
    """A candidate as a least-squares problem of its own.

    Attributes
    ----------
    pieces : tuple of Piece
        Short ones of a vehicle with rotors.
    whole : tuple of int
        How many of them, one after the other, make each stretch without a hole.
    """

    prepared: Prepared
    whole: tuple[int, ...]

    def problem(self, vehicle: Vehicle, weights: Weights) -> Misfit:
        """Return the problem with this window's nuisances."""
        pieces = self.prepared.pieces
        layout = Layout.of(vehicle, nuisances(vehicle, self.prepared))
        return Misfit(layout, pieces, weights, (tuple(len(p.time) for p in pieces),))


@dataclass(frozen=True, eq=False)
class Sensitive:
    """A vehicle about which windows are judged.

    Attributes
    ----------
    vehicle : Vehicle
    unit : (D,)
        Where its free numbers stand in their boxes.
    weights : Weights
        Of the noise of this flight.
    usual : float
        Root mean square of the whitened residuals of a piece, before any step.
    """

    vehicle: Vehicle
    unit: FloatArray
    weights: Weights
    usual: float

    @cached_property
    def layout(self) -> Layout:
        """Free numbers alone."""
        return Layout.of(self.vehicle, ())

    @property
    def names(self) -> tuple[str, ...]:
        """Free numbers."""
        return tuple(p.name for p in self.layout.parameters)

    @property
    def values(self) -> FloatArray:
        """Where the sensitivities were taken (D,), SI."""
        return np.asarray(self.layout.physical(self.unit[None, :])[0])

    @property
    def priors(self) -> FloatArray:
        """What the file knows (D, D), in the unit box."""
        index, _, sigma = self.layout.priors
        out = np.zeros(len(self.unit))
        out[index] = sigma**-2.0
        return np.diag(out)

    def errors(self, told: Sequence[FloatArray]) -> FloatArray:
        """Return the standard errors (D,), SI, that windows leave together; infinite where they do not tell."""
        inverse = invert(self.priors + sum(told, np.zeros_like(self.priors)))
        return standard_errors(marked(inverse.matrix, inverse.determined)) * self.layout.width

    def information(self, posed: Posed) -> FloatArray | None:
        """Return what a window tells (D, D), in the unit box; None where it cannot be flown."""
        problem = posed.problem(self.vehicle, self.weights)
        z = np.concatenate([self.unit, np.zeros(problem.extra)])
        r, J = _linear(problem, z)
        if not np.isfinite(r).all():
            return None
        return _told(problem, r, J, WILD * self.usual)


def _told(problem: Misfit, r: FloatArray, J: FloatArray, most: float) -> FloatArray:
    """Return the information (D, D) about the parameters; states are eliminated piece by piece, then biases.

    Every nuisance has a prior of one, so that no elimination is singular. A piece that the simulation leaves by more
    than `most` tells nothing: where it tumbles its sensitivities are huge and mean nothing.
    """
    d, every = problem.dimension, problem.layout.nuisances
    shared = [*range(d), *(d + j for j, n in enumerate(every) if n.is_bias)]
    total = np.zeros((len(shared), len(shared)))
    for i, block in enumerate(_blocks(problem)):
        if _rms(r[block]) < most:
            own = [d + j for j, n in enumerate(every) if n.piece == i]
            rows = J[block][:, [*shared, *own]]
            rows = rows[np.isfinite(rows).all(axis=1)]
            total += _eliminated(rows.T @ rows, len(shared))
    return _eliminated(total, d)


def _blocks(problem: Misfit) -> list[slice]:
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


def by_vehicle(
    sensitive: Sensitive, posed: Sequence[Posed | None], tell: Callable[[str], None] = lambda _: None
) -> tuple[Evidence, list[int]]:
    """Return what each candidate tells, and which candidates tell anything."""
    told = {}
    for i, one in enumerate(posed):
        tell(f"what window {i + 1} of {len(posed)} tells")
        matrix = sensitive.information(one) if one else None
        if matrix is not None:
            told[i] = matrix
    known = sensitive.priors + BOX * np.eye(len(sensitive.unit))
    return Evidence(known, tuple(told.values())), list(told)


def pose_window(vehicle: Vehicle, flight: Flight, one: Candidate) -> Posed | None:
    """Prepare a candidate as a fit would; None where the vehicle's state or its inputs were not measured."""
    window = Window(one.flight, one.start, one.stop)
    try:
        prepared = prepare(vehicle, {flight.name: flight}, [window])
    except FlightError:
        return None
    prepared = without_stuck_channels(vehicle, prepared)
    if observation_model(vehicle).open_loop:
        return Posed(prepared, (1,) * len(prepared.pieces))
    cut = [list(_short(vehicle, piece)) for piece in prepared.pieces]
    pieces = tuple(p for parts in cut for p in parts)
    return (
        Posed(replace(prepared, pieces=pieces), tuple(len(parts) for parts in cut if parts))
        if pieces
        else None
    )


def _short(vehicle: Vehicle, piece: Piece) -> Iterator[Piece]:
    """Cut a piece into windows of about a second that begin where the state was measured."""
    count = max(1, round((piece.time[-1] - piece.time[0]) / WINDOW_LENGTH))
    edges = np.linspace(0, len(piece.time), count + 1).astype(int)
    for a, b in pairwise(edges):
        columns = dict(zip(vehicle.outputs, piece.measured[a:b].T, strict=True))
        readings = {c: columns[c] for c in state_channels(vehicle) if c in columns}
        start, missing = guess_start(vehicle, piece.time[a:b], readings, "")
        if missing:
            continue  # its state was not measured there, and a guess falls out of the sky
        yield piece.part(a, b, {**start, "h": piece.start.get("h", 0.0)})


def judged(vehicle: Vehicle, posed: Sequence[Posed]) -> Sensitive:
    """Find where to take the sensitivities, and the noise of the flight, from some of its windows.

    Raises
    ------
    IdentificationError
        Nothing is free, or none of the windows can be flown.
    """
    sample = posed[:SAMPLED]
    layout = Layout.of(vehicle, ())
    if not layout.dimension:
        raise IdentificationError(f"{vehicle.where}: no number is free; set free = true or use --free NAME")
    weights = _stated(vehicle)
    unit = _start(vehicle, sample, weights)
    told = [(one, *_at(one.problem(vehicle, weights), unit)) for one in sample]
    told = [one for one in told if np.isfinite(one[2]).all()]
    if not told:
        raise IdentificationError(
            f"{vehicle.where}: the vehicle cannot be flown through any window from the values in its file; "
            "check values and units, or find windows without --vehicle"
        )
    for _ in range(ROUNDS):
        weights = Weights.of(_noise(vehicle, told, weights))
    flown = [_at(one.problem(vehicle, weights), unit) for one, *_ in told]
    usual = float(np.median([_rms(r[block]) for problem, r, _ in flown for block in _blocks(problem)]))
    return Sensitive(vehicle, unit, weights, usual)


def _at(problem: Misfit, unit: FloatArray) -> tuple[Misfit, FloatArray, FloatArray]:
    return problem, *_linear(problem, np.concatenate([unit, np.zeros(problem.extra)]))


def _stated(vehicle: Vehicle) -> Weights:
    return Weights.of(np.array([getattr(vehicle.file.sensors, c).sigma ** 2 for c in vehicle.outputs]))


def _start(vehicle: Vehicle, sample: Sequence[Posed], weights: Weights) -> FloatArray:
    """Return the start (D,) with the least cost from measured states: the file's, or that of a regression."""
    pieces = tuple(replace(p, maneuver=0) for one in sample for p in one.prepared.pieces)
    prepared = Prepared(sample[0].prepared.windows, pieces, ())  # as one maneuver: biases are shared
    biases = [n for n in nuisances(vehicle, prepared) if n.is_bias]
    problem = Misfit(Layout.of(vehicle, biases), pieces, weights, (tuple(len(p.time) for p in pieces),))
    with np.errstate(all="ignore"):
        guesses = starts(problem)
        costs = problem.costs(guesses, 0)
    return np.asarray(guesses[int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))])


def _step(J: FloatArray, r: FloatArray, d: int) -> FloatArray:
    """Return the linear step (D + E,) to the least squares, numbers held by their box."""
    told = np.isfinite(J).all(axis=1)
    A, b = J[told], r[told]
    normal = A.T @ A
    normal[np.arange(d), np.arange(d)] += BOX
    return np.asarray(np.linalg.solve(normal + 1e-9 * np.eye(len(normal)), -(A.T @ b)))


def _linear(problem: Misfit, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    with np.errstate(invalid="ignore", over="ignore"):
        r = problem.residuals(z[None, :], 0)[0]
        J, _ = problem.jacobian(z, 0, r) if np.isfinite(r).all() else (np.empty((0, len(z))), 0.0)
    return r, J


def _noise(
    vehicle: Vehicle, told: Sequence[tuple[Posed, Misfit, FloatArray, FloatArray]], weights: Weights
) -> FloatArray:
    """Return the variance (n_y,) of what a linear step leaves, times the time over which it repeats itself."""
    stated = np.diag(_stated(vehicle).covariance)
    ratio = np.sqrt(stated / np.diag(weights.covariance))
    left = [part for one, problem, r, J in told for part in _left(one, problem, r, J, ratio, np.sqrt(stated))]
    errors = np.concatenate(left)
    seen = np.isfinite(errors).any(axis=0)
    variance = stated.copy()
    variance[seen] = np.nanmean(errors[:, seen] ** 2, axis=0)
    variance = np.maximum(variance, FLOOR**2 * stated)
    dt = told[0][1].pieces[0].dt
    common = float(np.median(correlation_times(left, dt)[seen])) if seen.any() else 1.0
    return np.asarray(variance * common)


def _left(
    one: Posed, problem: Misfit, r: FloatArray, J: FloatArray, ratio: FloatArray, sigma: FloatArray
) -> list[FloatArray]:
    """Return the residuals (n, n_y), SI, of each stretch after a linear step; NaN where nothing was measured."""
    channels, rows = len(ratio), sum(len(p.time) for p in problem.pieces) * len(ratio)
    scale = np.concatenate([np.tile(ratio, rows // channels), np.ones(len(r) - rows)])
    step = _step(J * scale[:, None], r * scale, problem.dimension)
    after = (r + np.nan_to_num(J) @ step)[:rows].reshape(-1, channels) * sigma
    measured = np.concatenate([p.measured for p in problem.pieces])
    after = np.where(np.isfinite(measured), after, np.nan)
    lengths = [len(p.time) for p in problem.pieces]
    ends = np.cumsum([sum(part) for part in _split(lengths, one.whole)])
    return np.split(after, ends[:-1])


def _split(items: Sequence[int], counts: Sequence[int]) -> list[Sequence[int]]:
    edges = np.cumsum([0, *counts])
    return [items[a:b] for a, b in pairwise(edges)]


def of_flights(
    vehicle: Vehicle, flights: Mapping[str, Flight], found: Sequence[Candidate]
) -> list[Posed | None]:
    """Prepare all candidates."""
    return [pose_window(vehicle, flights[one.flight], one) for one in found]
