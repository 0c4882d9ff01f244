"""Windows of a flight -> segments whose inputs have no hole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray
from stoop.base.variables import variable
from stoop.errors import FlightError
from stoop.flight.channels import GAP
from stoop.flight.flight import Flight
from stoop.flight.grid import EDGE, complete

MOST_HOLES: Final = 4  #: that are told one by one
TRIMMED: Final = "trimmed to the record"  #: what the note says of a window that reaches beyond it
SHORTEST: Final = 0.5  #: s; shorter pieces say nothing about the aircraft and are dropped


@dataclass(frozen=True)
class Segment:
    """A contiguous piece of a maneuver; it has its own initial state.

    Attributes
    ----------
    t : (n,) s, uniform, on the log's own clock
    u : (n, m) inputs, complete
    z : (n, ny) outputs, NaN where missing
    extras : name -> (n,), NaN where missing
    """

    t: FloatArray
    u: FloatArray
    z: FloatArray
    extras: Mapping[str, FloatArray]


def segments(
    flight: Flight,
    start: float,
    stop: float,
    inputs: Sequence[str],
    outputs: Sequence[str],
    extras: Sequence[str] = (),
) -> tuple[list[Segment], list[str]]:
    """Cut a window out of a flight and split it where an input has a hole.

    Parameters
    ----------
    flight : the flight
    start, stop : s, on the log's own clock, both included
    inputs : variables that must be complete
    outputs : variables to compare with; may be missing in places, or altogether (then NaN)
    extras : further variables to carry along, as the outputs

    Returns
    -------
    segments : at least one
    notes : plain words about what was cut away

    Raises
    ------
    FlightError
        When an input is not in the flight, the window lies outside the record, or nothing is left of it.
    """
    _require(flight, inputs)
    window, notes = _window(flight, start, stop)
    inside = {name: _cut(flight, name, window) for name in (*inputs, *outputs, *extras)}
    t = flight.time[window]
    u = _stack(inside, inputs, t.size)
    pieces, cut = _pieces(flight, t, complete(u))
    if not pieces and t.size and t[-1] - t[0] < SHORTEST - 0.5 / flight.rate:
        raise FlightError(
            f"{flight.name} {start:g}:{stop:g}: {t[-1] - t[0]:.2g} s are too short; choose another window, one that holds "
            f"{SHORTEST:g} s without a hole"
        )
    if not pieces:
        raise FlightError(
            f"{flight.name} {start:g}:{stop:g}: no {SHORTEST:g} s without a hole in {', '.join(inputs)}; "
            "choose another window"
        )
    z = _stack(inside, outputs, t.size)
    made = [Segment(t[p], u[p], z[p], {name: inside[name][p] for name in extras}) for p in pieces]
    return made, [*notes, *cut, *_slow_inputs(flight, inputs)]


def _require(flight: Flight, inputs: Sequence[str]) -> None:
    for name in inputs:
        if name not in flight.data:
            variable(name, flight.name)
            there = ", ".join(str(known) for known in flight.data.data_vars)
            raise FlightError(f"{flight.name}: input '{name}' is not in this flight; it has {there}")


def _window(flight: Flight, start: float, stop: float) -> tuple[slice, list[str]]:
    """Return the samples of a window; the part outside the record is cut and noted."""
    t = flight.time
    first, last = float(t[0]), float(t[-1])
    where = f"{flight.name} {start:g}:{stop:g}"
    if not start < stop:
        raise FlightError(f"{where}: the window ends before it begins; write START:STOP in seconds")
    if stop <= first or start >= last:
        raise FlightError(
            f"{where}: outside the record, which runs from {first:.2f} to {last:.2f} s "
            "on the log's own clock; choose a window inside"
        )
    period = 1.0 / flight.rate
    notes = []
    if start < first - period or stop > last + period:
        notes.append(f"{where}: {TRIMMED}, {max(start, first):.2f} to {min(stop, last):.2f} s")
    low, high = np.searchsorted(t, [start - EDGE, stop + EDGE])
    return slice(int(low), int(high)), notes


def _cut(flight: Flight, name: str, window: slice) -> FloatArray:
    if name not in flight.data:
        variable(name, flight.name)
        return np.full(flight.time[window].size, np.nan)
    return flight.column(name)[window]


def _stack(columns: Mapping[str, FloatArray], names: Sequence[str], size: int) -> FloatArray:
    return np.column_stack([columns[name] for name in names]) if names else np.empty((size, 0))


def _pieces(flight: Flight, t: FloatArray, whole: npt.NDArray[np.bool_]) -> tuple[list[slice], list[str]]:
    """Return the runs of complete inputs that are long enough, and notes on holes and short runs."""
    least = SHORTEST * flight.rate
    pieces = runs(whole)
    kept = [run for run in pieces if run.stop - run.start >= least]
    edges = (0, t.size)  # a single sample at the edge is the rounding of the window, no hole
    holes = [
        run for run in runs(~whole) if run.stop - run.start > 1 or not {run.start, run.stop} & set(edges)
    ]
    dropped = len(pieces) - len(kept)
    short = f"{flight.name}: {dropped} pieces between holes were shorter than {SHORTEST:g} s and were dropped"
    return kept, [*_holes(flight, t, holes), *([short] if dropped else [])]


def _holes(flight: Flight, t: FloatArray, holes: list[slice]) -> list[str]:
    if len(holes) <= MOST_HOLES:
        return [
            f"{flight.name}: inputs are missing in {_span(t, run)}; no segment crosses it" for run in holes
        ]
    lost = sum(run.stop - run.start for run in holes) / flight.rate
    where = f"{t[holes[0].start]:.2f}:{t[holes[-1].stop - 1]:.2f}"
    return [
        f"{flight.name}: inputs are missing in {len(holes)} places in {where}, {lost:.2f} s in all; "
        "no segment crosses them"
    ]


def _span(t: FloatArray, run: slice) -> str:
    return f"{t[run.start]:.2f}:{t[run.stop - 1]:.2f}"


def runs(mask: npt.NDArray[np.bool_]) -> list[slice]:
    """Return the maximal runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _slow_inputs(flight: Flight, inputs: Sequence[str]) -> list[str]:
    """Warn of inputs logged so slowly that what happened between samples is guessed."""
    return [
        f"{flight.name}: input '{name}' was logged at {source.rate:.1f} Hz; between samples it is guessed"
        for name in inputs
        if (source := flight.sources.get(name)) is not None and 0.0 < source.rate < 1.0 / GAP
    ]
