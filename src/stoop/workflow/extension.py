"""Identification with extensions: what the score tests name is fitted, and kept where a held-back window says so.

Each round fits the strongest extension, and the ones that the data hardly tell from it, one at a time. The best of them is
kept if the log-likelihood rises by more than Schwarz's penalty and the window that is held back is predicted better.

References
----------
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
from stoop.base.notices import Notice, notice
from stoop.estimate import methods
from stoop.estimate.fit import Fit, Options
from stoop.estimate.initial_state import FittedModel
from stoop.estimate.noise import channel_residuals, noise_variance
from stoop.estimate.predict import identified_vehicle, mean_biases, predict
from stoop.flight import Flight
from stoop.problem import on_circle
from stoop.problem.windows import Window
from stoop.results.extensions import ExtensionTest
from stoop.results.result import Covariance, NoiseCovariance
from stoop.vehicle import Vehicle
from stoop.vehicle.document import with_entries
from stoop.vehicle.extensions import extended

MAX_ROUNDS: Final = 5
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
    fit: Fit
    bars: ErrorBars
    prediction: float  #: log-likelihood of the held-back windows under their prediction


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
    best, notices = _fit(vehicle, flights, fitted, held_back, options), list[Notice]()
    for _ in range(MAX_ROUNDS):
        found = extension_tests(best.fit, best.bars).found
        if not found:
            break
        known = {one.name: one for one in extended(best.vehicle)[1]}
        tests = {one.name: one for one in found}
        tried: list[tuple[ExtensionTest, Candidate, float]] = []
        for name in (found[0].name, *found[0].rivals[:MAX_RIVALS]):
            watch(f"extension: {name}")
            longer = with_entries(best.vehicle, known[name].free_entries(tests[name].change))
            candidate = _fit(longer, flights, fitted, held_back, options)
            tried.append((tests[name], candidate, _gain(best.fit, candidate.fit)))
        test, better, gain = max(tried, key=lambda one: one[2])
        ahead = better.prediction - best.prediction
        kept = gain > 0.0 and (ahead > 0.0 or not held_back)
        code = (
            "extension-refused" if not kept else "extension-kept" if held_back else "extension-kept-unchecked"
        )
        notices.append(notice(code, test.name, line=test.line, gain=gain, ahead=ahead))
        if not kept:
            break
        best = better
    return Extended(best.vehicle, tuple(notices))


def _fit(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    fitted: Sequence[Window],
    held_back: Sequence[Window],
    options: Options,
) -> Candidate:
    found = methods.find(options.method).fitter()(vehicle, flights, fitted, options, None, None)
    bars = error_bars(found)
    return Candidate(vehicle, found, bars, _predictive_score(found, bars, flights, held_back))


def _predictive_score(
    fit: Fit, bars: ErrorBars, flights: Mapping[str, Flight], windows: Sequence[Window]
) -> float:
    """Return the log-likelihood of the record of windows under their prediction; correlated errors count less."""
    problem, names = fit.problem, tuple(p.name for p in fit.problem.layout.parameters)
    outputs = problem.layout.vehicle.outputs
    variance = noise_variance(problem, channel_residuals(problem, fit.z))
    model = FittedModel(
        identified_vehicle(fit),
        Covariance(names, bars.covariance[: len(names), : len(names)]),
        NoiseCovariance(outputs, np.diag(variance), fit.inflation),
    )
    ahead = predict(model, flights, windows, [mean_biases(fit, window.flight) for window in windows])
    score = 0.0
    for piece, readings, deviation in zip(
        ahead.prepared.pieces, ahead.readings, ahead.deviations, strict=True
    ):
        standard = on_circle(piece.measured - readings, outputs) / deviation
        score -= float(np.nansum(standard**2 + 2.0 * np.log(deviation) + 0.0 * standard))
    return 0.5 * score / fit.inflation


def _gain(before: Fit, after: Fit) -> float:
    """Return the rise of the log-likelihood less Schwarz's penalty; correlated residuals count less."""
    deviances = []
    for fit in (before, after):
        residuals = np.concatenate(channel_residuals(fit.problem, fit.z))
        counts = np.isfinite(residuals).sum(axis=0) / before.inflation
        deviances.append(
            float(counts @ np.log(noise_variance(fit.problem, channel_residuals(fit.problem, fit.z))))
        )
    more = after.problem.dimension - before.problem.dimension
    return 0.5 * (deviances[0] - deviances[1]) - 0.5 * more * math.log(max(float(counts.sum()), 2.0))
