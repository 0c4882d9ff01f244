"""Extensions of the model that the score tests name are fitted, and kept where held-back windows do not speak against them.

Each round fits the strongest extension that was not refused, and those that the data hardly distinguish from it, in turn. The
best of them is kept if the log-likelihood rises by more than Schwarz's penalty and the windows that are held back do not speak
against it: their log-likelihood under the prediction does not fall by more than two standard errors of the difference (Vuong).
What was refused is tried again once something else was added. Gusts and delays of sensors are decided later.

References
----------
Q. H. Vuong, "Likelihood ratio tests for model selection and non-nested hypotheses", *Econometrica* 57(2), 1989, pp. 307-333.
G. Schwarz, "Estimating the dimension of a model", *The Annals of Statistics* 6(2), 1978, pp. 461-464.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from stoop.assessment.error_bars import ErrorBars
from stoop.assessment.extensions import extension_tests
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.errors import IdentificationError, VehicleError
from stoop.estimate.estimate import Estimate
from stoop.estimate.gusts import with_turbulence
from stoop.prediction.predict import expected_biases, predict, predictor
from stoop.results.extensions import ExtensionTest
from stoop.strategy import bounds
from stoop.strategy.decision import Change, Decision, Fitted, Fitter, Setup, estimate
from stoop.strategy.gusts import fit_in_gusts
from stoop.strategy.likelihood import log_likelihood_rise, penalized_rise
from stoop.vehicle import Vehicle
from stoop.vehicle.document import with_entries
from stoop.vehicle.extensions import Extension, catalogue

#: of a change with which a vehicle is impossible
MAX_HALVINGS: Final = 4
MAX_ROUNDS: Final = 8
#: standard errors by which a held-back window must speak against an extension to refuse it
CONFIDENCE: Final = 2.0
#: fitted beside the strongest extension of a round
MAX_RIVALS: Final = 2


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fit with its vehicle, and the log-likelihood (n,) of each held-back sample under its prediction."""

    vehicle: Vehicle
    fit: Estimate
    bars: ErrorBars
    prediction: FloatArray


@dataclass(frozen=True, eq=False)
class Trial:
    """An extension that was fitted, beside the best model so far."""

    test: ExtensionTest
    candidate: Candidate
    #: of the log-likelihood, beyond the penalty; of the held-back windows, with its standard error
    rise: float
    ahead: float
    spread: float

    @classmethod
    def of(cls, test: ExtensionTest, candidate: Candidate, best: Candidate) -> Trial:
        """Return a candidate compared with the best model so far."""
        color = best.fit.correlation_time  # one for both
        change = candidate.prediction - best.prediction
        ahead = float(np.sum(change)) / color
        spread = math.sqrt(float(np.sum((change - np.sum(change) / max(len(change), 1)) ** 2)) / color)
        return cls(test, candidate, penalized_rise(best.fit, candidate.fit), ahead, spread)

    def decided(self, held_back: bool) -> Notice:
        """Return whether the extension is kept: notice ``extension-kept``, ``-kept-unchecked`` or ``-refused``."""
        kept = self.rise > 0.0 and (self.ahead > -CONFIDENCE * self.spread or not held_back)
        code = "extension-kept" if held_back else "extension-kept-unchecked"
        figures = {"gain": self.rise, "ahead": self.ahead, "spread": self.spread}
        return notice(code if kept else "extension-refused", self.test.name, line=self.test.line, **figures)


