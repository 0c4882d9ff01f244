"""Flight and windows -> pieces: which channels were measured, and where each piece begins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray, run_slices
from stoop.base.rotations import matrices_of, quaternions_of
from stoop.errors import FlightError
from stoop.flight import Flight, segments
from stoop.flight.air_data_reconstruction import RECONSTRUCTED
from stoop.flight.airborne import flying
from stoop.reconstruct.equations import INPUTS, OUTPUTS
from stoop.reconstruct.problem import Piece
from stoop.reconstruct.unknowns import AIR, GROUND
from stoop.simulate.initial import rigid_states

LONGEST: Final = 10.0  #: s of one piece: integrated rates drift, and a new initial state stops that
SHORTEST: Final = 3.0  #: s; less tells nothing beside its own initial state
MOST: Final = 12  #: pieces; more hardly narrow what is alike in all of them
COMPARED: Final = 50.0  #: Hz at which channels are compared; integration runs at the rate of the grid
LEAD: Final = 0.3  #: s at both ends of a piece that are not compared, so that a delay finds what it needs
RATES: Final = ("p", "q", "r")
FORCES: Final = ("ax", "ay", "az")
EULER: Final = ("phi", "theta", "psi")
_FEWEST: Final = "a compatibility check needs p, q, r with phi, theta, psi, or with ax, ay, az and a velocity"


@dataclass(frozen=True, eq=False)
class Prepared:
    """What is compared.

    Attributes
    ----------
    flight : Flight
    logged : tuple of str
        Measured channels that take part, inputs first.
    pieces : tuple of Piece
    notes : tuple of str
    """

    flight: Flight
    logged: tuple[str, ...]
    pieces: tuple[Piece, ...]
    notes: tuple[str, ...]


def measured_channels(flight: Flight) -> tuple[str, ...]:
    """Return the channels that a sensor measured and that hold a value, inputs first."""
    names = (*INPUTS, *OUTPUTS)
    there = [n for n in dict.fromkeys(names) if n in flight.data and np.isfinite(flight.column(n)).any()]
    return tuple(n for n in there if flight.sources[n].source != RECONSTRUCTED)


def prepare(flight: Flight, windows: Sequence[tuple[float, float]] = ()) -> Prepared:
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
    logged = _taking_part(flight, measured_channels(flight))
    inputs = [name for name in INPUTS if name in logged]
    pieces: list[Piece] = []
    notes: list[str] = []
    spans = windows or _airborne(flight)
    for start, stop in spans:
        cut, said = _pieces(flight, logged, inputs, start, stop)
        pieces += cut
        notes += said
    if not pieces:
        holes = f"no {SHORTEST:g} s without a hole in {', '.join(inputs)}; choose another window"
        grounded = f"by speed and lift it is in the air for no {SHORTEST:g} s; choose a window"
        raise FlightError(f"{flight.name}: {holes if spans else grounded}")
    kept, said = _liveliest(pieces)
    return Prepared(flight, logged, kept, (*dict.fromkeys(notes), *said))


def _taking_part(flight: Flight, measured: tuple[str, ...]) -> tuple[str, ...]:
    """Return what can be compared; without accelerometers that is attitude and rates alone."""
    there = set(measured)
    lacking = [name for name in RATES if name not in there]
    if lacking:
        raise FlightError(
            f"{flight.name}: {', '.join(lacking)} were not logged, or hold no number that can be; {_FEWEST}"
        )
    whole, felt = set(EULER) <= there, set(FORCES) <= there
    if not whole:
        raise FlightError(f"{flight.name}: attitude was not logged; {_FEWEST}")
    if felt and there & (GROUND | AIR):
        return measured
    return tuple(name for name in measured if name in (*RATES, *EULER))


def _airborne(flight: Flight) -> list[tuple[float, float]]:
    return [
        (float(flight.time[run.start]), float(flight.time[run.stop - 1]))
        for run in run_slices(flying(flight))
        if run.stop - run.start > SHORTEST * flight.rate
    ]


def _pieces(
    flight: Flight, logged: Sequence[str], inputs: Sequence[str], start: float, stop: float
) -> tuple[list[Piece], list[str]]:
    outputs = [name for name in OUTPUTS if name in logged]
    try:
        found, notes = segments(flight, start, stop, inputs, outputs)
    except FlightError:
        if start < flight.time[-1] and stop > flight.time[0]:
            return [], []  # nothing but holes: said where no window is left
        raise
    out = []
    for segment in found:
        columns = dict(zip(inputs, segment.u.T, strict=True)) | dict(zip(outputs, segment.z.T, strict=True))
        for part in _parts(len(segment.t), flight.rate):
            piece = _piece(flight, segment.t[part], {name: x[part] for name, x in columns.items()})
            out += [piece] if piece is not None else []
    return out, [str(found) for found in notes]


def _parts(count: int, rate: float) -> list[slice]:
    """Split samples into parts of equal length, none longer than `LONGEST`."""
    many = max(1, int(np.ceil(count / (LONGEST * rate))))
    edges = np.linspace(0, count, many + 1).astype(int)
    return [slice(a, b) for a, b in pairwise(edges) if b - a >= SHORTEST * rate]


def _piece(flight: Flight, time: FloatArray, columns: Mapping[str, FloatArray]) -> Piece | None:
    """Return a piece that begins where its state was measured; None where that is too late."""
    state = [x for name, x in columns.items() if name in (*EULER, "vn", "ve", "vd", "V")]
    first = int(np.argmax(np.logical_and.reduce([np.isfinite(x) for x in state])))
    time, columns = time[first:], {name: x[first:] for name, x in columns.items()}
    start = _start({name: float(x[0]) for name, x in columns.items()})
    if len(time) < SHORTEST * flight.rate or not np.isfinite(list(start.values())).all():
        return None
    blank = np.full(len(time), np.nan)
    measured = np.column_stack([columns.get(name, blank) for name in OUTPUTS])
    edge = round(LEAD * flight.rate)
    measured[:edge], measured[-edge:] = np.nan, np.nan
    inputs = np.column_stack([columns.get(name, np.zeros(len(time))) for name in INPUTS])
    return Piece(time, inputs, measured, start, max(1, round(flight.rate / COMPARED)))


def _start(at: Mapping[str, float]) -> dict[str, float]:
    """Guess the initial state from the first sample; body velocity over ground, or through the air."""
    turned = {name: at[name] for name in EULER}
    if {"vn", "ve", "vd"} <= at.keys():
        rotation = matrices_of(quaternions_of(np.array(list(turned.values()))))
        u, v, w = np.array([at["vn"], at["ve"], at["vd"]]) @ rotation
    else:
        speed = at.get("V", at.get("airspeed_pitot", 0.0))
        flow = {"V": speed, "alpha": at.get("alpha", 0.0), "beta": at.get("beta", 0.0)}
        moving = rigid_states({name: np.nan_to_num(value) for name, value in flow.items()})
        u, v, w = (float(moving[name][0]) for name in "uvw")
    place = {name: float(np.nan_to_num(at.get(name, 0.0))) for name in ("pn", "pe", "pd")}
    return {"u": float(u), "v": float(v), "w": float(w), **turned, **place}


def _liveliest(pieces: Sequence[Piece]) -> tuple[tuple[Piece, ...], list[str]]:
    """Keep the pieces that turn and push most: the others tell next to nothing more."""
    if len(pieces) <= MOST:
        return tuple(pieces), []
    order = np.argsort([-_movement(piece) for piece in pieces], kind="stable")[:MOST]
    seconds = sum(float(pieces[i].time[-1] - pieces[i].time[0]) for i in order)
    note = f"compared in the {MOST} liveliest of {len(pieces)} pieces, {seconds:.0f} s in all; windows choose others"
    return tuple(pieces[i] for i in sorted(order)), [note]


def _movement(piece: Piece) -> float:
    spread = np.std(piece.inputs, axis=0)
    return float(np.sum(spread[3:]) + np.sum(spread[:3]) / 9.81)
