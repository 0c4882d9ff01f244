"""What a decision is: a question that a fit asks its data, and how the answer changes the fit.

A decision acts at up to three points. Before the search it changes the problem: data, vehicle or method. Within an estimator it
is a field of :class:`stoop.estimate.treatment.Treatment`. Around a fit it may ask for another one from what the first found.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np

from stoop.assessment.components import held_mass_properties
from stoop.assessment.error_bars import ErrorBars
from stoop.assessment.extensions import scored, tests_of
from stoop.assessment.model_error import model_error
from stoop.base.interrupts import deferred_interrupt
from stoop.base.notices import Notice, attempt, notice
from stoop.estimate import methods
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import Options
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.results.decisions import DecisionRecord
from stoop.results.extensions import ExtensionTests
from stoop.vehicle import Vehicle

Records: TypeAlias = Mapping[str, DecisionRecord]
SHOWN: Final = 5  #: numbers whose wider error bars are named
LEAST_WIDENED: Final = 1.1  #: times


@dataclass(frozen=True, eq=False)
class Setup:
    """A fit as the decisions so far have it."""

    vehicle: Vehicle
    flights: Mapping[str, Flight]
    fitted: Sequence[Window]
    held_back: Sequence[Window]
    #: their method is that of the fit
    options: Options
    #: whether the user named no method
    free_method: bool
    #: decisions that are switched on
    names: frozenset[str]
    #: components that the covariance does not hold
    left_out: frozenset[str] = frozenset()
    #: method where the filter does not explain the data as gusts; empty where none is modeled
    in_calm: str = ""
    notices: tuple[Notice, ...] = ()
    records: Records = field(default_factory=dict)
    callback: Callable[..., None] | None = None
    #: of an interrupted search, to resume
    state: Any = None
    #: called with the name of what is fitted
    watch: Callable[[str], None] = lambda text: None

    def by(self, method: str) -> Setup:
        """Return the fit by another method."""
        return replace(self, options=replace(self.options, method=method))

    def noting(self, *notices: Notice) -> Setup:
        """Return the fit with more notices."""
        return replace(self, notices=(*self.notices, *notices))

    def again(self, vehicle: Vehicle, known: Mapping[str, float]) -> Setup:
        """Return the fit of another vehicle, from known estimates (SI); what is saved, and resumed, is the first search."""
        options = replace(self.options, start=known)
        return replace(self, vehicle=vehicle, options=options, callback=None, state=None)


@dataclass(frozen=True, eq=False)
class Change:
    """What a decision found before the search, and the fit that it makes of it."""

    setup: Setup
    found: str
    done: str
    gained: float = float("nan")
    held_back: float = float("nan")

    def __post_init__(self) -> None:
        if not isinstance(self.setup, Setup):
            raise TypeError(f"a Change is one of a Setup, not of a {type(self.setup).__name__}")


@dataclass(frozen=True, eq=False)
class Tested:
    """Error bars of a fit, what its model lacks included, and the score tests of extensions of its model."""

    bars: ErrorBars
    tests: ExtensionTests
    #: by what error bars were widened, or why nothing was tested
    notices: tuple[Notice, ...] = ()


@dataclass(frozen=True)
class Provenance:
    """Where a fit comes from: hashes of its inputs by name, files, command line, `time.perf_counter` at its start."""

    inputs: Mapping[str, str] = field(default_factory=dict)
    files: tuple[Path, ...] = ()
    command: str = ""
    began: float = 0.0


@dataclass(frozen=True, eq=False)
class Fitted:
    """An estimate with the fit that it is of, and what is known of it."""

    setup: Setup
    estimate: Estimate
    #: of decisions around the fit
    records: Records = field(default_factory=dict)
    #: None until something asks for it
    tests: Tested | None = None
    #: one record for each decision of the table, once the fit is finished
    decisions: tuple[DecisionRecord, ...] = ()
    provenance: Provenance = field(default_factory=Provenance)

    @cached_property
    def tested(self) -> Tested:
        """Error bars, and score tests of extensions of the model."""
        tested, cut = (self.tests, False) if self.tests else test(self.estimate, self.setup.left_out)
        if cut:
            self.__dict__["tested"] = tested  # the next reader finds them
            raise KeyboardInterrupt
        return tested

    @property
    def flights(self) -> Mapping[str, Flight]:
        """As they were fitted."""
        return self.setup.flights

    @property
    def options(self) -> Options:
        """With the method that was used."""
        return self.setup.options

    def recorded(self, record: DecisionRecord) -> Fitted:
        """Return the estimate with one more record."""
        return replace(self, records={**self.records, record.name: record})

    def noting(self, *notices: Notice) -> Fitted:
        """Return the estimate with more notices, before its own."""
        return replace(self, estimate=replace(self.estimate, notices=(*notices, *self.estimate.notices)))

    def again(self, vehicle: Vehicle, fit: Fitter) -> Fitted:
        """Return the fit of another vehicle by the decisions that this one took: a method that failed is not tried again."""
        found = fit(self.setup.again(vehicle, self.estimate.start))
        return replace(found, records={**self.records, **found.records})

    def resuming(self, first: Fitted) -> Fitted:
        """Return the estimate with the state of a first search, which is the one that is saved and resumed."""
        outcome = replace(self.estimate.outcome, state=first.estimate.outcome.state)
        return replace(self, estimate=replace(self.estimate, outcome=outcome))

    def interrupted(self, doing: str) -> Fitted:
        """Return the estimate as that of a fit that the user stopped while it did something."""
        advice = f"stopped by the user while {doing}"
        outcome = replace(self.estimate.outcome, status="interrupted", advice=advice)
        return replace(self, estimate=replace(self.estimate, outcome=outcome))


def test(found: Estimate, left_out: Collection[str]) -> tuple[Tested, bool]:
    """Return error bars and score tests of a fit, and whether Ctrl-C came meanwhile: a search that has ended is not lost.

    The covariance does not hold the components that are `left_out`.
    """
    with deferred_interrupt() as ctrl_c:
        notices, bars = list[Notice](), ErrorBars.of(found).without(left_out)
        tests, known = ExtensionTests(), attempt(notices, None, scored, found, bars)
        if known is not None:
            nothing = np.zeros((len(bars.free),) * 2)
            shifts = attempt(notices, nothing, model_error, known, held_mass_properties(found))
            given, bars = bars, bars.with_model_error(shifts).without(left_out)
            tests = attempt(notices, tests, tests_of, known, found, bars)
            notices += _widened(found, given, bars)
    return Tested(bars, tests, tuple(notices)), ctrl_c.came


def _widened(found: Estimate, narrow: ErrorBars, bars: ErrorBars) -> list[Notice]:
    """Return a notice of the error bars that what the model lacks widens most."""
    names = [p.name for p in found.problem.layout.parameters]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.nan_to_num((bars.std / narrow.std)[: len(names)])
    most = [i for i in np.argsort(-ratios, kind="stable")[:SHOWN].tolist() if ratios[i] > LEAST_WIDENED]
    shown = tuple(f"{names[i]} {ratios[i]:.1f}" for i in most)
    return [notice("bars-widened", median=float(np.median(ratios[ratios > 0.0])), most=shown)] if most else []


Fitter: TypeAlias = Callable[[Setup], Fitted]


@dataclass(frozen=True)
class Decision:
    """A decision that a fit takes by itself; `default` says whether it does so unless it is switched off."""

    name: str
    question: str
    default: bool = True
    #: changes the data before the fit; None where nothing was found
    data: Callable[[Setup], Change | None] | None = None
    #: likewise the problem
    problem: Callable[[Setup], Change | None] | None = None
    #: field of :class:`stoop.estimate.treatment.Treatment`, by which an estimator takes the decision and records it
    treatment: str = ""
    #: fits, by a fitter that takes the decisions before this one, and may do so again
    around: Callable[[Setup, Fitter], Fitted] | None = None


def estimate(setup: Setup) -> Fitted:
    """Return the estimate by the method of a fit, with no decision around it; where it began is of no further use."""
    fitter = methods.find(setup.options.method).fitter()
    given = (setup.vehicle, setup.flights, setup.fitted, setup.options, setup.callback, setup.state)
    return Fitted(replace(setup, options=replace(setup.options, start={})), fitter(*given))