def extend(setup: Setup) -> Change | None:
    """Return the fit of a vehicle extended by what the data ask for.

    Where nothing is held back, the last of several fitted windows is, until the extensions are known.
    """
    trial = replace(setup, callback=None, state=None)
    if not setup.held_back and len(setup.fitted) > 1:
        trial = replace(trial, fitted=setup.fitted[:-1], held_back=setup.fitted[-1:])
    if trial.in_calm:  # whether gusts explain the residuals is decided once, for all candidates
        found = fit_in_gusts(trial, _fitter(trial))
        trial = replace(trial, in_calm=found.setup.in_calm, options=found.setup.options)
        first = best = _candidate(found, setup.vehicle)
    else:
        first = best = _fit(trial, setup.vehicle)
    notices, missing = dict[str, Notice](), extension_tests(best.fit, best.bars).found
    for _ in range(MAX_ROUNDS):
        if not missing:
            break
        tried = _tried(trial, best, missing)
        if not tried:
            missing = missing[1:]
            continue
        strongest = max(tried, key=lambda one: one.rise)
        notices[strongest.test.name] = decided = strongest.decided(bool(trial.held_back))
        # what was refused beside another model may be right beside this one
        if decided.code != "extension-refused":
            best = strongest.candidate
            missing = extension_tests(best.fit, best.bars).found
        else:
            missing = tuple(one for one in missing if one.name not in {t.test.name for t in tried})
    if not notices:
        return None
    kept = [n for n, one in notices.items() if one.code != "extension-refused"]
    done = f"{', '.join(kept)} added" if kept else "nothing added"
    ahead = float(np.sum(best.prediction - first.prediction)) / first.fit.correlation_time
    return Change(
        replace(setup, vehicle=best.vehicle).noting(*notices.values()),
        f"score tests ask for {', '.join(notices)}",
        done,
        log_likelihood_rise(first.fit, best.fit)[0] if kept else math.nan,
        ahead if kept and trial.held_back else math.nan,
    )


def _tried(setup: Setup, best: Candidate, missing: Sequence[ExtensionTest]) -> list[Trial]:
    """Return fits of the strongest extension and of its rivals, but for those that the method refuses."""
    known, tests = {one.name: one for one in catalogue(best.vehicle)}, {one.name: one for one in missing}
    tried = []
    for name in (missing[0].name, *[n for n in missing[0].rivals if n in tests][:MAX_RIVALS]):
        setup.watch(f"extension: {name}")
        longer = _freed(best.vehicle, known[name], tests[name].change)
        with suppress(IdentificationError):  # a filter needs delays that are known
            tried.append(Trial.of(tests[name], _fit(setup, longer), best))
    return tried


def _freed(vehicle: Vehicle, extension: Extension, change: float) -> Vehicle:
    """Return the vehicle with an extension free, begun where the linear test has it, or nearer where no vehicle can have that."""
    for _ in range(MAX_HALVINGS):
        try:
            return with_entries(vehicle, extension.free_entries(change))
        except VehicleError:  # an inertia of no body, say: the test overshoots
            change *= 0.5
    return with_entries(vehicle, extension.free_entries(change))


def _fitter(setup: Setup) -> Fitter:
    return partial(bounds.widen, fit=estimate) if bounds.NAME in setup.names else estimate


def _fit(setup: Setup, vehicle: Vehicle) -> Candidate:
    """Return the fit of a vehicle; by a filter with gusts among the unknowns, which the vehicle itself does not get."""
    flown = with_turbulence(vehicle) if setup.in_calm else vehicle
    return _candidate(_fitter(setup)(replace(setup, vehicle=flown)), vehicle)


def _candidate(found: Fitted, vehicle: Vehicle) -> Candidate:
    """Return a fit of a vehicle with the log-likelihood of each held-back sample under its prediction."""
    setup, fit = found.setup, found.estimate
    if fit.outcome.status == "interrupted":
        raise KeyboardInterrupt  # half a search is no trial
    bars = ErrorBars.of(fit)
    if not setup.held_back:
        return Candidate(vehicle, fit, bars, np.empty(0))
    own_biases = [expected_biases(fit, window.flight) for window in setup.held_back]
    model = predictor(fit, bars.covariance, setup.options.treatment.recorded_motion)
    ahead = predict(model, setup.flights, setup.held_back, own_biases)
    return Candidate(vehicle, fit, bars, ahead.log_likelihood(fit.problem.layout.vehicle.outputs))


EXTENSIONS = Decision(
    "extensions", "What do the data ask for that the model lacks?", default=False, problem=extend
)
