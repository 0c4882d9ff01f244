"""Output error over the kinematics: pieces of a flight, and the least-squares problem that Levenberg-Marquardt sees.

The vector holds the unknowns, then the initial states of all pieces, each as (value - prior mean) / prior
standard deviation. Nothing is bounded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray, IntArray, run_slices
from stoop.base.notices import Notice, distinct, notice
from stoop.base.rotations import matrices_of, quaternions_of
from stoop.base.variables import EULER, POSITION, RATES, SPECIFIC_FORCE, VELOCITY, WRAPPED
from stoop.errors import FlightError
from stoop.flight import Flight, segments
from stoop.flight.air_data import RECONSTRUCTED
from stoop.flight.instrument_errors import AIR, DELAYED, GROUND, RATES_DELAY, InstrumentError
from stoop.optimize import forward_jacobian
from stoop.optimize.normal_equations import TallMatrix
from stoop.problem import on_circle
from stoop.reconstruction.kinematics import INPUTS, OUTPUTS, PARAMETERS, SCALED, kernel
from stoop.vehicle.channels import rigid_states
from stoop.vehicle.delays import delayed


@dataclass(frozen=True)
class PieceLimits:
    """How a flight is cut."""

    longest: float = 10.0  #: s of one piece: integrated rates drift, and a new initial state stops that
    shortest: float = 3.0  #: s; a shorter piece determines its initial state only ...
    least: int = 15  #: samples: nor do fewer of a slow record
    pieces: int = 12  #: more hardly narrow what is alike in all of them
    rate: float = 50.0  #: Hz at which channels are compared; integration runs at the rate of the grid
    #: s at both ends of a piece that are not compared, so that a delay finds what it needs
    margin: float = 0.3

    def fewest(self, rate: float) -> float:
        """Return how many samples at a rate, Hz, a piece has at least."""
        return max(self.shortest * rate, self.least)


PIECES: Final = PieceLimits()
START: Final = {
    "u": 2.0, "v": 2.0, "w": 2.0, "phi": 0.05, "theta": 0.05, "psi": 0.1, "pn": 5.0, "pe": 5.0, "pd": 5.0,
}  #: m/s, rad, m: prior standard deviation of an initial state about its guess, wide  # fmt: skip
LATE: Final = {channel: f"{name}.delay" for name, channels in DELAYED.items() for channel in channels}
_NEEDED: Final = "a compatibility check needs p, q, r with phi, theta, psi, or with ax, ay, az and a velocity"


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch without a hole in the inertial data, with its own initial state."""

    time: FloatArray  #: (n,) s, uniform
    inputs: FloatArray  #: (n, 6), as read: ax ay az [m/s2], p q r [rad/s]
    readings: FloatArray  #: (n, 13), in the order of `OUTPUTS`; NaN where nothing was logged, or nothing is compared
    start: Mapping[str, float]  #: names of the initial state -> guess, SI
    every: int = 1  #: interval of the samples compared

    @cached_property
    def measured(self) -> FloatArray:
        """What is compared, (m, 13)."""
        return self.readings[:: self.every]

    @property
    def dt(self) -> float:
        """Sample period, s."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)


@dataclass(frozen=True, eq=False)
class Pieces:
    """The pieces of a flight; `logged` are the measured channels that are compared, inputs first."""

    flight: Flight
    logged: tuple[str, ...]
    pieces: tuple[Piece, ...]
    notices: tuple[Notice, ...]


def cut_pieces(flight: Flight, windows: Sequence[tuple[float, float]] = ()) -> Pieces:
    """Cut a flight, or windows (start, stop) of it, s on the log's own clock, into pieces; the airborne part without any.

    Raises
    ------
    FlightError
        What it holds has nothing to be compatible with, or no piece is long enough.
    """
    logged = _comparable(flight)
    pieces: list[Piece] = []
    notices: list[Notice] = []
    runs, least = run_slices(flight.flying()), PIECES.fewest(flight.rate)
    ends = [flight.time[[run.start, run.stop - 1]] for run in runs if run.stop - run.start > least]
    spans = windows or [(float(a), float(b)) for a, b in ends]
    for start, stop in spans:
        cut, found = _cut_window(flight, logged, start, stop)
        pieces += cut
        notices += found
    if not pieces:
        inputs = ", ".join(name for name in INPUTS if name in logged)
        shortest = PIECES.fewest(flight.rate) / flight.rate
        holes = f"no {shortest:.3g} s without a hole in {inputs}; choose another window"
        grounded = f"by speed and lift it is in the air for no {shortest:.3g} s; choose a window"
        raise FlightError(f"{flight.name}: {holes if spans else grounded}")
    notices = [*distinct(notices)]
    if len(pieces) > PIECES.pieces:  # the others add next to no information
        spreads = [np.std(piece.inputs, axis=0) for piece in pieces]
        movement = [-float(np.sum(spread[3:]) + np.sum(spread[:3]) / 9.81) for spread in spreads]
        order = np.argsort(movement, kind="stable")[: PIECES.pieces]
        seconds = sum(float(pieces[i].time[-1] - pieces[i].time[0]) for i in order)
        counts = {"count": PIECES.pieces, "total": len(pieces)}
        notices.append(notice("compared-in-part", "", **counts, duration=seconds))
        pieces = [pieces[i] for i in sorted(order)]
    return Pieces(flight, logged, tuple(pieces), tuple(notices))


def _comparable(flight: Flight) -> tuple[str, ...]:
    """Return the channels that a sensor measured and that can be compared, inputs first.

    Without accelerometers those are attitude and rates alone.
    """
    names = dict.fromkeys((*INPUTS, *OUTPUTS))
    there = [n for n in names if n in flight.names and np.isfinite(flight.column(n)).any()]
    measured = tuple(n for n in there if flight.sources[n].source != RECONSTRUCTED)
    lacking = [name for name in RATES if name not in measured]
    if lacking:
        raise FlightError(
            f"{flight.name}: {', '.join(lacking)} were not logged, or hold no number that can be; {_NEEDED}"
        )
    if not set(EULER) <= set(measured):
        raise FlightError(f"{flight.name}: attitude was not logged; {_NEEDED}")
    if set(SPECIFIC_FORCE) <= set(measured) and set(measured) & (GROUND | AIR):
        return measured
    return tuple(name for name in measured if name in (*RATES, *EULER))


def _cut_window(
    flight: Flight, logged: Sequence[str], start: float, stop: float
) -> tuple[list[Piece], list[Notice]]:
    """Split a window at its holes and into parts of equal length, none too long."""
    inputs, outputs = ([name for name in names if name in logged] for names in (INPUTS, OUTPUTS))
    try:
        found, notices = segments(flight, start, stop, inputs, outputs)
    except FlightError:
        if start < flight.time[-1] and stop > flight.time[0]:
            return [], []  # nothing but holes: said where no window is left
        raise
    out = []
    for segment in found:
        columns = dict(zip(inputs, segment.u.T, strict=True)) | dict(zip(outputs, segment.z.T, strict=True))
        parts = max(1, int(np.ceil(len(segment.t) / (PIECES.longest * flight.rate))))
        for a, b in pairwise(np.linspace(0, len(segment.t), parts + 1).astype(int)):
            if b - a >= PIECES.fewest(flight.rate):
                piece = _piece(flight, segment.t[a:b], {name: x[a:b] for name, x in columns.items()})
                out += [piece] if piece is not None else []
    return out, notices


def _piece(flight: Flight, time: FloatArray, columns: Mapping[str, FloatArray]) -> Piece | None:
    """Return a piece that begins where its state was measured; None where that is too late."""
    state = [x for name, x in columns.items() if name in (*EULER, *VELOCITY, "V")]
    first = int(np.argmax(np.logical_and.reduce([np.isfinite(x) for x in state])))
    time, columns = time[first:], {name: x[first:] for name, x in columns.items()}
    # body velocity over ground, or through the air
    at = {name: float(x[0]) for name, x in columns.items()}
    angles = {name: at[name] for name in EULER}
    if set(VELOCITY) <= at.keys():
        rotation = matrices_of(quaternions_of(np.array(list(angles.values()))))
        u, v, w = np.array([at[name] for name in VELOCITY]) @ rotation
    else:
        speed = at.get("V", at.get("airspeed_pitot", 0.0))
        flow = {"V": speed, "alpha": at.get("alpha", 0.0), "beta": at.get("beta", 0.0)}
        moving = rigid_states({name: np.nan_to_num(value) for name, value in flow.items()})
        u, v, w = (float(moving[name][0]) for name in "uvw")
    place = {name: float(np.nan_to_num(at.get(name, 0.0))) for name in POSITION}
    start = {"u": float(u), "v": float(v), "w": float(w), **angles, **place}
    if len(time) < PIECES.fewest(flight.rate) or not np.isfinite(list(start.values())).all():
        return None
    blank = np.full(len(time), np.nan)
    measured = np.column_stack([columns.get(name, blank) for name in OUTPUTS])
    edge = max(1, round(PIECES.margin * flight.rate))
    measured[:edge], measured[-edge:] = np.nan, np.nan
    inputs = np.column_stack([columns.get(name, np.zeros(len(time))) for name in INPUTS])
    return Piece(time, inputs, measured, start, max(1, round(flight.rate / PIECES.rate)))


@dataclass(frozen=True, eq=False)
class Problem:
    """See :class:`stoop.optimize.Problem`; one rung, no box."""

    unknowns: tuple[InstrumentError, ...]
    pieces: tuple[Piece, ...]
    sigma: FloatArray  #: (13,) by which each channel is weighted
    dimension: int = 0
    prices: tuple[float, ...] = (1.0,)

    @property
    def shared(self) -> int:
        """Number of unknowns that all pieces share."""
        return len(self.unknowns)

    @property
    def extra(self) -> int:
        """Length of the vector."""
        return self.shared + len(START) * len(self.pieces)

    @cached_property
    def scales(self) -> FloatArray:
        """Prior standard deviations (k,), SI."""
        return np.array([unknown.std for unknown in self.unknowns])

    def values(self, Z: FloatArray) -> FloatArray:
        """Return the unknowns (B, k) of vectors (B, E) or their first k entries, SI."""
        means = np.array([unknown.mean for unknown in self.unknowns])
        return np.asarray(means + Z[:, : self.shared] * self.scales)

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return the cost (B,) with everything at its prior mean: there is no box to search."""
        return np.asarray(np.sum(self.residuals(np.zeros((len(X), self.extra)), rung) ** 2, axis=1))

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return weighted residuals (B, n_r), those of the priors last."""
        blocks = [self._block(Z, i) for i in range(len(self.pieces))]
        return np.concatenate([*blocks, Z], axis=1)

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[TallMatrix, float]:
        """Differentiate by forward steps, a stretch a piece, which depends on the unknowns and its own initial state only."""
        parts, first = list[tuple[IntArray, FloatArray]](), 0
        for i, piece in enumerate(self.pieces):
            block = slice(first, first + piece.measured.size)
            entries = np.array([*range(self.shared), *self._own(i)], dtype=np.intp)
            part = _Part(self, z, i, entries)
            # a step of a millionth of a prior's standard deviation
            parts.append((entries, forward_jacobian(part, z[entries], 0, r[block], 1e-6)[0].T))
            first = block.stop
        parts.append((np.arange(self.extra), np.eye(self.extra)))
        return TallMatrix.stacked(parts, self.extra), float(self.shared + len(START))

    def reference(self, rung: int) -> float:
        """Return the cost of channels that stay at their first value."""
        total = 0.0
        for piece in self.pieces:
            first = np.array([column[np.isfinite(column)][:1].sum() for column in piece.measured.T])
            total += float(np.nansum(((first - piece.measured) / self.sigma) ** 2))
        return total

    def outputs(self, z: FloatArray, index: int) -> FloatArray:
        """Return the readings (m, 13) of one piece at the samples that are compared."""
        return np.asarray(self.trajectories(z[None, :], index)[0])

    def errors(self, z: FloatArray) -> list[FloatArray]:
        """Return measured minus reconstructed (m, 13) of every piece, NaN where nothing was measured."""
        pieces = enumerate(self.pieces)
        return [on_circle(piece.measured - self.outputs(z, i), OUTPUTS) for i, piece in pieces]

    @np.errstate(invalid="ignore", over="ignore")  # about to diverge: large numbers overflow
    def trajectories(self, Z: FloatArray, index: int) -> FloatArray:
        """Return the readings (B, m, 13) of one piece; gyros of the same delay are integrated together."""
        piece = self.pieces[index]
        values = dict(zip((u.name for u in self.unknowns), self.values(Z).T, strict=True))
        scales = {f"{name}.scale" for name in SCALED}
        usual = {name: np.full(len(Z), 1.0 if name in scales else 0.0) for name in PARAMETERS}
        rows = np.array([values.get(name, usual[name]) for name in PARAMETERS])
        own = Z[:, self._own(index)]
        at = {name: piece.start[name] + std * own[:, j] for j, (name, std) in enumerate(START.items())}
        turned = quaternions_of(np.column_stack([at[name] for name in EULER])).T
        start = np.array([*(at[name] for name in "uvw"), *turned, *(at[name] for name in POSITION)])
        late = values.get(RATES_DELAY, np.zeros(len(Z)))
        whole = np.empty((len(Z), len(piece.time), len(OUTPUTS)))
        for delay in np.unique(late):
            lanes, inputs = late == delay, piece.inputs
            if delay != 0.0:  # the gyros are read as much earlier as they are late
                gyro, inputs = INPUTS.index("p"), inputs.copy()
                inputs[:, gyro:] = delayed(piece.inputs[:, gyro:], -float(delay) / piece.dt)
            whole[lanes] = kernel().trajectories(rows[:, lanes], start[:, lanes], inputs, piece.dt)
        out = whole[:, :: piece.every].copy()
        for column, channel in enumerate(OUTPUTS):  # as late as each sensor delivers them
            delays = values.get(LATE[channel], np.zeros(len(out)))
            for delay in np.unique(delays[delays != 0.0]):
                lanes = delays == delay
                readings = np.ascontiguousarray(whole[lanes, :, column].T)
                if channel in WRAPPED and (np.abs(np.diff(readings, axis=0)) >= np.pi).any():
                    readings = np.unwrap(readings, axis=0)
                out[lanes, :, column] = delayed(readings, float(delay) / piece.dt, piece.every).T
        return out

    def _block(self, Z: FloatArray, index: int) -> FloatArray:
        measured = self.pieces[index].measured
        seen = np.isfinite(measured)
        with np.errstate(invalid="ignore", over="ignore"):
            error = self.trajectories(Z, index)
            error = on_circle((error - np.where(seen, measured, 0.0)) * seen, OUTPUTS)
            return np.asarray((error / self.sigma).reshape(len(Z), -1))

    def _own(self, index: int) -> range:
        first = self.shared + len(START) * index
        return range(first, first + len(START))


@dataclass(frozen=True, eq=False)
class _Part:
    """One piece as a function of the entries that move it, for `forward_jacobian`."""

    whole: Problem
    z: FloatArray
    index: int
    entries: NDArray[np.intp]
    dimension: int = 0
    prices: tuple[float, ...] = (1.0,)

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return weighted residuals (B, n) of the piece."""
        moved = np.repeat(self.z[None, :], len(Z), axis=0)
        moved[:, self.entries] = Z
        return self.whole._block(moved, self.index)
