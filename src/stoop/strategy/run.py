"""A fit by the decisions of a strategy."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from stoop.errors import IdentificationError
from stoop.estimate.fit import Options
from stoop.estimate.methods import DEFAULT as OUTPUT_ERROR
from stoop.flight import Flight
from stoop.problem.prepare import Prepared, decoupled
from stoop.problem.windows import Window
from stoop.results.decisions import DecisionRecord
from stoop.strategy.decision import Change, Fitted, Fitter, Setup, estimate, test
from stoop.strategy.gusts import GUSTS
from stoop.strategy.instability import INSTABILITY
from stoop.strategy.likelihood import against_start
from stoop.strategy.method import METHOD
from stoop.strategy.strategy import DECISIONS, Strategy
from stoop.vehicle import Vehicle

DEFAULTS = Options()
CHOICE = Strategy.textbook().only(METHOD.name, INSTABILITY.name, GUSTS.name)


def setup_of(
    strategy: Strategy,
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    fitted: Sequence[Window],
    held_back: Sequence[Window] = (),
    options: Options = DEFAULTS,
) -> Setup:
    """Return a fit before any decision."""
    if options.treatment != DEFAULTS.treatment:
        raise IdentificationError("treatment: a strategy decides it; switch decisions off with strategy=")
    known = replace(options, method=options.method or OUTPUT_ERROR, treatment=strategy.treatment)
    method = not options.method
    windows, choice = (tuple(fitted), tuple(held_back)), (strategy.names, strategy.left_out)
    return Setup(vehicle, flights, *windows, known, method, *choice)


def choose_method(
    name: str,
    vehicle: Vehicle,
    flights: Iterable[Flight],
    windows: Sequence[Window] = (),
    strategy: Strategy = CHOICE,
) -> Setup:
    """Return a fit by the method that a strategy takes for a vehicle and flights, where a name is given mostly that."""
    known = {one.name: one for one in flights}
    setup = setup_of(strategy, vehicle, known, windows, options=replace(DEFAULTS, method=name))
    for decision in strategy.decisions:
        if decision.name in CHOICE.names and decision.problem is not None:
            setup = _decided(setup, decision.name, decision.problem)
    return setup


def fit(
    strategy: Strategy,
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    fitted: Sequence[Window],
    held_back: Sequence[Window] = (),
    options: Options = DEFAULTS,
    callback: Callable[..., None] | None = None,
    state: Any = None,
    watch: Callable[[str], None] = lambda text: None,
) -> Fitted:
    """Fit the free numbers of a vehicle to windows of flights by the decisions of a strategy.

    Parameters
    ----------
    strategy : Strategy
    vehicle : Vehicle
    flights : mapping of str to Flight
    fitted, held_back : windows
        Those held back are not fitted; an extension is kept only if they do not speak against it.
    options : Options
        An empty method is chosen by the strategy: output error where it does not choose.
    callback, state
        As those of an estimator, see :mod:`stoop.estimate.methods`; of the first search.
    watch : callable
        Called with the name of each further fit.
    """
    setup = setup_of(strategy, vehicle, flights, fitted, held_back, options)
    for decision in strategy.decisions:
        if decision.data is not None:
            setup = _decided(setup, decision.name, decision.data)
    # so that the errors of windows come before the search
    coupled = strategy.treatment.recorded_motion
    here = decoupled(vehicle, setup.flights, held_back) if coupled else vehicle
    Prepared.of(here, setup.flights, held_back)
    setup = replace(setup, callback=callback, state=state, watch=watch)
    for decision in strategy.decisions:
        if decision.problem is not None:
            setup = _decided(setup, decision.name, decision.problem)
    fitter: Fitter = estimate
    for decision in strategy.decisions:
        if decision.around is not None:
            fitter = _enclosed(fitter, decision.around)
    found = fitter(setup)
    found = replace(found.noting(*found.setup.notices), decisions=_records(strategy, found))
    model = found.estimate.problem.layout.vehicle
    ahead = Prepared.of(model, found.setup.flights, held_back) if held_back and not model.measured else None
    return replace(found, estimate=against_start(found.estimate, ahead))


def with_tests(found: Fitted) -> Fitted:
    """Return a fit with its error bars and score tests; Ctrl-C meanwhile makes it one that was interrupted."""
    tested, cut = (found.tests, False) if found.tests else test(found.estimate, found.setup.left_out)
    found = replace(found, tests=tested)
    return found.interrupted("error bars were computed") if cut else found


def _enclosed(fitter: Fitter, around: Callable[[Setup, Fitter], Fitted]) -> Fitter:
    """Return a fitter with a decision around it."""
    return lambda setup: around(setup, fitter)


def _decided(setup: Setup, name: str, decide: Callable[[Setup], Change | None]) -> Setup:
    """Return the fit after a decision, with its record."""
    began = time.perf_counter()
    change, seconds = decide(setup), time.perf_counter() - began
    if change is None:
        return replace(setup, records={**setup.records, name: DecisionRecord(name, seconds=seconds)})
    figures = change.gained, change.held_back, seconds
    record = DecisionRecord(name, "applied", change.found, change.done, *figures)
    return replace(change.setup, records={**setup.records, name: record})


def _records(strategy: Strategy, found: Fitted) -> tuple[DecisionRecord, ...]:
    """Return a record for each decision of the table."""
    within = (*found.estimate.prepared.decisions, *found.estimate.decisions)
    known = {**found.setup.records, **found.records, **{one.name: one for one in within}}
    off = [one.name for one in DECISIONS if one.name not in strategy.names]
    known |= {name: DecisionRecord(name, "off") for name in off}
    return tuple(known.get(one.name, DecisionRecord(one.name)) for one in DECISIONS)
