"""A window that begins while commands are on their way: they are known from the record before it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stoop.flight import Flight
from stoop.problem.archive import problem_arrays, problem_document, restored_problem
from stoop.problem.misfit import HISTORY, Misfit, Piece
from stoop.problem.prepare import prepare
from stoop.problem.windows import Window
from stoop.simulation import parameter_rows
from stoop.strategy import Strategy
from stoop.vehicle import Vehicle
from stoop.vehicle.document import with_entries
from stoop.workflow.identification import search
from stoop_studies.verify import scenes

CONTROLS = ("elevator", "aileron", "rudder")
DELAY = 0.3  #: s


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    own = {"value": DELAY, "free": True, "prior": 0.1}
    shared = {("controls", c, "delay"): "=controls.elevator.delay" for c in CONTROLS[1:]}
    return with_entries(scenes.aircraft(), {("controls", "elevator", "delay"): own} | shared)


@pytest.fixture(scope="module")
def flight() -> Flight:
    """A maneuver whose commands are stamped before they act."""
    flown = scenes.simulate_flight(scenes.aircraft(), scenes.maneuvers()["pitch"], noise=True, name="pitch")
    n = round(DELAY * flown.rate)
    ahead = {c: ("time", np.append(flown.column(c)[n:], np.full(n, flown.column(c)[-1]))) for c in CONTROLS}
    return replace(flown, data=flown.data.assign(ahead))


def begun(flight: Flight) -> float:
    """Return a time at which the elevator has moved just before."""
    moved = np.abs(np.diff(flight.column("elevator"))) > 0.0
    return float(flight.time[np.flatnonzero(moved)[0] + round(0.5 * DELAY * flight.rate)])


def pieces(vehicle: Vehicle, flight: Flight, start: float) -> tuple[Piece, ...]:
    return prepare(vehicle, {flight.name: flight}, [Window(flight.name, start, scenes.DURATION)]).pieces


def test_a_window_receives_what_the_whole_record_does(vehicle: Vehicle, flight: Flight) -> None:
    rows = parameter_rows(vehicle)
    (whole,), (late,) = pieces(vehicle, flight, 0.0), pieces(vehicle, flight, begun(flight))
    first = len(whole.time) - len(late.time)
    expected = whole.received(vehicle, rows)[first:]
    assert late.received(vehicle, rows) == pytest.approx(expected, abs=1e-12)
    assert np.abs(replace(late, before=None).received(vehicle, rows) - expected).max() > 0.01
    part = whole.part(first, len(whole.time), late.start)
    assert part.received(vehicle, rows) == pytest.approx(expected, abs=1e-12)


def test_commands_are_known_back_to_a_hole(vehicle: Vehicle, flight: Flight) -> None:
    elevator = flight.column("elevator").copy()
    elevator[int(np.searchsorted(flight.time, 2.0)) - 7] = np.nan
    holed = replace(flight, data=flight.data.assign(elevator=("time", elevator)))
    given = ((flight, 2.0), (holed, 2.0), (flight, 0.0))
    shapes = [p.before.shape for f, start in given for p in pieces(vehicle, f, start) if p.before is not None]
    assert shapes == [(n, len(vehicle.recorded)) for n in (round(HISTORY * flight.rate), 6, 0)]


def test_a_fit_of_such_a_window_finds_the_truth(vehicle: Vehicle, flight: Flight) -> None:
    window, textbook = f"{begun(flight)}:{scenes.DURATION}", Strategy.named("textbook")
    done = search(vehicle, [flight], [window], strategy=textbook).estimate
    truth = scenes.aircraft()
    assert done.estimates["controls.elevator.delay"] == pytest.approx(DELAY, abs=0.005)
    assert done.estimates["Cmq"] == pytest.approx(truth.value("Cmq"), rel=0.1)
    again: Misfit = restored_problem(problem_document(done.problem), problem_arrays(done.problem))
    for kept, restored in zip(done.problem.pieces, again.pieces, strict=True):
        assert np.array_equal(np.asarray(kept.before), np.asarray(restored.before))
