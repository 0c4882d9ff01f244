"""Identification with extensions: what the score tests name is fitted, and kept where a held-back window says so.

Each round fits the strongest extension that was not refused, and those that the data hardly distinguish from it, in turn. The
best of them is kept if the log-likelihood rises by more than Schwarz's penalty and the windows that are held back do not speak
against it: their log-likelihood under the prediction does not fall by more than two standard errors of the difference (Vuong).
What was refused is tried again once something else was added.

References
----------
Q. H. Vuong, "Likelihood ratio tests for model selection and non-nested hypotheses", *Econometrica* 57(2), 1989, pp. 307-333.
G. Schwarz, "Estimating the dimension of a model", *The Annals of Statistics* 6(2), 1978, pp. 461-464.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.assessment.error_bars import ErrorBars, error_bars
from stoop.assessment.extensions import extension_tests
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.errors import VehicleError
from stoop.estimate import methods
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import Options
from stoop.estimate.predict import expected_biases, predict, predictor
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.results.extensions import ExtensionTest
from stoop.vehicle import Vehicle
from stoop.vehicle.document import with_entries
from stoop.vehicle.extensions import Extension, catalogue

MAX_HALVINGS: Final = 4  #: of a change with which a vehicle is impossible
MAX_ROUNDS: Final = 8
CONFIDENCE: Final = (
    2.0  #: standard errors by which a held-back window must speak against an extension to refuse it
)
MAX_RIVALS: Final = 2  #: fitted beside the strongest extension of a round


@dataclass(frozen=True, eq=False)
class Extended:
    """A vehicle with the extensions that were kept, and what was tried."""

    vehicle: Vehicle
    notices: tuple[Notice, ...]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fit with its vehicle, and how well it does."""

    vehicle: Vehicle
    fit: Estimate
    bars: ErrorBars
    prediction: (
        FloatArray  #: (n,), log-likelihood of each sample of the held-back windows under their prediction
    )


def extend(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    fitted: Sequence[Window],
    held_back: Sequence[Window],
    options: Options,
    watch: Callable[[str], None],
) -> Extended:
    """Extend a vehicle by what the data ask for.

    Parameters
    ----------
    flights : mapping of str to Flight
        Without the held-back windows' faults, as the fit takes them.
    fitted, held_back : windows
        Where nothing is held back, the last of several fitted windows is, until the extensions are known.
    watch : callable
        Is told what is fitted.
    """
    if not held_back and len(fitted) > 1:
        *fitted, last = fitted
        held_back = [last]
    best = _fit(vehicle, flights, fitted, held_back, options)
    notices, missing = dict[str, Notice](), extension_tests(best.fit, best.bars).found
    for _ in range(MAX_ROUNDS):
        if not missing:
            break
        known = {one.name: one for one in catalogue(best.vehicle)}
        tests = {one.name: one for one in missing}
        tried: list[tuple[ExtensionTest, Candidate, float]] = []
        for name in (missing[0].name, *[n for n in missing[0].rivals if n in tests][:MAX_RIVALS]):
            watch(f"extension: {name}")
            longer = _freed(best.vehicle, known[name], tests[name].change)
            candidate = _fit(longer, flights, fitted, held_back, options)
            tried.append((tests[name], candidate, gain(best.fit, candidate.fit)))
        test, better, rise = max(tried, key=lambda one: one[2])
        color = best.fit.inflation  # one for both: so many samples say as much as one independent sample
        change = better.prediction - best.prediction
        ahead = float(np.sum(change)) / color
        spread = math.sqrt(float(np.sum((change - np.sum(change) / max(len(change), 1)) ** 2)) / color)
        kept = rise > 0.0 and (ahead > -CONFIDENCE * spread or not held_back)
        code = (
            "extension-refused" if not kept else "extension-kept" if held_back else "extension-kept-unchecked"
        )
        notices[test.name] = notice(code, test.name, line=test.line, gain=rise, ahead=ahead, spread=spread)
        if kept:  # what was refused beside another model may be right beside this one
            best, missing = better, extension_tests(better.fit, better.bars).found
        else:
            missing = tuple(one for one in missing if one.name not in {t.name for t, *_ in tried})
    return Extended(best.vehicle, tuple(notices.values()))


def _freed(vehicle: Vehicle, extension: Extension, change: float) -> Vehicle:
    """Return the vehicle with an extension free, begun where the linear test has it, or nearer where no vehicle can have that."""
    for _ in range(MAX_HALVINGS):
        try:
            return with_entries(vehicle, extension.free_entries(change))
        except VehicleError:  # an inertia of no body, say: the test overshoots
            change *= 0.5
    return with_entries(vehicle, extension.free_entries(change))


def _fit(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    fitted: Sequence[Window],
    held_back: Sequence[Window],
    options: Options,
) -> Candidate:
    found = methods.run(vehicle, flights, fitted, options)
    bars = error_bars(found)
    return Candidate(vehicle, found, bars, _predictive_score(found, bars, flights, held_back))


def _predictive_score(
    fit: Estimate, bars: ErrorBars, flights: Mapping[str, Flight], windows: Sequence[Window]
) -> FloatArray:
    """Return the log-likelihood (n,) of each sample of windows under their prediction."""
    if not windows:
        return np.empty(0)
    own_biases = [expected_biases(fit, window.flight) for window in windows]
    ahead = predict(predictor(fit, bars.covariance), flights, windows, own_biases)
    return ahead.log_likelihood(fit.problem.layout.vehicle.outputs)


def gain(before: Estimate, after: Estimate) -> float:
    """Return the rise of the log-likelihood less Schwarz's penalty; correlated residuals count less."""
    more, count = after.problem.dimension - before.problem.dimension, 0.0
    deviances = []
    for fit in (before, after):
        residuals = np.concatenate(fit.residuals)
        counts = np.isfinite(residuals).sum(axis=0) / before.inflation
        count = float(counts.sum())
        variance = np.nanmean(residuals[:, counts > 0.0] ** 2, axis=0)
        filtered = fit.outcome.optimizer == methods.SCORING  # a cost is twice minus the log-likelihood
        deviances.append(fit.cost if filtered else float(counts[counts > 0.0] @ np.log(variance)))
    return 0.5 * (deviances[0] - deviances[1]) - 0.5 * more * math.log(max(count, 2.0))
