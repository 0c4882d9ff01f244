"""Windows of a flight -> segments whose inputs have no hole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, run_slices
from stoop.base.notices import Notice, notice
from stoop.base.variables import variable
from stoop.errors import FlightError
from stoop.flight.channels import MAX_GAP
from stoop.flight.flight import Flight
from stoop.flight.gridding import TIME_TOLERANCE, complete

MAX_LISTED: Final = 4  #: holes that get a notice each
MIN_SEGMENT: Final = 0.5  #: s; shorter pieces say nothing about the aircraft and are dropped


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
) -> tuple[list[Segment], list[Notice]]:
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
    notices : what was cut away

    Raises
    ------
    FlightError
        When an input is not in the flight, the window lies outside the record, or nothing is left of it.
    """
    for name in inputs:
        if name not in flight.data:
            variable(name, flight.name)
            there = ", ".join(str(known) for known in flight.data.data_vars)
            raise FlightError(f"{flight.name}: input '{name}' is not in this flight; it has {there}")
    window, notices = _window(flight, start, stop)
    t = flight.time[window]
    inside = {}
    for name in (*inputs, *outputs, *extras):
        if name in flight.data:
            inside[name] = flight.column(name)[window]
        else:
            variable(name, flight.name)
            inside[name] = np.full(t.size, np.nan)
    u = _stack(inside, inputs, t.size)
    whole = complete(u)
    pieces = [run for run in run_slices(whole) if run.stop - run.start >= MIN_SEGMENT * flight.rate]
    if not pieces:
        where = f"{flight.name} {start:g}:{stop:g}"
        if t.size and t[-1] - t[0] < MIN_SEGMENT - 0.5 / flight.rate:
            raise FlightError(
                f"{where}: {t[-1] - t[0]:.2g} s are too short; choose another window, one that holds "
                f"{MIN_SEGMENT:g} s without a hole"
            )
        raise FlightError(
            f"{where}: no {MIN_SEGMENT:g} s without a hole in {', '.join(inputs)}; choose another window"
        )
    z = _stack(inside, outputs, t.size)
    made = [Segment(t[p], u[p], z[p], {name: inside[name][p] for name in extras}) for p in pieces]
    notices += _holes(flight, t, ~whole)
    dropped = len(run_slices(whole)) - len(pieces)
    if dropped:
        notices.append(notice("short-pieces-dropped", flight.name, count=dropped, duration=MIN_SEGMENT))
    for name in inputs:
        source = flight.sources.get(name)
        if source is not None and 0.0 < source.rate < 1.0 / MAX_GAP:
            notices.append(notice("slow-input", flight.name, variable=name, rate=source.rate))
    return made, notices


def _window(flight: Flight, start: float, stop: float) -> tuple[slice, list[Notice]]:
    """Return the samples of a window, and a notice where it reaches beyond the record."""
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
    notices = []
    if start < first - period or stop > last + period:
        notices.append(notice("window-trimmed", where, start=max(start, first), stop=min(stop, last)))
    low, high = np.searchsorted(t, [start - TIME_TOLERANCE, stop + TIME_TOLERANCE])
    return slice(int(low), int(high)), notices


def _stack(columns: Mapping[str, FloatArray], names: Sequence[str], size: int) -> FloatArray:
    return np.column_stack([columns[name] for name in names]) if names else np.empty((size, 0))


def _holes(flight: Flight, t: FloatArray, missing: BoolArray) -> list[Notice]:
    """Name the holes of the inputs; a single sample at the edge is the rounding of the window, no hole."""
    holes = [
        run
        for run in run_slices(missing)
        if run.stop - run.start > 1 or not {run.start, run.stop} & {0, t.size}
    ]
    if len(holes) <= MAX_LISTED:
        return [
            notice("inputs-missing", flight.name, start=float(t[run.start]), stop=float(t[run.stop - 1]))
            for run in holes
        ]
    lost = sum(run.stop - run.start for run in holes) / flight.rate
    span = {"start": float(t[holes[0].start]), "stop": float(t[holes[-1].stop - 1])}
    return [notice("inputs-missing-often", flight.name, count=len(holes), duration=lost, **span)]
