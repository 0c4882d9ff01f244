"""Flight and windows -> pieces: which channels were measured, and where each piece begins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray, run_slices
from stoop.base.notices import Notice, distinct, notice
from stoop.base.rotations import matrices_of, quaternions_of
from stoop.base.variables import EULER, POSITION, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.errors import FlightError
from stoop.flight import Flight, segments
from stoop.flight.air_data import RECONSTRUCTED
from stoop.flight.airborne import flying
from stoop.flight.instrument_errors import AIR, GROUND
from stoop.reconstruction.kinematics import INPUTS, OUTPUTS
from stoop.simulation.initial import rigid_states

MAX_DURATION: Final = 10.0  #: s of one piece: integrated rates drift, and a new initial state stops that
MIN_DURATION: Final = 3.0  #: s; less tells nothing beside its own initial state
MAX_PIECES: Final = 12  #: more hardly narrow what is alike in all of them
COMPARED_RATE: Final = 50.0  #: Hz at which channels are compared; integration runs at the rate of the grid
MARGIN: Final = 0.3  #: s at both ends of a piece that are not compared, so that a delay finds what it needs
_NEEDED: Final = "a compatibility check needs p, q, r with phi, theta, psi, or with ax, ay, az and a velocity"


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch without a hole in the inertial data, with its own initial state.

    Attributes
    ----------
    time : (n,) s, uniform
    inputs : (n, 6), as read: ax ay az [m/s2], p q r [rad/s]
    readings : (n, 13), in the order of `OUTPUTS`; NaN where nothing was logged, or nothing is compared
    start : mapping, names of the initial state -> guess, SI
    every : int
        Each so-manieth sample is compared.
    """

    time: FloatArray
    inputs: FloatArray
    readings: FloatArray
    start: Mapping[str, float]
    every: int = 1

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
    """What is compared.

    Attributes
    ----------
    flight : Flight
    logged : tuple of str
        Measured channels that take part, inputs first.
    pieces : tuple of Piece
    notices : tuple of Notice
    """

    flight: Flight
    logged: tuple[str, ...]
    pieces: tuple[Piece, ...]
    notices: tuple[Notice, ...]


def measured_channels(flight: Flight) -> tuple[str, ...]:
    """Return the channels that a sensor measured and that hold a value, inputs first."""
    names = dict.fromkeys((*INPUTS, *OUTPUTS))
    there = [n for n in names if n in flight.data and np.isfinite(flight.column(n)).any()]
    return tuple(n for n in there if flight.sources[n].source != RECONSTRUCTED)


def cut_pieces(flight: Flight, windows: Sequence[tuple[float, float]] = ()) -> Pieces:
    """Cut a flight into pieces.

    Parameters
    ----------
    flight : Flight
    windows : sequence of (start, stop), s on the log's own clock; the airborne part without any

    Raises
    ------
    FlightError
        What it holds has nothing to be compatible with, or no piece is long enough.
    """
    logged = _comparable(flight, measured_channels(flight))
    pieces: list[Piece] = []
    notices: list[Notice] = []
    spans = windows or [
        (float(flight.time[run.start]), float(flight.time[run.stop - 1]))
        for run in run_slices(flying(flight))
        if run.stop - run.start > MIN_DURATION * flight.rate
    ]
    for start, stop in spans:
        cut, found = _cut_window(flight, logged, start, stop)
        pieces += cut
        notices += found
    if not pieces:
        inputs = ", ".join(name for name in INPUTS if name in logged)
        holes = f"no {MIN_DURATION:g} s without a hole in {inputs}; choose another window"
        grounded = f"by speed and lift it is in the air for no {MIN_DURATION:g} s; choose a window"
        raise FlightError(f"{flight.name}: {holes if spans else grounded}")
    notices = [*distinct(notices)]
    if len(pieces) > MAX_PIECES:  # the others tell next to nothing more
        order = np.argsort([-_movement(piece) for piece in pieces], kind="stable")[:MAX_PIECES]
        seconds = sum(float(pieces[i].time[-1] - pieces[i].time[0]) for i in order)
        notices.append(notice("compared-in-part", count=MAX_PIECES, total=len(pieces), duration=seconds))
        pieces = [pieces[i] for i in sorted(order)]
    return Pieces(flight, logged, tuple(pieces), tuple(notices))


def _comparable(flight: Flight, measured: tuple[str, ...]) -> tuple[str, ...]:
    """Return what can be compared; without accelerometers that is attitude and rates alone."""
    there = set(measured)
    lacking = [name for name in RATES if name not in there]
    if lacking:
        raise FlightError(
            f"{flight.name}: {', '.join(lacking)} were not logged, or hold no number that can be; {_NEEDED}"
        )
    if not set(EULER) <= there:
        raise FlightError(f"{flight.name}: attitude was not logged; {_NEEDED}")
    if set(SPECIFIC_FORCE) <= there and there & (GROUND | AIR):
        return measured
    return tuple(name for name in measured if name in (*RATES, *EULER))


def _cut_window(
    flight: Flight, logged: Sequence[str], start: float, stop: float
) -> tuple[list[Piece], list[Notice]]:
    """Split a window at its holes and into parts of equal length, none longer than `MAX_DURATION`."""
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
        parts = max(1, int(np.ceil(len(segment.t) / (MAX_DURATION * flight.rate))))
        for a, b in pairwise(np.linspace(0, len(segment.t), parts + 1).astype(int)):
            if b - a >= MIN_DURATION * flight.rate:
                piece = _piece(flight, segment.t[a:b], {name: x[a:b] for name, x in columns.items()})
                out += [piece] if piece is not None else []
    return out, notices


def _piece(flight: Flight, time: FloatArray, columns: Mapping[str, FloatArray]) -> Piece | None:
    """Return a piece that begins where its state was measured; None where that is too late."""
    state = [x for name, x in columns.items() if name in (*EULER, *VELOCITY, "V")]
    first = int(np.argmax(np.logical_and.reduce([np.isfinite(x) for x in state])))
    time, columns = time[first:], {name: x[first:] for name, x in columns.items()}
    start = _initial_state({name: float(x[0]) for name, x in columns.items()})
    if len(time) < MIN_DURATION * flight.rate or not np.isfinite(list(start.values())).all():
        return None
    blank = np.full(len(time), np.nan)
    measured = np.column_stack([columns.get(name, blank) for name in OUTPUTS])
    edge = round(MARGIN * flight.rate)
    measured[:edge], measured[-edge:] = np.nan, np.nan
    inputs = np.column_stack([columns.get(name, np.zeros(len(time))) for name in INPUTS])
    return Piece(time, inputs, measured, start, max(1, round(flight.rate / COMPARED_RATE)))


def _initial_state(at: Mapping[str, float]) -> dict[str, float]:
    """Guess the initial state from the first sample; body velocity over ground, or through the air."""
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
    return {"u": float(u), "v": float(v), "w": float(w), **angles, **place}


def _movement(piece: Piece) -> float:
    spread = np.std(piece.inputs, axis=0)
    return float(np.sum(spread[3:]) + np.sum(spread[:3]) / 9.81)
