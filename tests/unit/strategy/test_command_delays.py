"""Delays of commands up to half a second are found in the record; a file that gives one decides, and none is made up."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stoop.assessment.error_bars import error_bars
from stoop.estimate.fit import Options
from stoop.estimate.regression.command_delay import LONGEST, Scan, scan_delays
from stoop.flight import Flight
from stoop.problem.prepare import prepare
from stoop.problem.windows import Window
from stoop.strategy import Strategy
from stoop.strategy.command_delays import with_found_delays
from stoop.strategy.run import setup_of
from stoop.vehicle import Vehicle
from stoop.vehicle.document import with_entries
from stoop.workflow.identification import search
from stoop_studies.verify import scenes

CONTROLS = ("elevator", "aileron", "rudder")
NAMES = ("pitch", "roll")
NUMBER = "controls.elevator.delay"
WINDOWS = [Window(name, 0.0, scenes.DURATION) for name in NAMES]


@cache
def flown() -> tuple[Flight, ...]:
    fly, truth, maneuvers = scenes.simulate_flight, scenes.aircraft(), scenes.maneuvers()
    return tuple(fly(truth, maneuvers[n], noise=True, seed=seed, name=n) for seed, n in enumerate(NAMES))


def commanded_early(flight: Flight, seconds: float) -> Flight:
    """Return the flight with stamps of its commands so much before they act."""
    n = round(seconds * flight.rate)
    ahead = {c: ("time", np.append(flight.column(c)[n:], np.full(n, flight.column(c)[-1]))) for c in CONTROLS}
    return replace(flight, data=flight.data.assign(ahead))


def scanned(flights: list[Flight]) -> Scan | None:
    """Return the scan of delays of all controls in these flights."""
    vehicle = scenes.aircraft()
    pieces = prepare(vehicle, {one.name: one for one in flights}, WINDOWS).pieces
    return scan_delays(vehicle, pieces, [vehicle.inputs.index(c) for c in CONTROLS])


def best(flights: list[Flight]) -> float:
    """Return the delay that explains these flights best."""
    scan = scanned(flights)
    assert scan is not None
    assert scan.delays[-1] == pytest.approx(LONGEST)
    return float(scan.delays[np.argmax(scan.log_likelihood)])


def found(vehicle: Vehicle, seconds: float) -> dict[str, float]:
    flights = {one.name: commanded_early(one, seconds) for one in flown()}
    changed, notices = with_found_delays(setup_of(Strategy.default(), vehicle, flights, WINDOWS), vehicle)
    assert {n.subject for n in notices} == {n for n in changed.rows if n == NUMBER and n not in vehicle.rows}
    return {n.subject: float(str(n.values["delay"])) for n in notices}


@pytest.mark.parametrize("seconds", [0.0, 0.12, 0.46])
def test_the_scan_finds_the_sample(seconds: float) -> None:
    flights = [commanded_early(one, seconds) for one in flown()]
    assert best(flights) == pytest.approx(seconds, abs=0.5 / flown()[0].rate)


def test_a_delay_by_which_controls_turn_the_wrong_way_is_none() -> None:
    """Commands that answer a motion explain it at the delay of the answer, with the other sign."""
    early = [commanded_early(one, 0.3) for one in flown()]
    back = [replace(e, data=e.data.assign({c: ("time", -e.column(c)) for c in CONTROLS})) for e in early]
    scan = scanned(back)
    assert scan is not None
    there = int(np.argmin(np.abs(scan.delays - 0.3)))
    # no better than no control at all, which any delay may be
    assert scan.log_likelihood[there] == pytest.approx(scan.log_likelihood.min(), abs=1.0)


def test_a_delay_beyond_the_usual_is_found_and_none_is_made_up() -> None:
    assert found(scenes.aircraft(), 0.0) == {}
    assert found(scenes.aircraft(), 0.06) == {}  # the usual prior covers it
    assert found(scenes.aircraft(), 0.3) == {NUMBER: pytest.approx(0.3, abs=0.011)}


@pytest.mark.parametrize("entry", [0.0, {"value": 0.0, "free": True, "bounds": [0.0, 0.1]}])
def test_a_file_that_gives_a_delay_decides(entry: object) -> None:
    given = with_entries(scenes.aircraft(), {("controls", c, "delay"): entry for c in CONTROLS})
    flights = {one.name: commanded_early(one, 0.3) for one in flown()}
    changed, notices = with_found_delays(setup_of(Strategy.default(), given, flights, WINDOWS), given)
    assert changed is given
    assert not notices


def test_a_drafted_prior_of_a_delay_is_moved() -> None:
    """As stoop vehicle new writes it: usual of an autopilot and a logger, not of a radio link."""
    shared = "=controls.elevator.delay"
    first = {("controls", "elevator", "delay"): {"value": 0.02, "prior": 0.02}}
    others = {("controls", c, "delay"): shared for c in CONTROLS[1:]}
    drafted = with_entries(scenes.aircraft(), first | others)
    flights = [commanded_early(one, 0.4) for one in flown()]
    done = search(drafted, flights, [str(w) for w in WINDOWS], options=Options(seed=1))
    names = [p.name for p in done.estimate.problem.layout.parameters]
    std = error_bars(done.estimate).std[names.index(NUMBER)]
    assert std < 0.005
    assert abs(done.estimate.estimates[NUMBER] - 0.4) < 4.0 * std
    assert [n.code for n in done.estimate.notices].count("command-delay-found") == 1


def test_no_rates_no_scan() -> None:
    lost = {c: ("time", np.full(len(flown()[0].time), np.nan)) for c in "pqr"}
    assert scanned([replace(one, data=one.data.assign(lost)) for one in flown()]) is None


@pytest.mark.parametrize("lost", [0.06, 0.3])
def test_a_reading_that_one_maneuver_lacks_for_a_while(lost: float) -> None:
    first, second = (commanded_early(one, 0.3) for one in flown())
    alpha = second.column("alpha").copy()
    alpha[: round(lost * len(alpha))] = np.nan
    blind = replace(second, data=second.data.assign(alpha=("time", alpha)))
    assert best([first, blind]) == pytest.approx(0.3, abs=0.5 / first.rate)
